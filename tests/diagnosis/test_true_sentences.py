"""Summaries of diagnoses, on made and on measured logs, held sentence by sentence to the truth."""

from dataclasses import replace

import claims
import numpy as np
import pytest
from reference import measured_runs
from reference import whole_runs as wr
from shared_data import data_folder

import diffthrust as dft

THRUSTER = {"alpha": 0.037, "beta": 42.0, "ct": 0.019, "nominal": 16.0}
UNITS = {"command": "V", "speed": "rad/s", "thrust": "N"}


def thruster(seed, system=None, **hidden):
    """Three logs of a thruster, the last unseen, and what is true of them."""
    system = system or wr.yoerger(deadband="band" in hidden)
    truth, noise = {**THRUSTER, **hidden}, {"speed": 0.3, "thrust": 0.3}
    time = 0.05 * np.arange(500)
    rng = np.random.default_rng(seed)
    commands = [np.repeat(rng.uniform(-2.0, 2.0, 25), 20) for _ in range(3)]
    runs = [wr.Run(time, {"command": c}, {}, {"speed": 0.0}) for c in commands]
    return _recorded(rng, system, runs, truth, noise, UNITS)


def boat(seed):
    """Speeds and heading of a boat with quadratic drag in a current."""
    system = wr.twin_boat(drag=("surge",), current=True)
    truth = {n: r.start for n, r in system.parameters.items()}
    truth |= {"m22": 28.0, "d11": 8.0, "q_surge": 20.0, "to_north": 0.15, "to_east": -0.1}
    noise = {"surge": 0.01, "sway": 0.01, "yaw_rate": 0.01, "heading": 0.01}
    rng = np.random.default_rng(seed)
    runs = []
    for _ in range(3):
        mean, turn = (np.repeat(rng.uniform(*ends, 20), 20) for ends in ((3, 30), (-4, 4)))
        inputs = {"left_force": mean + turn, "right_force": mean - turn}
        runs.append(wr.Run(0.2 * np.arange(400), inputs, {}, dict.fromkeys(system.states, 0.0)))
    units = {"left_force": "N", "right_force": "N", "surge": "m/s", "sway": "m/s"}
    return _recorded(
        rng, system, runs, truth, noise, {**units, "yaw_rate": "rad/s", "heading": "rad"}
    )


def _recorded(rng, system, runs, truth, noise, units):
    logs, kept = [], []
    for k, (run, out) in enumerate(zip(runs, wr.simulate(system, runs, truth), strict=True)):
        measured = {
            c: out[c] + size * rng.standard_normal(len(run.time)) for c, size in noise.items()
        }
        kept.append(wr.Run(run.time, run.inputs, measured, {}, f"log {k + 1}"))
        logs.append(dft.Log(run.time, run.inputs, measured, units=units, name=f"log {k + 1}"))
    page = claims.Page(kept[:2], kept[2:], true=system, truth=truth, noise=noise)
    return logs[:2], logs[2:], page


def dead_band():
    train, unseen, page = thruster(1, band=0.4)
    page.hidden = frozenset({"command_deadband"})
    return dft.Thruster(), train, unseen, page


def nothing():
    train, unseen, page = thruster(2)
    page.hidden = frozenset()
    return dft.Thruster(), train, unseen, page


def outside():
    """A hump of the load at some speed, which no effect of the catalogue has."""
    base = wr.yoerger()

    def rates(x, u, p):
        hump = 30.0 * np.sign(x["speed"]) * np.exp(-(((np.abs(x["speed"]) - 25.0) / 5.0) ** 2))
        return {"speed": base.rates(x, u, p)["speed"] - hump}

    train, unseen, page = thruster(3, wr.replace(base, rates=rates))
    page.hidden, page.law = frozenset(), ("load, shaft, drive", "speed")
    return dft.Thruster(), train, unseen, page


def vessel():
    train, unseen, page = boat(4)
    page.hidden = frozenset({"quadratic_surge_drag", "water_current"})
    model = dft.Vessel(drive="twin", lever_arm=0.285).replace(
        m11=20.0, m22=20.0, i33=1.7, d11=30.0, d22=30.0, d33=5.0
    )
    return model, train, unseen, page


MADE = {made.__name__: made for made in (dead_band, nothing, outside, vessel)}
QUICK = {
    "dead_band": ["command_deadband", "linear_damping", "thrust_sensor_lag"],
    "nothing": ["linear_damping"],
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", QUICK)
def test_few_candidates(name):
    model, train, unseen, page = MADE[name]()
    diag = dft.diagnose(model, train, holdout=unseen, candidates=QUICK[name], experiment=False)
    assert page.quiet
    assert bool(diag.added) == bool(page.hidden)
    assert claims.contradictions(diag, page) == []


@pytest.mark.slow
@pytest.mark.parametrize("name", MADE)
def test_made(name):
    model, train, unseen, page = MADE[name]()
    diag = dft.diagnose(model, train, holdout=unseen, experiment=False)
    assert claims.contradictions(diag, page) == []


def turned():
    """The thruster with a dead band, with a load cell that counts the other way."""
    model, train, unseen, page = dead_band()

    def reread(measured):
        return {**measured, "thrust": -measured["thrust"]}

    train, unseen = (
        [log.replaced(measured=reread(log.measured)) for log in logs] for logs in (train, unseen)
    )
    page.train, page.unseen = (
        [wr.replace(run, measured=reread(run.measured)) for run in runs]
        for runs in (page.train, page.unseen)
    )
    page.mistaken = True
    return model, train, unseen, page


@pytest.mark.thorough
def test_nothing_is_sought_in_logs_that_are_to_be_mended_first():
    """Half an hour of search on a BlueBoat ended in thrusters that steer with -0 %."""
    model, train, unseen, page = turned()
    diag = dft.diagnose(model, train, holdout=unseen, experiment=False)
    assert not diag.sought
    assert (diag.verdict, diag.added, diag.ranking, diag.laws) == ("unexplained", (), (), ())
    first, *_ = diag.summary.splitlines()
    assert first.startswith("First mend the logs, then diagnose again: with the sign of thrust rev")
    assert claims.contradictions(diag, page) == []
    assert "No effect was sought in logs that are to be mended first." in " ".join(
        diag.report().split()
    )
    assert diag.to_json()["sought"] is False
    assert "say nothing" not in diag.details
    for status, why in {
        "NOT_CONVERGED": "its fit to these logs did not converge",  # as a Kingfisher's
        "STARTS_DISAGREE": "its fit to these logs depends on where it starts",
        "NOT_IDENTIFIABLE": "these logs do not tell all its parameters apart",
    }.items():
        lost = replace(diag.fit, status=dft.estimation.Status[status])
        unended = replace(diag, stages=(replace(diag.stages[0], fit=lost),))
        said = f"The errors of the model as given say nothing: {why}."
        assert unended.details.endswith(said)
        assert claims.contradictions(diag, page, text=said) != []
        assert claims.contradictions(unended) == []
    named = dft.diagnose(
        model, train, holdout=unseen, candidates=["linear_damping"], experiment=False
    )
    assert named.sought


def emps():
    folder = data_folder("emps")
    logs = [
        dft.read_log(
            folder / f"{name}.csv",
            time="time_exp",
            inputs={"thrust": dft.Column("u_in", "N", scale=35.15, hold="linear")},
            measured={
                "position": dft.Column("q_meas", "m", scale=0.125),
                "velocity": dft.Column("v_est", "m/s", scale=0.125),
            },
        )
        for name in ("DATA_EMPS_SC", "DATA_EMPS_PULSES_SC")
    ]
    return dft.AxisVehicle(), logs[:1], logs[1:], claims.Page(*measured_runs.emps())


def blueboat():
    data_folder("blueboat")
    runs = dft.datasets.blueboat()
    train, unseen = ([log.averaged(5) for log in logs] for logs in (runs.train, runs.unseen))
    model = dft.Vessel(drive="twin", lever_arm=0.285).replace(
        m11={"value": 20.0, "bounds": (15.0, None)},
        m22={"value": 20.0, "bounds": (15.0, None)},
        i33={"value": 1.7, "fixed": True},
        d11=30.0,
        d22=30.0,
        d33=5.0,
    )
    plain = (
        measured_runs.blueboat(numbers, 5)
        for numbers in (measured_runs.BLUEBOAT_TRAIN, measured_runs.BLUEBOAT_UNSEEN)
    )
    return model, train, unseen, claims.Page(*plain, starts=4)


@pytest.mark.slow
@pytest.mark.parametrize("measured", [emps, blueboat])
def test_measured(measured):
    model, train, unseen, page = measured()
    diag = dft.diagnose(model, train, holdout=unseen, experiment=False)
    assert claims.contradictions(diag, page) == []

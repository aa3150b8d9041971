"""Fits: recovery, coverage, honest statuses, units, several logs, segments."""

from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest
from hidden import sets
from problems import build, examine, multistart_module, optimum_module, restarts, solve
from reference import inputs, noise, thruster, vessel
from short_logs import TwiceTheSame
from steps import Clock, Refit, bind

import diffthrust as dft
from diffthrust.simulation import CoarseStepWarning

TRUE = {"alpha": 0.037, "beta": 42.0, "ct": 0.02}
ERROR_KEYS = {"rmse", "nrmse", "fit_percent", "samples", "unit", "written"}


def record(seed=0, duration=30.0, step=0.05, speed=0.3, thrust=0.5, unsigned=False, **hidden):
    rng = np.random.default_rng(seed)
    time = inputs.grid(duration, step)
    command = inputs.low_passed_random(time, 1.5, rng)
    made = thruster.simulate(time, command, **TRUE, method="rk4", **hidden)
    sensor = noise.Sensor(std=speed, unsigned=unsigned)
    return noise.measure(made, rng, speed=sensor, thrust=noise.Sensor(std=thrust))


def log_of(made, **changed):
    """The log of a record; with other inputs or measurements where these are given."""
    fields = {"time": made.time, "inputs": dict(made.inputs), "measured": dict(made.measured)}
    return dft.Log(**{**fields, **changed})


def test_recovers_the_truth_from_a_poor_guess_within_its_errors():
    log = log_of(record())
    fit = dft.fit(dft.Thruster(alpha=0.2, beta=10.0, ct=0.1), log)
    assert fit.status is dft.estimation.Status.CONVERGED
    for name, true in TRUE.items():
        estimate = fit.parameters[name]
        assert abs(estimate.value - true) < 4 * estimate.std_error
        assert estimate.std_error < 0.01 * true
    assert fit.noise["speed"] == pytest.approx(0.3, rel=0.1)
    assert fit.noise["thrust"] == pytest.approx(0.5, rel=0.1)


def test_noise_free_data_give_the_truth_to_the_integrators_accuracy():
    made = record(speed=0.0, thrust=0.0)
    fit = dft.fit(dft.Thruster(alpha=0.06, beta=30.0, ct=0.01), log_of(made), substeps=4)
    for name, true in TRUE.items():
        assert fit.parameters[name].value == pytest.approx(true, rel=1e-5)
    assert fit.train.nrmse < 1e-5


@pytest.fixture
def begun(monkeypatch):
    """The searches that are begun, with their arguments."""
    begun, once = [], optimum_module._searched
    monkeypatch.setattr(optimum_module, "_searched", lambda *a: begun.append(a) or once(*a))
    return begun


@pytest.mark.parametrize("followed", [True, False])
def test_finer_steps_follow_the_optimum_unless_they_lead_to_another(monkeypatch, begun, followed):
    log = log_of(record(step=0.3, duration=60.0))
    if not followed:
        monkeypatch.setattr(multistart_module.Search, "improves_on", lambda *a: True)
    fit = dft.fit(dft.Thruster(), log, starts=3)
    assert fit.substeps > 1
    assert len(begun) == (1 if followed else 2)
    given = dft.fit(dft.Thruster(), log, starts=3, substeps=fit.substeps)
    assert fit.log_likelihood == pytest.approx(given.log_likelihood, abs=1e-4)
    for name, estimate in given.parameters.items():
        assert abs(fit.parameters[name].value - estimate.value) < 0.01 * estimate.std_error


@pytest.mark.parametrize(("first", "steps"), [(1, 2), (2, 2), (3, 3)])
def test_a_refit_goes_on_to_the_finer_steps_that_its_optimum_needs(begun, first, steps):
    # a diagnosis searched with the steps of its first fit, again with one, and then followed that
    log = log_of(record(step=0.3, duration=60.0))
    model = dft.Thruster()
    refit = Refit(bind(model, [log]), (), {"seed": 0}, Clock(), first_substeps=first)
    fit = refit(model, starts=3).fit
    assert [substeps for _, _, substeps, _ in begun] == [first]
    assert fit.substeps == steps
    given = dft.fit(dft.Thruster(), log, starts=3, substeps=fit.substeps)
    assert fit.log_likelihood == pytest.approx(given.log_likelihood, abs=1e-4)


def test_a_status_that_is_well_says_where_the_steps_are_too_coarse():
    """Of a BlueBoat "converged" was all that it said, with 8 steps a sample for 16."""
    log = log_of(record(step=0.3, duration=60.0))
    with pytest.warns(CoarseStepWarning):
        fit = dft.fit(dft.Thruster(), log, starts=2, substeps=1)
    assert fit.status.ok
    assert fit.coarse
    assert "too coarse a simulation, with 1 of " in fit.message
    assert "too coarse" not in dft.fit(dft.Thruster(), log, starts=2).message


class Follower(dft.Model):
    """A speed that follows its command, too fast for steps of a tenth of a second."""

    name = "follower"
    inputs: ClassVar[dict] = {"command": "m/s"}
    states: ClassVar[dict] = {"level": "m/s"}
    outputs: ClassVar[dict] = {"level": "m/s"}
    rate: float = dft.parameter(10.0, "1/s", bounds=(1.0, 400.0))

    def equations(self, s, port):
        """The rate of the level, and what is measured of it."""
        return {"level": self.rate * (s.command - s.level)}, {"level": s.level}


def followed(rate, every=0):
    """Its log under held commands, by the closed form; with spikes where ``every`` says."""
    rng, step, count = np.random.default_rng(4), 0.1, 300
    command = np.repeat(rng.uniform(-1.0, 1.0, count // 5), 5)
    level, keep = np.zeros(count), np.exp(-rate * step)
    for k in range(count - 1):
        level[k + 1] = keep * level[k] + (1.0 - keep) * command[k]
    level += 0.002 * rng.standard_normal(count)
    if every:
        level[::every] += 0.3
    return dft.Log(step * np.arange(count), {"command": command}, {"level": level}, hold="zero")


@pytest.mark.thorough
@pytest.mark.parametrize("every", [0, 37])
def test_finer_steps_of_an_innovations_fit_have_limits_of_their_own(every):
    options = {"likelihood": "innovations", "loss": "student_t", "starts": 2}
    fit = dft.fit(Follower(), followed(18.0, every), **options)
    assert fit.substeps > 1
    given = dft.fit(Follower(), followed(18.0, every), substeps=fit.substeps, **options)
    assert fit.log_likelihood == pytest.approx(given.log_likelihood, abs=0.1)
    assert fit.limits["level"] == pytest.approx(given.limits["level"], rel=0.05)


def test_where_coarse_steps_forbid_most_starts_finer_ones_begin_anew():
    """A step of 0.1 s is stable up to a rate of 28 per second, and most starts lie above."""
    fit = dft.fit(Follower(rate=200.0), followed(24.0), starts=4)
    assert fit.substeps > 1
    assert fit.status is dft.estimation.Status.CONVERGED
    assert fit.checks.starts_agreeing >= 2


@pytest.mark.thorough
def test_an_optimum_that_only_coarse_steps_have_gives_way_to_one_that_finer_steps_uphold():
    """At the edge of a scheme's stability a boat had an inertia of 0.013 kg m^2 for 0.86."""
    boat = sets.draw("field-vessel/rudder_inflow", 9303000)
    fit = dft.fit(boat.model, boat.train, holdout=boat.unseen)
    fine = dft.fit(boat.model, boat.train, starts=1, substeps=8)
    assert fit.substeps == 1
    assert fit.coarse == ()
    assert not any("too coarse" in note for note in fit.notes)
    assert sum("only coarse integrator steps have it" in note for note in fit.notes) == 1
    for name, estimate in fine.parameters.items():
        assert fit.parameters[name].value == pytest.approx(estimate.value, rel=1e-3)
    assert fit.holdout.nrmse < 0.25  # 0.43 with that inertia


@pytest.mark.parametrize(("slides", "left"), [(False, [0.9]), (True, None)])
def test_what_finer_steps_uphold_is_looked_at_again_where_it_ends(monkeypatch, slides, left):
    """A start that was given up may slide to the edge of the steps that it goes on with."""
    costs = {"coarse": {0.013: 100.0, 0.9: 200.0}, "finer": {0.013: 2500.0, 0.9: 200.0}}

    def at(problem, z):
        quadratic = SimpleNamespace(cost=costs[problem][z])
        return SimpleNamespace(z=z, quadratic=quadratic, cost=quadratic.cost, steps=1)

    def solve(problem, z, budget=None):
        return at(problem, 0.013 if slides and budget is None else z)

    monkeypatch.setattr(multistart_module, "solve", solve)
    search = multistart_module.Search(
        "coarse", ((at("coarse", 0.013), 1), (at("coarse", 0.9), 4)), 8
    )
    upheld = search.upheld("finer")
    assert (upheld and [solved.z for solved, _ in upheld.optima]) == left
    assert upheld is None or upheld.problem == "coarse"  # these are its optima


@pytest.mark.thorough
def test_an_optimum_is_followed_as_far_as_coarse_steps_hold_it_back():
    """Where the water follows the propeller at once, coarse steps end at a small loss of thrust.

    On the bench of the NGS a loss of 2.8 +- 0.1 was told, where finer steps lead to 16.
    """
    flow = {"loss": 16.0, "mass": 2.23}
    logs = []
    for seed in (1, 2):
        rng, time = np.random.default_rng(seed), inputs.grid(8.0, 0.04)
        command = 3.0 * np.sin(0.5 * np.pi * (1.0 + 0.3 * seed) * time)
        true = {"alpha": 0.0, "beta": 722.0, "ct": 0.157, "linear_damping": 14.1}
        made = thruster.simulate(time, command, axial_flow=flow, method="rk4", substeps=64, **true)
        logs.append(
            log_of(noise.measure(made, rng, speed=noise.Sensor(0.5), thrust=noise.Sensor(0.3)))
        )
    model = dft.Thruster(alpha=1e-9, beta=700.0, ct=0.002) + "linear_damping" + "axial_flow"
    begin = {"linear_damping.rate": 12.0, "axial_flow.loss": 0.3, "axial_flow.mass": 3.0}
    fit = dft.fit(model.fix("alpha").replace(begin), logs, starts=1, doubts=False)
    assert fit.coarse == ()
    for name, true in flow.items():
        estimate = fit.parameters[f"axial_flow.{name}"]
        assert abs(estimate.value - true) < 4 * estimate.std_error
        assert estimate.std_error < 0.05 * true


def test_guesses_are_counted_once():
    fit = dft.fit(Follower(), followed(18.0), starts=1, guesses=[{"rate": 12.0}, {"rate": 14.0}])
    assert fit.substeps > 1
    assert fit.checks.starts_agreeing <= fit.checks.starts == 3


@pytest.mark.slow
def test_standard_errors_cover_the_truth():
    """100 repetitions, three parameters: 95 % intervals must cover 90 to 99 % of 300.

    With independent intervals of 95 %, fewer than 270 or more than 297 of 300 come with
    probability below 2e-3 (binomial).
    """
    covered = 0
    model = dft.Thruster(**TRUE)
    for seed in range(100):
        fit = dft.fit(model, log_of(record(seed=seed, duration=15.0)), starts=1)
        for name, true in TRUE.items():
            estimate = fit.parameters[name]
            covered += abs(estimate.value - true) < 1.96 * estimate.std_error
    assert 270 <= covered <= 297


@pytest.mark.parametrize("name", ["actuator_lag", "command_deadband", "reverse_thrust_asymmetry"])
def test_each_effect_is_recovered_from_the_reference(name):
    size, parameter = {
        "actuator_lag": (0.12, "time_constant"),
        "command_deadband": (0.25, "half_width"),
        "reverse_thrust_asymmetry": (-0.2, "change"),
    }[name]
    made = record(seed=3, **{name: size})
    effect = dft.effects.EFFECTS[name]()
    plain = dft.fit(dft.Thruster(), log_of(made))
    fit = dft.fit(dft.Thruster() + effect, log_of(made))
    estimate = fit.parameters[f"{name}.{parameter}"]
    assert fit.status.ok, fit.message
    assert abs(estimate.value - size) < max(4 * estimate.std_error, 0.02 * abs(size))
    assert fit.log_likelihood > plain.log_likelihood + 20


def test_the_same_log_in_other_units_gives_the_same_fit():
    made = record(seed=1)
    ours = dft.fit(dft.Thruster(), log_of(made))
    theirs = dft.Log(
        time=made.time * 1e3,
        inputs={"command": made.inputs["command"] * 1e3},
        measured={
            "speed": made.measured["speed"] * 60 / (2 * np.pi),
            "thrust": made.measured["thrust"] / 1e3,
        },
        units={"time": "ms", "command": "mV", "speed": "rpm", "thrust": "kN"},
    )
    fit = dft.fit(dft.Thruster(), theirs)
    for name, estimate in ours.parameters.items():
        assert fit.parameters[name].value == pytest.approx(estimate.value, rel=1e-6)
        assert fit.parameters[name].std_error == pytest.approx(estimate.std_error, rel=1e-4)
    assert fit.train.nrmse == pytest.approx(ours.train.nrmse, rel=1e-6)


def test_a_redundant_parameter_is_named_and_has_no_standard_error():
    fit = dft.fit(dft.Thruster() + TwiceTheSame(), log_of(record(seed=2)))
    assert fit.status is dft.estimation.Status.NOT_IDENTIFIABLE
    assert "beta" in fit.message
    assert "drive_gain.gain" in fit.message
    assert "alpha" not in fit.message
    assert fit.checks.rank == fit.checks.free_parameters - 1
    assert fit.parameters["beta"].std_error is None
    assert fit.parameters["drive_gain.gain"].std_error is None
    assert fit.parameters["alpha"].std_error is not None


def test_a_parameter_that_the_logs_do_not_show_is_held_and_told():
    made = record(seed=2)
    log = log_of(made, measured={"speed": made.measured["speed"]})
    fit = dft.fit(dft.Thruster(ct=0.011), log)
    assert fit.status.ok
    assert fit.parameters["ct"].value == 0.011
    assert fit.parameters["ct"].std_error is None
    assert "Not estimated, but held as given: ct; these logs do not tell." in fit.message
    assert "Not estimated" not in dft.fit(dft.Thruster(**TRUE), log_of(made), starts=2).message


def test_bounds_are_respected_and_contact_is_told():
    low = dft.Thruster().replace(alpha={"value": 0.05, "bounds": (0.045, 0.2)})
    fit = dft.fit(low, log_of(record()))
    assert fit.status is dft.estimation.Status.AT_BOUND
    assert fit.parameters["alpha"].at_bound
    assert fit.parameters["alpha"].value == pytest.approx(0.045)
    assert fit.parameters["alpha"].std_error is None


def test_unsigned_speed_and_missing_samples():
    made = record(seed=4, unsigned=True)
    speed = made.measured["speed"].copy()
    speed[50:90] = np.nan
    log = log_of(made, measured={**made.measured, "speed": np.abs(speed)}, unsigned=("speed",))
    fit = dft.fit(dft.Thruster(alpha=0.1), log)
    for name, true in TRUE.items():
        assert fit.parameters[name].value == pytest.approx(true, rel=0.02)
    assert fit.train.channels["speed"].samples == speed.size - 40


def test_a_shaft_that_turned_backwards_before_an_unsigned_log_began():
    made = record(seed=4)
    begin = np.argmin(made.truth["speed"])  # and is turned round by what is commanded from then on
    assert made.truth["speed"][begin] < -5.0
    log = dft.Log(
        time=made.time[begin:],
        inputs={"command": made.inputs["command"][begin:]},
        measured={"speed": np.abs(made.measured["speed"][begin:])},
        unsigned=("speed",),
    )
    fit = dft.fit(dft.Thruster().fix("ct"), log, starts=1)
    true = made.truth["speed"][begin]
    assert fit.initial[0]["speed"] == pytest.approx(true, abs=1.0)


def test_several_logs_with_their_own_initial_states():
    made = [record(seed=s, duration=d) for s, d in ((5, 10.0), (6, 14.0), (7, 33.0))]
    late = [log_of(m).slice(start=3.0) for m in made]
    fit = dft.fit(dft.Thruster(), late)
    assert fit.status.ok
    for m, initial in zip(made, fit.initial, strict=True):
        true = m.truth["speed"][np.searchsorted(m.time, 3.0 - 1e-9)]
        assert initial["speed"] == pytest.approx(true, abs=0.5)
    assert fit.parameters["alpha"].value == pytest.approx(0.037, rel=0.01)


@pytest.mark.thorough
def test_student_t_forgives_spikes_where_the_gaussian_does_not():
    made = record(seed=8)
    speed = made.measured["speed"].copy()
    rng = np.random.default_rng(0)
    speed[rng.choice(speed.size, 20, replace=False)] += 150.0
    log = log_of(made, measured={**made.measured, "speed": speed})
    robust = dft.fit(dft.Thruster(), log, loss="student_t")
    plain = dft.fit(dft.Thruster(), log)

    assert abs(robust.parameters["beta"].value - 42.0) < 0.2
    assert abs(plain.parameters["beta"].value - 42.0) > 0.4


def test_a_prior_counts_as_one_more_measurement():
    log = log_of(record(seed=9))
    free = dft.fit(dft.Thruster(), log).parameters["ct"]
    mean = free.value + 2 * free.std_error
    prior = dft.models.Normal(mean=mean, std=free.std_error)
    fit = dft.fit(dft.Thruster().replace(ct={"prior": prior}), log).parameters["ct"]
    assert fit.value - free.value == pytest.approx(free.std_error, rel=0.05)
    assert fit.std_error == pytest.approx(free.std_error / np.sqrt(2), rel=0.1)


@pytest.mark.thorough
def test_measured_speed_as_the_input_fits_the_thrust_alone():
    made = record(seed=10)
    speed, thrust = made.truth["speed"], made.measured["thrust"]
    log = log_of(made, inputs={"speed": speed}, measured={"thrust": thrust})
    fit = dft.fit(dft.Thruster(ct=0.1), log)
    assert fit.status.ok
    assert fit.parameters["ct"].value == pytest.approx(0.02, rel=0.01)
    assert "held as given: alpha, beta;" in fit.message


@pytest.mark.thorough
def test_a_failed_simulation_says_so():
    class Explodes(dft.Effect):
        """Feeds the shaft back with the wrong sign."""

        name = "explodes"
        port = "shaft"
        gain: float = dft.parameter(1e4, bounds=(1e4, 1e5))

        def __call__(self, value, s):
            return value + self.gain * s.speed**3

    fit = dft.fit(dft.Thruster() + Explodes(), log_of(record()), starts=2)
    assert fit.status is dft.estimation.Status.SIMULATION_FAILED
    assert fit.train.nrmse == np.inf


def test_too_few_steps_are_not_called_converged():
    problem = build(dft.Thruster(alpha=0.1, beta=10.0), [log_of(record())])
    stopped = solve(problem, problem.start(), budget=3)
    assert not stopped.done
    assert examine(problem, stopped.z, stopped.quadratic).gradient > 1e-3


def vessel_log(seed, duration=60.0):
    rng = np.random.default_rng(seed)
    time = inputs.grid(duration, 0.1)
    angle = np.deg2rad(20) * np.sign(np.sin(2 * np.pi * time / 16.0 + seed))
    speed = 98.0 + 15.0 * np.sign(np.sin(2 * np.pi * time / 37.0))
    made = vessel.simulate(time, {"propeller_speed": speed, "rudder_angle": angle}, method="rk4")
    sensors = dict.fromkeys(("surge", "sway", "yaw_rate"), noise.Sensor(std=0.01))
    return log_of(noise.measure(made, rng, **sensors))


@pytest.mark.thorough
def test_a_long_vessel_run_goes_through_segments_to_whole_runs():
    fit = dft.fit(dft.Vessel(m11=9.0, m22=3.0, i33=2.0, d11=7.0), [vessel_log(0), vessel_log(1)])
    assert fit.status.ok, fit.message
    assert fit.horizon is None
    for name in ("m11", "m22", "d11", "d22", "d33", "i33", "exponent"):
        estimate = fit.parameters[name]
        true = vessel.SIRAMDASU[name]
        assert abs(estimate.value - true) < 4.5 * estimate.std_error, name


def test_segments_restart_at_the_measured_state():
    log = vessel_log(2)
    problem = build(dft.Vessel(), [log], segmented=True)
    set_ = restarts(problem, 10.0, hold=True)
    surge = set_.numbers.batches[0].restarts["surge"]
    chosen = np.flatnonzero(np.isfinite(np.asarray(surge.value[0])))
    assert log.time[chosen] == pytest.approx([10.0, 20.0, 30.0, 40.0, 50.0])
    low, high = set_.limits()
    assert np.array_equal(low[len(set_.free) :], high[len(set_.free) :])
    whole = restarts(problem, None)
    assert not np.isfinite(np.asarray(whole.numbers.batches[0].restarts["surge"].value)).any()


def test_nothing_to_fit_and_nothing_measured():
    made = record(duration=2.0)
    with pytest.raises(dft.InputError, match="nothing to fit"):
        dft.fit(dft.Thruster().fix("alpha", "beta", "ct"), log_of(made))
    blind = log_of(made, measured={"torque": made.measured["speed"]})
    with pytest.raises(dft.InputError, match="No log measures an output of 'thruster'"):
        dft.fit(dft.Thruster(), blind)


def test_json_has_the_contract_and_the_report_is_readable():
    fit = dft.fit(dft.Thruster(), log_of(record()), holdout=log_of(record(seed=1)))
    data = fit.to_json()
    assert set(data) == {
        "schema", "model", "effects", "status", "parameters", "train", "holdout", "checks", "doubts"
    }  # fmt: skip
    estimate = {"value", "std_error", "unit", "fixed", "at_bound", "written"}
    assert set(data["parameters"]["alpha"]) == estimate
    assert set(data["train"]["channels"]["speed"]) == ERROR_KEYS
    assert set(data["checks"]) == {
        "gradient", "rank", "free_parameters", "condition", "starts", "starts_agreeing"
    }  # fmt: skip
    assert "alpha" in fit.report()
    assert "converged" in fit.report()


def test_physical_quantities_of_the_jason_thruster():
    log = log_of(record(speed=0.05, thrust=0.1))
    fit = dft.fit(dft.Thruster(), log)
    found = dft.uncertainty.physical(fit, pitch=0.101, area=0.0527)
    efficiency = np.sqrt(0.02 / (1000 * 0.0527 * 0.101**2))
    volume = 0.0527 * efficiency * 0.101 / (2 * 0.037)
    assert found["efficiency"].value == pytest.approx(efficiency, rel=2e-3)
    assert found["volume"].value == pytest.approx(volume, rel=3e-3)
    torque = 42.0 * 1000 * volume * efficiency**2 * 0.101**2
    assert found["torque_constant"].value == pytest.approx(torque, rel=5e-3)
    ct = fit.parameters["ct"]
    half = 0.5 * ct.std_error / ct.value
    assert found["efficiency"].std_error / found["efficiency"].value == pytest.approx(half)
    with pytest.raises(dft.InputError, match="positive pitch"):
        dft.uncertainty.physical(fit, pitch=0.0, area=0.05)

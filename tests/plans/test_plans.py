"""Test plans: their levels and times, their files, and the check of recorded logs against them."""

import numpy as np
import pytest
from reference import thruster, vessel

import diffthrust as dft
from diffthrust import InputError, papers, plans

THRUSTER = dft.Thruster()


def measured(log, model, leave=()):
    """What a rig that is as the model says would bring back: the reference simulator's run."""
    values = {name: float(p.value) for name, p in model.parameters.items()}
    if isinstance(model, dft.Thruster):
        run = thruster.simulate(log.time, log.inputs["command"], **values, method="rk4")
    else:
        run = vessel.simulate(log.time, log.inputs, parameters=values, method="rk4")
    kept = {n: x for n, x in run.truth.items() if n not in leave}
    units = {**log.units, **{n: model.outputs[n] for n in kept}}
    return dft.Log(log.time, log.inputs, kept, units)


def test_the_settling_time_is_that_of_the_closed_form():
    # at rest under a constant command the speed is a tanh with the rate sqrt(alpha beta c)
    for command in (0.1, 2.0):
        rate = np.sqrt(THRUSTER.alpha * THRUSTER.beta * command)
        expected = np.arctanh(0.99) / rate
        found = plans.settling_time(THRUSTER, ["speed"], {"command": command})
        assert found == pytest.approx(expected, rel=0.02)
    fast = dft.Thruster(alpha=0.37, beta=4200.0)  # in 0.05 s, of which steps of 0.01 s see little
    expected = np.arctanh(0.99) / np.sqrt(fast.alpha * fast.beta * 2.0)
    found = plans.settling_time(fast, ["speed"], {"command": 2.0}, first=0.02)
    assert found == pytest.approx(expected, rel=0.02)
    stuck = dft.AxisVehicle(drag={"value": 0.0, "transform": "linear"})
    with pytest.raises(InputError, match="do not come to rest within"):
        plans.settling_time(stuck, ["velocity"], {"thrust": 1.0})


def test_the_static_plan_has_its_levels_and_serves_the_static_test():
    plan = plans.static_test(THRUSTER, limits=(-2.0, 4.0), levels=4, hold=4.0)
    (run,) = plan.runs.values()
    wanted = [1.0, 2.0, 3.0, 4.0, 0.0, -0.5, -1.0, -1.5, -2.0, 0.0]
    assert [level.inputs["command"] for level in plan.levels] == wanted
    assert all(level.stop - level.start >= plan.settle + 3.9 for level in plan.levels)
    static = papers.yoerger.static_test(measured(run, THRUSTER), settle=plan.settle)
    assert static.ratio.value == pytest.approx(THRUSTER.beta / THRUSTER.alpha, rel=0.02)


def test_the_dynamic_plan_moves_within_the_limits():
    plan = plans.dynamic_test(THRUSTER, limits=(0.0, 4.0), duration=30.0)
    command = plan.runs["dynamic_test"].inputs["command"]
    assert command.min() >= 0.0
    assert command.max() <= 4.0
    assert np.ptp(command) > 3.0
    assert plan.levels == ()


def test_the_plan_of_the_sequence_serves_it():
    vessel, angles = dft.Vessel(), np.radians([-24.0, -8.0, 8.0, 24.0])
    plan = plans.sequential(vessel, speeds=[69.2, 98.0, 120.0], angles=angles)
    assert list(plan.runs) == ["straight_69.2", "straight_98", "straight_120",
                               "circle_-24", "circle_-8", "circle_+8", "circle_+24"]  # fmt: skip
    logs = {name: measured(run, vessel, ("north", "east", "heading"))
            for name, run in plan.runs.items()}  # fmt: skip
    straight = [log for name, log in logs.items() if name.startswith("straight")]
    circles = [log for name, log in logs.items() if name.startswith("circle")]
    found = papers.siramdasu.sequential(straight, circles, settle=plan.settle).vessel
    assert found.d22 == pytest.approx(vessel.d22, rel=0.02)
    assert plan.check(list(logs.values())).good


def test_the_files_are_what_a_rig_can_run(tmp_path):
    plan = plans.static_test(THRUSTER, limits=(0.0, 3.0), levels=3, settle=2.0, hold=1.0)
    (path,) = plan.save(tmp_path / "new" / "folder")
    first, second = path.read_text().splitlines()[:2]
    assert (first, second) == ("time [s],command [V]", "0,1")
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    np.testing.assert_allclose(table[:, 1], plan.runs["static_test"].inputs["command"])
    with pytest.raises(InputError, match="cannot be made"):
        plan.save(path / "below a file")


# -- what came back --------------------------------------------------------------------------------


def test_a_record_as_planned_is_good():
    plan = plans.static_test(THRUSTER, limits=(-3.0, 3.0), levels=3)
    check = plan.check(measured(plan.runs["static_test"], THRUSTER))
    assert check.good
    assert "8 of 8 as planned" in check.report()


def test_what_is_missing_is_named():
    plan = plans.static_test(THRUSTER, limits=(0.0, 4.0), levels=4, settle=3.0, hold=2.0)
    whole = measured(plan.runs["static_test"], THRUSTER)
    cut = plan.check(whole.slice(0.0, 12.0))  # two levels, and two seconds of the third
    said = {finding.what: finding.found for finding in cut.missing}
    assert list(said) == ["command = 3 V", "command = 4 V", "command = 0 V"]
    assert said["command = 3 V"].startswith("held for 2 s; it takes 3 s")
    assert said["command = 4 V"] == "not run: command from 1 to 3 V"
    assert said["command = 0 V"] == "not run: command from 1 to 3 V"
    both = plan.check([whole.slice(0.0, 12.0), whole.slice(10.0, None)])  # in two logs
    assert both.good
    blind = plan.check(measured(plan.runs["static_test"], THRUSTER, leave=("thrust",)))
    assert {finding.found for finding in blind.missing} == {"'thrust' not measured"}


def test_a_moving_record_must_reach_its_range():
    plan = plans.dynamic_test(THRUSTER, limits=(-4.0, 4.0), duration=20.0)
    run = plan.runs["dynamic_test"]
    assert plan.check(measured(run, THRUSTER)).good
    timid = dft.Log(run.time, {"command": 0.5 * run.inputs["command"]}, units=run.units)
    (finding,) = plan.check(timid).missing
    assert finding.what.startswith("command from -")


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: plans.static_test(dft.Vessel(), limits=(0, 1)), "a thruster with the input"),
        (lambda: plans.static_test(THRUSTER, limits=(1, 1)), "limits: expected a lowest"),
        (lambda: plans.static_test(THRUSTER, limits=3), "limits: expected a lowest"),  # pyright: ignore
        (lambda: plans.static_test(THRUSTER, limits=(0, 1), levels=1), "levels: expected 2"),
        (lambda: plans.dynamic_test(THRUSTER, limits=(0, 1), cutoff=99.0), "cutoff: expected Hz"),
        (lambda: plans.sequential(dft.Vessel("twin"), speeds=[1, 2], angles=[-0.1, 0.1]),
         "a vessel with a propeller"),
        (lambda: plans.sequential(dft.Vessel(), speeds=[98], angles=[-0.1, 0.1]), "two or more"),
        (lambda: plans.sequential(dft.Vessel(), speeds=[69, 98], angles=[0.1]), "both sides"),
        (lambda: plans.sequential(dft.Vessel(), speeds=[69, 98], angles=[-24, 24]), "right angle"),
    ],
)  # fmt: skip
def test_what_cannot_be_meant_is_refused(call, words):
    with pytest.raises(InputError, match=words):
        call()


def test_a_log_without_the_input_is_refused():
    plan = plans.static_test(THRUSTER, limits=(0.0, 1.0), settle=2.0)
    time = np.arange(0.0, 5.0, 0.1)
    other = dft.Log(time, {"thrust": time}, name="run.csv", units={"thrust": "N"})
    with pytest.raises(InputError, match=r"run\.csv: expected the input 'command'"):
        plan.check(other)

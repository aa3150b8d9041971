"""Plans for a motor, its speed loop, a black-box record and a depth sensor: what they serve for."""

import numpy as np
import pytest
from reference import dc_motor
from scipy import signal
from scipy.optimize import root_scalar
from test_examples import run as run_example

import diffthrust as dft
from diffthrust import InputError, papers, plans
from diffthrust import control as dc
from diffthrust.papers import aras

MOTOR = aras.thruster(load=aras.load_from(280.4))
SENSOR = dft.LinearSensor(slope=0.16, offset=1.6)


def answered(run, noise=0.0):
    """A run of the sensor as it would come back from the rig: its line, by hand."""
    reading = 0.16 * run.inputs["depth"] + 1.6 + noise
    return dft.Log(run.time, run.inputs, {"reading": reading}, {**run.units, "reading": "V"})


def turned(run):
    """A run of the motor by the reference simulator, whose friction is not smoothed."""
    names = {"resistance": "resistance", "inductance": "inductance", "ke": "back_emf",
             "km": "torque_constant", "inertia": "inertia", "viscous": "viscous",
             "friction": "coulomb", "kq": "load", "kt0": "thrust_linear",
             "kt": "thrust_quadratic"}  # fmt: skip
    values = {name: float(MOTOR.parameters[ours].value) for name, ours in names.items()}
    voltage = run.inputs["command"]
    made = dc_motor.simulate(run.time, voltage, parameters=values, method="rk4")
    kept = {name: made.truth[name] for name in ("speed", "thrust")}
    return dft.Log(run.time, run.inputs, kept, {**run.units, "speed": "rad/s", "thrust": "N"})


# -- the steady map --------------------------------------------------------------------------------


def test_the_steady_plan_steps_evenly_in_thrust():
    plan = plans.steady_map(MOTOR, limits=(-6.5, 13.0), levels=4)
    voltages = np.array([level.inputs["command"] for level in plan.levels])
    assert (voltages[3], voltages[8]) == pytest.approx((13.0, -6.5))
    p = {name: described.value for name, described in MOTOR.parameters.items()}

    def beyond(speed, voltage):  # the motor at rest, by hand
        torque = p["load"] * speed**2 + p["viscous"] * speed + p["coulomb"] * np.tanh(speed / 0.1)
        return p["resistance"] * torque / p["torque_constant"] + p["back_emf"] * speed - voltage

    for end, part in ((13.0, voltages[:4]), (6.5, -voltages[5:9])):
        squared = [root_scalar(beyond, (v,), bracket=(0.0, 1e3)).root ** 2 for v in (*part, end)]
        top = squared.pop()
        np.testing.assert_allclose(squared, top * np.array([0.25, 0.5, 0.75, 1.0]), rtol=1e-6)


def test_a_record_of_the_steady_plan_gives_the_map():
    plan = plans.steady_map(MOTOR, limits=(0.0, 13.0), levels=3, hold=1.0, step=0.01)
    log = turned(plan.runs["steady_map"])
    assert plan.check(log).good
    parts = papers.steady_portions(log, settle=plan.settle, inputs=["command"])
    thrust = [part.mean("thrust", "N") for part in parts[:3]]
    voltages = [part.mean("command", "V") for part in parts[:3]]
    np.testing.assert_allclose(aras.steady_map(MOTOR, thrust).own, voltages, rtol=5e-3)


# -- the black-box record --------------------------------------------------------------------------


def band_of(slow, fast):
    return 1.0 / (3.0 * slow) / (2.0 * np.pi), 2.0 / fast / (2.0 * np.pi)


def test_the_sequence_has_the_band_of_the_time_constants():
    plan = plans.black_box(aras.plant(), limits=(-13.0, 13.0), periods=1)
    (run,) = plan.runs.values()
    slow, fast = 1.0 / np.abs(np.sort(np.roots([1.0, 45.09, 16.33]))[::-1])
    assert plan.band
    assert plan.band == pytest.approx(band_of(slow, fast))
    command = run.inputs["command"][:-1]
    assert set(command) == {-13.0, 13.0}
    lines = np.abs(np.fft.rfft(command)) ** 2
    frequency = np.fft.rfftfreq(command.size, run.time[1])
    assert frequency[1] <= plan.band[0]
    ends = np.interp(plan.band, frequency[1:], lines[1:])
    assert ends[1] / ends[0] == pytest.approx(0.5, abs=0.06)
    one = np.sign(command[::8])  # eight samples to the shortest switching
    shifted = np.fft.irfft(np.abs(np.fft.rfft(one)) ** 2, one.size)
    np.testing.assert_allclose(shifted[1:], -1.0, atol=1e-6)  # a maximum-length sequence


def test_the_band_of_a_thruster_is_that_of_its_steps():
    thruster = dft.Thruster()
    plan = plans.black_box(thruster, limits=(-2.0, 4.0))
    # atanh(0.99) / rate for the speed; the thrust, its square, settles later: atanh(sqrt(0.99))
    times = [np.arctanh(np.sqrt(0.99)) / np.sqrt(thruster.alpha * thruster.beta * c)
             for c in (2.0, 4.0)]  # fmt: skip
    expected = band_of(*(t / np.log(100.0) for t in times))
    assert plan.band == pytest.approx(expected, rel=0.02)
    assert plan.measure == ("speed", "thrust")


def test_the_multisine_is_flat_in_its_band_and_in_time():
    plan = plans.black_box(aras.plant(), (-1.0, 3.0), signal="multisine", periods=1)
    assert plan.band
    (run,) = plan.runs.values()
    command = run.inputs["command"][:-1] - 1.0
    lines = 2.0 * np.abs(np.fft.rfft(command)) / command.size
    frequency = np.fft.rfftfreq(command.size, run.time[1])
    inside = (frequency > 0.5 * plan.band[0]) & (frequency <= plan.band[1] * (1.0 + 1e-9))
    np.testing.assert_allclose(lines[inside], lines[inside][0], rtol=1e-9)
    assert np.max(lines[~inside]) < 1e-9
    assert np.max(np.abs(command)) == pytest.approx(2.0)
    assert np.max(np.abs(command)) / np.std(command) < 2.0  # sines in phase would have 38


def test_a_record_of_the_plan_gives_the_transfer_function():
    plan = plans.black_box(aras.plant(), limits=(-13.0, 13.0), step=0.0155, periods=1)
    (run,) = plan.runs.values()
    command, plant = run.inputs["command"], aras.plant()
    _, single = signal.step((plant.num, plant.den), T=run.time)
    answer = np.convolve(np.diff(command, prepend=0.0), single)[: command.size]
    noisy = answer + 0.01 * np.random.default_rng(0).standard_normal(answer.size)
    log = dft.Log(run.time, run.inputs, {"depth": noisy}, {"command": "V", "depth": "V"})
    assert plan.check(log).good
    found = dft.blackbox.output_error(log, input="command", output="depth").transfer()
    np.testing.assert_allclose(found.den, aras.plant().den, rtol=5e-3)
    np.testing.assert_allclose(found.num, aras.plant().num, rtol=5e-3)


def test_a_record_that_misses_part_of_the_band_is_told():
    plan = plans.black_box(dft.Thruster(), limits=(-4.0, 4.0))
    (run,) = plan.runs.values()
    low, high = plan.band or (0.0, 0.0)
    slow = dft.Log(4.0 * run.time, run.inputs, units=run.units)
    (finding,) = plan.check(slow).missing
    assert finding.what == f"command, {low:.3g} to {high:.3g} Hz"
    assert finding.found.startswith(f"excited from {low:.3g} to ")
    reached = float(finding.found.split(" to ")[1].removesuffix(" Hz"))
    assert 0.2 * high < reached < 0.6 * high
    rare = dft.Log(run.time[::40], {"command": run.inputs["command"][::40]}, units=run.units)
    assert not plan.check(rare).good
    still = dft.Log(run.time, {"command": np.full(len(run), 4.0)}, units=run.units)
    assert [f.found for f in plan.check(still).missing][-1] == "not excited"
    assert plan.check([slow, run]).good


# -- the speed loop --------------------------------------------------------------------------------


def test_the_speed_plan_waits_until_the_loop_has_come_to_rest():
    loop = aras.speed_loop(MOTOR)
    plan = plans.speed_steps(loop, limits=(-90.0, 180.0), levels=2, hold=0.5)
    wanted = [level.inputs["reference"] for level in plan.levels]
    assert wanted == [90.0, 180.0, 0.0, -45.0, -90.0, 0.0]
    (run,) = plan.runs.values()
    made = loop.simulate(dc.Trajectory(run.time, run.inputs["reference"]), run.duration)
    speed = np.interp(run.time, made.time, made["speed"])
    for level in plan.levels[:2]:
        rested = (run.time > level.start + plan.settle) & (run.time < level.stop - 0.02)
        np.testing.assert_allclose(speed[rested], level.inputs["reference"], rtol=0.015)
    units = {**run.units, "speed": "rad/s"}
    assert plan.check(dft.Log(run.time, run.inputs, {"speed": speed}, units)).good
    missing = plan.check(run).missing
    assert {finding.found for finding in missing} == {"'speed' not measured"}


# -- the depth sensor ------------------------------------------------------------------------------


def test_the_calibration_plan_serves_the_calibration():
    plan = plans.depth_calibration((0.0, 3.6576), sensor=SENSOR, readable=(0.2, 4.9), hold=2.0)
    assert list(plan.runs) == ["reading_1_down", "reading_2_up", "reading_3_down"]
    assert plan.settle == pytest.approx(np.log(100.0))
    assert len(plan.levels) == 39
    rng, readings = np.random.default_rng(0), {}
    logs = [answered(run, 0.01 * rng.standard_normal(len(run))) for run in plan.runs.values()]
    for name, log in zip(plan.runs, logs, strict=True):
        parts = papers.steady_portions(log, settle=plan.settle, inputs=["depth"])
        parts.sort(key=lambda part: part.mean("depth", "m"))
        readings[name] = [part.mean("reading", "V") for part in parts]
    found = aras.calibrate(np.linspace(0.0, 3.6576, 13), readings)
    assert found.slope.value == pytest.approx(0.16, abs=0.002)
    assert not found.fits
    assert plan.check(logs).good


def test_a_reading_that_was_left_out_is_missing():
    plan = plans.depth_calibration((0.0, 3.0), sensor=SENSOR, levels=3)
    logs = [answered(run) for run in plan.runs.values()]
    check = plan.check(logs[:2])
    assert [(f.run, f.found) for f in check.missing] == 3 * [("reading_3_down", "not run")]
    joined = answered(  # down and up in one log: the greatest depth is held for twice as long
        dft.Log(np.concatenate([logs[0].time, logs[0].time[-1] + 0.1 + logs[1].time]),
                {"depth": np.concatenate([g.inputs["depth"] for g in logs[:2]])},
                units={"depth": "m"}))  # fmt: skip
    assert plan.check([joined, logs[2]]).good


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: plans.steady_map(dft.Vessel(), (0, 1)), "a thruster with the input"),  # pyright: ignore
        (lambda: plans.steady_map(dft.Thruster(), (0, 1)), "expected a DCMotorThruster"),  # pyright: ignore
        (lambda: plans.steady_map(MOTOR, (0, 1e-3)), "does not overcome its friction"),
        (lambda: plans.black_box(dft.Vessel(), (0, 1)), "a thruster with the input"),
        (lambda: plans.black_box(dft.Thruster(), (1, 0)), "a lowest and a highest command"),
        (lambda: plans.black_box(dft.Thruster(), (0, 1), signal="noise"), "'noise'"),  # pyright: ignore
        (lambda: plans.black_box(dft.Thruster(), (0, 1), step=9.0), "step: expected seconds"),
        (lambda: plans.black_box(([1.0], [1.0, -1.0]), (0, 1)), "a stable system"),
        (lambda: plans.black_box(([1.0], [1.0, 1e6, 1.0]), (0, 1)), "more than 16383"),
        (lambda: plans.speed_steps(dft.Thruster(), (0, 1)), "a loop of a thruster's speed"),  # pyright: ignore
        (lambda: plans.speed_steps(aras.speed_loop(MOTOR), (0, 400)), "comes to rest at 280.4"),
        (lambda: plans.speed_steps(aras.speed_loop(MOTOR), (9, 9)), "a highest speed"),
        (lambda: plans.depth_calibration((-1, 3)), "a least depth"),
        (lambda: plans.depth_calibration((0, 3), readable=(0.2, 4.9)), "-0.0973 to 0.473 V"),
        (lambda: plans.depth_calibration((0, 3), levels=2), "levels: expected 3 or more"),
    ],
)
def test_what_cannot_be_meant_is_refused(call, words):
    with pytest.raises(InputError, match=words):
        call()


@pytest.mark.slow
def test_the_example_writes_every_plan_and_tells_what_is_missing(tmp_path):
    text = run_example("papers_plans", tmp_path)
    files = sorted(path.name for path in (tmp_path / "figures").glob("*.csv"))
    assert len(files) == 17
    assert {"static_test.csv", "dynamic_test.csv", "circle_-24.csv", "reading_2_up.csv",
            "steady_map.csv", "speed_steps.csv", "black_box_prbs.csv"} <= set(files)  # fmt: skip
    assert "8 of 18 as planned." in text
    assert "excited from 0.214 to 0.751 Hz" in text

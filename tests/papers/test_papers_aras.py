"""The motor, the depth sensor and the printed transfer function of Aras et al. 2013."""

import re
import sys

import control
import numpy as np
import pytest
from places import EXAMPLES
from reference.make_fits import DEPTH_SENSOR
from scipy import signal, stats
from test_examples import figure, run

import diffthrust as dft
from diffthrust import InputError
from diffthrust.control import Step
from diffthrust.papers import aras

sys.path.insert(0, str(EXAMPLES))  # what is printed is part of an example, which is no package
from printed.aras import printed_figures
from printed.printed import printed_table
from printed.table_4 import table_4
from printed.transfer import gain_limit, linear_loop, plot_responses, step_response

DEPTH = np.linspace(0.0, 3.6, 13)


def readings(seed=0, noise=0.01, lines=((0.1901, -0.0973), (0.1901, -0.0973))):
    rng = np.random.default_rng(seed)
    return {
        f"reading {i + 1}": slope * DEPTH + offset + noise * rng.standard_normal(DEPTH.size)
        for i, (slope, offset) in enumerate(lines)
    }


# -- the thruster ----------------------------------------------------------------------------------


def test_the_motor_has_the_printed_values():
    motor, rounded = aras.thruster(), dft.DCMotorThruster()
    for name, p in rounded.parameters.items():
        assert motor.parameters[name].value == pytest.approx(p.value, rel=5e-5)
    assert motor.parameters["back_emf"].value == motor.parameters["torque_constant"].value


def test_equation_7_is_the_steady_state_without_friction():
    motor = aras.thruster(load=2e-6, thrust=3e-4)
    thrust = np.array([-4.0, 0.0, 0.5, 2.0, 8.0])
    plain = aras.steady_map(motor.replace(viscous=0.0, coulomb=0.0), thrust)
    np.testing.assert_allclose(plain.own, plain.printed, rtol=1e-12, atol=1e-15)
    v = motor.parameters
    modified = v["torque_constant"].value * 3e-4 / 2e-6
    by_hand = v["resistance"].value * 2.0 / modified + v["back_emf"].value * np.sqrt(2.0 / 3e-4)
    assert plain.printed[3] == pytest.approx(by_hand)
    assert np.all(aras.steady_map(motor, thrust).friction[2:] > 0.1)


@pytest.mark.parametrize("linear", [0.0, 0.01])
def test_the_map_is_where_the_simulation_comes_to_rest(linear):
    motor = aras.thruster().replace(thrust_linear=linear)
    found = aras.steady_map(motor, [0.3, 3.0])
    time = np.arange(0.0, 4.0, 0.002)
    for i in range(2):
        command = np.full(time.size, found.own[i])
        log = dft.Log(time=time, inputs={"command": command}, units={"command": "V"})
        at_rest = dft.simulate(motor, log)
        assert at_rest["speed"][-1] == pytest.approx(found.speed[i], rel=1e-6)
        assert at_rest["thrust"][-1] == pytest.approx(found.thrust[i], rel=1e-6)


def test_a_known_speed_tells_the_load():
    load = aras.load_from(280.4)
    motor = aras.thruster(load=load)
    assert aras.steady_map(motor, [1e-4 * 280.4**2]).own == pytest.approx([13.0])
    with pytest.raises(InputError, match="that of the motor without load, found 500 rad/s"):
        aras.load_from(500.0)


def test_the_speed_loop_has_the_printed_gains():
    loop = aras.speed_loop()
    made = loop.simulate(dft.control.Step(150.0), 4.0)
    assert (loop.controller.kp, loop.controller.ki) == (5.0, 15.0)
    assert made["speed"][-1] == pytest.approx(150.0, rel=1e-3)  # an integral leaves no error
    assert np.max(np.abs(made["command"])) <= 13.0


# -- the depth sensor ------------------------------------------------------------------------------


def test_the_f_test_is_that_of_a_line_without_free_coefficients():
    y = readings()["reading 1"]
    found = aras.calibrate(DEPTH, {"one": y})
    line = stats.linregress(DEPTH, y)
    assert found.lines["one"].slope == pytest.approx(line.slope)
    assert found.lines["one"].slope_error == pytest.approx(line.stderr)
    fitted = np.sum((y - line.slope * DEPTH - line.intercept) ** 2)
    prior = np.sum((y - 0.1901 * DEPTH + 0.0973) ** 2)
    f = (prior - fitted) / 2 / (fitted / 11)
    assert found.tests["one"].statistic == pytest.approx(f)
    assert found.tests["one"].p_value == pytest.approx(stats.f.sf(f, 2, 11))
    assert found.tests["together"] == found.tests["one"]
    assert found.offset.std_error is None


def test_a_right_line_is_rejected_as_often_as_the_level_says():
    """400 tables at the level 5 %; a right test fails here once in 10 000 cases."""
    tests = [aras.calibrate(DEPTH, readings(seed), level=0.05) for seed in range(400)]
    least, most = stats.binom.ppf([5e-5, 1 - 5e-5], 400, 0.05)
    for rejected in (
        sum(one.tests["reading 1"].rejected for one in tests),
        sum(not one.fits for one in tests),
        sum(one.same.rejected for one in tests),
    ):
        assert least <= rejected <= most
    assert "fits the readings" in next(one for one in tests if one.fits).sentence


def test_a_wrong_line_is_told_in_words():
    found = aras.calibrate(DEPTH, readings(lines=((0.16, 1.6), (0.15, 1.6), (0.16, 1.7))))
    assert not found.fits
    assert found.same.rejected
    assert "does not fit the readings (F(6, 33) = " in found.sentence
    assert "rejected for 3 of 3 readings" in found.sentence
    assert "at the surface they lie 1.7" in found.sentence
    assert "differ among themselves" in found.sentence
    assert [axes.get_ylabel() for axes in found.plot().axes] == ["reading [V]"]


def test_table_4_is_that_of_the_paper():
    depth, read = table_4()
    np.testing.assert_array_equal(np.column_stack([depth, *read.values()]), DEPTH_SENSOR)


def test_table_4_against_the_datasheet():
    """The lines by SciPy from the printed readings, and the paper's own 3 V = 6.082 m by none."""
    printed = np.array(DEPTH_SENSOR)
    lines = [stats.linregress(printed[:, 0], y) for y in printed[:, 1:].T]
    found = aras.calibrate(*table_4())
    np.testing.assert_allclose([line.slope for line in lines], [0.1608, 0.1579, 0.1481], atol=5e-5)
    for ours, line in zip(found.lines.values(), lines, strict=True):
        assert ours.slope == pytest.approx(line.slope)
        assert ours.intercept == pytest.approx(line.intercept)
        assert ours.slope_error == pytest.approx(line.stderr)
        assert ours.slope_error < 0.005
    assert all(test.rejected for test in found.tests.values())
    assert found.offset.value == pytest.approx(np.mean([line.intercept for line in lines]))
    together = stats.linregress(np.tile(printed[:, 0], 3), printed[:, 1:].T.ravel())
    depth = (3.0 - together.intercept) / together.slope
    assert found.depth(3.0) == pytest.approx(depth)
    assert min(abs(depth - 6.082), abs(depth - 16.29)) > 2.0
    rows = printed_figures()
    text = printed_table(rows)
    assert "not held by them: F(6, 33)" in " ".join(text.split())
    depths = [row.ours for row in rows if row.what == "3 V as a depth"]
    np.testing.assert_allclose(depths, [depth, 16.29, 6.06], atol=0.01)


def test_the_papers_depths_count_from_the_surface():
    line = aras.Datasheet()
    assert line.depth(3.0) == pytest.approx(16.29, abs=0.005)
    assert line.depth(3.0, surface=1.848) == pytest.approx(6.082, rel=0.005)
    assert line.depth(5.0, surface=1.848) == pytest.approx(16.57, rel=0.001)


# -- the printed transfer function -----------------------------------------------------------------


def test_the_printed_transfer_function():
    g = aras.plant()
    np.testing.assert_allclose(np.sort(g.poles), [-44.725, -0.365], atol=1e-3)
    assert np.roots(g.num) == pytest.approx([16.28 / 28.77])
    assert np.real(g(0.0)) == pytest.approx(16.28 / 16.33)
    time = np.linspace(0.0, 12.0, 601)
    exact = control.step_response(control.TransferFunction(g.num, g.den), time).outputs
    found = step_response(g, time, 13.0)
    np.testing.assert_allclose(found, 13.0 * exact, atol=1e-9)
    assert found[1] < 0  # in the wrong direction first


def test_the_linear_loop_rests_at_half_of_the_set_point():
    g = control.TransferFunction([-28.77, 16.28], [1.0, 45.09, 16.33])
    closed, loop = control.feedback(g, 1.0), linear_loop(1.0)
    s = 1j * np.array([0.0, 0.3, 4.0, 50.0])
    np.testing.assert_allclose(loop(s), closed(s), rtol=1e-9)
    assert np.real(loop(0.0)) == pytest.approx(0.4992, abs=1e-4)
    assert np.all(np.real(loop.poles) < 0)
    limit = gain_limit()
    assert np.all(np.real(linear_loop(0.999 * limit).poles) < 0)
    assert np.any(np.real(linear_loop(1.001 * limit).poles) > 0)
    titles = [axes.get_title(loc="left") for axes in plot_responses().axes]
    assert titles == ["Open loop: G(s)", "Depth loop, proportional gain 1"]


def test_the_printed_figures_that_follow_and_the_half_that_does_not():
    rows = {row.what: row for row in printed_figures()}
    for row in rows.values():
        if row.what.startswith("G(s)"):
            assert row.ours is None  # its record is not printed: finding it again would be a circle
    assert rows["deepest reading, 5 V"].ratio == pytest.approx(1.0, abs=2e-3)
    assert rows["set point reached, gain 1"].ratio == pytest.approx(0.5, abs=2e-3)
    text = printed_table(rows.values())
    assert text.splitlines()[0].split()[:3] == ["Figure", "Paper", "Ours"]


# -- the depth loop in time ------------------------------------------------------------------------


def loop_by_hand(gain, wanted, duration):
    """At 1 kHz with the exact answer of G(s) to a held voltage, as SciPy gives it."""
    a, b, c, _ = signal.tf2ss([-28.77, 16.28], [1.0, 45.09, 16.33])
    a, b, *_ = signal.cont2discrete((a, b, c, 0.0), 1e-3)
    state, told = np.zeros(2), []
    for _ in range(round(1000 * duration) + 1):
        reading = 1.848 + (c @ state).item()
        seen = min(max(reading, 0.2), 4.9)
        volts = min(max(gain * (wanted - seen), -13.0), 13.0)
        told.append((reading, seen, volts))
        state = a @ state + b[:, 0] * volts
    return np.array(told).T


@pytest.mark.parametrize(("gain", "wanted"), [(1.0, 3.0), (1.0, 13.0), (5.0, 3.0)])
def test_the_depth_loop_is_that_of_scipy(gain, wanted):
    """At rest, blind beyond the sensor's range, and swinging between the ends of both."""
    run = aras.depth_loop(gain).simulate(Step(wanted), 5.0, substeps=4)
    reading, seen, volts = loop_by_hand(gain, wanted, 5.0)
    np.testing.assert_allclose(run["reading"], reading, atol=1e-6)
    np.testing.assert_allclose(run["measured.reading"], seen, atol=1e-6)
    np.testing.assert_allclose(run["command"], volts, atol=1e-5)


def test_the_depth_loop_rests_halfway_is_blind_beyond_the_sensor_and_swings():
    halfway = aras.depth_loop().simulate(Step(3.0), 12.0)["measured.reading"][-1]
    rest = np.real(linear_loop(1.0)(0.0))
    assert halfway == pytest.approx(1.848 + rest * (3.0 - 1.848), abs=1e-3)
    blind = aras.depth_loop().simulate(Step(13.0), 5.0)
    late = blind.time > 2.0
    assert np.ptp(blind["measured.reading"][late]) == np.ptp(blind["command"][late]) == 0.0
    assert np.ptp(blind["reading"][late]) > 2.0  # while the vehicle goes on
    for gain, swings in ((0.9 * gain_limit(), False), (5.0, True)):
        run = aras.depth_loop(gain).simulate(Step(3.0), 12.0)
        assert (np.ptp(run["command"][run.time > 10.0]) > 1.0) == swings
        assert np.max(np.abs(run["command"])) <= 13.0


def open_loop(rails=None):
    time = np.arange(0.0, 12.0, 0.01)
    _, answer = signal.step(([-28.77, 16.28], [1.0, 45.09, 16.33]), T=time[:-100])
    reading = 1.848 + np.concatenate([np.zeros(100), 13.0 * answer])
    reading = reading + 0.005 * np.random.default_rng(0).standard_normal(time.size)
    if rails:
        reading = np.clip(reading, *rails)
    command, units = {"command": 13.0 * (time >= 1.0)}, {"command": "V", "reading": "V"}
    more = {"rails": {"reading": rails}} if rails else {}
    return dft.Log(time, command, {"reading": reading}, units, **more)


@pytest.mark.thorough
def test_the_open_loop_record_gives_the_printed_transfer_function():
    """Four standard errors: a right fit fails once in 3000 for one of the five."""
    guess = aras.DepthPlant(s1=-20.0, s0=10.0, p1=30.0, p0=10.0, surface=2.0)
    fit = dft.fit(guess, open_loop())
    assert fit.status.ok, fit.message
    printed = {"s1": -28.77, "s0": 16.28, "p1": 45.09, "p0": 16.33, "surface": 1.848}
    for name, truth in printed.items():
        found = fit.parameters[name]
        assert abs(found.value - truth) < 4.0 * found.std_error < 0.02 * abs(truth), name


def test_a_sensor_that_ends_leaves_only_ratios_of_the_open_loop_record():
    fit = dft.fit(aras.DepthPlant(), open_loop((0.2, 4.9)))
    for name in ("s1", "s0", "p1", "p0"):
        found = fit.parameters[name]
        assert found.std_error > abs(found.value), name
    rest = dft.uncertainty.derived(fit, lambda p: {"rest": p["s0"] / p["p0"]}, {})["rest"]
    assert abs(rest.value - 16.28 / 16.33) < 4.0 * rest.std_error < 0.1


@pytest.mark.slow
def test_the_example_of_the_depth_loop(tmp_path):
    text = run("papers_aras_depth", tmp_path)
    assert "Of the record the sensor to 4.9 V sees 14 %." in text
    assert "Gain 1, set point 3 V: reads 2.42 to 2.42 V" in text
    assert "Gain 5, set point 3 V: reads 0.20 to 4.90 V, voltage -9.50 to 13.00 V" in text
    for name in ("open_loop", "depth_loop"):
        figure(tmp_path, f"aras_{name}.png")


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: aras.calibrate(DEPTH, {}), "expected some by name, found none"),
        (lambda: aras.calibrate(DEPTH, [DEPTH]), "expected some by name, found list"),  # pyright: ignore
        (lambda: aras.calibrate(DEPTH, {"a": ["x"] * 13}), "'a': expected numbers"),
        (lambda: aras.calibrate(DEPTH, {"a": [1.0]}), r"shapes \(1,\) and \(13,\)"),
        (lambda: aras.calibrate(DEPTH, {"a": DEPTH * np.nan}), "not a finite number"),
        (lambda: aras.calibrate(DEPTH, readings(), level=5), "level: expected a share"),
        (lambda: aras.steady_map(dft.Thruster(), [1.0]), "expected a DCMotorThruster"),  # pyright: ignore
        (
            lambda: aras.steady_map(aras.thruster(load=0.0), [1.0]),
            "'load': expected a positive value",
        ),
        (lambda: aras.steady_map(aras.thruster(), [np.nan]), "finite numbers"),
        (lambda: linear_loop(0.0), "other than zero"),
        (lambda: step_response(aras.plant(), [1.0, 2.0]), "from 0 on"),
        (lambda: step_response(([1.0], [1.0, 1.0], 2.0), [0.0, 1.0]), "dead time of 2 s"),
    ],
)
def test_what_cannot_be_meant_is_refused(call, words):
    with pytest.raises(InputError, match=words):
        call()


# -- the example -----------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_example_prints_its_table_and_figures(tmp_path):
    text = run("papers_aras", tmp_path)
    assert "does not fit the readings" in text
    assert "\n*  " in text  # a model was chosen
    for kind in ("Output error", "State space"):
        found = re.search(rf"{kind} of order 2: G\(s\) = \((\S+) s \+ (\S+)\)", text)
        assert found
        assert [float(x) for x in found.groups()] == pytest.approx([-28.77, 16.28], rel=5e-3)
    for name in ("calibration", "steady_map", "transfer", "blackbox"):
        figure(tmp_path, f"aras_{name}.png")

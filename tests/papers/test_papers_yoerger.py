"""The static and the dynamic test of a thruster, on records with known parameters."""

import math
from functools import cache

import numpy as np
import pytest
from reference import thruster as reference

import diffthrust as dft
from diffthrust import InputError, papers
from diffthrust.papers import yoerger

TRUE = {"alpha": 0.037, "beta": 42.0, "ct": 0.019}
STEP = 0.05
UNITS = {"command": "V", "speed": "rad/s", "thrust": "N"}


@cache
def stairs_made():
    levels = [1.0, 2.0, 3.0, 4.0, -1.5, -3.0]
    return reference.simulate(*papers.staircase(levels, dwell=15.0, step=STEP, rest=2.0), **TRUE)


@cache
def moving_made():
    return reference.simulate(*papers.lowpass_noise(60.0, STEP, peak=4.0, seed=1), **TRUE)


def recorded(made, noise, seed, lasting=0.0):
    """A record of the reference simulator, read by sensors whose noise may last."""
    white = np.random.default_rng(seed).standard_normal((2, made.time.size))
    for k in range(1, made.time.size):
        white[:, k] = lasting * white[:, k - 1] + math.sqrt(1.0 - lasting**2) * white[:, k]
    measured = {n: made.truth[n] + noise * white[i] for i, n in enumerate(("speed", "thrust"))}
    return dft.Log(made.time, dict(made.inputs), measured, UNITS)


def stairs(noise=0.0, seed=0):
    return recorded(stairs_made(), noise, seed)


def moving(noise=0.0, seed=0, lasting=0.0):
    return recorded(moving_made(), noise, seed, lasting)


# -- what is steady --------------------------------------------------------------------------------


def test_steady_portions_begin_after_settling_and_leave_out_ramps():
    time = np.arange(0.0, 30.0, 0.1)
    ramp = np.clip(time - 10.0, 0.0, 10.0) * 0.2
    log = dft.Log(time=time, inputs={"command": ramp}, measured={"speed": 3.0 * ramp},
                  units={"command": "V", "speed": "rad/s"})  # fmt: skip
    first, last = papers.steady_portions(log, settle=2.0, least=3.0)
    assert (first.start, first.stop) == pytest.approx((2.0, 10.0), abs=0.11)
    assert (last.start, last.stop) == pytest.approx((22.0, 29.9), abs=0.11)
    assert last.mean("speed", "rad/s") == pytest.approx(6.0)
    assert last.std_error("speed", "rad/s") < 1e-9
    with pytest.raises(InputError, match="held for 25 s"):
        papers.steady_portions(log, settle=25.0)
    with pytest.raises(InputError, match=r"'thruster'.*'command'"):
        papers.steady_portions(log, settle=1.0, inputs=["thruster"])


# -- the static test -------------------------------------------------------------------------------


def test_the_static_test_finds_ct_and_the_ratio():
    static = yoerger.static_test(stairs(), settle=10.0)
    assert len(static.portions) == 4  # forward
    assert static.ct.value == pytest.approx(0.019, rel=1e-6)
    assert static.ratio.value == pytest.approx(42.0 / 0.037, rel=1e-3)
    assert len(yoerger.static_test(stairs(), settle=10.0, direction="reverse").portions) == 2
    assert len(yoerger.static_test(stairs(), settle=10.0, direction="both").portions) == 6


def test_a_sensor_without_a_sign_serves_the_static_test():
    log = stairs()
    folded = dft.Log(
        time=log.time, inputs=log.inputs, units=log.units, unsigned=("speed",),
        measured={**log.measured, "speed": np.abs(log.measured["speed"])},
    )  # fmt: skip
    static = yoerger.static_test(folded, settle=10.0, direction="both")
    assert static.ratio.value == pytest.approx(42.0 / 0.037, rel=1e-3)


def test_errors_of_the_static_test_are_those_of_repeats():
    """200 repeats tell a spread to 5 %: right errors fall out of these bounds 1 time in 250."""
    found = [yoerger.static_test(stairs(0.3, seed), settle=10.0) for seed in range(200)]
    for name, truth in (("ct", 0.019), ("ratio", 42.0 / 0.037)):
        each = [getattr(one, name) for one in found]
        values, errors = np.array([(one.value, one.std_error) for one in each]).T
        told = np.sqrt(np.mean(errors**2)) / np.std(values)
        assert 0.9 < told < 1.2, name  # the larger of two right errors: some per cent too large
        settling = 2e-5 * truth  # the smallest level still moves by so much after 10 s
        assert abs(values.mean() - truth) < 3.3 * values.std() / math.sqrt(200) + settling, name


def test_points_off_the_line_are_told_whatever_the_samples_say():
    x = np.arange(1.0, 6.0)
    y = 2.0 * x + np.array([0.3, -0.4, 0.2, 0.4, -0.3])
    plain = papers.fit_line(x, y, "line", through_origin=True)
    expected = math.sqrt(np.sum((y - plain.slope * x) ** 2) / 4 / np.sum(x**2))
    assert plain.slope_error == pytest.approx(expected)
    sure = papers.fit_line(x, y, "line", through_origin=True, errors=np.full(5, 0.01))
    assert sure.slope_error == plain.slope_error
    worst = np.array([0.0, 0.0, 0.0, 0.0, 3.0])
    unsure = papers.fit_line(x, y, "line", through_origin=True, errors=worst)
    assert unsure.slope_error == pytest.approx(3.0 * 5.0 / np.sum(x**2))


# -- the dynamic test ------------------------------------------------------------------------------


def test_the_dynamic_test_finds_the_truth_without_noise():
    dynamic = yoerger.dynamic_test(moving())
    assert dynamic.alpha.value == pytest.approx(0.037, rel=0.01)
    assert dynamic.beta.value == pytest.approx(42.0, rel=0.01)
    assert dynamic.ct is not None
    assert dynamic.ct.value == pytest.approx(0.019, rel=1e-6)
    forward = yoerger.dynamic_test(moving(), direction="forward")
    assert forward.alpha.value == pytest.approx(0.037, rel=0.01)


def test_noise_in_the_speed_biases_the_dynamic_test_and_not_the_fit():
    records = [moving(3.0, seed) for seed in range(10, 16)]  # none that made the command
    linear = np.array([yoerger.dynamic_test(log, cutoff=9.0).alpha.value for log in records])
    fits = [dft.fit(dft.Thruster(), log) for log in records]
    fitted = np.array([fit.parameters["alpha"].value for fit in fits])
    assert abs(linear.mean() / 0.037 - 1.0) > 3.0 * abs(fitted.mean() / 0.037 - 1.0)
    assert abs(fitted.mean() / 0.037 - 1.0) < 0.02


@pytest.mark.parametrize("lasting", [0.0, 0.8])
def test_noise_in_the_speed_leaves_ct_as_it_is(lasting):
    """A tenth of the speed is noise; right means and errors fail 1 time in 500."""
    found = [yoerger.dynamic_test(moving(2.0, k, lasting)).ct for k in range(100)]
    values, errors = np.array([(one.value, one.std_error) for one in found]).T
    assert abs(values.mean() - 0.019) < 3.3 * values.std() / 10.0
    if not lasting:  # the errors are those of white noise
        assert np.sqrt(np.mean(errors**2)) / np.std(values) == pytest.approx(1.0, abs=0.23)
    log = moving(2.0, 0, lasting)
    squared = log.measured["speed"] * np.abs(log.measured["speed"])
    assert squared @ log.measured["thrust"] / (squared @ squared) < 0.0188  # least squares


def test_what_is_no_thruster_is_refused():
    log = moving(0.3)
    turned = dft.Log(log.time, {"command": -log.inputs["command"]}, log.measured, UNITS)
    with pytest.raises(InputError, match=r"beta came out as -.*has no meaning"):
        yoerger.dynamic_test(turned)


def test_the_figures_name_what_they_show():
    static = yoerger.static_test(stairs(0.2), settle=10.0)
    labels = [axes.get_xlabel() for axes in static.plot().axes]
    assert labels == ["speed |speed| [rad²/s²]", "command [V]"]
    figure = yoerger.dynamic_test(moving(0.2)).plot()
    assert figure.axes[1].get_ylabel() == "thrust [N]"


# -- commands --------------------------------------------------------------------------------------


def test_the_noise_has_the_band_and_the_size_that_are_asked_for():
    time, command = papers.lowpass_noise(200.0, 0.01, peak=3.0, cutoff=1.0, seed=2)
    assert np.max(np.abs(command)) == pytest.approx(3.0)
    power = np.abs(np.fft.rfft(command)) ** 2
    share = power[np.fft.rfftfreq(time.size, 0.01) < 1.0].sum() / power.sum()
    # of white noise through |H|^2 = 1 / (1 + f^4), f from 0 to 1 of 0 to infinity
    assert share == pytest.approx(0.78, abs=0.05)
    np.testing.assert_array_equal(papers.lowpass_noise(200.0, 0.01, 3.0, seed=2)[1], command)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: papers.staircase([], 1.0, 0.1), "levels: expected finite numbers"),
        (lambda: papers.staircase([1.0], 0.0, 0.1), "dwell: expected seconds"),
        (lambda: papers.lowpass_noise(10.0, 0.1, 1.0, cutoff=6.0), "half the sample rate, 5 Hz"),
        (lambda: yoerger.static_test(stairs(), settle=math.nan), "settle: expected seconds"),
        (lambda: yoerger.static_test(stairs(), settle=1.0, direction="back"), "'back'"),  # pyright: ignore
        (lambda: yoerger.static_test(stairs(), settle="3"), "settle: expected seconds.*'3'"),  # pyright: ignore
        (lambda: yoerger.static_test([], settle=1.0), "no record was given"),
        (lambda: yoerger.dynamic_test(moving(), cutoff=20.0), "cutoff: expected Hz"),
        (lambda: yoerger.dynamic_test([moving()]), "expected one Log, found list"),  # pyright: ignore
        (lambda: yoerger.dynamic_test(moving().slice(0.0, 1.0)), "30 or more"),
        (lambda: papers.fit_line([1.0, 1.0], [2.0, 3.0], "line"), "2 or more different points"),
    ],
)
def test_what_cannot_be_meant_is_refused(call, words):
    with pytest.raises(InputError, match=words):
        call()


# -- the duct: a torque, and the flow that leaves it -----------------------------------------------


def test_the_steps_of_figure_6_are_those_of_the_closed_form():
    """From rest under a torque the speed is a tanh; the smaller the step, the slower."""
    model, time = dft.models.DuctedThruster(), np.arange(0.0, 5.5, 0.01)
    advance, volume = 0.2 * 0.101, 0.016
    alpha, beta = 0.0527 * advance / (2.0 * volume), 1.0 / (1000.0 * volume * advance**2)
    half = []
    for torque in (2.0, 1.0 / 3.0, 0.25):
        log = dft.Log(time, {"command": np.full(time.size, torque)}, units={"command": "N m"})
        found = dft.simulate(model, log, substeps=8)
        speed = math.sqrt(beta / alpha * torque) * np.tanh(math.sqrt(alpha * beta * torque) * time)
        np.testing.assert_allclose(found["speed"], speed, atol=1e-6)
        np.testing.assert_allclose(found["flow"], advance * speed, atol=1e-7)
        # the power of the shaft at rest is that of the jet: torque speed = area density flow^3 / 2
        jet = 0.5 * 1000.0 * 0.0527 * found["flow"][-1] ** 3
        if torque == 2.0:
            assert torque * found["speed"][-1] == pytest.approx(jet, rel=1e-4)
        half.append(np.interp(0.5, found["thrust"] / (2.0 * torque / advance), time))
    assert half == sorted(half)


def rig(seed):
    """A thruster driven by a torque, by the reference simulator, with speed and outflow."""
    time, torque = papers.lowpass_noise(40.0, STEP, peak=2.0, seed=3)
    advance, volume = 0.19 * 0.101, 0.014
    record = reference.simulate(
        time, torque, alpha=0.0527 * advance / (2.0 * volume),
        beta=1.0 / (1000.0 * volume * advance**2), ct=1000.0 * 0.0527 * advance**2,
    )  # fmt: skip
    rng = np.random.default_rng(seed)
    speed = record.truth["speed"]
    return record.truth["thrust"], dft.Log(
        time=time,
        inputs={"command": torque},
        measured={
            "speed": speed + 0.5 * rng.standard_normal(time.size),
            "flow": advance * speed + 0.02 * rng.standard_normal(time.size),
        },
        units={"command": "N m", "speed": "rad/s", "flow": "m/s"},
    )


def test_speed_and_outflow_tell_efficiency_volume_and_thrust():
    """Four standard errors: a right fit fails once in 8000 for each of the two."""
    thrust, log = rig(0)
    fit = dft.fit(dft.models.DuctedThruster(), log)
    assert fit.status.ok, fit.message
    for name, truth in (("efficiency", 0.19), ("volume", 0.014)):
        found = fit.parameters[name]
        assert abs(found.value - truth) < 4.0 * found.std_error < 0.02 * truth, name
    np.testing.assert_allclose(dft.simulate(fit.model, log)["thrust"], thrust, atol=0.3)


def test_a_thruster_commanded_by_a_torque_has_a_torque_constant_of_one():
    thrust, log = rig(1)
    measured = {"speed": log.measured["speed"], "thrust": thrust}
    units = {"command": "N m", "speed": "rad/s", "thrust": "N"}
    fit = dft.fit(dft.Thruster(), dft.Log(log.time, log.inputs, measured, units))
    assert fit.model.inputs["command"] == "N m"
    found = dft.uncertainty.physical(fit, pitch=0.101, area=0.0527)
    assert found["torque_constant"].unit == ""
    assert found["torque_constant"].value == pytest.approx(1.0, rel=0.01)
    assert found["efficiency"].value == pytest.approx(0.19, rel=0.01)

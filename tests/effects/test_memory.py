"""Expressions that remember: lags, plays and integrals, in formulas, curves, files and exports."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from expressions import expression_of, values_along
from scipy.integrate import solve_ivp
from scipy.signal import lfilter

import diffthrust as dft
from diffthrust.effects import Curve, Formula

TIME = 0.05 * np.arange(400)
COMMAND = 6.0 * np.sign(np.sin(0.7 * TIME)) + np.sin(2.0 * TIME)
STILL = dft.Thruster(alpha=1e-12, beta=1e-12)


def driven(command=COMMAND):
    return dft.Log(time=TIME, inputs={"command": command}, units={"command": "V"})


def along(text, series, time):
    """The value of an expression at the samples."""
    return values_along(expression_of(text), series.__getitem__, series.__getitem__, time)[0]


def swallowed(series: np.ndarray, width: float) -> np.ndarray:
    out, at = [], 0.0
    for value in series:
        at = min(max(at, value - width), value + width)
        out.append(at)
    return np.array(out)


def test_a_play_at_the_drive_is_that_of_the_command_before_it():
    model = dft.Thruster()
    ours = model + Formula(
        "drive", "play(value, b)", b={"unit": "rad/s^2", "value": 25.0, "null": 0}
    )
    plain = dft.simulate(model, driven(swallowed(COMMAND, 25.0 / model.beta)))["speed"]
    np.testing.assert_allclose(dft.simulate(ours, driven())["speed"], plain, rtol=0, atol=1e-9)
    curve = Curve("drive", "value - play(value, b)", -25.0, 25.0, shape=(0.0, -50.0),
                  b={"unit": "rad/s^2", "value": 25.0})  # fmt: skip
    seen = dft.simulate(model + curve, driven())["speed"]
    np.testing.assert_allclose(seen, plain, rtol=0, atol=1e-9)


def test_a_formula_finds_by_itself_where_a_play_does_nothing():
    formula = Formula("drive", "play(value, b)", b={"unit": "rad/s^2", "value": 25.0})
    assert formula.declared["b"].null == 0.0
    assert formula.declared["b"].bounds == (0.0, None)


def test_a_lag_of_a_lag_is_a_filter_of_second_order():
    text = "a * lag(lag(command**2, fast), slow)"
    formula = Formula(
        "drive",
        text,
        a={"unit": "1/s^2", "value": 1.0},
        fast={"unit": "s", "value": 0.3},
        slow={"unit": "s", "value": 2.0},
    )
    assert set(formula.states) == {"lag", "lag2"}
    seen = dft.simulate(STILL + formula, driven(), substeps=8)["speed"]

    def rate(t, x):
        return [(held - x[0]) / 0.3, (x[0] - x[1]) / 2.0, x[1]]

    x = np.array([COMMAND[0] ** 2, COMMAND[0] ** 2, 0.0])
    expected = [0.0]
    for k in range(TIME.size - 1):
        held = COMMAND[k] ** 2
        x = solve_ivp(rate, TIME[k : k + 2], x, method="DOP853", rtol=1e-10, atol=1e-10).y[:, -1]
        expected.append(x[2])
    np.testing.assert_allclose(seen, expected, atol=1e-5 * np.max(expected))


def test_a_curve_of_a_lag_follows_the_lag_of_its_signal():
    # a level alone would not tell; a straight line of the lagged square is the lag itself
    curve = Curve("drive", "lag(command**2, T)", 0.0, 100.0, shape=(50.0, 100.0),
                  T={"unit": "s", "value": 2.0})  # fmt: skip
    seen = dft.simulate(STILL + curve, driven())["speed"]
    kept = np.exp(-0.05 / 2.0)
    square = np.concatenate([COMMAND[:1], COMMAND[:-1]]) ** 2
    lag = lfilter([1 - kept], [1.0, -kept], square, zi=[kept * COMMAND[0] ** 2])[0]
    expected = np.concatenate([[0.0], np.cumsum(0.5 * 0.05 * (lag[1:] + lag[:-1]))])
    assert np.allclose(seen, expected, rtol=2e-3, atol=0.5)


def test_the_integral_of_one_is_the_time_and_that_of_a_speed_a_position():
    clock = Formula("drive", "a * integral(1)", a={"unit": "rad/s^3", "value": 2.0, "null": 0.0})
    seen = dft.simulate(STILL + clock, driven())["speed"]
    np.testing.assert_allclose(seen, TIME**2, atol=1e-9)
    spring = Formula("shaft", "-k * integral(speed)", k={"unit": "1/s^2", "value": 4.0, "null": 0})
    push = Formula("drive", "a", name="push", a={"unit": "rad/s^2", "value": 3.0, "null": 0.0})
    seen = dft.simulate(STILL + push + spring, driven(), substeps=8)["speed"]
    np.testing.assert_allclose(seen, 1.5 * np.sin(2.0 * TIME), atol=1e-4)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("u - play(u, 0.5)", COMMAND - swallowed(COMMAND, 0.5)),
        ("2 * integral(1)", 2 * TIME),
        ("lag(1, 4, 0)", 1 - np.exp(-TIME / 4)),
        ("lag(2 + 0 * u, 4, 3)", 2 + np.exp(-TIME / 4)),
        ("lag(u, 1e-9)", np.concatenate([COMMAND[:1], COMMAND[:-1]])),
        ("lag(play(u, 0.5), 1e-9)", swallowed(COMMAND, 0.5)[np.r_[0, : TIME.size - 1]]),
    ],
)
def test_along_a_log_they_are_what_they_are_in_a_run(text, expected):
    seen = along(text, {"u": COMMAND}, TIME)
    np.testing.assert_allclose(seen, expected, atol=1e-12)


def test_what_is_cold_when_a_log_begins_warms_up():
    text = "a * lag(command, T, 0)"
    warm = Formula("drive", text, a={"unit": "1", "value": 1.0}, T={"unit": "s", "value": 4.0})
    seen = dft.simulate(STILL + warm, driven(np.ones(400)), substeps=4)["speed"]
    np.testing.assert_allclose(seen, TIME - 4 * (1 - np.exp(-TIME / 4)), atol=1e-6)


def test_along_an_uneven_log_a_lag_takes_each_step_as_it_is():
    time = np.cumsum(np.random.default_rng(2).choice([0.01, 0.2], 300))
    u = np.sign(np.sin(time))
    seen = along("lag(u, 0.5)", {"u": u}, time)
    expected = [u[0]]
    for k in range(299):
        kept = np.exp(-(time[k + 1] - time[k]) / 0.5)
        expected.append(u[k] + kept * (expected[-1] - u[k]))
    np.testing.assert_allclose(seen, expected, atol=1e-12)


@pytest.mark.parametrize("text", ["u - play(u, 0.3)", "u * lag(u, 0.5)", "x * u", "play(x, 0.3)"])
def test_as_the_next_sample_comes_a_held_input_is_still_what_it_was(text):
    """What an expression comes to then, by samples ten thousand times as near."""
    u, x, time = COMMAND[:40], np.cos(TIME[:40]), TIME[:40]
    late = np.interp(time + 0.05 * (1 - 1e-4), time, x)
    fine = np.sort(np.concatenate([time, time + 0.05 * (1 - 1e-4)]))
    held = {"u": np.repeat(u, 2), "x": np.stack([x, late], axis=1).ravel()}
    expected = along(text, held, fine)[1::2]
    ends = {"u": u, "x": np.append(x[1:], x[-1:])}
    now = {"u": u, "x": x}.__getitem__
    _, found = values_along(expression_of(text), now, ends.__getitem__, time)
    np.testing.assert_allclose(found[:-1], expected[:-1], atol=2e-3)


def test_the_plainest_lag_and_play_do_nothing_at_zero():
    for text in ("lag(value, T)", "play(value, T)"):
        law = Formula("drive", text, T={"unit": "s", "value": 0.2})
        assert (law.declared["T"].null, law.declared["T"].bounds) == (0.0, (0.0, None))


def test_the_slope_by_the_width_of_a_play_is_right_where_it_is_zero():
    law = Formula("drive", "play(value, b)", b={"unit": "rad/s^2", "value": 0.0})
    value = jnp.array([2.0, -2.0, 1.0])
    s = dft.models.Signals({"play": jnp.array([1.0, -1.0, 1.0])})  # rising, falling, at rest
    moved = jax.jacfwd(lambda b: law._bound({"b": b})(value, s))(0.0)
    np.testing.assert_array_equal(moved, [-1.0, 1.0, 0.0])


def test_what_occurs_twice_is_remembered_once():
    law = expression_of("lag(u, T) + lag(u, T, 0) - lag(u, T, 0)")
    assert [one.state for one in law.memories] == ["lag", "lag2"]
    law = expression_of("lag(speed, T) * abs(lag(speed, T)) + lag(speed, S) + play(speed, b)")
    assert [one.state for one in law.memories] == ["lag", "lag2", "play"]
    assert law.sizes == {"T", "S", "b"}


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("lag(speed)", "expected 2 in the brackets of 'lag', found 1"),
        ("play(speed, b, 0)", "expected 2 in the brackets of 'play', found 3"),
        ("lag * speed", "'lag' is a function"),
        ("lag(speed, -1)", "the time or width of 'lag' has a sign"),
        ("lag(lag2, T) + lag(speed, T)", "'lag2' is the state of what remembers here"),
    ],
)
def test_what_cannot_remember_is_told_with_a_mark(text, told):
    with pytest.raises(dft.InputError, match=told) as caught:
        expression_of(text)
    assert "^" in str(caught.value)


def test_states_are_refused_at_channels_with_the_ports_that_have_them():
    with pytest.raises(dft.InputError, match="states of its own") as caught:
        dft.Thruster() + Formula("command", "play(value, b)", b={"unit": "V", "value": 0.5})
    assert "'drive'" in str(caught.value)


@pytest.mark.thorough
def test_a_fit_finds_the_width_and_the_time_constant():
    own = {"T": {"unit": "s", "value": 1.0}, "b": {"unit": "V", "value": 0.2}}
    law = Formula("drive", "-a * lag(command, T) - c * (command - play(command, b))", name="law",
                  a={"unit": "rad/(V s^2)", "value": 5.0}, c={"unit": "rad/(V s^2)", "value": 5.0},
                  **own)  # fmt: skip
    truth = {"law.a": 12.0, "law.c": 30.0, "law.T": 2.5, "law.b": 0.6}
    known = dft.Thruster().fix("alpha", "beta")
    plant = (known + law).replace(**truth)
    time = 0.05 * np.arange(1200)
    command = 6.0 * np.sin(0.9 * time) + 2.0 * np.sin(2.3 * time)
    log = dft.Log(time=time, inputs={"command": command}, units={"command": "V"})
    speed = dft.simulate(plant, log)["speed"]
    speed = speed + 0.05 * np.random.default_rng(6).standard_normal(time.size)
    measured = dft.Log(time=time, inputs={"command": command}, measured={"speed": speed},
                       units={"command": "V", "speed": "rad/s"}, noise={"speed": 0.05})  # fmt: skip
    fit = dft.fit(known + law, measured, starts=1)
    for name, value in truth.items():
        estimate = fit.parameters[name]
        assert abs(estimate.value - value) < 5 * estimate.std_error + 1e-3 * value

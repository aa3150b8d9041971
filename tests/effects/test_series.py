"""Delay, rate limit and lag of recorded series, against closed forms and the reference."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from expressions import delayed, lagged, rate_limited
from reference import hidden

RNG = np.random.default_rng(31)
TIME = np.cumsum(RNG.uniform(0.01, 0.08, 60))
SERIES = RNG.normal(size=60)
BY_NAME = {"delayed": (delayed, 0.0), "rate_limited": (rate_limited, np.inf), "lagged": (lagged, 0)}


def derivative(function, at, time=TIME, series=SERIES):
    """Value and slope with respect to the last argument."""
    given = jnp.asarray(time), jnp.asarray(series)
    one = jnp.asarray(1.0)
    return jax.jvp(lambda p: function(*given, p), (jnp.asarray(float(at)),), (one,))


@pytest.mark.parametrize("name", BY_NAME)
def test_nothing_changes_at_the_null(name):
    function, null = BY_NAME[name]
    value, slope = derivative(function, null)
    assert np.array_equal(value, SERIES)
    assert np.all(np.isfinite(slope))


@pytest.mark.parametrize("name", ["delayed", "lagged"])
def test_the_slope_at_the_null_is_that_towards_a_late_signal(name):
    function, _ = BY_NAME[name]
    _, slope = derivative(function, 0.0)
    ahead = (function(jnp.asarray(TIME), jnp.asarray(SERIES), 1e-6) - SERIES) / 1e-6
    np.testing.assert_allclose(slope, ahead, rtol=1e-2, atol=1e-8)
    assert slope[0] == 0.0
    np.testing.assert_allclose(slope[1:], -np.diff(SERIES) / np.diff(TIME), rtol=1e-9)


@pytest.mark.parametrize("name", BY_NAME)
@pytest.mark.parametrize("size", [0.0, 0.03, 2.0, np.inf])
def test_stamps_that_repeat_at_the_end_change_nothing(name, size):
    function, _ = BY_NAME[name]
    if name != "rate_limited" and size == np.inf:
        size = 50.0
    time, series = np.append(TIME, [TIME[-1]] * 3), np.append(SERIES, [SERIES[-1]] * 3)
    value, slope = derivative(function, size, time, series)
    short, short_slope = derivative(function, size)
    np.testing.assert_array_equal(value[:60], short)
    np.testing.assert_array_equal(slope[:60], short_slope)
    np.testing.assert_array_equal(value[60:], np.full(3, short[-1]))
    assert np.all(np.isfinite(slope))


def test_a_delay_shifts_along_straight_lines():
    at = np.maximum(TIME - 0.1, TIME[0])
    value = delayed(jnp.asarray(TIME), jnp.asarray(SERIES), 0.1)
    np.testing.assert_allclose(value, np.interp(at, TIME, SERIES), rtol=1e-12, atol=1e-12)


def test_a_delayed_staircase_keeps_its_mean_over_every_interval():
    time = 0.05 * np.arange(41)
    levels = RNG.normal(size=41)
    value = delayed(jnp.asarray(time), jnp.asarray(levels), 0.13)
    fine = np.linspace(0.0, 0.05, 20001)[:-1] + 0.5 * 0.05 / 20000
    for k in range(40):
        index = np.clip(np.floor((time[k] + fine - 0.13) / 0.05 + 1e-9).astype(int), 0, 40)
        assert float(value[k]) == pytest.approx(levels[index].mean(), abs=1e-3)


def test_the_rate_limit_is_that_of_the_reference():
    value = rate_limited(jnp.asarray(TIME), jnp.asarray(SERIES), 8.0)
    _, expected = hidden.command_rate_limit(TIME, SERIES, rate=8.0)
    assert not np.array_equal(expected, SERIES)
    np.testing.assert_allclose(value, expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("time_constant", [1e-6, 0.01, 0.3, 1e4])
def test_a_lagged_ramp_has_its_closed_form(time_constant):
    t = TIME - TIME[0]
    value = lagged(jnp.asarray(TIME), jnp.asarray(2.0 + 3.0 * t), time_constant)
    exact = 2.0 + 3.0 * (t + time_constant * np.expm1(-t / time_constant))
    np.testing.assert_allclose(value, exact, rtol=2e-9)

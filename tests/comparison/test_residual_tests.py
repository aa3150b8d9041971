"""Residual tests: levels hold for coloured residuals and inputs, and what is there is seen."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from diffthrust._support.correlation import (  # private: against closed forms
    autocorrelation,
    covariance,
    ljung_box,
)
from diffthrust.comparison._residual_tests import (  # private: the tests on made residuals alone
    cross_correlation,
    residual_tests,
)


def coloured(rng: np.random.Generator, n: int, pole: float) -> np.ndarray:
    """An AR(1) series of unit variance, settled."""
    shocks = rng.standard_normal(n + 400) * np.sqrt(1 - pole**2)
    return lfilter([1.0], [1.0, -pole], shocks)[400:]


def drives(seed: int, n: int) -> np.ndarray:
    """A coloured input: filtered noise, a staircase or a multisine."""
    rng = np.random.default_rng(seed + 10_000)
    if seed % 3 == 0:
        return coloured(rng, n, 0.95)
    if seed % 3 == 1:
        return np.repeat(rng.uniform(-2, 2, n // 40 + 1), 40)[:n]
    phase = rng.uniform(0, 2 * np.pi, 8)
    return np.sin(2 * np.pi * np.outer(np.arange(n) / n, np.arange(3, 35, 4)) + phase).sum(axis=1)


def test_autocorrelation_of_a_known_process_across_runs_and_gaps():
    rng = np.random.default_rng(0)
    runs = [coloured(rng, 20_000, 0.8) for _ in range(2)]
    runs[0][rng.random(20_000) < 0.3] = np.nan
    found = autocorrelation(runs, 5)
    np.testing.assert_allclose(found, 0.8 ** np.arange(6), atol=0.03)


def test_covariance_matches_its_definition_and_its_direction():
    rng = np.random.default_rng(1)
    one, two = rng.standard_normal(30), rng.standard_normal(30)
    a, b = one - one.mean(), two - two.mean()
    direct = [sum(a[t + k] * b[t] for t in range(30) if 0 <= t + k < 30) / 30 for k in range(-4, 5)]
    np.testing.assert_allclose(covariance([one], [two], 4), direct, atol=1e-12)
    long = np.concatenate([np.zeros(3), two])[:30]  # follows `two` by three samples
    assert covariance([long], [two], 8).argmax() - 8 == 3


def test_lags_beyond_a_short_run():
    found = covariance([np.arange(4.0), np.arange(40.0)], [np.arange(4.0), np.arange(40.0)], 10)
    assert np.all(np.isfinite(found))
    assert found.size == 21


def test_ljung_box_keeps_its_level_and_finds_colour():
    rng = np.random.default_rng(2)
    p = [ljung_box(autocorrelation([rng.standard_normal(400)], 20)[1:], 400) for _ in range(400)]
    assert 0.02 < np.mean(np.array(p) < 0.05) < 0.09
    assert ljung_box(autocorrelation([coloured(rng, 400, 0.5)], 20)[1:], 400) < 1e-3


def test_the_band_holds_for_coloured_series_where_the_naive_one_fails():
    within, naive, related = [], [], 0
    for seed in range(200):
        rest = coloured(np.random.default_rng(seed), 800, 0.9)
        found = cross_correlation("command", [rest], [drives(seed, 800)], 40, 0.1)
        within.append(np.mean(np.abs(found.values) < found.band))
        naive.append(np.mean(np.abs(found.values) < 1.96 / np.sqrt(800)))
        related += found.related
    assert 0.93 < np.mean(within) < 0.985
    assert np.mean(naive) < 0.6
    assert related <= 20  # 5 % of 200 and three standard deviations


def test_a_related_signal_is_found_with_its_lag():
    rng = np.random.default_rng(3)
    command = coloured(rng, 2000, 0.8)
    rest = coloured(rng, 2000, 0.9)
    rest[6:] += 0.8 * command[:-6]
    other = coloured(rng, 2000, 0.8)
    found = residual_tests(
        "speed", [rest], [{"command": command, "inflow": other}], step=0.1, unit="rad/s"
    )
    assert found is not None
    assert found.signals["command"].related
    assert found.signals["command"].lag == pytest.approx(0.6)
    assert not found.signals["inflow"].related
    assert "related to command 0.6 s before" in found.sentence


def test_correlation_time_and_effective_samples():
    rng = np.random.default_rng(4)
    found = residual_tests("speed", [coloured(rng, 40_000, 0.9)], [{}], step=0.05)
    assert found is not None
    assert found.lag_one == pytest.approx(0.9, abs=0.01)
    assert found.correlation_time == pytest.approx(19 * 0.05, rel=0.15)  # (1 + a) / (1 - a)
    assert found.effective_samples == pytest.approx(40_000 / 19, rel=0.15)
    assert not found.white
    white = residual_tests("speed", [rng.standard_normal(4000)], [{}], step=0.05)
    assert white is not None
    assert white.white
    assert white.effective_samples > 3500


def test_an_offset_is_named_with_an_honest_error():
    rng = np.random.default_rng(5)
    found = residual_tests("thrust", [coloured(rng, 3000, 0.9) + 2.0], [{}], step=0.04, unit="N")
    assert found is not None
    assert abs(found.mean - 2.0) < 3 * found.mean_error
    assert found.mean_error > 3 / np.sqrt(3000)
    assert "N above the model" in found.sentence


def test_nothing_to_test():
    assert residual_tests("speed", [np.zeros(100)], [{}], step=0.1) is None
    assert residual_tests("speed", [np.full(100, np.inf)], [{}], step=0.1) is None
    assert residual_tests("speed", [np.ones(4)], [{}], step=0.1) is None

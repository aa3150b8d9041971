"""Residual tests: levels hold for coloured residuals and inputs, and what is there is seen."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from problems import LOSSES, NOISE_MODELS
from residuals import (
    autocorrelation,
    covariance,
    cross_correlation,
    ljung_box,
    noise_advice,
    outstanding,
    residual_tests,
)
from scipy.signal import lfilter
from scipy.stats import norm
from scipy.stats import t as student


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


def runs(rmse, spread):
    """Runs of one channel with given errors, beside how much varies in each."""
    made = []
    for k, (error, size) in enumerate(zip(rmse, spread, strict=True)):
        one = SimpleNamespace(rmse=error, nrmse=error / size, samples=100, shown=(error, "rad/s"))
        errors = SimpleNamespace(channels={"speed": one})
        made.append(SimpleNamespace(name=f"run {k}", channels={"speed": None}, errors=errors))
    return made


def test_a_run_with_a_large_error_stands_out():
    (one,) = outstanding(runs([1.0, 1.2, 5.0, 0.9], [10.0, 10.0, 10.0, 10.0]))
    assert (one.place, one.run) == (2, "run 2")
    assert one.ratio == pytest.approx(5.0 / 1.1)
    assert one.share == pytest.approx(25.0 / 28.25)


@pytest.mark.parametrize("size", [8.0, 1 / 8.0])
def test_a_larger_or_smaller_manoeuvre_does_not(size):
    """A larger one errs by as large a share, a smaller one by as much."""
    error = max(size, 1.0)
    assert outstanding(runs([1.0, 1.0, error, 1.0], [10.0, 10.0, 10.0 * size, 10.0])) == []


def test_of_two_runs_none_stands_out():
    assert outstanding(runs([1.0, 9.0], [10.0, 10.0])) == []


def advice(rests, step=0.1):
    time = np.arange(rests.size) * step
    return noise_advice({"speed": [rests]}, {"speed": [time]})


def lasting(new, kept):
    out = np.zeros(new.size)
    for i, value in enumerate(new):
        out[i] = kept * out[i - 1] + value
    return out


@pytest.mark.parametrize("noise_model", NOISE_MODELS)
@pytest.mark.parametrize("loss", LOSSES)
def test_the_law_of_the_noise_is_recommended(noise_model, loss):
    rng = np.random.default_rng(1)
    for _ in range(10):
        new = rng.standard_t(4, 600) if loss == "student_t" else rng.normal(size=600)
        found = advice(lasting(new, 0.8) if noise_model == "ar1" else new)
        assert (found.noise_model, found.loss) == (noise_model, loss)
        assert min(found.bic.values()) == 0.0


@pytest.mark.thorough
def test_white_noise_is_rarely_taken_for_more():
    rng = np.random.default_rng(2)
    wrong = sum(advice(rng.normal(size=400)).noise_model != "white" for _ in range(200))
    # the criterion errs where a likelihood ratio exceeds log(400) = 6: one-sided, 0.7 %
    assert wrong <= 6  # more than 6 of 200 at 0.7 %: once in 1000


def test_correlation_time_and_widening_are_told():
    rng = np.random.default_rng(3)
    found = advice(lasting(rng.normal(size=5000), 0.8))
    assert found.correlation["speed"] == pytest.approx(-0.1 / np.log(0.8), rel=0.15)
    assert found.widening["speed"] == pytest.approx(3.0, rel=0.1)
    assert "noise_model='ar1'" in found.sentence
    assert "3" in found.sentence


def test_gaps_of_missing_samples_do_not_matter():
    rng = np.random.default_rng(4)
    rests = lasting(rng.normal(size=4000), 0.8)
    rests[rng.random(4000) < 0.3] = np.nan
    assert advice(rests).correlation["speed"] == pytest.approx(-0.1 / np.log(0.8), rel=0.2)


def test_costs_are_those_of_scipy():
    rests = np.random.default_rng(5).standard_t(4, 300)
    level = np.sqrt(np.mean(rests**2))
    cost = LOSSES["gaussian"].level_cost(rests)
    assert cost == pytest.approx(-norm(scale=level).logpdf(rests).sum())
    scale = student.fit(rests, f0=4, floc=0)[2]
    least = -student(4, scale=scale).logpdf(rests).sum()
    assert LOSSES["student_t"].level_cost(rests) == pytest.approx(least, rel=1e-6)

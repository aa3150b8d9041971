"""The sandwich covariance: equal to the plain one under white noise, honest where it is not."""

from dataclasses import replace

import numpy as np
import pytest
from posterior_cases import sample_scores, sandwich_module, summed
from problems import problem_of, solve
from reference import noise
from short_logs import MODEL, TRUE, TwiceTheSame, fitted, made_log

import diffthrust as dft
from diffthrust.uncertainty import sandwich


@pytest.mark.thorough
def test_scores_sum_to_the_gradient_and_their_curvature_is_the_fits():
    logs = [made_log(seed=1), made_log(seed=2, count=250)]
    fit = fitted(logs)
    problem, z = problem_of(fit, logs)
    away = z + np.linspace(0.01, 0.02, z.size)
    told = sample_scores(problem, away)
    q = solve(problem, away, budget=1).quadratic
    total = np.zeros(z.size)
    for value, place in zip(told.values, told.places, strict=True):
        total[place] += value.sum(axis=(0, 2))
    np.testing.assert_allclose(total, q.gradient, rtol=1e-9)
    np.testing.assert_allclose(told.curvature, q.information, rtol=1e-9, atol=1e-9)
    assert [v.shape[2] for v in told.values] == [400, 250]


@pytest.mark.thorough
def test_white_noise_leaves_the_standard_errors_as_they_are():
    """On 8000 samples the ratio of the two is within 8 % of one.

    A variance of scores on n samples has a relative standard deviation of about sqrt(4 / n), 2 %,
    its root 1 %, and prewhitening adds as much again: 8 % is beyond four deviations for each of
    three parameters.
    """
    log = made_log(seed=3, count=8000)
    told = sandwich(fitted(log), log)
    for name in TRUE:
        assert told.inflation[name] == pytest.approx(1.0, abs=0.08)
        assert told.memory[name] < 1.2
    assert told.block_seconds == pytest.approx(told.block * 0.05)


def test_known_least_squares_case_has_whites_covariance():
    """A straight line with noise that grows with depth: White 1980 in closed form."""
    rng = np.random.default_rng(4)
    depth = rng.uniform(0.0, 3.0, 4000)  # shuffled: no correlation in time
    volts = 0.19 * depth - 0.097 + 0.02 * depth * rng.standard_normal(depth.size)
    log = dft.Log(time=np.arange(4000.0), inputs={"depth": depth}, measured={"reading": volts})
    told = sandwich(dft.fit(dft.LinearSensor(), log, starts=1), log)
    design = np.stack([depth, np.ones_like(depth)], axis=1)
    inverse = np.linalg.inv(design.T @ design)
    rest = volts - design @ (inverse @ design.T @ volts)
    white = inverse @ (design.T * rest**2) @ design @ inverse
    np.testing.assert_allclose(
        np.sqrt(np.diagonal(told.covariance)), np.sqrt(np.diagonal(white)), rtol=0.08
    )
    assert told.inflation["offset"] < 0.7  # small where the line is pinned down


@pytest.mark.slow
def test_logs_are_independent_of_each_other():
    """The same log twice halves the variance: nothing is carried from one to the other."""
    log = made_log(seed=5, count=1600, correlation=0.8)
    one, two = sandwich(fitted(log), log), sandwich(fitted([log, log]), [log, log])
    ratio = np.diagonal(two.covariance) / np.diagonal(one.covariance)
    np.testing.assert_allclose(ratio, 0.5, rtol=0.06)


def test_a_parameter_at_a_bound_has_no_error_and_the_others_have_theirs():
    model = MODEL.replace(alpha={"value": 0.05, "bounds": (0.045, 0.2)})
    log = made_log(seed=6)
    told = sandwich(dft.fit(model, log, starts=1), log)
    assert told.std_errors["alpha"] is None
    assert told.interval("alpha") is None
    assert np.isnan(told.covariance[0]).all()
    assert told.std_errors["beta"] > 0
    assert told.to_json()["covariance"][0][0] is None


@pytest.mark.thorough
def test_parameters_that_cannot_be_told_apart_have_no_error():
    log = made_log(seed=7)
    fit = dft.fit(MODEL + TwiceTheSame(), log, starts=1)
    told = sandwich(fit, log)
    assert told.std_errors["beta"] is None
    assert told.std_errors["drive_gain.gain"] is None
    assert told.std_errors["alpha"] > 0


def test_a_prior_counts_as_a_measurement():
    prior = MODEL.replace(ct={"prior": dft.models.Normal(mean=0.02, std=1e-6)})
    log = made_log(seed=8)
    told = sandwich(dft.fit(prior, log, starts=1), log)
    assert told.std_errors["ct"] == pytest.approx(1e-6, rel=0.01)


@pytest.mark.parametrize(
    "status", [dft.estimation.Status.NOT_CONVERGED, dft.estimation.Status.SIMULATION_FAILED]
)
def test_a_fit_that_is_at_no_optimum_is_refused(status):
    log = made_log(seed=1)
    with pytest.raises(dft.InputError, match=f"sandwich.*{status.value}"):
        sandwich(replace(fitted(log), status=status), log)


def test_correlated_noise_is_seen():
    log = made_log(seed=9, correlation=0.8)
    fit = fitted(log)
    told = sandwich(fit, log)
    assert all(1.5 < told.inflation[name] < 6.0 for name in TRUE)
    assert sample_scores(*problem_of(fit, log)).lag_one() == pytest.approx(0.8, abs=0.1)
    low, high = told.interval("alpha")
    width = 2 * 1.96 * told.std_errors["alpha"]
    assert width < high - low < 1.4 * width


def test_the_scatter_of_a_first_order_series_is_its_long_run_variance():
    """Against the closed form 1 / (1 - a)^2, on 20 000 samples, within 15 %."""
    series = np.stack([noise.ar1(np.random.default_rng(s), 20_000, 1.0, 0.8) for s in (0, 1)])
    scatter, _, memory, degrees = summed([series[None, :, :12_000], series[None, :, 12_000:]])
    expected = 20_000 * (1 + 0.8) / (1 - 0.8)
    np.testing.assert_allclose(np.diagonal(scatter), expected, rtol=0.15)
    assert abs(scatter[0, 1]) < 0.1 * expected
    np.testing.assert_allclose((memory - 1) / (memory + 1), 0.8, atol=0.02)
    assert np.all(degrees > 500)


@pytest.mark.parametrize("a", [-0.4, 0.1, 0.3, 0.7])
def test_blocks_are_as_long_as_a_first_order_series_asks(a):
    """Andrews 1991: 1.1447 (alpha(1) n)^(1/3), with alpha(1) = 4 a^2 / ((1 - a)^2 (1 + a)^2)."""
    asked = 1.1447 * (4 * a**2 / (1 - a**2) ** 2 * 5000) ** (1 / 3)
    assert sandwich_module._block(np.array([a]), 5000) == pytest.approx(asked)
    assert sandwich_module._block(np.array([a, np.nan, a]), 5000) == pytest.approx(asked)
    assert sandwich_module._block(np.array([0.0, a]), 5000) < asked


def test_few_samples_that_last_have_a_wide_interval_and_not_an_endless_one():
    series = noise.ar1(np.random.default_rng(0), 26, 1.0, 0.95)[None]
    scatter, _, memory, degrees = summed([series[None]])
    assert np.isfinite(scatter).all()
    assert degrees[0] == 2.0
    assert memory[0] <= 26 / 4 + 1e-9


def test_a_channel_read_at_every_fifth_sample_is_as_correlated_as_its_readings():
    """Two channels on one grid: the scatter of the slow one is that of its own series."""
    rng = np.random.default_rng(3)
    fast, slow = noise.ar1(rng, 20_000, 1.0, 0.2), noise.ar1(rng, 4000, 1.0, 0.8)
    run = np.full((2, 1, 20_000), np.nan)
    run[0, 0], run[1, 0, ::5] = fast, slow
    scatter, _, memory, _ = summed([run])
    expected = 20_000 * 1.2 / 0.8 + 4000 * 1.8 / 0.2
    np.testing.assert_allclose(scatter[0, 0], expected, rtol=0.15)
    assert 1.2 / 0.8 < memory[0] < 1.8 / 0.2


@pytest.mark.thorough
def test_noise_that_two_sensors_share_counts_twice():
    shared = noise.ar1(np.random.default_rng(4), 20_000, 1.0, 0.5)
    scatter, *_ = summed([np.stack([shared[None], shared[None]])])
    np.testing.assert_allclose(scatter[0, 0], 4 * 20_000 * 3, rtol=0.15)

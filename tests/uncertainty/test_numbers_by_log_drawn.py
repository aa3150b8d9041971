"""Numbers that differ by log: intervals, draws, and predictions of a log that is not known."""

import numpy as np
import pytest
from offsets_by_log import NOISE, fitted, readings

import diffthrust as dft


@pytest.fixture(scope="module")
def logs():
    rng = np.random.default_rng(7)
    return readings(rng, rng.normal(1.0, 0.4, 4))


@pytest.fixture(scope="module")
def fit(logs):
    return fitted(logs)


def test_draws_by_log_are_as_wide_as_the_standard_errors(fit, logs):
    post = dft.sample(fit, logs, draws=600, warmup=300)
    drawn = post.posterior["per_log.offset"]
    assert [*drawn.coords["log"].values] == [log.name for log in logs]
    for k, value in enumerate(fit.per_log["offset"].values.values()):
        ours = drawn.values[..., k]
        assert np.mean(ours) == pytest.approx(value.value, abs=0.2 * value.std_error)
        assert np.std(ours) == pytest.approx(value.std_error, rel=0.1)
    mean = fit.parameters["offset"]
    assert np.std(post.posterior["offset"].values) == pytest.approx(mean.std_error, rel=0.15)


def test_intervals_have_a_row_for_each_log(fit, logs):
    found = dft.intervals(fit, logs)
    value = fit.per_log["offset"].values["run2"]
    row = found["offset in run2"]
    assert row.best.low == pytest.approx(value.value - 1.96 * value.std_error, rel=1e-3)
    assert "offset in run2" in found.report()
    # the mean of a few logs is known by their number: sandwich and profile are near the covariance
    assert found["offset"].intervals["profile"].high == pytest.approx(
        found["offset"].intervals["covariance"].high, rel=1e-3
    )
    assert dft.uncertainty.sandwich(fit, logs).inflation["offset"] == pytest.approx(1.0, abs=0.1)


def test_a_prediction_of_a_new_log_is_as_wide_as_the_logs_are(fit, logs):
    predicted = dft.predict(fit, logs[0], draws=400)
    width = np.hypot(fit.per_log["offset"].width, fit.parameters["offset"].std_error)
    band = predicted.channels["reading"]
    half = 0.5 * np.median(band.noisy_high - band.noisy_low)
    assert half == pytest.approx(1.96 * np.hypot(width, NOISE), rel=0.15)
    assert "a log of which nothing is known" in predicted.report()

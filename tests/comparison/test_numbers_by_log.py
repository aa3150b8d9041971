"""Numbers that differ by log: those of unseen logs, of the first part of each."""

import numpy as np
import pytest
from offsets_by_log import NOISE, fitted, readings

import diffthrust as dft


def made(seed=2, **options):
    rng = np.random.default_rng(seed)
    return readings(rng, rng.normal(1.0, 0.4, 6), **options)


def test_an_unseen_log_has_the_value_of_its_first_quarter():
    logs = made(samples=80)
    fit = fitted(logs[:5], holdout=logs[5:])
    (run,) = dft.compare(fit, logs[5:]).runs
    first = logs[5].time <= 0.25 * logs[5].time[-1]
    slope, mean = fit.parameters["slope"].value, fit.parameters["offset"].value
    apart = (logs[5].measured["reading"] - slope * logs[5].inputs["depth"] - mean)[first]
    # the posterior of a Gaussian about the mean, with the noise that the logs state
    weight = apart.size / NOISE**2
    value = mean + weight * apart.mean() / (weight + fit.per_log["offset"].width ** -2)
    assert run.start["offset"] == pytest.approx(value, rel=1e-3)
    assert run.differing == ("offset",)


def test_two_samples_count_by_the_noise_of_the_fit():
    rng = np.random.default_rng(51)
    logs = readings(rng, rng.normal(1.0, 0.05, 6), samples=80, known=False)
    fit = fitted(logs[:5])
    short = logs[5].slice(0.0, 6.5)  # two of seven samples are in the first quarter
    slope, mean = fit.parameters["slope"].value, fit.parameters["offset"].value
    apart = short.measured["reading"] - slope * short.inputs["depth"] - mean
    weight = 2.0 / fit.noise["reading"] ** 2
    value = mean + weight * apart[:2].mean() / (weight + fit.per_log["offset"].width ** -2)
    (run,) = dft.compare(fit, short).runs
    assert run.start["offset"] == pytest.approx(value, rel=1e-4)
    # of a model alone by what least squares leave of two samples: one is free
    noise = np.std(apart[:2], ddof=1)
    weight = 2.0 / noise**2
    value = mean + weight * apart[:2].mean() / (weight + fit.per_log["offset"].width ** -2)
    (run,) = dft.compare(fit.model, short).runs
    assert run.start["offset"] == pytest.approx(value, rel=1e-3)


def test_what_comes_after_the_first_quarter_moves_nothing():
    logs = made(samples=80)
    fit, unseen = fitted(logs[:5]), logs[5]
    reading = np.where(unseen.time > 0.25 * unseen.time[-1], 7.0, unseen.measured["reading"])
    spoilt = unseen.replaced(measured={"reading": reading})
    whole, changed = (dft.compare(fit, log).runs[0].start["offset"] for log in (unseen, spoilt))
    assert whole == changed


def test_a_first_quarter_that_tells_nothing_leaves_the_value_at_the_mean():
    logs = made(samples=80)
    fit, unseen = fitted(logs[:5]), logs[5]
    reading = np.where(unseen.time < 0.5 * unseen.time[-1], np.nan, unseen.measured["reading"])
    (run,) = dft.compare(fit, unseen.replaced(measured={"reading": reading})).runs
    assert run.start["offset"] == pytest.approx(fit.parameters["offset"].value)


def test_reports_say_where_the_value_of_an_unseen_log_is_from():
    logs = made()
    fit = fitted(logs[:5], holdout=logs[5:])
    said = "Estimated from the first 25 % of each run"
    assert said in fit.report()
    assert said in " ".join(dft.compare(fit, logs[5:]).report().split())
    assert fit.holdout.channels["reading"].rmse < 1.5 * NOISE


def test_a_log_of_the_fit_keeps_its_value():
    logs = made()
    fit = fitted(logs[:5])
    comparison = dft.compare(fit, logs[:5])
    assert comparison.errors.nrmse == pytest.approx(fit.train.nrmse, rel=1e-12)
    assert fit.own_numbers(logs[1])["offset"] == fit.per_log["offset"].values["run1"].value
    assert "Estimated from" not in comparison.report()


def test_a_positive_number_stays_positive_and_it_is_said_where_it_is_unusual():
    rng = np.random.default_rng(31)
    logs = readings(rng, [1.0] * 5, samples=80)
    logs = [
        log.replaced(measured={"reading": log.measured["reading"] + factor * log.inputs["depth"]})
        for log, factor in zip(logs, (0.8, 0.9, 1.0, 1.1, 0.95), strict=True)
    ]
    model = dft.LinearSensor(slope=1.0, offset=1.0).fix("offset")
    model = model.replace(slope={"bounds": (0, None), "transform": "log"})
    fit = dft.fit(model, logs[:4], per_log=["slope"], starts=1)
    usual = dft.compare(fit, logs[4])
    assert usual.runs[0].start["slope"] == pytest.approx(1.15, abs=0.05)
    assert "widths from the mean" not in usual.report()
    turned = logs[4].replaced(measured={"reading": 2.0 - logs[4].measured["reading"]})
    comparison = dft.compare(fit, turned)  # a sensor of the wrong sign
    assert 0.0 < comparison.runs[0].start["slope"] < usual.runs[0].start["slope"]
    assert "widths from the mean" in " ".join(comparison.report().split())
    assert comparison.errors.channels["reading"].nrmse > 0.9


def test_a_value_of_an_unseen_log_ends_at_a_bound():
    logs = made(samples=80)
    fit = fitted(logs[:5])
    high = fit.parameters["offset"].value + 0.1
    far = logs[5].replaced(measured={"reading": logs[5].measured["reading"] + 1.0})
    comparison = dft.compare(fit.model.replace(offset={"bounds": (None, high)}), far)
    assert comparison.runs[0].start["offset"] == high
    assert "at its bound" in " ".join(comparison.report().split())

"""Thresholds, recommendations and sentences of intervals, on both sides of each limit."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from posterior_cases import (
    PROFILE,
    Evidence,
    Interval,
    heading,
    intervals_module,
    sentences,
    threshold_of,
)
from problems import AR1
from scipy.stats import chi2, f, norm
from scipy.stats import t as student


def problem(known=(False,), counts=(40.0, 23.0), closed=True, lasts=False, independent=30.0):
    noise = SimpleNamespace(lasts=lasts, independent=lambda channels, numbers, values: independent)
    return SimpleNamespace(
        layout=SimpleNamespace(
            likelihood=SimpleNamespace(noise=noise, law=SimpleNamespace(closed=closed)),
            known_noise=known,
            channels=("speed",),
        ),
        numbers=SimpleNamespace(counts=np.array(counts)),
        values=lambda z: {},
        own=("a", "b"),
        local=3,
    )


@pytest.mark.parametrize("level", [0.5, 0.95, 0.99])
def test_the_drop_that_ends_an_interval(level):
    z = np.zeros(4)
    plain = chi2.ppf(level, 1)
    for case in (problem(known=(False, True)), problem(closed=False), problem(counts=(3.0, 1.0))):
        assert threshold_of(case, z, level) == pytest.approx(plain, rel=1e-12)
    # a level that was estimated: twice the drop is n log(1 + F / (n - k))
    ratio = f.ppf(level, 1, 59)
    expected = 63.0 * math.log(1.0 + ratio / 59.0)
    assert threshold_of(problem(), z, level) == pytest.approx(expected, rel=1e-6)
    one = 5.0 * math.log(1.0 + f.ppf(level, 1, 1) / 1.0)
    assert threshold_of(problem(counts=(3.0, 2.0)), z, level) == pytest.approx(one, rel=1e-6)
    lasting = student.ppf(0.5 + 0.5 * level, 15) ** 2 * 30.0 / 25.0
    assert threshold_of(problem(lasts=True), z, level) == pytest.approx(lasting, rel=1e-6)
    few = student.ppf(0.5 + 0.5 * level, 2.5) ** 2 * 5.0 / 1.0
    case = problem(lasts=True, independent=5.0)
    assert threshold_of(case, z, level) == pytest.approx(few, rel=1e-3)


@pytest.mark.parametrize("level", [0.5, 0.95])
def test_how_far_a_standard_error_reaches(level):
    z, tail, reach = np.zeros(4), 0.5 + 0.5 * level, intervals_module._reach
    assert reach(problem(), z, level) == pytest.approx(student.ppf(tail, 59), rel=1e-6)
    for case in (problem(known=(True,)), problem(closed=False), problem(counts=(3.0, 1.0))):
        assert reach(case, z, level) == pytest.approx(norm.ppf(tail), rel=1e-6)
    lasting = problem(lasts=True)
    root = math.sqrt(threshold_of(lasting, z, level))
    assert reach(lasting, z, level) == pytest.approx(root, rel=1e-12)


def test_how_wide_a_sandwich_must_be_to_be_believed():
    def wider(ratio, degrees):
        robust = SimpleNamespace(inflation={"a": ratio}, degrees=degrees)
        return intervals_module._wider(robust, "a"), intervals_module._chance(robust, "a")

    assert wider(None, {}) == (False, 0.0)
    assert wider(1.2499, {})[0] is False
    assert wider(1.2501, {})[0] is True
    # three relative standard deviations of a spread of 50 degrees of freedom
    assert wider(1.5499, {"a": 50.0}) == (False, pytest.approx(0.3))
    assert wider(1.5501, {"a": 50.0})[0] is True


def test_draws_leave_out_equal_shares():
    values = np.random.default_rng(0).normal(size=(3, 500))
    posterior = SimpleNamespace(posterior={"a": SimpleNamespace(values=values)})
    low, high = intervals_module._drawn(posterior, "a", 0.9)
    assert (low, high) == tuple(np.quantile(values, [0.05, 0.95]))
    assert intervals_module._judged(SimpleNamespace()) == []
    assert intervals_module._judged(SimpleNamespace(attrs={"status": "converged"})) == []
    stuck = SimpleNamespace(attrs={"status": "stuck", "message": "One chain is stuck."})
    assert intervals_module._judged(stuck) == ["Posterior: One chain is stuck."]
    assert intervals_module._judged(SimpleNamespace(attrs={"status": "stuck"})) == [
        "Posterior: stuck"
    ]


# Sentences on disagreement.


def evidence(profile=None, std_error=0.25, at_bound=False, **more):
    estimate = SimpleNamespace(at_bound=at_bound, std_error=std_error)
    given = {
        "fit": SimpleNamespace(parameters={"a": estimate}),
        "profile": replace(PROFILE, **{"high": 2.5, "bounds": (None, None), **(profile or {})}),
        "intervals": {"profile": Interval(1.5, 2.5)},
        "inflation": 1.0,
        "chance": 0.0,
        "correlation": 0.0,
        "prior": False,
        "recommended": "profile",
        **more,
    }
    return " ".join(sentences(Evidence(**given)))


def test_where_all_agree_nothing_is_said():
    assert evidence() == ""
    assert evidence(inflation=1.249) == evidence(inflation=1 / 1.249) == ""
    assert evidence(inflation=None) == ""
    assert (
        evidence(intervals={"profile": Interval(1.5, 2.5), "posterior": Interval(1.41, 2.59)}) == ""
    )


def test_no_standard_error():
    assert evidence(at_bound=True).startswith("a lies at its bound: it has no standard error")
    assert evidence(std_error=None).startswith("a has no standard error: these logs cannot")


def test_open_ends():
    open_end = {"low": None, "open_low": "never falls"}
    assert evidence(open_end) == "a: downwards the profile is open; never falls."
    assert "upwards the profile is open; up there." in evidence(
        {"high": None, "open_high": "up there"}
    )
    bound = {"low": None, "open_low": "reaches the bound 0.5", "bounds": (0.5, None)}
    told = evidence(bound)
    assert told == "a: downwards the profile is open; it reaches the bound 0.5."
    assert "open" not in evidence(bound, at_bound=True)  # that it lies there has been said


def arms(low, high, **more):
    told = {"inflation": None, "intervals": {"profile": Interval(low, high)}, **more}
    return evidence({"low": low, "high": high}, **told)


def test_lopsided_profiles():
    assert arms(1.5, 2.57) == arms(1.5, 2.44) == ""
    assert "reaches 1.2 times as far up as the other way" in arms(1.5, 2.58)
    assert "reaches 1.2 times as far down as the other way" in arms(1.5, 2.43)
    assert "not quadratic there, for b and c may meet a bound, and" in arms(
        1.5, 3.0, met=("b", "c")
    )
    assert arms(1.5, 3.0).endswith("symmetric by construction.")
    wide = arms(1.5, 3.0, recommended="sandwich")
    assert wide.endswith("expect the same of the truth, within the width of the sandwich.")


@pytest.mark.parametrize(
    ("said", "words"),
    [
        ({"inflation": 1.4, "correlation": 0.3}, "times as wide as the covariance: residuals "
         "are correlated from sample to sample (0.30)."),
        ({"inflation": 1.4, "chance": 0.41}, "no more than chance gives on so few samples."),
        ({"inflation": 1.4, "chance": 0.39}, "residuals are large, or last long, where"),
        ({"inflation": 0.7}, "residuals are small where this parameter acts most, or alternate"),
        ({"inflation": 0.7, "chance": 0.31}, "no more than chance"),
        ({"inflation": 1.251}, "1.3 times as wide"),
        ({"inflation": 1 / 1.251}, "0.8 times as wide"),
    ],
)  # fmt: skip
def test_inflated_sandwiches(said, words):
    assert words in evidence(**said)


def posterior(low, high, **more):
    return evidence(
        intervals={"profile": Interval(1.5, 2.5), "posterior": Interval(low, high)}, **more
    )


def test_a_posterior_that_is_apart():
    # an arm is 0.5 long, a fifth of it 0.1
    assert posterior(1.401, 2.599) == ""
    assert "differ at the lower end: a bound or the prior cuts" in posterior(1.399, 2.5)
    assert "differ at the upper end" in posterior(1.5, 2.399)
    assert "differ at both ends" in posterior(1.3, 2.7)
    assert "the draws follow the density of the prior" in posterior(1.3, 2.7, prior=True)
    drawn = {"profile": Interval(1.5, 3.0), "posterior": Interval(1.2, 3.0)}
    assert "a posterior averages over the other parameters" in arms(1.5, 3.0, intervals=drawn)
    drawn = {"profile": Interval(1.0, 2.5), "posterior": Interval(1.0, 2.8)}
    assert "a posterior averages over the other parameters" in arms(1.0, 2.5, intervals=drawn)
    open_end = {"profile": Interval(None, 2.5), "posterior": Interval(-9.0, 2.5)}
    assert "posterior" not in arms(None, 2.5, intervals=open_end)


def test_the_heading_gives_the_reason():
    def told(lag, correlated, sandwich, noise="white", likelihood="simulation", states=("x",)):
        fit = SimpleNamespace(
            noise_model=noise, likelihood=likelihood, model=SimpleNamespace(states=states)
        )
        return heading(fit, lag, correlated, sandwich)

    assert (
        told(0.02, False, False) == "Residuals are white, as the fit takes them: take the profile."
    )
    assert "but not of one size or law" in told(0.02, False, True)
    assert told(0.31, True, True).startswith(
        "Residuals are correlated from sample to sample (0.31)"
    )
    assert 'or fit with noise_model="ar1"' in told(0.31, True, True)
    assert 'noise_model="ar1"' not in told(0.31, True, True, likelihood="innovations")
    assert 'noise_model="ar1"' not in told(0.31, True, True, states=())
    assert told(0.31, True, True, AR1.word).endswith("something is missing from the model.")
    assert told(0.31, True, True, AR1.word).startswith("What is new in the noise is correlated")
    assert told(0.0, False, False, AR1.word).startswith(
        "What is new in the noise at each sample is"
    )

"""Intervals side by side: which is recommended, and the reasons given where they disagree."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from short_logs import MODEL, TRUE, fitted, made_log
from test_profile import Saturating, curve_log

import diffthrust as dft
from diffthrust.uncertainty import intervals, profile, sandwich


def drawn(fit, widen=1.0, seed=0):
    """An object like ArviZ's, with draws of the normal law of the covariance."""
    mean = [fit.parameters[n].value for n in fit.free]
    rng = np.random.default_rng(seed)
    values = rng.multivariate_normal(mean, widen**2 * fit.covariance, size=(4, 2000))
    group = {n: SimpleNamespace(values=values[..., i]) for i, n in enumerate(fit.free)}
    return SimpleNamespace(posterior=group, attrs={"status": "converged"})


def test_under_white_noise_all_agree_and_the_profile_is_recommended():
    log = made_log(seed=1)
    fit = fitted(log)
    found = intervals(fit, log, drawn(fit))
    assert found.methods == ("covariance", "sandwich", "profile", "posterior")
    assert found.correlation == 0.0
    assert not found.sentences
    assert "They agree." in found.report()
    assert "take the profile" in found.notes[0]
    for name in TRUE:
        row, error = found[name], fit.parameters[name].std_error
        assert row.recommended == "profile"
        assert row.best == row.intervals["profile"]
        ends = np.array([row.intervals[m] for m in found.methods], float)
        assert np.all(np.ptp(ends, axis=0) < 0.4 * error)


def test_the_same_numbers_as_the_calls_behind_it():
    log = made_log(seed=1)
    fit = fitted(log)
    found = intervals(fit, log, level=0.9)
    one, robust = profile(fit, log, level=0.9), sandwich(fit, log)
    for name in TRUE:
        assert found[name].intervals["profile"] == pytest.approx((one[name].low, one[name].high))
        assert found[name].intervals["sandwich"] == pytest.approx(robust.interval(name, 0.9))


def test_correlated_residuals_make_the_sandwich_the_one_to_take():
    log = made_log(seed=2, correlation=0.8)
    found = intervals(fitted(log), log)
    assert found.correlation == pytest.approx(0.8, abs=0.1)
    assert all(row.recommended == "sandwich" for row in found.rows.values())
    assert 'noise_model="ar1"' in found.notes[0]
    assert any("times as wide as the covariance" in s for s in found["beta"].sentences)
    assert any("correlated" in s for s in found["beta"].sentences)


@pytest.mark.slow
def test_a_noise_model_that_accounts_for_it_is_asked_for_its_profile():
    log = made_log(seed=2, correlation=0.8)
    found = intervals(dft.fit(MODEL, log, starts=1, noise_model="ar1"), log)
    assert all(row.recommended == "profile" for row in found.rows.values())
    assert "What is new in the noise" in found.notes[0]
    plain = intervals(fitted(log), log)
    for name in TRUE:
        low, high = found[name].best
        naive = plain[name].intervals["profile"]
        assert high - low > naive.high - naive.low


def test_a_lopsided_profile_is_explained():
    log = curve_log()
    fit = dft.fit(Saturating(), log, starts=4)
    found = intervals(fit, log, drawn(fit))
    told = " ".join(found["half"].sentences)
    assert "not quadratic" in told
    assert "posterior and profile differ" in told
    assert "chance" in told  # eight samples: the sandwich is uncertain
    assert found["half"].recommended == "profile"


def test_a_parameter_at_its_bound_has_only_a_profile():
    model = MODEL.replace(alpha={"value": 0.05, "bounds": (0.045, 0.2)})
    log = made_log(seed=6)
    found = intervals(dft.fit(model, log, starts=1), log)
    row = found["alpha"]
    assert set(row.intervals) == {"profile"}
    assert row.recommended == "profile"
    assert row.bounds == (pytest.approx(0.045), None)
    assert row.best.low is None
    assert row.best.high > 0.045
    assert row.best.holds(0.045)
    assert "lies at its bound" in row.sentences[0]
    assert "bound to" in found.report()
    assert found.to_json()["parameters"]["alpha"]["intervals"]["profile"][0] is None
    assert len(found.plot().axes) == 3


@pytest.mark.slow
def test_a_bound_that_another_parameter_meets_makes_a_profile_lopsided():
    log = made_log(seed=1)
    model = MODEL + dft.effects.EFFECTS["command_deadband"]()
    found = intervals(dft.fit(model, log, starts=4), log)
    row = found["command_deadband.half_width"]
    assert row.bounds == (0.0, None)
    assert "downwards the profile is open; it reaches the bound 0." in row.sentences[0]
    assert "for command_deadband.half_width may meet a bound" in " ".join(found["beta"].sentences)


def test_an_open_end_is_told():
    log = curve_log(depth=0.1 * np.array([0.1, 0.2, 0.35, 0.5, 0.8, 1.1, 1.5, 2.0]), seed=2)
    found = intervals(dft.fit(Saturating(), log, starts=4), log)
    told = " ".join(found["half"].sentences)
    assert "the likelihood never falls far enough" in told
    assert "cannot tell it from others" in told
    assert "open" in found.report()
    assert found.directions[1].grade == "not known at all"


def test_a_posterior_that_differs_is_told_and_a_chain_that_did_not_converge():
    prior = MODEL.replace(ct={"prior": dft.models.Normal(mean=0.02, std=1e-3)})
    log = made_log(seed=3)
    fit = dft.fit(prior, log, starts=1)
    wide = drawn(fit, widen=1.5)
    wide.attrs = {"status": "not_converged", "message": "The chains are too short."}
    found = intervals(fit, log, wide)
    assert "density of the prior" in " ".join(found["ct"].sentences)
    assert "both ends" in " ".join(found["alpha"].sentences)
    assert "Posterior: The chains are too short." in found.notes


def test_noise_that_grows_with_the_signal_calls_for_the_sandwich():
    rng = np.random.default_rng(4)
    depth = rng.uniform(-3.0, 3.0, 4000)
    volts = 0.19 * depth - 0.097 + 0.02 * depth**2 * rng.standard_normal(depth.size)
    log = dft.Log(time=np.arange(4000.0), inputs={"depth": depth}, measured={"reading": volts})
    found = intervals(dft.fit(dft.LinearSensor(), log, starts=1), log)
    assert found["slope"].recommended == "sandwich"
    assert "not of one size" in found.notes[0]
    assert "where this parameter acts most" in found["slope"].sentences[0]


class Marked(dict):
    """Draws that say of which fit they are."""

    attrs = {"fit": "of another"}


@pytest.mark.parametrize(
    ("posterior", "match"),
    [
        (SimpleNamespace(posterior=Marked()), "drawn from another fit"),
        (SimpleNamespace(posterior={}), "alpha"),
        (object(), "posterior"),
        (
            SimpleNamespace(
                posterior={n: SimpleNamespace(values=np.array([[1.0, np.nan]])) for n in TRUE}
            ),
            "finite",
        ),
    ],
)
def test_a_posterior_that_cannot_be_used_is_refused(posterior, match):
    log = made_log(seed=1)
    with pytest.raises(dft.InputError, match=match):
        intervals(fitted(log), log, posterior)


def test_a_fit_that_failed_and_a_level_that_is_none_are_refused():
    log = made_log(seed=1)
    fit = fitted(log)
    with pytest.raises(dft.InputError, match="intervals"):
        intervals(replace(fit, status=dft.estimation.Status.NOT_CONVERGED), log)
    with pytest.raises(dft.InputError, match="level"):
        intervals(fit, log, level=95)

"""Which law of noise is recommended, and how often white noise is taken for more; seeded."""

import numpy as np
import pytest
from problems import LOSSES, NOISE_MODELS
from scipy.stats import norm
from scipy.stats import t as student

from diffthrust.comparison._noise_advice import noise_advice  # private: made residuals alone


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

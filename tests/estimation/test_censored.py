"""Samples at a rail taken as "at least": held against an independent likelihood, and the truth."""

import numpy as np
import pytest
from reference import inputs, thruster
from scipy.optimize import minimize
from scipy.stats import norm

import diffthrust as dft

CT = thruster.JASON["ct"]


def clipped(seed, *, share=0.15, noise=3.0, low=-np.inf, **told):
    """A log of the reference thruster whose load cell ends below a share of the true thrust."""
    rng, time = np.random.default_rng(seed), inputs.grid(20.0, 0.02)
    command = inputs.multisine(time, 2.0, (0.07, 0.21, 0.47), rng)
    record = thruster.simulate(time, command, method="rk4", substeps=4)
    truth, high = record.truth, float(np.quantile(record.truth["thrust"], 1.0 - share))
    speed = truth["speed"] + 0.5 * rng.standard_normal(time.size)
    thrust = np.clip(truth["thrust"] + noise * rng.standard_normal(time.size), low, high)
    log = dft.Log(time, {"command": command}, {"speed": speed, "thrust": thrust}, **told)
    return log, truth["speed"], high


def tobit(speed, thrust, low, high):
    """ct, the level of the noise and the standard error of ct by SciPy, of thrust = ct n |n|."""
    drive = speed * np.abs(speed)
    above, below = thrust >= high, thrust <= low

    def cost(x):
        rest, level = thrust - 0.02 * x[0] * drive, np.exp(x[1])
        each = -norm.logpdf(rest, scale=level)
        each[above] = -norm.logsf(rest[above], scale=level)
        each[below] = -norm.logcdf(rest[below], scale=level)
        return each.sum()

    found = minimize(cost, [1.0, 1.0], method="Nelder-Mead", options={"xatol": 1e-8, "fatol": 1e-9})
    x, h = found.x, 1e-3
    steps = h * np.eye(2)
    hessian = [
        [
            (cost(x + a + b) - cost(x + a - b) - cost(x - a + b) + cost(x - a - b)) / (4 * h * h)
            for a in steps
        ]
        for b in steps
    ]
    error = np.sqrt(np.linalg.inv(np.array(hessian))[0, 0])
    return 0.02 * x[0], np.exp(x[1]), 0.02 * error


@pytest.mark.thorough
@pytest.mark.parametrize("low", [-np.inf, -9.0])
def test_the_fit_is_that_of_an_independent_tobit(low):
    log, speed, high = clipped(3, low=low)
    thrust = log.measured["thrust"]
    told = dft.Log(
        log.time,
        {"speed": speed},
        {"thrust": thrust},
        rails={"thrust": (low, high)},
        censored=("thrust",),
        hold="linear",
    )
    fit = dft.fit(dft.Thruster(), told, starts=1)
    ct, level, error = tobit(speed, thrust, low, high)
    assert fit.parameters["ct"].value == pytest.approx(ct, rel=1e-5)
    assert fit.noise["thrust"] == pytest.approx(level, rel=1e-5)
    assert fit.parameters["ct"].std_error == pytest.approx(error, rel=0.02)


def shares(seeds, **told):
    """The error of ct over its standard error, one for each seed."""
    out = []
    for seed in seeds:
        log, _, high = clipped(seed)
        rails = {"thrust": (-np.inf, high)}
        log = clipped(seed, rails=rails, **told)[0]
        ct = dft.fit(dft.Thruster(), log, starts=1, doubts=False).parameters["ct"]
        out.append((ct.value - CT) / ct.std_error)
    return np.array(out)


@pytest.mark.slow
def test_standard_errors_hold_under_censoring():
    """Of 40 fits 95 % within 1.96 standard errors; by chance 1 in 500 times fewer than 34."""
    off = shares(range(40), censored=("thrust",))
    assert np.sum(np.abs(off) < 1.96) >= 34
    assert abs(np.mean(off)) < 3.0 / np.sqrt(40)


def test_a_rail_that_is_not_told_is_found_and_no_longer_drags_ct_along():
    log, _, _ = clipped(0, noise=0.5)
    blind = log.replaced(rails={"thrust": (-np.inf, np.inf)})
    dragged, free = (dft.fit(dft.Thruster(), one, starts=1) for one in (blind, log))
    assert dragged.parameters["ct"].value < 0.93 * CT
    assert abs(free.parameters["ct"].value / CT - 1.0) < 0.01
    assert any("are ignored" in note for note in free.notes)
    (doubt,) = free.doubts
    assert (doubt.channel, doubt.kind) == ("thrust", "saturated")
    count = log.railed["thrust"].samples
    assert free.train.channels["thrust"].samples == len(log) - count
    assert dft.compare(free, log).errors.channels["thrust"].samples == len(log) - count


@pytest.mark.thorough
def test_a_fit_says_how_it_took_samples_at_a_rail():
    log = clipped(1, censored=("thrust",))[0]
    told = dft.fit(dft.Thruster(), log, starts=1)
    assert any("taken as 'at least' or 'at most'" in note for note in told.notes)
    for words in ({"loss": "student_t"}, {"noise_model": "ar1"}, {"likelihood": "innovations"}):
        other = dft.fit(dft.Thruster(), log, starts=1, **words)
        assert any("Only likelihood='simulation'" in note for note in other.notes), words


def test_intervals_of_a_censored_fit_agree():
    """Covariance, profile and sandwich, each its own use of the law."""
    log = clipped(2, censored=("thrust",))[0]
    fit = dft.fit(dft.Thruster(), log, starts=1)
    found = dft.intervals(fit, log).rows["ct"].intervals
    widths = {way: i.high - i.low for way, i in found.items()}
    assert len(widths) >= 3
    assert max(widths.values()) < 1.15 * min(widths.values())

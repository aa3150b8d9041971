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

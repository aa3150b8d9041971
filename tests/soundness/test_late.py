"""Readings that come late by a varying time, told from noise and from missing physics."""

import numpy as np
import pytest

import diffthrust as dft
from diffthrust.soundness._times import Readings, lateness  # private: the test's own rates

STEP, SAMPLES, SIGMA = 0.1, 1500, 0.1
TIME = STEP * np.arange(SAMPLES)


def followed(command, time_constant=0.8, band=0.0):
    """A first-order signal, by the exact step of a held command."""
    driven = np.sign(command) * np.maximum(np.abs(command) - band, 0.0)
    keep = np.exp(-STEP / time_constant)
    x = np.zeros(SAMPLES)
    for k in range(SAMPLES - 1):
        x[k + 1] = keep * x[k] + (1 - keep) * driven[k]
    return x


def drawn(rng):
    return np.repeat(rng.uniform(-5, 5, SAMPLES // 25), 25)


def white(rng, x, command):
    return SIGMA * rng.standard_normal(SAMPLES)


def heavy(rng, x, command):
    return SIGMA * rng.standard_t(3, SAMPLES)


def lasting(rng, x, command):
    errors = SIGMA * rng.standard_normal(SAMPLES)
    for k in range(1, SAMPLES):
        errors[k] += 0.9 * errors[k - 1]
    return errors


def a_dead_band_is_missing(rng, x, command):
    return x - followed(command, band=1.0) + white(rng, x, command)


def a_delay_is_missing(rng, x, command):
    return x - np.interp(TIME - 0.25, TIME, x) + white(rng, x, command)


@pytest.mark.parametrize("every", [1, 3])
@pytest.mark.parametrize(
    "errors", [white, heavy, lasting, a_dead_band_is_missing, a_delay_is_missing]
)
def test_neither_noise_nor_missing_physics_is_taken_for_it(errors, every):
    """Four standard errors: of 60 sets one is said by chance in one of five hundred runs."""
    for seed in range(60):
        rng = np.random.default_rng(seed)
        command = drawn(rng)
        x = followed(command)
        measured = x - errors(rng, x, command)
        measured[np.arange(SAMPLES) % every != 0] = np.nan
        late = lateness([Readings(TIME, x, measured)])
        assert late is None or not late.sure


@pytest.mark.parametrize("every", [1, 3])
def test_the_scatter_of_the_times_is_that_of_the_truth(every):
    """Lateness even between 0 and 0.4 s: 0.2 s in the mean, scatter 0.4 / sqrt(12) = 0.115 s."""
    scatters, means = [], []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        x = followed(drawn(rng))
        arrived = np.interp(TIME - rng.uniform(0.0, 0.4, SAMPLES), TIME, x)
        arrived += white(rng, x, None)
        arrived[np.arange(SAMPLES) % every != 0] = np.nan
        late = lateness([Readings(TIME, x, arrived)])
        assert late.sure
        scatters.append(late.scatter)
        means.append(late.mean)
    assert np.mean(scatters) == pytest.approx(0.115, rel=0.1)
    assert np.mean(means) == pytest.approx(0.2, rel=0.05)


def test_a_fit_says_so():
    rng = np.random.default_rng(3)
    command = drawn(rng)
    x = followed(command)
    arrived = np.interp(TIME - rng.uniform(0.0, 0.4, SAMPLES), TIME, x)
    log = dft.Log(
        TIME,
        {"command": command},
        {"speed": arrived + white(rng, x, command)},
        units={"command": "rad/s", "speed": "rad/s"},
    )
    fit = dft.fit(dft.SpeedLoopThruster(command="rad/s").fix("exponent", "ct"), log, starts=1)
    (doubt,) = [doubt for doubt in fit.doubts if doubt.kind == "lag"]
    assert doubt.channel == "speed"
    assert "late by a varying time" in doubt.evidence
    assert "when the sensor measured speed" in doubt.mend

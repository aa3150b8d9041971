"""Fits of a motor whose log repeats the last reading, against SciPy on the readings alone."""

import numpy as np
import pytest
from reference import first_order

import diffthrust as dft

MODEL = dft.SpeedLoopThruster(command="rad/s").fix("exponent", "ct")
SEEDS = range(20)


def log_of(made, speed=None):
    return dft.Log(
        made.time,
        {"command": made.command},
        {"speed": made.speed if speed is None else speed},
        units={"command": "rad/s", "speed": "rad/s"},
    )


@pytest.fixture(scope="module")
def fits():
    """Of every seed; one start, as there is one optimum."""
    drawn = [first_order.drawn(seed) for seed in SEEDS]
    return [(made, dft.fit(MODEL, log_of(made), starts=1)) for made in drawn]


def test_fits_are_those_of_scipy_on_the_readings(fits):
    for made, fit in fits[:5]:
        gain, time_constant, _ = first_order.fitted(made)
        assert fit.parameters["time_constant"].value == pytest.approx(time_constant, rel=1e-4)
        assert fit.parameters["gain"].value == pytest.approx(gain, rel=1e-4)


def test_errors_cover_the_truth(fits):
    """Nineteen of twenty are expected within 1.96 errors; fewer than 16 in one of 400 studies."""
    for name, truth in (("time_constant", 0.5), ("gain", 1.05)):
        found = [fit.parameters[name] for _, fit in fits]
        assert sum(abs(p.value - truth) < 1.96 * p.std_error for p in found) >= 16


def test_what_counts_is_said(fits):
    for made, fit in fits:
        count = fit.train.channels["speed"].samples
        assert 0 <= made.read.size - count <= 1  # the reading that equals none before it
        (doubt,) = fit.doubts
        assert (doubt.channel, doubt.kind) == ("speed", "stuck")
        assert f"{count} of {made.time.size} samples are readings" in doubt.evidence
        assert any(f"{count} readings count" in note for note in fit.notes)


def test_blanked_by_hand_is_the_same(fits):
    made, fit = fits[0]
    by_hand = np.full(made.time.size, np.nan)
    by_hand[made.read] = made.speed[made.read]
    other = dft.fit(MODEL, log_of(made, by_hand), starts=1)
    for name in ("gain", "time_constant"):
        assert fit.parameters[name].value == pytest.approx(other.parameters[name].value, rel=1e-6)

"""Samples at a rail on their way into a fit: where they stand, on which side, and what is told."""

import numpy as np
import pytest
from error_laws import Censored, Gaussian, are_censored, rail_notes
from problems import SimulationError, bind, build, likelihood_of

import diffthrust as dft


def log(count, *, censored=("thrust",), scale=1.0, **more):
    rng = np.random.default_rng(count)
    thrust = np.clip(rng.normal(scale=2.0, size=count), -1.5, 2.5)
    measured = {"speed": rng.normal(size=count), "thrust": scale * thrust}
    return dft.Log(
        0.1 * np.arange(count),
        {"command": rng.normal(size=count)},
        measured,
        rails={"thrust": (-1.5 * scale, 2.5 * scale)},
        censored=censored,
        **more,
    )


def test_they_stand_at_their_rails_on_their_sides():
    logs = [log(17), log(23, units={"thrust": "mN"}, scale=1000.0), log(11, censored=())]
    problem = build(dft.Thruster(), logs, likelihood=SimulationError(law=Censored()))
    sides = {-1: 0, 0: 0, 1: 0}
    for batch, indices in zip(problem.numbers.batches, problem.order, strict=True):
        for row, index in enumerate(indices):
            one = logs[index]
            count, told = len(one), one.values("thrust", "N")
            side = 1 * (told >= 2.5) - 1 * (told <= -1.5)
            if index == 2:  # not censored: such samples are left out
                np.testing.assert_array_equal(np.isnan(batch.measured[row, 1, :count]), side != 0)
                assert not np.any(batch.beyond[row])
                continue
            np.testing.assert_array_equal(batch.beyond[row, 1, :count], side)
            np.testing.assert_allclose(batch.measured[row, 1, :count], told, rtol=1e-12)
            assert not np.any(batch.beyond[row, 0])
            assert not np.any(batch.beyond[row, :, count:])
            for way in sides:
                sides[way] += int(np.sum(side == way))
    assert min(sides.values()) >= 3


def test_what_is_told_of_them():
    logs = [log(17), log(23), log(11, censored=())]
    counts = [one.railed["thrust"].samples for one in logs]
    assert min(counts) > 0
    records = bind(dft.Thruster(), logs)
    assert are_censored(records)
    assert not are_censored(records[2:])
    assert rail_notes(Censored(), records[2:]) == ()
    total = counts[0] + counts[1]
    (told,) = rail_notes(Censored(), records)
    assert told == f"Saturated samples are taken as 'at least' or 'at most': {total} of thrust."
    (told,) = rail_notes(Gaussian(), records)
    assert told.startswith(f"Saturated samples are ignored: {total} of thrust. Only")


@pytest.mark.parametrize("censored", [True, False])
def test_which_law_is_taken(censored):
    logs = [log(17, censored=("thrust",) if censored else ())]
    words = {"likelihood": "simulation", "noise_model": "white", "loss": "gaussian"}
    law = likelihood_of(dft.Thruster(), logs, **words).law
    assert law.censors == censored

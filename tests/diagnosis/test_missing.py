"""The mean of a missing signal over a signal of the model, against a known law."""

import numpy as np
import pytest
from reference import noise

from diffthrust.diagnosis._missing_signal import NONE, dependence_of  # private: against a known law
from diffthrust.diagnosis._residual_structure import (  # private: the basis of that law
    hats,
    knots_of,
)


def made(seed, logs=2, size=1500):
    """A signal with a kink in another one, beside errors that last; the last part is not known."""
    rng = np.random.default_rng(seed)
    over = [rng.uniform(-3.0, 3.0, size) for _ in range(logs)]
    rest = [noise.ar1(rng, size, 0.5, 0.9) for _ in range(logs)]
    return over, [np.where(np.arange(size) < 1400, np.abs(x) + e, np.nan)
                  for x, e in zip(over, rest, strict=True)]  # fmt: skip


def test_the_mean_follows_the_law_within_its_errors():
    beyond = total = 0
    for seed in range(100):
        over, signal = made(seed)
        knots = np.linspace(-3.0, 3.0, 7)
        found = dependence_of(signal, [hats(x, knots) for x in over], knots)
        at, mean, error = found.curve
        beyond += np.sum(np.abs(mean - np.abs(at)) > 2 * error)
        total += at.size
        law = np.var(np.abs(np.concatenate(over)))
        np.testing.assert_allclose(found.share, law / (law + 0.5**2), atol=0.12)
    # 5 % of normal means; 7 % with errors from so few blocks. The seven means of a set go together:
    # more than 14 % come by chance about once in a thousand
    assert beyond < 0.14 * total


def staircase(levels, size=1500):
    return np.repeat(np.arange(levels), size // levels).astype(float)


@pytest.mark.parametrize(
    ("over", "most"), [(np.arange(1500.0), 0.15), (staircase(10), 0.15), (staircase(50) % 7, 0.12)]
)
def test_errors_allow_for_signals_that_move_slowly(over, most):
    beyond, total = 0, 0
    for seed in range(100):
        rng = np.random.default_rng(seed)
        rest = [noise.ar1(rng, over.size, 0.5, 0.9) for _ in range(2)]
        knots = np.linspace(over.min(), over.max(), 7)
        _, mean, error = dependence_of(rest, [hats(over, knots)] * 2, knots).curve
        known = np.isfinite(error)
        beyond += np.sum(np.abs(mean[known]) > 2 * error[known])
        total += known.sum()
    assert 0 < beyond < most * total  # of normal means 5 % are


def test_a_knot_without_samples_has_no_mean():
    over, signal = made(0)
    signal = [np.where(x > 1.0, np.nan, y) for x, y in zip(over, signal, strict=True)]
    knots = np.linspace(-3.0, 3.0, 7)
    _, mean, error = dependence_of(signal, [hats(x, knots) for x in over], knots).curve
    assert np.isnan(mean[-2:]).all()
    assert np.isnan(error[-2:]).all()
    assert np.isfinite(error[:4]).all()


def test_what_depends_on_nothing_is_not_told():
    over, signal = made(0)
    knots = knots_of(np.concatenate(over))
    series = [hats(x, knots) for x in over]
    assert dependence_of([np.full_like(one, np.nan) for one in signal], series, knots) is NONE
    assert dependence_of([np.zeros_like(one) for one in signal], series, knots) is NONE

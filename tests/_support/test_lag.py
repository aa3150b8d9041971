"""First-order lags, held against the recursion and against SciPy's filter."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from diffthrust._support.lag import lagged  # private: behind filters of several modules


@pytest.mark.parametrize("columns", [1, 3])
def test_uneven_steps_follow_the_recursion(columns):
    rng = np.random.default_rng(0)
    toward, kept = rng.standard_normal((50, columns)), rng.uniform(0.0, 1.0, 50)
    expected = [rng.standard_normal(columns)]
    for value, share in zip(toward, kept, strict=True):
        expected.append(share * expected[-1] + (1.0 - share) * value)
    np.testing.assert_allclose(lagged(expected[0], toward, kept), expected, atol=1e-14)


def test_even_steps_are_a_filter():
    series = np.random.default_rng(1).standard_normal((4000, 2))
    by_filter = lfilter([0.03], [1.0, -0.97], series, axis=0, zi=0.97 * series[:1])[0]
    ours = lagged(series[0], series[1:], np.full(3999, 0.97))
    np.testing.assert_allclose(ours, by_filter, atol=1e-12)


def test_one_sample_is_its_start():
    np.testing.assert_array_equal(lagged(np.array([2.0]), np.empty((0, 1)), np.empty(0)), [[2.0]])

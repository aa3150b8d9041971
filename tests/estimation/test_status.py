"""What a status rests on: information that is left where other coordinates follow."""

import numpy as np

from diffthrust.estimation._status import marginal_spread  # private: told by no result

INSIDE, BESIDE = np.array([0, 1, 2]), np.array([3, 4])


def spread_information(rng):
    rows = rng.standard_normal((40, 5))
    return rows.T @ rows, rng.standard_normal(5)


def test_what_others_follow_leaves_the_covariance_and_the_step_as_they_are():
    information, slope = spread_information(np.random.default_rng(1))
    gradient, left = marginal_spread(slope, information, INSIDE, BESIDE)
    whole = np.linalg.inv(information)
    np.testing.assert_allclose(np.linalg.inv(left), whole[:3, :3], rtol=1e-10)
    np.testing.assert_allclose(np.linalg.solve(left, gradient), (whole @ slope)[:3], rtol=1e-10)
    np.testing.assert_array_equal(left, left.T)


def test_a_start_that_nothing_tells_of_takes_nothing_away():
    information, slope = spread_information(np.random.default_rng(2))
    information[3], information[:, 3], slope[3] = 0.0, 0.0, 0.0  # a state that no sensor feels
    gradient, left = marginal_spread(slope, information, INSIDE, BESIDE)
    expected = marginal_spread(slope, information, INSIDE, BESIDE[1:])
    np.testing.assert_allclose(gradient, expected[0], rtol=1e-9)
    np.testing.assert_allclose(left, expected[1], rtol=1e-9)
    alone = marginal_spread(slope, information, INSIDE, BESIDE[:0])
    np.testing.assert_array_equal(alone[1], information[:3, :3])

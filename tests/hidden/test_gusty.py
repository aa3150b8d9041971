"""The gusty runs: that gusts are all that the model lacks."""

import numpy as np
import pytest

import diffthrust as dft

from . import gusty


@pytest.mark.thorough
def test_gusts_are_all_that_the_model_lacks():
    still, again = gusty.drawn(3, gust=0.0), gusty.drawn(3, gust=0.0)
    windy = gusty.drawn(3)
    for name in gusty.MEASURED:
        one, two = (made.unseen[0].measured[name] for made in (still, again))
        np.testing.assert_array_equal(one, two)
    assert [len(log) for log in (*windy.train, *windy.unseen)] == [401] * 5
    fit = dft.fit(still.model, still.train, holdout=still.unseen, horizon=None, starts=2)
    assert fit.holdout.nrmse < 0.1  # sensors of 1 % of the range
    assert dft.compare(fit, windy.unseen).errors.nrmse > 4.0 * fit.holdout.nrmse

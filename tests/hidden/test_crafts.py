"""Crafts of the bench: the model with what is hidden is the plant, and two sets are judged."""

import numpy as np
import pytest

import diffthrust as dft

from . import bench, crafts
from .score import score


@pytest.mark.thorough
@pytest.mark.parametrize("wrong", ["centre", "azimuth"])
def test_the_fitted_truth_errs_as_the_sensors(wrong):
    """The constant freed, whole runs err by the noise: what is hidden is what the set says."""
    made = crafts.drawn(np.random.default_rng(3), wrong)
    fit = dft.fit(made.model.free(*made.about), made.train, starts=1)
    for name, channel in fit.train.channels.items():
        assert channel.rmse < 1.1 * crafts.SIGMA, name


@pytest.mark.thorough
def test_commands_that_are_exchanged_are_named():
    made = bench.drawn("craft/exchanged", 0)
    assert score(made, dft.diagnose(made.model, made.train, candidates=[])).right


@pytest.mark.thorough
def test_a_current_that_differs_by_log_is_named():
    made = bench.drawn("craft/current", 1)
    diag = dft.diagnose(
        made.model,
        made.train,
        holdout=made.unseen,
        candidates=["water_current", "sway_yaw_coupling"],
        experiment=False,
    )
    assert score(made, diag).right
    assert "m/s, another in each log" in diag.summary


def test_a_current_carries_a_boat():
    """A run in a current, seen from the water, is the run in still water."""
    time = crafts.STEP * np.arange(3)
    still = {"surge": np.ones(3), "sway": np.zeros(3), "heading": np.full(3, 0.5 * np.pi)}
    still |= {"north": np.zeros(3), "east": time}
    carried = crafts._carried(still, time, 0.2, 0.3)
    np.testing.assert_allclose(carried["surge"], 1.3)
    np.testing.assert_allclose(carried["sway"], -0.2)
    np.testing.assert_allclose(carried["north"], 0.2 * time)
    np.testing.assert_allclose(np.gradient(carried["east"], time), carried["surge"])

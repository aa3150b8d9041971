"""Rails of sensors as doubts, and how often they are found and imagined."""

import numpy as np
import pytest

import diffthrust as dft

from . import railed


@pytest.mark.thorough
def test_some_sound_logs_have_no_rails():
    assert railed.false_alarms(60, seed=1) == 0


def test_some_rails_are_found():
    found, of = railed.detected(20, seed=1)[True]
    assert of > 5
    assert found == of


@pytest.mark.slow
def test_rails_are_found_and_not_imagined():
    assert railed.false_alarms(400, seed=3) <= 2
    found, of = railed.detected(150, seed=3)[True]
    assert found >= 0.95 * of


def test_a_rail_is_a_doubt_with_its_mend():
    log, rail, _ = next(case for case in railed.cut(20, seed=1) if case[2])
    (doubt,) = dft.soundness.doubts(log, dft.Thruster())
    assert (doubt.channel, doubt.kind) == ("thrust", "saturated")
    assert f"rails = [-inf, {rail:g}] and censored = true" in doubt.mend
    told = log.replaced(rails={"thrust": (-np.inf, rail)})
    assert dft.soundness.doubts(told, dft.Thruster()) == ()

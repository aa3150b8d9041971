"""What speaks against a stage, on made-up errors."""

from types import SimpleNamespace

import numpy as np
import pytest

from diffthrust.diagnosis._whole_runs import missed, no_better
from diffthrust.simulation._errors import ChannelError, Errors


def errors(**nrmse):
    channels = {n: ChannelError(10 * e, e, 100 * (1 - e), 500) for n, e in nrmse.items()}
    return Errors(float(np.sqrt(np.mean(np.square([*nrmse.values()])))), channels)


def stage(train, unseen=None):
    return SimpleNamespace(train=train, holdout=unseen)


BEFORE = stage(errors(speed=0.5, thrust=0.020), errors(speed=0.5, thrust=0.020))


@pytest.mark.parametrize(
    ("train", "unseen", "why"),
    [
        ((0.5, 0.019), (0.5, 0.019), None),  # the small channel alone gains
        ((0.506, 0.010), (0.506, 0.010), None),  # one grows a little, the other is halved
        ((0.5, 0.020), (0.5, 0.020), "changes nothing"),
        ((0.49, 0.019), (0.61, 0.019), "whole unseen runs worse"),
        ((0.51, 0.021), (0.51, 0.021), "unseen and training ones"),
        ((0.51, 0.021), (0.49, 0.019), None),
        ((0.495, 0.0198), (0.52, 0.0208), "unseen and training ones"),
        ((np.inf, np.inf), (0.5, 0.020), "cannot be carried"),
    ],
)
def test_simulations_speak_against_a_stage(train, unseen, why):
    new = stage(*(errors(speed=a, thrust=b) for a, b in (train, unseen)))
    told = no_better(BEFORE, new)
    assert told is None if why is None else why in told


def test_without_unseen_logs_only_training_runs_speak():
    before = stage(errors(speed=0.5))
    assert no_better(before, stage(errors(speed=0.6))) is None
    assert "changes nothing" in no_better(before, stage(errors(speed=0.5)))


def test_a_dropped_effect_is_missed_where_training_runs_grow_worse():
    assert missed(BEFORE, stage(errors(speed=0.52, thrust=0.020)))
    assert not missed(BEFORE, stage(errors(speed=0.501, thrust=0.020)))

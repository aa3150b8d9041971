"""What simulations over whole runs say of a new stage, against the evidence of one-step errors."""

from __future__ import annotations

import math
import statistics

from diffthrust.diagnosis._result import Stage
from diffthrust.simulation._errors import Errors

SPOILT = 1.2
"""An effect is refused with which the error of whole unseen runs grows by more than this."""
GROWN = 1.01
"""So it is where those of unseen and of training runs together (the product of both, each in the
mean of the channels) grow by more than this;"""
NOTHING = 1e-4
"""and where the error of no channel changes by more than this over whole training runs."""


def missed(last: Stage, stage: Stage) -> bool:
    """Whether whole training runs miss an effect that one-step errors can do without."""
    return statistics.geometric_mean(_growth(last.train, stage.train)) > GROWN


def no_better(last: Stage, stage: Stage) -> str | None:
    """Why the simulations of a new stage speak against it, if they do."""
    if not math.isfinite(stage.train.nrmse):
        return "cannot be carried over whole runs"
    trained = _growth(last.train, stage.train)
    if all(abs(growth - 1.0) < NOTHING for growth in trained):
        return "changes nothing in whole runs"
    if last.holdout is not None and stage.holdout is not None:
        if stage.holdout.nrmse > SPOILT * last.holdout.nrmse:
            return "whole unseen runs worse"
        unseen = _growth(last.holdout, stage.holdout)
        if math.prod(map(statistics.geometric_mean, (trained, unseen))) > GROWN:
            return "whole runs worse, unseen and training ones together"
    return None


def _growth(before: Errors, after: Errors) -> list[float]:
    """By how much the error of each channel has grown; 1 where that cannot be told."""
    pairs = [(before.channels[n].rmse, one.rmse) for n, one in after.channels.items()]
    return [new / old if 0 < old < math.inf and 0 < new < math.inf else 1.0 for old, new in pairs]

"""What a log does that the others do not: an astern run among runs ahead.

Where a model lacks something, its error shows most in the log that goes where the others do not:
of six runs the only astern one errs four times as much with one thrust coefficient for both ways,
and was recorded as well as the others. Such a log is accused of nothing.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from diffthrust._support.words import humanize, number
from diffthrust.comparison._derived_signals import signals_of, units_of
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.models._base.model import Model
from diffthrust.simulation._runs import Run

_NAMED = 2
"""Display: signals that are named; the others mostly follow from these."""
_MARGIN = 0.05
"""Numerics: share of what the other logs cover by which their ends count as wider."""


def beyond_others(model: Model, run: Run, others: Sequence[Run]) -> tuple[str, ...]:
    """Where a log goes and most of the other logs do not, in words: "command below 0.3 V".

    The signals that are for long beyond what the others reach, or half of them, the plainest first.
    Inputs are held against each other and states as the model follows them: what was measured may
    itself be what is odd about the log.
    """
    words = []
    by_log = [signals_of(model, peer) for peer in others]
    for name, values in signals_of(model, run).items():
        peers = [signals[name] for signals in by_log if name in signals]
        if not peers:
            continue
        lows, highs = (np.sort([end(peer) for peer in peers]) for end in (np.min, np.max))
        margin = _MARGIN * float(highs[-1] - lows[0])
        unit = units_of(run).get(name, "")
        # what any of them reaches, or else at least half of them: of a T200's maps that at 20 V
        # goes above the 16 V of the highest other one, not only above 12 V
        below = (lows[0], lows[(len(peers) - 1) // 2])
        above = (highs[-1], highs[len(peers) // 2])
        for side, sign, ends in (("below", -1.0, below), ("above", 1.0, above)):
            beyond = (end for end in ends if _is_long(sign * (values - end) > margin))
            if (end := next(beyond, None)) is not None:
                words.append(f"{humanize(name)} {side} {number(float(end), 2)} {unit}".rstrip())
    return tuple(words[:_NAMED])


def _is_long(outside: np.ndarray) -> bool:
    return bool(np.mean(outside) > SETTINGS.outlier_logs.least_time_beyond)

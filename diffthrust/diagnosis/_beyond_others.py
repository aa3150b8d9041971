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
    """Where a log goes and most of the other logs do not, in words.

    Inputs are held against each other and states as the model follows them: what was measured may
    itself be what is odd about the log.

    Args:
        model: of the runs.
        run: of the log.
        others: the runs of the logs that it is held against.

    Returns:
        The signals that are for long beyond what half of the others reach, the plainest first.

    Example:
        >>> beyond_others(model, astern, ahead)
        ('command below 0.3 V',)
    """
    words = []
    by_log = [signals_of(model, peer) for peer in others]
    for name, values in signals_of(model, run).items():
        peers = [signals[name] for signals in by_log if name in signals]
        if not peers:
            continue
        lows, highs = (np.sort([end(peer) for peer in peers]) for end in (np.min, np.max))
        margin = _MARGIN * float(highs[-1] - lows[0])
        # what at least half of them reach
        low, high = float(lows[(len(peers) - 1) // 2]), float(highs[len(peers) // 2])
        unit = units_of(run).get(name, "")
        for outside, side, end in (
            (values < low - margin, "below", low),
            (values > high + margin, "above", high),
        ):
            if np.mean(outside) > SETTINGS.outlier_logs.least_time_beyond:
                words.append(f"{humanize(name)} {side} {number(end, 2)} {unit}".rstrip())
    return tuple(words[:_NAMED])

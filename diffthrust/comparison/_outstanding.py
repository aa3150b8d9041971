"""Runs whose errors stand out from those of the others."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from diffthrust._support.words import percent
from diffthrust.simulation._runs import Run

_OUTSTANDING = 3.0
"""A run stands out where its error is this multiple of the median run's, both absolute and as a
share of what varies in the run: neither a larger manoeuvre nor a smaller one makes it odd."""


class Outstanding(NamedTuple):
    """The error of one run beside those of the others, in one channel.

    Args:
        place: of the run among those that were given.
        run: its name.
        channel: the channel.
        ratio: RMSE of the run over that of the median run.
        share: of the squared error of all runs.
        size: the RMSE in words.
    """

    place: int
    run: str
    channel: str
    ratio: float
    share: float
    size: str

    @property
    def sentence(self) -> str:
        """In plain words."""
        return (
            f"{self.run}: its {self.channel} error (RMSE {self.size}) is {self.ratio:.2g} times "
            f"that of the median run and makes up {percent(self.share)} of the squared error of "
            "all runs."
        )


def beside_others(runs: Sequence[Run], channel: str) -> list[Outstanding]:
    """The error of every run that has a channel, beside that of the median run.

    Example:
        >>> beside_others(runs, "speed")[0].ratio
        1.1
    """
    by_run = {i: r.errors.channels[channel] for i, r in enumerate(runs) if channel in r.channels}
    usual = float(np.median([e.rmse for e in by_run.values()])) if by_run else np.nan
    total = sum(e.rmse**2 * e.samples for e in by_run.values())
    return [
        Outstanding(
            place=i,
            run=runs[i].name,
            channel=channel,
            ratio=e.rmse / usual if usual > 0 else 1.0,
            share=e.rmse**2 * e.samples / total if total > 0 else 0.0,
            size=f"{e.shown[0]:.3g} {e.shown[1]}".rstrip(),
        )
        for i, e in by_run.items()
    ]


def outstanding(runs: Sequence[Run]) -> list[Outstanding]:
    """The runs whose errors stand out, channel by channel; none of fewer than three.

    Example:
        >>> [one.run for one in outstanding(runs)]
        ['run 3']
    """
    standing_out = []
    for name in dict.fromkeys(name for run in runs for name in run.channels):
        by_run = beside_others(runs, name)
        relative = [runs[entry.place].errors.channels[name].nrmse for entry in by_run]
        most = _OUTSTANDING * float(np.median(relative))
        for entry, nrmse in zip(by_run, relative, strict=True):
            # of two runs the median lies between both: neither can be three times as large
            if len(by_run) > 2 and _OUTSTANDING < entry.ratio < np.inf and nrmse > most:
                standing_out.append(entry)
    return standing_out

"""What an effect is worth: how much of the error over whole runs it removes, and how sure that is.

The share of the squared errors is taken over all samples of all logs, each channel in units of its
own spread. Its interval is by bootstrap over logs, and over blocks of time within them that are
longer than the errors last (Künsch 1989).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from diffthrust._support.correlation import autocorrelation, integral
from diffthrust._support.words import percent
from diffthrust.diagnosis._settings import SETTINGS

_DRAWS = 1000
"""Numerics: draws of the bootstrap; its 5 % ends are then known to 0.7 % of probability."""


class BeforeAfter(NamedTuple):
    """The errors of one channel over one log, without an effect and with it; ``(T,)`` each.

    NaN where nothing was measured.
    """

    measured: np.ndarray
    before: np.ndarray
    after: np.ndarray


@dataclass(frozen=True)
class Worth:
    """Share of the squared whole-run error that an effect removes, of unseen logs if there are any.

    A diagnosis takes it of the error of the model as given, so that shares add up.

    Args:
        share: 0 changes nothing, 1 leaves no error, below 0 makes it larger.
        low: lower end of the 90 % interval.
        high: upper end.
        channels: the same of each channel alone, where there are several.

    Example:
        >>> Worth(0.72, 0.6, 0.8).to_json()
        {'share': 0.72, 'interval': [0.6, 0.8]}
        >>> str(Worth(0.72, 0.6, 0.8))
        '72 % (60 % to 80 %)'
    """

    share: float
    low: float
    high: float
    channels: Mapping[str, Worth] = field(default_factory=dict)

    def __str__(self) -> str:
        return "{} ({})".format(*self.cells)

    @property
    def cells(self) -> tuple[str, str]:
        """The share and its interval in words."""
        return share_words(self.share), f"{share_words(self.low)} to {share_words(self.high)}"

    @property
    def sure(self) -> bool:
        """Whether it is surely worth something, and more than a few per cent."""
        return self.low > 0 and self.share > SETTINGS.whole_runs.negligible_share

    def of(self, remaining: float) -> Worth:
        """The same as a share of a larger error, a share ``remaining`` of which is left before."""
        remaining = remaining if math.isfinite(remaining) else 1.0
        return Worth(self.share * remaining, self.low * remaining, self.high * remaining)

    def to_json(self) -> dict[str, Any]:
        """The worth as plain data; ``None`` where it is not finite, as of runs that fail."""
        share, low, high = (
            x if math.isfinite(x) else None for x in (self.share, self.low, self.high)
        )
        return {"share": share, "interval": [low, high]}


def share_words(share: float) -> str:
    """A share as a percentage; one below zero makes the error larger."""
    if not math.isfinite(share):
        return "?"
    return f"-{percent(-share)}" if share < 0 else percent(share)


def explained_share(logs: Sequence[Mapping[str, BeforeAfter]], seed: int = 0) -> Worth:
    """The share of the squared errors that a change removes, with its interval.

    Args:
        logs: for each log the errors of its channels.
        seed: of the bootstrap.

    Example:
        >>> error = np.random.default_rng(0).standard_normal(500)
        >>> worth = explained_share([{"speed": BeforeAfter(10 * error, error, 0.5 * error)}])
        >>> round(worth.share, 2), worth.sure
        (0.75, True)
    """
    names = list(dict.fromkeys(name for log in logs for name in log))
    table = _table(logs, names)
    drawn = [_drawn(table, seed), np.sum([b.sum(axis=0) for b in table], axis=0)[None]]
    total = _interval(*(sums.sum(axis=1) for sums in drawn))
    if len(names) == 1:
        return total
    by_channel = {name: _interval(*(sums[:, c] for sums in drawn)) for c, name in enumerate(names)}
    return Worth(total.share, total.low, total.high, by_channel)


def matters(worth: Worth, everywhere: Worth) -> bool:
    """Whether whole runs are surely better by an effect, over all channels or one of them by much.

    Args:
        worth: on unseen logs; must not be negligible.
        everywhere: on training and unseen logs together: where random forces last for as long as
            an unseen log does, only all logs together can be sure.
    """

    def surely(share: Worth, joint: Worth, least: float) -> bool:
        return share.share > least and max(share.low, joint.low) > 0

    pairs = (
        (share, everywhere.channels.get(name, share)) for name, share in worth.channels.items()
    )
    alone = any(
        surely(share, joint, SETTINGS.whole_runs.one_channel_share) for share, joint in pairs
    )
    return surely(worth, everywhere, SETTINGS.whole_runs.negligible_share) or (
        worth.share > 0 and alone
    )


def _table(logs: Sequence[Mapping[str, BeforeAfter]], names: Sequence[str]) -> list[np.ndarray]:
    """For each log the squared errors of its blocks, ``(blocks, channels, 2)``.

    Before and after, in units of the variance of each channel and of its number of samples.
    """
    unit = {}
    for name in names:
        measured = np.concatenate([log[name].measured for log in logs if name in log])
        unit[name] = float(np.nanvar(measured)) * np.isfinite(measured).sum()
    limits, table = SETTINGS.whole_runs, []
    for log in logs:
        size = len(next(iter(log.values())).measured)
        squares, lasts = np.zeros((size, len(names), 2)), 1.0
        for c, name in enumerate(names):
            if name not in log or not unit[name] > 0:
                continue
            errors = log[name]
            finite = np.isfinite(errors.measured)
            for k, residual in enumerate((errors.before, errors.after)):
                with np.errstate(over="ignore"):  # of a run that diverges
                    squares[finite, c, k] = (
                        np.where(np.isfinite(residual), residual, np.inf)[finite] ** 2
                    )
                lasts = max(lasts, _lasting(np.where(finite, residual, np.nan)))
            squares[:, c] /= unit[name]
        pieces = int(
            np.clip(size / (limits.block_length * lasts), limits.fewest_blocks, limits.most_blocks)
        )
        table.append(np.array([b.sum(axis=0) for b in np.array_split(squares, min(pieces, size))]))
    return table


def _lasting(residual: np.ndarray) -> float:
    """The number of samples over which errors are correlated."""
    finite = residual[~np.isnan(residual)]
    fewest = SETTINGS.whole_runs.fewest_blocks
    if finite.size < fewest or not np.all(np.isfinite(finite)) or not np.ptp(finite) > 0:
        return 1.0
    unit = np.abs(finite).max()  # the squares of a run that diverges would overflow
    read = integral(autocorrelation([finite / unit], finite.size // fewest))
    # a sensor that repeats values has fewer readings than samples
    return read * residual.size / finite.size


def _drawn(table: Sequence[np.ndarray], seed: int) -> np.ndarray:
    """Sums over logs and blocks that were drawn with replacement, ``(draws, channels, 2)``."""
    rng = np.random.default_rng(seed)
    drawn = np.zeros((_DRAWS, *table[0].shape[1:]))
    picked = rng.integers(0, len(table), (_DRAWS, len(table)))
    for k, blocks in enumerate(table):
        for turn in range(len(table)):
            (draws,) = np.nonzero((picked == k).sum(axis=1) > turn)
            at = rng.integers(0, len(blocks), (len(draws), len(blocks)))
            drawn[draws] += blocks[at].sum(axis=1)
    return drawn


def _interval(drawn: np.ndarray, total: np.ndarray) -> Worth:
    """The share and its interval, from squared errors before and after; ``(n, 2)``, ``(1, 2)``."""
    level = SETTINGS.whole_runs.interval_level
    ends = np.quantile(_removed(drawn), [0.5 * (1 - level), 0.5 * (1 + level)], method="nearest")
    return Worth(float(_removed(total)[0]), float(ends[0]), float(ends[1]))


def _removed(sums: np.ndarray) -> np.ndarray:
    """The share that is removed of squared errors, from those before and after, ``(n, 2)``."""
    baseline, updated = sums.T
    finite = (baseline > 0) & np.isfinite(baseline)
    remaining = np.divide(updated, baseline, out=np.ones_like(baseline), where=finite)
    return 1.0 - np.where(np.isinf(baseline) & np.isfinite(updated), 0.0, remaining)

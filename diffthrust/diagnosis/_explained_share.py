"""What an effect is worth: how much of the error over whole runs it removes, and how sure that is.

The share of the squared errors is taken over all samples of all logs, each channel in units of its
own spread; and of each channel alone, because a channel that no model explains would drown what an
effect does to the others. Its interval is by bootstrap over logs, and over blocks of time within
them that are longer than the errors last (Künsch 1989).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from diffthrust._support.correlation import autocorrelation, integral
from diffthrust._support.words import percent
from diffthrust.diagnosis._settings import SETTINGS

_DRAWS = 1000
"""Numerics: draws of the bootstrap; its 5 % ends are then known to 0.7 % of probability."""

_LEAST_PRINTED = 5e-4
"""Display: a smaller share is printed as 0.0 %."""


class BeforeAfter(NamedTuple):
    """The errors of one channel over one log, without an effect and with it; ``(T,)`` each.

    NaN where nothing was measured.
    """

    measured: np.ndarray
    before: np.ndarray
    after: np.ndarray


ErrorsByLog = Sequence[Mapping[str, Sequence[np.ndarray]]]
"""By log and channel what was measured, and the errors of one model after the other; ``(T,)``."""


@dataclass(frozen=True)
class Worth:
    """Share of the squared whole-run error that an effect removes, of unseen logs if there are any.

    A diagnosis takes it of the error of the model as given, so that shares add up; that of a law,
    or of an effect that it leaves out, of the error that is left without.

    Args:
        share: 0 changes nothing, 1 leaves no error, below 0 makes it larger.
        low: lower end of the 90 % interval.
        high: upper end.
        channels: the same of each channel alone, where there are several; with intervals that
            hold together.
        everywhere: the same of training and unseen logs together, where both are known.
        together: the effects that have this share jointly, where no one has a share of its own.
        nrmse: of a channel, its error without the effect over what it does; NaN if not known.
        beside_others: the share of the error left without it that it removes beside all other
            effects, which are fitted again without it; where there are several.

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
    everywhere: Worth | None = None
    together: tuple[str, ...] = ()
    nrmse: float = math.nan
    beside_others: Worth | None = None

    def __str__(self) -> str:
        return "{} ({})".format(*self.cells)

    @property
    def cells(self) -> tuple[str, str]:
        """The share and its interval in words."""
        return share_words(self.share), f"{share_words(self.low)} to {share_words(self.high)}"

    @property
    def of_all(self) -> Worth:
        """The same of training and unseen logs together; it is that where there are no unseen."""
        return self.everywhere or self

    @property
    def above_zero(self) -> bool:
        """Whether its interval excludes zero, also as it is printed."""
        return self.low >= _LEAST_PRINTED

    @property
    def sure(self) -> bool:
        """Whether it is surely worth something, and more than a few per cent."""
        return self.above_zero and self.share > SETTINGS.whole_runs.negligible_share

    def to_json(self) -> dict[str, Any]:
        """The worth as plain data; ``None`` where it is not finite, as of runs that fail."""
        data: dict[str, Any] = _share_data(self)
        if self.channels:
            data["channels"] = {name: _share_data(each) for name, each in self.channels.items()}
        if self.everywhere:
            data["everywhere"] = _share_data(self.everywhere)
        if self.together:
            data["together"] = list(self.together)
        if self.beside_others:
            data["beside_others"] = self.beside_others.to_json()
        return data


def _share_data(worth: Worth) -> dict[str, Any]:
    share, low, high = (
        x if math.isfinite(x) else None for x in (worth.share, worth.low, worth.high)
    )
    return {"share": share, "interval": [low, high]}


def share_words(share: float) -> str:
    """A share as a percentage; one below zero makes the error larger."""
    if not math.isfinite(share):
        return "?"
    return f"-{percent(-share)}" if share < 0 else percent(share)


def explained_share(logs: ErrorsByLog, seed: int = 0) -> Worth:
    """The share of the squared errors that a change removes, with its interval.

    Example:
        >>> error = np.random.default_rng(0).standard_normal(500)
        >>> worth = explained_share([{"speed": BeforeAfter(10 * error, error, 0.5 * error)}])
        >>> round(worth.share, 2), worth.sure
        (0.75, True)
    """
    return shares_of_steps(logs, [[1]], seed)[0]


def worth_of(trained: ErrorsByLog, unseen: ErrorsByLog) -> Worth:
    """The `explained_share` of unseen logs if there are any, and beside it that of all logs."""
    return worths_of(trained, unseen, [[1]])[0]


def worths_of(
    trained: ErrorsByLog, unseen: ErrorsByLog, steps: Sequence[Sequence[int]]
) -> list[Worth]:
    """The `shares_of_steps` of unseen logs if there are any, and beside these those of all logs."""
    worths = shares_of_steps(unseen or trained, steps)
    if not unseen:
        return worths
    of_all = shares_of_steps([*trained, *unseen], steps)
    return [replace(worth, everywhere=joint) for worth, joint in zip(worths, of_all, strict=True)]


def shares_of_steps(
    logs: ErrorsByLog, steps: Sequence[Sequence[int]], seed: int = 0
) -> list[Worth]:
    """The shares of the first model's squared errors that steps from model to model remove.

    All are shares of one whole: those of different steps add up to what all of them remove.

    Each share is of some steps: step 1 leads from the first model to the second.

    Example:
        >>> error = np.random.default_rng(0).standard_normal(500)
        >>> models = 10 * error, error, 0.5 * error, 0.1 * error
        >>> [round(worth.share, 2) for worth in shares_of_steps([{"speed": models}], [[1], [2]])]
        [0.75, 0.24]
    """
    names = list(dict.fromkeys(name for log in logs for name in log))
    table = _table(logs, names)
    drawn, sums = _drawn(table, seed), np.sum([b.sum(axis=0) for b in table], axis=0)[None]
    worths = []
    for chosen in steps:
        total = _interval(drawn.sum(axis=1), sums.sum(axis=1), chosen)
        if len(names) > 1:  # so many intervals are all to hold (Bonferroni)
            by_channel = {
                name: replace(
                    _interval(drawn[:, c], sums[:, c], chosen, len(names)),
                    nrmse=float(sums[0, c, min(chosen) - 1] ** 0.5),
                )
                for c, name in enumerate(names)
            }
            total = replace(total, channels=by_channel)
        worths.append(total)
    return worths


# -- what a share allows to say --------------------------------------------------------------------


def matters(worth: Worth, driven: str = "") -> bool:
    """Whether whole runs are surely better by an effect: in all, or one channel and none worse.

    A channel that no model explains weighs most in the sum, and hides what an effect does to the
    others: a drag that removes 54 % of the surge error of a boat, whose sway nothing explains,
    removes -2 % (-11 % to 5 %) of all of it.

    Args:
        worth: on unseen logs it must not be negligible, and on training and unseen logs together
            it must be sure: a few unseen logs seldom are, and random forces may last for as long
            as one of them.
        driven: the measured channel in which it enters, where that is known: one channel alone
            speaks for it only if this one is surely better, too. A curve in the surge of a
            BlueBoat, which removes 24 % of the squared yaw rate error, removed of that of surge
            31 % (-12 % to 89 %).
    """
    everywhere = worth.of_all
    if not (math.isfinite(worth.share) and math.isfinite(everywhere.share)):
        return False  # a run diverges: of the NGS with a curve that helped in all the others
    if everywhere.sure and worth.share > SETTINGS.whole_runs.negligible_share:
        return True
    least = SETTINGS.whole_runs.one_channel_share
    alone = any(
        joint.above_zero and min(joint.share, worth.channels.get(name, joint).share) > least
        for name, joint in everywhere.channels.items()
    )
    entered = everywhere.channels.get(driven, everywhere).above_zero if driven else True
    return alone and entered and not harms(everywhere)


def negligible(worth: Worth) -> bool:
    """Whether an effect changes next to nothing, sure or not, in all and of each channel."""
    limits, both = SETTINGS.whole_runs, (worth, worth.of_all)
    return all(abs(each.share) <= limits.negligible_share for each in both) and all(
        channel.share <= limits.one_channel_share
        for each in both
        for channel in each.channels.values()
    )


def adds_little(worth: Worth) -> bool:
    """Whether an effect removes no tenth of the squared error, in all and of no channel.

    Neither of what was left before it nor of what would be left without it.
    """
    return _is_little(worth) and (worth.beside_others is None or _is_little(worth.beside_others))


def surely_removes(worth: Worth) -> bool:
    """Whether an effect surely removes something, when it was added or beside all others."""
    last = worth.beside_others
    return bool(sure_share(worth) or (last and sure_share(last)))


def order_matters(worth: Worth) -> bool:
    """Whether an effect removes much, and surely, only when it was added or only beside others."""
    last = worth.beside_others
    much = [not _is_little(w) and sure_share(w) is not None for w in (worth, last) if w]
    return len({*much}) > 1


def _is_little(worth: Worth) -> bool:
    least = SETTINGS.whole_runs.one_channel_share
    shares = filter(None, (worth, worth.everywhere))
    return all(part.share <= least for each in shares for part in (each, *each.channels.values()))


def surely_less(everywhere: Worth) -> bool:
    """Whether whole runs surely err less, in all or in one channel, however little, and none more.

    A constant that the logs contradict biases all else, however little it does to whole runs.
    """
    shares = (everywhere, *everywhere.channels.values())
    return any(each.above_zero for each in shares) and not harms(everywhere)


def harms(everywhere: Worth) -> bool:
    """Whether the squared error of a channel surely grows, by more than is negligible.

    A channel that the model follows no better than a constant does says nothing: the sway of a boat
    grew from 1.3 to 1.4 of what it does, by where fits of the other channels end.

    Args:
        everywhere: on training and unseen logs together: of one unseen log alone, such a channel
            surely grew by chance in a tenth of cases.
    """
    least = -SETTINGS.whole_runs.negligible_share
    return any(
        each.high < 0 and each.share < least and not each.nrmse >= 1
        for each in everywhere.channels.values()
    )


class SureShare(NamedTuple):
    """A share that is surely above zero, and what it is a share of.

    Args:
        worth: the share and its interval.
        channel: of this channel's squared error; of that of all channels where empty.
        everywhere: of training and unseen logs together.
    """

    worth: Worth
    channel: str = ""
    everywhere: bool = False


def sure_share(worth: Worth) -> SureShare | None:
    """What surely can be said of the share of an effect; ``None`` where every interval holds zero.

    Of unseen logs rather than of all; and of all channels, unless one of them gains surely more
    than these do, or alone is sure.

    Example:
        >>> drowned = Worth(
        ...     0.1, -0.1, 0.2, {"speed": Worth(0.8, 0.7, 0.9), "thrust": Worth(0, 0, 0)}
        ... )
        >>> sure_share(drowned).channel
        'speed'
    """
    least = SETTINGS.whole_runs.one_channel_share
    for shares in (worth, worth.everywhere):
        if shares is None:
            continue
        sure = [n for n, c in shares.channels.items() if c.above_zero and c.share > least]
        # two drags removed 118 % of a boat's squared north error as given, which the current
        # before them had raised: true, and nothing to read
        within = [n for n in sure if shares.channels[n].share <= 1.0]
        sure = within or sure * (not shares.above_zero)
        best = max(((shares.channels[n].share, n) for n in sure), default=(0.0, ""))[1]
        if best and not (shares.above_zero and shares.channels[best].low <= shares.share):
            return SureShare(shares.channels[best], best, shares is not worth)
        if shares.above_zero:
            return SureShare(shares, "", shares is not worth)
    return None


# -- squared errors by blocks, and draws of them ---------------------------------------------------


def _table(logs: ErrorsByLog, names: Sequence[str]) -> list[np.ndarray]:
    """For each log the squared errors of its blocks, ``(blocks, channels, models)``.

    In units of the variance of each channel and of its number of samples.
    """
    unit = {}
    models = len(next(iter(logs[0].values()))) - 1
    for name in names:
        measured = np.concatenate([log[name][0] for log in logs if name in log])
        measured = measured[np.isfinite(measured)]
        unit[name] = float(np.var(measured)) * measured.size if measured.size else 0.0
    limits, table = SETTINGS.whole_runs, []
    for log in logs:
        size = len(next(iter(log.values()))[0])
        squares, lasts = np.zeros((size, len(names), models)), 1.0
        for c, name in enumerate(names):
            if name not in log or not unit[name] > 0:
                continue
            measured, *errors = log[name]
            finite = np.isfinite(measured)
            for k, residual in enumerate(errors):
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
    """Sums over logs and blocks that were drawn with replacement, ``(draws, channels, models)``."""
    rng = np.random.default_rng(seed)
    drawn = np.zeros((_DRAWS, *table[0].shape[1:]))
    picked = rng.integers(0, len(table), (_DRAWS, len(table)))
    for k, blocks in enumerate(table):
        for turn in range(len(table)):
            (draws,) = np.nonzero((picked == k).sum(axis=1) > turn)
            at = rng.integers(0, len(blocks), (len(draws), len(blocks)))
            drawn[draws] += blocks[at].sum(axis=1)
    return drawn


def _interval(drawn: np.ndarray, total: np.ndarray, steps: Sequence[int], beside: int = 1) -> Worth:
    """The share and its interval, one of several, from squared errors ``(draws or 1, models)``."""
    outside = 0.5 * (1 - SETTINGS.whole_runs.interval_level) / beside
    ends = np.quantile(_removed(drawn, steps), [outside, 1 - outside], method="nearest")
    return Worth(float(_removed(total, steps)[0]), float(ends[0]), float(ends[1]))


def _removed(sums: np.ndarray, steps: Sequence[int]) -> np.ndarray:
    """The share of the first model's squared errors that steps remove, from all ``(n, models)``."""
    given = sums[:, 0]
    finite = (given > 0) & np.isfinite(given)
    removed = np.zeros(len(sums))
    for k in steps:
        baseline, updated = sums[:, k - 1], sums[:, k]
        with np.errstate(invalid="ignore"):  # of runs that diverge before and after
            share = np.divide(baseline - updated, given, out=np.zeros_like(given), where=finite)
        mended = np.isinf(given) & np.isinf(baseline) & np.isfinite(updated)
        removed += np.where(mended, 1.0, np.where(np.isnan(share), 0.0, share))
    return removed

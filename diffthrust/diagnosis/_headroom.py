"""What of the remaining error any model could explain on unseen records, and what recurs.

Where logs repeat their inputs physics recurs, and a disturbance does not. Of two runs with the same
inputs the errors of a model have a part in common, which the inputs make, and a part of their own.
The share of the common part is the correlation within pairs (Fisher 1925, Statistical Methods for
Research Workers, section 38), with an interval as that of any share of the squared error.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations, pairwise
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from diffthrust._support._running.blas import one_blas_thread
from diffthrust._support.errors import InputError
from diffthrust._support.progress import Progress, ProgressOption, progressing, reporter, subtask
from diffthrust._support.report import Report, Rows, Section
from diffthrust._support.results import Result
from diffthrust._support.words import percent
from diffthrust.comparison._compare import Comparison, compare
from diffthrust.diagnosis._explainable import (
    ErrorRecord,
    Explainable,
    Rung,
    explainable,
    independent_samples,
)
from diffthrust.diagnosis._explained_share import BeforeAfter, Worth, explained_share
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model
from diffthrust.simulation._runs import Run

if TYPE_CHECKING:
    from diffthrust.estimation._result import Fit

_STRETCHES = 4
"""Numerics: stretches into which one record or two are cut, so that some can be left out and
halved."""
_FEWEST_RECORDS = 3
"""Numerics: with at least this number of records none is cut."""
_MOST_SAMPLES = 20_000
"""Numerics: above this number samples are thinned, so that the regressions stay quick."""
_FEWEST_COMMON = 100
"""Numerics: samples in common from which two runs are compared; fewer give no mean square."""


@dataclass(frozen=True)
class ChannelHeadroom:
    """What a flexible correction explains of one channel's error on records it has not seen.

    Args:
        physics: NRMSE of the model on those records.
        corrected: NRMSE with the correction.
        share: of the squared error that the correction explains; below zero where it harms.
        low: lower end of the 90 % interval of the share that a correction could explain if it
            learned from unlimited records.
        high: upper end.
        rung: the form of the correction.
        signals: the signals that enter it.
        samples: that it learned from; of a sensor with repeated values, its readings.
    """

    physics: float
    corrected: float
    share: float
    low: float
    high: float
    rung: Rung
    signals: tuple[str, ...]
    samples: int

    @property
    def cells(self) -> tuple[str, str, str, str, str]:
        """Both NRMSE, the share, its interval and the form of the correction, in words.

        Shares below zero are shown as zero: a correction that harms would not be made.
        """
        share, low, high = (percent(max(value, 0.0)) for value in (self.share, self.low, self.high))
        return f"{self.physics:.3g}", f"{self.corrected:.3g}", share, f"{low} to {high}", self.rung


@dataclass(frozen=True, repr=False)
class Headroom(Result):
    """How much a search for missing physics can find at most, and whether to stop.

    Args:
        channels: by measured channel.
        judged_on: "unseen" records, or "left-out" ones, each predicted from the others.
        model: words for the model.

    Example:
        >>> left = diag.headroom[-1]
        >>> sorted(left.channels), left.judged_on
        (['speed', 'thrust'], 'unseen')
        >>> len(left.summary) > 0
        True
        >>> left.worth, list(left.to_json())[:3]
        (False, ['schema', 'model', 'judged_on'])
    """

    channels: Mapping[str, ChannelHeadroom] = field(repr=False)
    judged_on: Literal["unseen", "left-out"]
    model: str

    @property
    def worth(self) -> bool:
        """Whether a channel has a tenth of its squared error, or may have, for a model to find."""
        return any(
            c.high >= SETTINGS.headroom.worthwhile_share and c.low > 0
            for c in self.channels.values()
        )

    @property
    def summary(self) -> str:
        """The answer in a sentence for each channel."""
        return " ".join(_words(name, c, self.judged_on) for name, c in self.channels.items())

    def _report(self) -> Report:
        rows = [(name, *c.cells) for name, c in self.channels.items()]
        headings = ("Channel", "Physics (NRMSE)", "With a correction", "Share explained",
                    "90 % interval", "Form")  # fmt: skip
        table = Rows.of(headings, rows, numbers=(1, 2, 3))
        return Report(Section("", table, self.summary))

    def to_json(self) -> dict[str, Any]:
        """The headroom as plain data."""
        from diffthrust._support.files import plain

        channels = {name: vars(c) for name, c in self.channels.items()}
        return plain({"schema": 1, "model": self.model, "judged_on": self.judged_on,
                      "worth": self.worth, "channels": channels})  # fmt: skip

    def _line(self) -> str:
        shares = ", ".join(f"{name} {c.cells[2]}" for name, c in self.channels.items())
        return f"{self.model}: of the squared error could be explained: {shares}"


@progressing
def headroom(
    fit: Fit | Model,
    logs: Log | Sequence[Log],
    *,
    holdout: Log | Sequence[Log] | None = None,
    seed: int = 0,
    progress: ProgressOption = None,
) -> Headroom:
    """How much of the errors of a model could any model of moderate flexibility explain.

    The model is simulated over each whole record. A regression from its inputs, and from its own
    states and outputs, to the error is learned on ``logs`` and judged on records it has not seen:
    those under ``holdout``, or each of ``logs`` in turn by the regression of the others (a lone
    record is cut into four). What it explains there is structure that repeats, whatever its form:
    a search for missing physics can find about as much. What it does not explain is noise, or what
    these signals do not tell.

    Args:
        fit: a fit, or a model at its present values.
        logs: one or several.
        holdout: unseen ones.
        seed: of the random features, and of the halves of the logs.
        progress: True for a bar, or a function of a message and the share done.

    Returns:
        For each measured channel the share of the squared error, with an interval, that of all
        possible shares where there are fewer than a hundred samples to learn from; a sentence.

    Raises:
        InputError: a log without a channel that the model needs, or no channel in common.

    Example:
        >>> left = dft.diagnosis.headroom(fit, log, holdout=unseen)
        >>> left.worth
        False
    """
    report = reporter(progress)
    report("simulating", 0.0)
    learn, judge = compare(fit, logs), compare(fit, holdout) if holdout else None
    return headroom_of(learn, judge, seed, subtask(report, 0.1, 1.0))


def headroom_between(learn: Comparison, judge: Comparison | None) -> Headroom | None:
    """`headroom_of` two comparisons; ``None`` where they have no channel in common."""
    try:
        return headroom_of(learn, judge)
    except InputError:
        return None


@one_blas_thread()
def headroom_of(
    learn: Comparison, judge: Comparison | None, seed: int = 0, progress: Progress | None = None
) -> Headroom:
    """`headroom` from comparisons with the logs to learn from, and with unseen ones."""
    model, runs, unseen = learn.model, learn.runs, judge.runs if judge else None
    channels, report = {}, reporter(progress)
    names = list(dict.fromkeys(n for run in (unseen or runs) for n in run.channels))
    hidden = bool({*model.all_states} - {n for run in runs for n in run.channels})
    for k, name in enumerate(names):
        report(f"what could be explained of {name}", k / len(names))
        train, test = (_records(model, logs, name) for logs in (runs, unseen or ()))
        measured = [r.channels[name].measured for r in (unseen or runs) if name in r.channels]
        if train:
            channels[name] = _channel(_thinned(train), test, np.concatenate(measured), seed, hidden)
    if not channels:
        raise InputError(
            "headroom: the logs to learn from and the unseen ones have no channel in common.",
            "Give logs that measure the same channels.",
        )
    report("done", 1.0)
    return Headroom(channels, "unseen" if unseen else "left-out", str(model))


def _records(model: Model, runs: Sequence[Run], name: str) -> list[ErrorRecord]:
    """The errors of a channel in the runs that have any: a sensor may have started late."""
    measuring = [run for run in runs if name in run.channels]
    records = [_record(model, run, name) for run in measuring]
    return [record for record in records if np.isfinite(record.error).any()]


def _record(model: Model, run: Run, name: str) -> ErrorRecord:
    signals: dict[str, np.ndarray] = {}
    for key, values in run.signals.items():
        if key in model.angles:  # one more turn is the same direction
            signals |= {f"cos {key}": np.cos(values), f"sin {key}": np.sin(values)}
        elif run.units.get(key) != "m":  # a vessel's errors do not depend on where it is
            signals[key] = values
    return ErrorRecord(run.time, signals, run.channels[name].residual, run.record.log.static)


def _thinned(records: list[ErrorRecord]) -> list[ErrorRecord]:
    """Records with fewer errors; signals keep all samples, for the filters."""
    every = -(-sum(r.time.size for r in records) // _MOST_SAMPLES)
    kept = [np.arange(r.time.size) % every == 0 for r in records]
    return [
        r._replace(error=np.where(k, r.error, np.nan)) for r, k in zip(records, kept, strict=True)
    ]


def _channel(
    train: list[ErrorRecord], test: list[ErrorRecord], measured: np.ndarray, seed: int, hidden: bool
) -> ChannelHeadroom:
    """The headroom of a channel; ``hidden`` says whether the model has states nobody measures.

    What is missing may be a law of such a state. The model's own is then no guide to it, and a
    correction learns it from many swings only: from few it excludes no share.
    """
    if len(train) < _FEWEST_RECORDS:
        train = [stretch for record in train for stretch in _cut(record, _STRETCHES // len(train))]
    samples = sum(int(np.isfinite(r.error).sum()) for r in train)
    nothing = Explainable(0.0, 0.0, 1.0, Rung.NOTHING, ())
    explained = (
        explainable(train, test, seed) if samples >= SETTINGS.headroom.least_samples else nothing
    )
    few = samples and independent_samples(train) < SETTINGS.headroom.least_independent
    if hidden and few:
        explained = explained._replace(high=1.0)
    errors = np.concatenate([record.error for record in test or train])
    physics = float(np.sqrt(np.nanmean(errors**2))) / float(np.nanstd(measured))
    corrected = physics * float(np.sqrt(1.0 - explained.share))
    return ChannelHeadroom(physics, corrected, *explained, samples)


def _cut(record: ErrorRecord, into: int) -> list[ErrorRecord]:
    """A record in consecutive stretches with about as many errors each."""
    measured = np.flatnonzero(np.isfinite(record.error))
    inner = measured[np.linspace(0, measured.size, into + 1).astype(int)[1:-1]]
    edges = [0, *inner, record.time.size]
    return [
        ErrorRecord(
            record.time[a:b],
            {n: v[a:b] for n, v in record.signals.items()},
            record.error[a:b],
            record.static,
        )
        for a, b in pairwise(edges)
    ]


def _words(name: str, c: ChannelHeadroom, judged_on: str) -> str:
    where, (physics, corrected, share, interval, rung) = f"on {judged_on} logs", c.cells
    if c.samples < SETTINGS.headroom.least_samples:
        return (
            f"What a flexible model could explain of the error of {name} {where}, {c.samples} "
            f"samples to learn from do not tell: {SETTINGS.headroom.least_samples} are needed."
        )
    start = f"Of the squared error of {name} {where}, "
    if c.high < SETTINGS.headroom.worthwhile_share:
        return (
            f"{start}a flexible model explains {share} ({interval}): what is left does not repeat, "
            "or these signals do not tell it."
        )
    if c.low <= 0:
        return (
            f"{start}these logs are too few to tell what a flexible model could explain ({share}, "
            f"{interval})."
        )
    return (
        f"{start}a flexible model ({rung}) explains {share} ({interval}): the NRMSE could fall "
        f"from {physics} to about {corrected}, or further by the right physics."
    )


# -- what recurs -----------------------------------------------------------------------------------


def recurring_shares(model: Model, runs: Sequence[Run]) -> dict[str, Worth]:
    """By channel the share of the squared error that recurs, from all runs that repeat others.

    The inputs of a model are compared over whole logs; empty where no two have the same.
    """
    repeats = [(a, b, n) for a, b in combinations(runs, 2) if (n := _common(model, a, b))]
    channels = (name for a, _, _ in repeats for name in a.channels)
    pairs: dict[str, list[dict[str, BeforeAfter]]] = {name: [] for name in channels}
    for a, b, n in repeats:
        for name in (name for name in a.channels if name in b.channels):
            pairs[name] += ({name: pair} for pair in _halved(a, b, name, n))
    return {name: explained_share(halves) for name, halves in pairs.items() if halves}


def _common(model: Model, first: Run, second: Run) -> int:
    """The number of samples over which two runs have the same inputs; 0 if they have not."""
    size = min(first.time.size, second.time.size)
    steps = [np.median(np.diff(run.time)) for run in (first, second)]
    if size < _FEWEST_COMMON or not np.isclose(*steps, rtol=1e-2):
        return 0
    for name in model.inputs:
        a, b = (run.signals[name][:size] for run in (first, second))
        if not np.std(a - b) <= SETTINGS.verdict.repeated_input * np.std(a):
            return 0
    return size


def _halved(first: Run, second: Run, name: str, size: int) -> Iterator[BeforeAfter]:
    """The errors of two runs, and half their difference's square: what does not recur."""
    errors = [run.channels[name].residual[:size] for run in (first, second)]
    both = np.isfinite(errors[0]) & np.isfinite(errors[1])
    if np.count_nonzero(both) < _FEWEST_COMMON:
        return
    measured = np.where(both, first.channels[name].measured[:size], np.nan)
    mean = np.sqrt(0.5 * (errors[0] ** 2 + errors[1] ** 2))
    yield BeforeAfter(measured, mean, (errors[0] - errors[1]) / np.sqrt(2.0))

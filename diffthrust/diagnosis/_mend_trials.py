"""Fits to mended logs: whether a doubt is right, and what its mend is worth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import islice

import numpy as np

from diffthrust.diagnosis._explained_share import BeforeAfter, explained_share
from diffthrust.diagnosis._mended import MeasuredMend
from diffthrust.diagnosis._search_state import FittedStage, SearchContext
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.simulation._record import bind
from diffthrust.simulation._runs import Run, pooled_errors

_STARTS = 4
"""Numerics: starts of a fit to mended logs: the optimum may be far from that of the logs as they
are, where the model stood still rather than move against them."""


def measured_mends(context: SearchContext, first: FittedStage) -> tuple[MeasuredMend, ...]:
    """The model as given, fitted to the logs without each mistake that is doubted.

    Args:
        context: what the search works with.
        first: the model as given, fitted to the logs as they are; with its doubts.
    """
    used = {*context.given.inputs, *context.given.optional_inputs, *first.fit.train.channels}
    tried = (
        (doubt, k)
        for doubt in first.fit.doubts
        for k, reading in enumerate(doubt.readings)
        if set(reading.sources) <= {*used, "time"}
    )
    mends = []
    for doubt, k in islice(tried, SETTINGS.whole_runs.most_mends):
        reading = doubt.readings[k]
        context.say(f"with {reading.words}", 0.1)
        train, unseen = (
            bind(context.given, doubt.mended([record.log for record in records], k))
            for records in (context.fitter.records, context.unseen)
        )
        fitted = context.refit(
            first.fit.model,
            guesses=[context.guess],
            starts=_STARTS,
            records=(train, unseen),
            segments=True,
        )
        before = first.unseen_runs or first.runs
        after = fitted.holdout_runs or fitted.runs
        errors = pooled_errors(before), pooled_errors(after)
        if math.isfinite(errors[1].nrmse):
            worth = explained_share(_paired(before, after))
            mends.append(MeasuredMend(doubt, reading, *errors, worth, bool(context.unseen)))
    return tuple(mends)


def _paired(before: Sequence[Run], after: Sequence[Run]) -> list[dict[str, BeforeAfter]]:
    """The errors of both fits in units of what each channel does in the logs of that fit."""
    spread = [
        {name: _spread(runs, name) for run in runs for name in run.channels}
        for runs in (before, after)
    ]
    return [
        {
            name: BeforeAfter(
                trace.measured / spread[0][name],
                trace.residual / spread[0][name],
                mended.channels[name].residual / spread[1][name],
            )
            for name, trace in run.channels.items()
            if name in mended.channels and spread[0][name] > 0 and spread[1][name] > 0
        }
        for run, mended in zip(before, after, strict=True)
    ]


def _spread(runs: Sequence[Run], name: str) -> float:
    values = [run.channels[name].measured for run in runs if name in run.channels]
    return float(np.nanstd(np.concatenate(values)))

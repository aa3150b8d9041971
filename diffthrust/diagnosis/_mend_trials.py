"""Fits to mended logs: whether a doubt is right, and what its mend is worth."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import islice

import numpy as np

from diffthrust.diagnosis._criteria import missed
from diffthrust.diagnosis._explained_share import BeforeAfter, explained_share
from diffthrust.diagnosis._mended import MeasuredMend
from diffthrust.diagnosis._search_state import FittedStage, SearchContext
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.estimation._fit import FitRuns
from diffthrust.estimation._result import Fit
from diffthrust.simulation._record import bind
from diffthrust.simulation._runs import Run, pooled_errors
from diffthrust.soundness._doubt import Doubt

_STARTS = 4
"""Numerics: starts of a fit to mended logs: the optimum may be far from that of the logs as they
are, where the model stood still rather than move against them."""
_AGREEING = 2
"""Numerics: starts that must end in an optimum for what a mend is worth to be told of it."""


def measured_mends(context: SearchContext, first: FittedStage) -> tuple[MeasuredMend, ...]:
    """The model as given, fitted to the logs without each mistake that is doubted.

    None of a reading whose fit has not reached what several starts reach.
    The logs as they are are fitted from where those ended, too: on the BlueBoat, whose own fit had
    ended in 0.95, an exchange of the thrusters that ended in 0.76 was credited with what more
    starts do to the logs as they are. No two of their starts need to agree: with a mistake in them
    a model may have no optimum that is worth the name.
    """
    used = {*context.given.inputs, *context.given.optional_inputs, *first.fit.train.channels}
    tried = (
        (doubt, k)
        for doubt in first.fit.doubts
        for k, reading in enumerate(doubt.readings)
        if set(reading.sources) <= {*used, "time"}
    )
    fits, guesses = [], [context.guess]
    for doubt, k in islice(tried, SETTINGS.whole_runs.most_mends):
        fitted = _fitted_to_mended(context, first, doubt, k, guesses)
        if not _is_reached(fitted.fit):
            continue
        guesses.append({n: e.value for n, e in fitted.fit.parameters.items() if not e.fixed})
        fits.append((doubt, doubt.readings[k], fitted))
    if not fits:
        return ()
    baseline = _as_they_are(context, first, guesses)
    mends = []
    for doubt, reading, fitted in fits:
        before = baseline.unseen_runs or baseline.runs
        after = fitted.holdout_runs or fitted.runs
        errors = pooled_errors(before), pooled_errors(after)
        if math.isfinite(errors[1].nrmse):
            worth = explained_share(_paired(before, after))
            mends.append(MeasuredMend(doubt, reading, *errors, worth, bool(context.unseen)))
    return tuple(mends)


def _fitted_to_mended(
    context: SearchContext,
    first: FittedStage,
    doubt: Doubt,
    k: int,
    guesses: Sequence[Mapping[str, float]],
) -> FitRuns:
    """The model as given, fitted to the logs with the k-th reading of a doubt.

    Also from where the fits to other readings ended: an exchange of two thrusters is a turned yaw
    rate and a turned sway, and on the BlueBoat it ran into a sway damping of 7000 N s/m by itself.
    """
    context.say(f"with {doubt.readings[k].words}", 0.1)
    train, unseen = (
        bind(context.given, doubt.mended([record.log for record in records], k))
        for records in (context.records, context.unseen)
    )
    records = (train, unseen)
    return context.refit(first.fit.model, guesses, starts=_STARTS, records=records, segments=True)


def _as_they_are(
    context: SearchContext, first: FittedStage, guesses: Sequence[Mapping[str, float]]
) -> FittedStage:
    """The model as given on the logs as they are; fitted as to mended ones, where it pays."""
    if _is_reached(first.fit) and first.fit.checks.starts >= _STARTS:
        return first
    fitted = context.refit(first.fit.model, guesses=guesses, starts=_STARTS, segments=True)
    again = FittedStage((), *fitted)
    failed = not math.isfinite(again.train.nrmse)
    return first if failed or missed(first, again) else again


def _is_reached(fit: Fit) -> bool:
    return fit.checks.starts_agreeing >= _AGREEING


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

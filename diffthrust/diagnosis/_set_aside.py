"""Logs that are set aside: unlike the others by every fit, and then not what a verdict rests on.

A fit follows the logs that it is made of, and may end badly: one that has lost a log it needed
errs more on the others, and would accuse these of what it did itself. So a log is called unlike
the others only where it is so by the best fit of all logs and by that of the others, and where the
latter is as good on the others as the former.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from diffthrust.comparison._compare import comparison_of
from diffthrust.diagnosis._findings import Assessment, OddLog
from diffthrust.diagnosis._innovations_fit import CandidateFitter, TrialFit
from diffthrust.diagnosis._outlier_logs import error_ratio
from diffthrust.diagnosis._residual_structure import remaining_structure
from diffthrust.diagnosis._search_start import compiled_fitter
from diffthrust.diagnosis._search_state import FittedStage, SearchContext
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.simulation._runs import Run, pooled_errors, runs_over

_STARTS = 2
"""Numerics: starts of a fit without the odd logs, or with all: its model is fitted already, and one
more tells whether these had bent it into another valley."""
_SAME = 1.01
"""Numerics: a fit has reached another's error over the same logs where it is larger by no more."""


def upheld(
    context: SearchContext, last: FittedStage, odd: tuple[OddLog, ...]
) -> tuple[tuple[OddLog, ...], FittedStage | None]:
    """The odd logs less those whose accusation another fit does not bear out.

    Args:
        context: what the search worked with.
        last: the last stage, fitted to all training logs.
        odd: the logs that deviate by that fit.

    Returns:
        The odd logs, and the last stage fitted without the accused ones; none where no training
        log is accused.
    """
    accused = {log.log for log in odd if log.accused}
    if not accused:
        return odd, None
    records, unseen = context.fitter.records, context.unseen
    kept = [record for record in records if record.name not in accused]
    kept_unseen = [record for record in unseen if record.name not in accused]
    runs: list[Sequence[Run]] = []
    others = None
    if not kept:  # nothing would be left to fit
        return tuple(log for log in odd if not log.accused), None
    if len(kept) < len(records):
        context.say("without the odd logs", 1.0)
        others = FittedStage(
            last.effects,
            *context.refit(last.fit.model, starts=_STARTS, records=(kept, kept_unseen)),
        )
        if not _as_good(others, last, accused):
            return tuple(log for log in odd if not log.accused), None
        runs.append(runs_over(others.fit.model, (*records, *unseen)))
    if len(kept_unseen) < len(unseen):  # the fit has not seen these
        context.say("with the odd logs", 1.0)
        all_logs = (*records, *unseen), ()
        runs.append(context.refit(last.fit.model, starts=_STARTS, records=all_logs).runs)
    before = (*last.trained.runs, *(last.judged.runs if unseen else ()))
    least = SETTINGS.outlier_logs.least_error_ratio
    cleared = {
        log.log
        for log in odd
        if log.accused
        and error_ratio(log, before) > least
        and not all(error_ratio(log, by_fit) > least for by_fit in runs)
    }
    if not cleared:
        return odd, others
    return upheld(context, last, tuple(log for log in odd if log.log not in cleared))


def _as_good(others: FittedStage, last: FittedStage, accused: set[str]) -> bool:
    """Whether a fit without some logs errs no more on the others than the fit of all logs does."""
    pairs = [(others.runs, last.runs, _SAME)]
    if others.unseen_runs:
        pairs.append((others.unseen_runs, last.unseen_runs, SETTINGS.admission.most_unseen_growth))
    return all(
        pooled_errors(without).nrmse
        <= most * pooled_errors([run for run in every if run.name not in accused]).nrmse
        for without, every, most in pairs
    )


def set_aside(
    context: SearchContext, last: FittedStage, assessment: Assessment, others: FittedStage | None
) -> Assessment:
    """The assessment without the odd logs that carry much of the error.

    A log that disagrees with the others may say nothing about what all of them lack, and bends the
    parameters that they share: where one is among the training logs the last stage is fitted
    without it, and tested for structure once more.

    Args:
        context: what the search worked with.
        last: the last stage.
        assessment: with the odd logs.
        others: the last stage fitted without those that are accused.

    Returns:
        The same where no log is so odd, and where no unseen log would be left: what is odd about
        the only one may be what the model lacks.
    """
    odd = {log.log for log in assessment.odd_logs if log.accused}
    if not odd:
        return assessment
    records, unseen = context.fitter.records, context.unseen
    trained, judged = (
        tuple(run for run in runs if run.name not in odd)
        for runs in (last.trained.runs, last.judged.runs if unseen else ())
    )
    removed = len(records) + len(unseen) - len(trained) - len(judged)
    if removed > len(odd) or (unseen and not judged):  # several logs may bear one name
        return assessment
    if others is None:
        return replace(assessment, apart=(last.trained, comparison_of(last.fit, judged)))
    kept = [run.record for run in trained], [run.record for run in judged]
    fitter, trial = compiled_fitter(others.fit, (), (), *kept)
    return replace(
        assessment,
        remaining=remaining_structure(fitter, trial),
        one_step=one_step_sizes(fitter, trial),
        apart=(others.trained, others.judged),
    )


def one_step_sizes(fitter: CandidateFitter, trial: TrialFit) -> dict[str, float]:
    """Standard deviations of the one-step errors of a trial, by channel."""
    return dict(zip(fitter.channels, map(float, trial.quadratic.sigma), strict=True))

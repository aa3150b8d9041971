"""The start of a search: the model as given, fitted, and the programs of its trials."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust._support.progress import Progress, subtask
from diffthrust.diagnosis._candidates import Candidates, candidates_of, constants_of
from diffthrust.diagnosis._innovations_fit import CandidateFitter, TrialFit
from diffthrust.diagnosis._search_state import (
    FITTED,
    Clock,
    CurrentModel,
    FittedStage,
    Refit,
    SearchContext,
    SearchState,
)
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.diagnosis._trial_windows import trial_windows
from diffthrust.estimation._fit import FitRuns
from diffthrust.estimation._horizons import schedule, to_whole_runs
from diffthrust.estimation._result import Fit
from diffthrust.estimation._status import Status
from diffthrust.models._base.effect import Effect
from diffthrust.models._base.model import Model
from diffthrust.simulation._errors import Errors
from diffthrust.simulation._levels import levels_when_asked
from diffthrust.simulation._linearise import InfiniteSlope
from diffthrust.simulation._record import Record
from diffthrust.simulation._runs import (
    Run,
    failures,
    infinite_slopes,
    pooled_errors,
    runs_over,
    with_steps,
)
from diffthrust.simulation._step_size import CoarseStepWarning, noise_levels

_SUBSTEPS = 2
"""Numerics: integrator steps per sample of the trials: over one sample errors do not accumulate."""
_ALIKE = 0.02
"""Numerics: relative change of the whole-run NRMSE above which more steps per sample are taken."""
_SAME = 0.005
"""Numerics: the same for fits to whole runs that are compared: one in a hundred of a squared error,
of which an effect has to remove several. Of a boat whose thrust ends as a step of its command the
trials needed 16 steps a sample, for what they do from one sample to the next; with 2 its whole runs
err the same to 0.05 %, and the fits of its pairs took 16 to 47 s each with 16."""
_UNNOTICED = 1.0
"""Numerics: so are they where their error makes a likelihood ratio of this: of a vehicle with eight
thrusters that turns fast it was 87 with two steps, and a thruster's place 0.2 mm off explained 25
of it; with four it is 0.13."""


def start_search(
    fit: Fit | Model,
    train: Sequence[Record],
    unseen: Sequence[Record],
    wanted: Candidates | None,
    seed: int,
    say: Progress,
) -> tuple[SearchContext, SearchState]:
    """Fit the model as it is, and compile the programs of the trials."""
    say("fitting the model as it is", 0.0)
    clock = Clock()
    options = fit.options if isinstance(fit, Fit) else {}
    refit = Refit(train, unseen, {"seed": seed, **options}, clock)
    progress = subtask(say, 0.0, FITTED)
    if isinstance(fit, Fit):
        fitted = _with_its_runs(fit, train, unseen)
        fitted = fitted or refit(fit.model, progress=progress, doubts=True)
        guess = fit.guess
    else:
        fitted = refit(fit, progress=progress, doubts=True)
        guess = fitted.fit.guess
    first = fitted.fit
    refit = replace(refit, first_substeps=few_substeps(first, train))
    if first.horizon is None:
        refit = replace(refit, horizon=to_whole_runs(schedule(first.model, train, "auto")))
    effects, untestable = candidates_of(first.model, (*train, *unseen), wanted)
    levels = levels_when_asked(first.model, train)
    effects = [effect.scaled(levels) for effect in effects]
    if len(train) > 1:
        effects = [effect.differing() for effect in effects]
    say("compiling the trials", FITTED)
    with clock("compile"):
        constants = constants_of(first.model, wanted)
        windows = trial_windows(first.model, fitted.runs)
        fitter, trial = compiled_fitter(first, effects, constants, train, unseen, windows)
    mend_first = any(doubt.contrary for doubt in first.doubts)
    context = SearchContext(first.model, fitter, tuple(unseen), refit, guess, say, mend_first)
    stage = FittedStage((), *fitted)
    return context, SearchState(CurrentModel(fitter, trial), (stage,), untestable)


def _with_its_runs(fit: Fit, train: Sequence[Record], unseen: Sequence[Record]) -> FitRuns | None:
    """A fit with its runs over the logs of this diagnosis; ``None`` if it is of other logs.

    It is of these logs if its errors agree with those of the runs. Its errors on unseen logs are
    those of the fit, whose steps may be finer there than on the training logs: a fit of a boat that
    needed 32 steps a sample where it had 16 was taken for one of other logs, and fitted anew from
    0.72 to 0.76.
    """
    if len(fit.initial) != len(train):
        return None
    runs = runs_over(fit.model, train, initial=fit.initial, substeps=fit.substeps)
    if not _agree(fit.train, pooled_errors(runs)):
        return None
    if not unseen:
        return FitRuns(replace(fit, holdout=None) if fit.holdout else fit, runs, ())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CoarseStepWarning)  # the fit has warned
        finer = runs_over(fit.model, unseen, noise=fit.noise_of_runs)
    unseen_runs = with_steps(fit.model, finer, fit.substeps)
    errors = [pooled_errors(finer), pooled_errors(unseen_runs)]
    if fit.holdout is None or not any(_agree(fit.holdout, each) for each in errors):
        fit = replace(fit, holdout=errors[0])
    return FitRuns(fit, runs, unseen_runs)


def _agree(errors: Errors, others: Errors) -> bool:
    return errors.nrmse < math.inf and math.isclose(errors.nrmse, others.nrmse, rel_tol=1e-6)


def compiled_fitter(
    fit: Fit,
    effects: Sequence[Effect],
    constants: Sequence[str],
    train: Sequence[Record],
    unseen: Sequence[Record],
    windows: Sequence[Record],
    present: TrialFit | None = None,
    steps: Sequence[int] = (),
) -> tuple[CandidateFitter, TrialFit]:
    """The fitter, and its first trial: the model as it is, or with the effects of ``present``.

    Of the training logs only the ``windows`` are passed (see `trial_windows`).

    A model whose fit has failed is tried alone first, before all its candidates are compiled. The
    ``steps``, of integration a sample, are tried in turn: those of the fit, if not given, but an
    effect that is present may need more.
    """
    failed = fit.status is Status.SIMULATION_FAILED
    if failed and not math.isfinite(_trial_of(fit, [], train).cost):
        raise _not_finite(fit, [], train)
    for substeps in dict.fromkeys(steps or (trial_substeps(fit, train), fit.substeps)):
        logs = (windows, unseen)
        fitter = CandidateFitter(fit.model, effects, *logs, substeps, fit.noise_model, constants)
        first = fitter.base(present.effects, present.values) if present else fitter.base()
        if math.isfinite(first.cost):
            _refuse_blinding(fit, effects, train, first)
            return fitter, first
    raise _not_finite(fit, effects, train)


def with_finer_steps(
    context: SearchContext, state: SearchState
) -> tuple[SearchContext, SearchState]:
    """The search with as many integrator steps a sample as the runs of its last stage need.

    Trials have as many as the model as given needs. The water in the duct of an NGS thruster needs
    16, and with one its trials ran away: a speed sensor offset passed for a command offset, with
    which the training runs surely err less.
    """
    fitter, fit = context.fitter, state.stages[-1].fit
    present, records = fitter.substeps, context.records
    if fit.substeps <= present:
        return context, state
    coarse = pooled_errors(runs_over(fit.model, records, initial=fit.initial, substeps=present))
    if coarse.nrmse <= SETTINGS.whole_runs.equivalent_error * fit.train.nrmse:
        return context, state
    trial, values = state.current.trial, fit.model.parameters
    fitted = {name: values[name].value for name in trial.values if name in values}
    try:
        with context.clock("compile"):
            finer, settled = compiled_fitter(
                state.stages[0].fit,
                [*fitter.candidates.values()],
                fitter.constants,
                records,
                context.unseen,
                fitter.records,
                replace(trial, values={**trial.values, **fitted}),
                (trial_substeps(fit, records), fit.substeps),
            )
    except InputError:  # one-step trials overflow where whole runs do not: better coarse than none
        return context, state
    return replace(context, fitter=finer), replace(state, current=CurrentModel(finer, settled))


def few_substeps(fit: Fit, train: Sequence[Record]) -> int:
    """The fewest integrator steps per sample that reproduce the whole-run errors of a fit.

    Fits of many models that are compared with each other have as many; one that is kept begins with
    them, and goes on to as many as it needs.
    """
    return _fewest(fit, train, lambda _, error: math.isclose(error, fit.train.nrmse, rel_tol=_SAME))


def trial_substeps(fit: Fit, train: Sequence[Record]) -> int:
    """The fewest for trials, whose error from one sample to the next must be lost in the noise."""
    if fit.substeps <= _SUBSTEPS:
        return fit.substeps
    fine = runs_over(fit.model, train, initial=fit.initial, substeps=fit.substeps)

    def serve(runs: Sequence[Run], error: float) -> bool:
        alike = math.isclose(error, fit.train.nrmse, rel_tol=_ALIKE)
        return alike and _step_evidence(runs, fine) < _UNNOTICED

    return _fewest(fit, train, serve)


def _fewest(
    fit: Fit, train: Sequence[Record], serve: Callable[[Sequence[Run], float], bool]
) -> int:
    """The fewest integrator steps per sample whose whole runs and NRMSE ``serve`` accepts.

    Of a fit that has failed, whose errors are infinite with any steps, its own.
    """
    substeps = min(_SUBSTEPS, fit.substeps)
    while substeps < fit.substeps:
        runs = runs_over(fit.model, train, initial=fit.initial, substeps=substeps)
        error = pooled_errors(runs).nrmse
        if math.isfinite(error) and serve(runs, error):
            break
        substeps *= 2
    return substeps


def _step_evidence(coarse: Sequence[Run], fine: Sequence[Run]) -> float:
    """The likelihood ratio that an effect gains by what coarse steps do within a sample alone."""
    total = 0.0
    for run, finer in zip(coarse, fine, strict=True):
        noise = noise_levels(run.record)
        for name, trace in run.channels.items():
            moved = np.diff(trace.modelled - finer.channels[name].modelled)
            moved = moved[np.isfinite(trace.measured[1:])] / noise.get(name, np.inf)
            total += float(np.sum(moved**2))
    return total


def _refuse_blinding(
    fit: Fit, effects: Sequence[Effect], train: Sequence[Record], first: TrialFit
) -> None:
    """Raise where a user's effect makes the linear response of all others NaN, though it is absent.

    A root of what is zero in some samples is finite, and its slope is not: beside it no effect
    promised anything, and dry friction that was there went unseen.
    """
    # a response is not worked out for the catalogue's effects
    own = [effect for effect in effects if effect.of_user]
    if own and not _has_response(first) and (error := _blamed(fit, own, train, _has_response)):
        raise error


def _has_response(trial: TrialFit) -> bool:
    return all(
        bool(np.all(np.isfinite(array)))
        for s in trial.response.slopes
        for array in (s.transition, s.push_now, s.push_over, s.output, s.direct, s.jacobian)
    )


def _not_finite(fit: Fit, effects: Sequence[Effect], train: Sequence[Record]) -> InputError:
    """The error if no trial has a finite cost; it names the user's effect that is the cause."""
    own = [effect for effect in effects if effect.of_user]
    if error := _blamed(fit, own, train, lambda trial: math.isfinite(trial.cost)):
        return error
    # no cost hangs on derivatives by inputs and ports
    if slope := _infinite_slope(fit, train, places=False):
        return InputError(f"The '{fit.model}' cannot be diagnosed. {slope.problem}", slope.mend)
    return InputError(
        f"The '{fit.model}' cannot be simulated along these logs at the parameters of its fit "
        f"({fit.status.value}): expected finite one-step errors, found none."
        + (f" {fit.message}" if fit.status is Status.SIMULATION_FAILED else ""),
        "Give bounds that keep its time constants longer than a fifth of a sample, and check "
        "the units of the logs.",
    )


def _infinite_slope(fit: Fit, train: Sequence[Record], *, places: bool) -> InfiniteSlope | None:
    """Where a derivative of a fit's model along its logs is not finite, though its runs are."""
    begun = None if fit.status is Status.SIMULATION_FAILED else fit.initial
    runs = runs_over(fit.model, train, initial=begun, substeps=fit.substeps)
    return None if failures(runs) else infinite_slopes(fit.model, runs, places=places)


def blind_notes(state: SearchState, train: Sequence[Record]) -> tuple[str, ...]:
    """A note where nothing can be predicted beside the model, and why.

    Only what a search has worked out is looked at: a note is worth no program of its own.
    """
    trial = state.current.trial
    if "response" not in vars(trial) or _has_response(trial):
        return ()
    slope = _infinite_slope(state.stages[0].fit, train, places=True)
    # an effect that was added may be the cause: a root of a speed that is zero in some samples
    added = "" if slope or not trial.effects else f" with {listing(trial.effects)}"
    return (
        "What the effects promise and what is missing at the ports cannot be predicted: along "
        f"these logs the model as given{added} has derivatives that are not finite."
        + (f" {slope.problem} {slope.mend}" if slope else ""),
    )


def _blamed(
    fit: Fit,
    own: Sequence[Effect],
    train: Sequence[Record],
    is_sound: Callable[[TrialFit], bool],
) -> InputError | None:
    """The error for the user's effect with which, absent, a trial is not sound that is without."""
    if not own or not is_sound(_trial_of(fit, [], train)):
        return None
    for effect in own:
        if not is_sound(_trial_of(fit, [effect], train)):
            return InputError(
                f"The effect '{effect.name}' cannot be tried: at its null value the errors or "
                "their derivatives are not finite.",
                "Write it so that its derivative at the null is finite (no root or logarithm "
                "of zero), or leave it out.",
            )
    return None


def _trial_of(fit: Fit, effects: Sequence[Effect], train: Sequence[Record]) -> TrialFit:
    """The first trial with only these candidates."""
    return CandidateFitter(fit.model, effects, train, [], fit.substeps, fit.noise_model).base()

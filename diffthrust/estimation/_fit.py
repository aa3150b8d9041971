"""Fitting a model to logs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal, NamedTuple

import numpy as np

from diffthrust._support.later import Later
from diffthrust._support.progress import ProgressOption, progressing, reporter
from diffthrust._support.warned import warn
from diffthrust.estimation._arguments import (
    WORDS,
    FitOptions,
    check_arguments,
    check_guesses,
    differing_by_log,
    likelihood_of,
    training_and_unseen,
)
from diffthrust.estimation._estimate import Estimate, shown_unit
from diffthrust.estimation._horizons import schedule
from diffthrust.estimation._insensitive import vanished_notes
from diffthrust.estimation._laws import rail_notes
from diffthrust.estimation._likelihood import noise_levels
from diffthrust.estimation._optimum import Optimum, Task, optimum_of
from diffthrust.estimation._origin import origin_of
from diffthrust.estimation._per_log import per_log_notes, per_log_of
from diffthrust.estimation._problem import Problem
from diffthrust.estimation._refine import disturbance_of, limits_of, rounding_of
from diffthrust.estimation._result import Fit
from diffthrust.estimation._solver import Solved
from diffthrust.estimation._status import (
    GRADIENT_LIMIT,
    Checks,
    Local,
    correlation_notes,
    effect_notes,
    examine,
    failed_over,
    judge,
    unstable_advice,
)
from diffthrust.estimation._unexplained import (
    doubts_about,
    hint_at,
    little_explained,
    silent_doubts,
    with_runaways,
)
from diffthrust.logs._log import Log
from diffthrust.logs._written import ShownUnits
from diffthrust.models._base.model import Model
from diffthrust.simulation._commands import adopted
from diffthrust.simulation._levels import with_sizes
from diffthrust.simulation._record import Record, bind, input_ranges
from diffthrust.simulation._runs import (
    Run,
    failures,
    infinite_slopes,
    pooled_errors,
    runs_over,
    shown_of,
    start_notes,
)
from diffthrust.simulation._step_size import CoarseStepWarning


@progressing
def fit(
    model: Model,
    logs: Log | Sequence[Log],
    *,
    holdout: Log | Sequence[Log] | None = None,
    starts: int = 8,
    guesses: Sequence[Mapping[str, float]] = (),
    seed: int = 0,
    horizon: float | Sequence[float | None] | Literal["auto"] | None = "auto",
    likelihood: str = "simulation",
    loss: str = "gaussian",
    noise_model: str = "white",
    initial: Literal["auto", "estimate", "measured"] = "auto",
    substeps: int | None = None,
    per_log: Sequence[str] | None = None,
    doubts: bool = True,
    progress: ProgressOption = None,
) -> Fit:
    """Estimate the free parameters of a model from logs.

    Maximum likelihood of the simulation error: every log is simulated, and the differences to the
    measurements are taken as noise whose level is estimated for each channel where the log does
    not give it. Levenberg-Marquardt in scaled coordinates, within the bounds, from several starts.

    Where random forces act (turbulence, gusts) or sensor errors last from sample to sample,
    ``likelihood="innovations"`` takes the error of predicting each sample from all earlier ones
    (Ljung 1999, section 7.3), and estimates with the parameters how much of an error the model's
    states take over. Its standard errors hold under such noise; it needs a measured state.

    Args:
        model: the model with its effects; its parameter values are the first guess.
        logs: training logs. Each has its own initial state.
        holdout: unseen logs, only compared.
        starts: number of starts; the first is the model's own values.
        guesses: values of parameters by name, of which each mapping is one more start; parameters
            that it does not name begin as the model has them. They are begun with at every horizon,
            and carried to the end at the last, so that the fit ends no worse than the best does.
        seed: of the other starts.
        horizon: the simulation is set to the measured state again every so many seconds. A
            sequence is gone through from the first to the last, each stage from the result of the
            one before; ``None`` means whole runs. "auto" uses whole runs, except for models with a
            ``horizon`` of their own (vessels) and logs of more than twice that length: these are
            fitted on segments of a tenth, a third and all of that length (the shorter, the fewer
            false minima), and on whole runs, where all starts are made once more unless there are
            ``guesses``. If these raise the noise of a channel by more than a tenth, segments of
            three times that length are tried as well, and of the last three the one is taken that
            errs least over whole runs of logs that are left out.
        likelihood: "simulation" or "innovations". The latter goes through whole runs, without a
            ``horizon``; a noise level that a log gives is the sensor's alone, and that of the
            prediction is estimated.
        loss: "gaussian", or "student_t" (4 degrees of freedom), which forgives outliers.
        noise_model: "white", or "ar1": the noise of each channel lasts from sample to sample (a
            first-order autoregression), with a correlation that is estimated. Standard errors
            then hold where residuals are correlated so; a noise level that a log gives is not used.
            For "simulation" only: the innovations form has lasting sensor errors of its own. What
            suits a fit's residuals, `Comparison.noise_advice` says.
        initial: "estimate" the initial value of measured states, or take it as "measured". "auto"
            estimates it for whole runs and takes it as measured for segments, all of which then
            begin alike: a model that lacks something would abuse free initial states to hide it.
            A state that is not measured is estimated for each log, unless the model's `initial`
            gives it by a free parameter, which is then estimated for all logs together. Over
            unseen logs only states that are not measured are estimated.
        substeps: integrator steps per sample; chosen by halving the step where ``None``.
        per_log: parameters that differ from log to log, by full name: a current, a tare, a battery.
            Each log has a value of its own, of a Gaussian about the mean of all; its mean and its
            width are estimated with them (`Fit.per_log`). In an unseen log the value is estimated
            from the first quarter, and a note says so.
        doubts: look whether all logs are sound, the unseen ones too, by
            `diffthrust.soundness.doubts`, once somebody looks at the fit's ``doubts``. Otherwise
            only channels that it hardly explains are doubted.
        progress: True for a bar, or a function of a message and the share done.

    Returns:
        A `Fit`. Look at ``doubts`` and ``status`` first: they are earned by checks, not assumed.

    Raises:
        InputError: a log that does not fit the model, or arguments out of range.

    Example:
        >>> result = dft.fit(dft.Thruster(), log, holdout=unseen, starts=2)
        >>> result.status, round(result.parameters["alpha"].value, 3)
        (<Status.CONVERGED: 'converged'>, 0.037)
    """
    logs, unseen = training_and_unseen(logs, holdout)
    options = FitOptions(
        starts=starts,
        guesses=guesses,
        seed=seed,
        horizon=horizon,
        likelihood=likelihood,
        loss=loss,
        noise_model=noise_model,
        initial=initial,
        substeps=substeps,
        doubts=doubts,
    )
    model = differing_by_log(model, per_log)
    check_arguments(model, logs, options, per_log)
    model = adopted(model, logs)
    check_guesses(model, guesses)
    records, holdout_records = bind(model, logs), bind(model, unseen)
    return fit_records(model, records, holdout_records, options, progress).fit


class FitRuns(NamedTuple):
    """A fit with the whole runs of its model."""

    fit: Fit
    runs: tuple[Run, ...]  # over the training records,
    holdout_runs: tuple[Run, ...]  # and the unseen ones


def fit_records(
    model: Model,
    records: Sequence[Record],
    holdout_records: Sequence[Record],
    options: FitOptions,
    progress: ProgressOption = None,
    first_substeps: int | None = None,
) -> FitRuns:
    """As `fit`, of records bound to the model, whose options are checked; with its runs.

    A refit has ``first_substeps``, the integrator steps per sample that are tried first; those of
    the options are then taken unchecked. Its unseen runs have those of the fit, by which refits
    compare, and its programs compile quickly where they are small.
    """
    records, holdout_records = tuple(records), tuple(holdout_records)
    model = with_sizes(model, records)
    words = {name: getattr(options, name) for name in WORDS}
    likelihood, substeps = likelihood_of(model, records, **words), options.substeps
    task = Task(
        records=records,
        likelihood=likelihood,
        horizons=(None,) if likelihood.corrects else schedule(model, records, options.horizon),
        options=options,
        rng=np.random.default_rng(options.seed),
        tell=reporter(progress),
        refit=first_substeps is not None,
        checked=not (first_substeps and substeps),
    )
    optimum, notes = optimum_of(task, model, substeps, first_substeps or 1)
    for note in optimum.coarse:
        warn(note, CoarseStepWarning)
    steps = optimum.substeps if optimum.failed or first_substeps else substeps
    levels = _of_noise(optimum.problem, optimum.best)
    noise = None if levels["disturbance"] else levels["noise"]
    holdout_runs: tuple[Run, ...] = ()
    if holdout_records:
        holdout_runs = runs_over(optimum.model, holdout_records, substeps=steps, noise=noise)
    notes += failures(holdout_runs) + start_notes(optimum.model, holdout_runs)
    notes += rail_notes(likelihood.law, records)
    task.tell("done", 1.0)
    logs, unseen = [r.log for r in records], [r.log for r in holdout_records]
    fitted = Fit(
        holdout=pooled_errors(holdout_runs) if holdout_runs else None,
        guess={name: p.value for name, p in model.parameters.items()},
        origin=origin_of(logs, unseen),
        ranges=(ranges := input_ranges(model, records)),
        hold={name: records[0].hold[name] for name in ranges},
        written={name: way for log in reversed(logs) for name, way in log.written.items()},
        logs=(*logs, *unseen),
        **words,
        **_judged(optimum, model, notes, (*logs, *unseen) if options.doubts else ()),
        **levels,
    )
    fitted = with_runaways(fitted, optimum.runs, doubts=options.doubts)
    return FitRuns(fitted, optimum.runs, holdout_runs)


def _judged(
    optimum: Optimum, given: Model, notes: tuple[str, ...], doubted: tuple[Log, ...]
) -> dict[str, Any]:
    """What a fit of a model as ``given`` reports of its optimum, with notes on a refit and runs.

    The logs that are ``doubted`` are looked at whether they are sound.
    """
    search, problem, best = optimum.search, optimum.problem, optimum.best
    local, cost = examine(problem, best.z, best.quadratic), best.cost
    if np.isfinite(cost) and local.gradient > GRADIENT_LIMIT:
        local = replace(local, rounding=rounding_of(problem, best))
    agreeing = search.agreeing_on_parameters
    alone = search.begun - len(search.guesses) == 1
    status, message = judge(local, cost, search.begun, agreeing, search.rivals, alone)
    correlated = correlation_notes(problem, best.z, optimum.runs)
    train, failed = pooled_errors(optimum.runs), failures(optimum.runs)
    hint, model, runs, little = "", optimum.model, optimum.runs, {}
    if failed:
        status, message = failed_over(failed, message, np.isfinite(cost))
    elif optimum.failed and (slope := infinite_slopes(model, runs, places=False)):
        message = f"No search can begin. {slope.problem} {slope.mend}"
    else:
        little = little_explained(train)
        corrects = problem.layout.likelihood.corrects
        hint = hint_at(little) + unstable_advice(status, model, runs, corrects)
        hint += optimum.caution * status.ok
    # later: most fits are asked for their numbers alone, and doubts take longer than a small fit
    seen = () if failed else runs
    doubts = Later(lambda: doubts_about(little, seen, model, given, doubted))
    vanished = vanished_notes(problem, best.z)
    of_logs = [f"{run.name}: {note}" for run in optimum.runs for note in run.log.notes]
    estimates = _estimates(problem, best.z, local, shown_of(optimum.runs))
    per_log = per_log_of(problem, best.z, best.quadratic, local.spread, estimates)
    return {
        "model": optimum.released,
        "parameters": estimates,
        "per_log": per_log,
        "covariance": local.covariance,
        "free": problem.own,
        "status": status,
        "message": message + optimum.unmoved + hint,
        "checks": Checks(
            local.gradient, local.rank, local.columns, local.condition, search.begun, agreeing
        ),
        "train": train,
        "log_likelihood": -cost,
        "initial": optimum.states,
        "horizon": problem.horizon,
        "held": problem.held,
        "substeps": optimum.substeps,
        "notes": (
            *optimum.notes,
            *notes,
            *vanished,
            *per_log_notes(per_log),
            *optimum.coarse,
            *correlated,
            *effect_notes(optimum.model, optimum.runs),
            *of_logs,
        ),
        "correlation": correlated,
        "coarse": optimum.coarse,
        "doubts_sought": bool(doubted),
        "doubts": doubts if doubted else silent_doubts(little, (), model, runs),
    }


def _of_noise(problem: Problem, best: Solved) -> dict[str, Any]:
    """What a fit reports of noise and random forces."""
    likelihood = problem.layout.likelihood
    limited = likelihood.corrects and likelihood.law.forgiving
    return {
        "noise": noise_levels(problem, best.z, best.quadratic.sigma),
        "disturbance": disturbance_of(problem, best.z) if problem.nuisance else None,
        "limits": limits_of(problem) if limited else None,
        "reach": float(problem.numbers.reach),
    }


def _estimates(
    problem: Problem, z: np.ndarray, local: Local, shown: ShownUnits
) -> dict[str, Estimate]:
    spread = np.sqrt(np.diagonal(local.covariance))
    errors = dict(zip(problem.own, spread, strict=True))
    values = problem.values(z)
    out = {}
    for name, p in problem.model.parameters.items():
        error = errors.get(name, math.nan)
        per, unit = shown_unit(p, problem.model, shown)
        out[name] = Estimate(
            value=values[name],
            std_error=float(error) if math.isfinite(error) else None,
            unit=p.unit,
            fixed=p.fixed,
            at_bound=name in local.at_bound,
            per=per,
            shown_unit=unit,
        )
    return out

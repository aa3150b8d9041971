"""Fitting a model to logs."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from functools import partial
from typing import Literal

import numpy as np

from diffthrust._support._running.batching import lanes
from diffthrust._support.progress import Progress
from diffthrust.estimation._arguments import check_arguments, listed
from diffthrust.estimation._arrange import build
from diffthrust.estimation._horizons import schedule, through, whole_runs
from diffthrust.estimation._innovations import (
    clipped,
    disturbance_of,
    limits_of,
    observer_for,
    polished,
)
from diffthrust.estimation._insensitive import without_silent
from diffthrust.estimation._likelihood import noise_levels
from diffthrust.estimation._notes import correlation_notes
from diffthrust.estimation._problem import Problem
from diffthrust.estimation._result import Estimate, Fit
from diffthrust.estimation._status import Checks, Local, examine, judge
from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model
from diffthrust.simulation._runs import Run, pooled_errors, runs_over
from diffthrust.simulation._step_size import CoarseStepWarning, fewest_steps


def fit(
    model: Model,
    logs: Log | Sequence[Log],
    *,
    holdout: Log | Sequence[Log] | None = None,
    starts: int = 8,
    seed: int = 0,
    horizon: float | Sequence[float | None] | Literal["auto"] | None = "auto",
    likelihood: Literal["simulation", "innovations"] = "simulation",
    loss: Literal["gaussian", "student_t"] = "gaussian",
    noise_model: Literal["white", "ar1"] = "white",
    initial: Literal["auto", "estimate", "measured"] = "auto",
    substeps: int | None = None,
    progress: Progress | None = None,
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
        seed: of the other starts.
        horizon: the simulation is set to the measured state again every so many seconds. A
            sequence is gone through from the first to the last, each stage from the result of the
            one before; ``None`` means whole runs. "auto" uses whole runs, except for models with a
            ``horizon`` of their own (vessels) and logs of more than twice that length: these are
            fitted on segments of a tenth, a third and all of that length (the shorter, the fewer
            false minima), and then on whole runs if the errors over them are no larger.
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
        substeps: integrator steps per sample; chosen by halving the step where ``None``.
        progress: called with a message and the share done.

    Returns:
        A `Fit`. Look at ``status`` first: it is earned by checks, not assumed.

    Raises:
        InputError: a log that does not fit the model, or arguments out of range.

    Example:
        >>> fit = dft.fit(dft.Thruster(), train, holdout=unseen)
        >>> print(fit.report())
    """
    logs = listed(logs)
    unseen = listed(holdout) if holdout is not None else ()
    check_arguments(
        model,
        logs,
        unseen,
        seed=seed,
        starts=starts,
        substeps=substeps,
        loss=loss,
        initial=initial,
        likelihood=likelihood,
        noise_model=noise_model,
        horizon=horizon,
    )
    guess = {name: p.value for name, p in model.parameters.items()}
    rng = np.random.default_rng(seed)
    chosen = substeps or 1  # the first guess may need more than the optimum does
    observer = observer_for(model, logs) if likelihood == "innovations" else None
    horizons = (None,) if observer else schedule(model, logs, horizon)
    whole = horizon == "auto" and horizons != (None,)
    refitted = False
    while True:
        notes: list[str] = []  # of this pass: a refit tells its own
        arrange = partial(
            build,
            logs=logs,
            substeps=chosen,
            initial="measured" if initial == "measured" else "estimate",
            segmented=any(h is not None for h in horizons),
            loss=loss,
            observer=observer,
            lasting=noise_model == "ar1",
        )
        problem = arrange(model)
        if horizons != (None,) and not any(grid.restarted for grid in problem.layout.grids):
            horizons, whole = (None,), False
            notes.append("No state is measured as it is: whole runs are fitted, not segments.")
        begin = horizons[0] is None
        problem, silent, first = without_silent(problem, arrange, rng, begin)
        found, final = through(problem, horizons, initial == "auto", starts, rng, progress, first)
        length = horizons[-1]
        if whole:
            found, final, length = whole_runs(found, final, length, notes)
        if observer and loss == "student_t":
            found, final = clipped(found, final)
        if observer:
            found = polished(found, final)
        model_found = final.model_at(found.best.z)
        failed = not np.isfinite(found.best.quadratic.cost)
        states = tuple(final.initial_states(found.best.z))
        initial_states = None if failed else states
        runs = runs_over(model_found, logs, initial=initial_states, substeps=chosen)
        needed = _substeps(model_found, runs)
        if needed <= chosen or refitted or substeps:
            break
        model, chosen, refitted = _unfixed(model_found, silent), needed, True
    if refitted:
        notes.append(
            f"The integration step was too coarse at the optimum: refitted with {chosen} steps per "
            "sample."
        )
    if silent:
        notes.append(f"These logs say nothing about {', '.join(silent)}: held at the value given.")
    if needed > chosen:
        notes.append(
            f"At the optimum the model needs {needed} integrator steps per sample, but {chosen} "
            "were used: parameters and errors are off by more than the sensor noise explains."
        )
        if lanes() is None:  # of many fits, each has its note
            warnings.warn(notes[-1], CoarseStepWarning, stacklevel=2)
    best = found.best
    local = examine(final, best.z, best.quadratic)
    agreeing = found.agreeing_on(final)
    status, message = judge(
        local, float(best.quadratic.cost), found.begun, agreeing, found.rivals(final)
    )
    notes += correlation_notes(final, best.z, runs)
    steps = chosen if failed else substeps
    return Fit(
        model=_unfixed(model_found, silent),
        parameters=_estimates(final, best.z, local),
        covariance=local.covariance,
        free=final.own,
        status=status,
        message=message,
        checks=Checks(
            local.gradient, local.rank, local.columns, local.condition, found.begun, agreeing
        ),
        noise=noise_levels(final, best.z, best.quadratic.sigma),
        train=pooled_errors(runs),
        holdout=pooled_errors(runs_over(model_found, unseen, substeps=steps)) if unseen else None,
        log_likelihood=-float(best.quadratic.cost),
        initial=states,
        horizon=length,
        substeps=chosen,
        notes=(*notes, *(f"{log.name}: {note}" for log in logs for note in log.notes)),
        likelihood=likelihood,
        loss=loss,
        noise_model=noise_model,
        disturbance=disturbance_of(final, best.z) if final.nuisance else None,
        held=final.held,
        limits=limits_of(final) if observer and loss == "student_t" else None,
        reach=float(final.numbers.reach),
        guess=guess,
    )


def _substeps(model: Model, runs: Sequence[Run]) -> int:
    """What the log with the longest step needs, from its estimated initial states on."""
    run = max(runs, key=lambda run: (run.log.step, len(run.log)))
    simulated = run.signals if run.substeps == 1 else None
    return fewest_steps(model, run.log, run.start, simulated)[0]


def _unfixed(model: Model, silent: Sequence[str]) -> Model:
    return model.free(*silent) if silent else model


def _estimates(problem: Problem, z: np.ndarray, local: Local) -> dict[str, Estimate]:
    spread = np.sqrt(np.diagonal(local.covariance))
    errors = dict(zip(problem.own, spread, strict=True))
    values = problem.values(z)
    out = {}
    for name, p in problem.model.parameters.items():
        error = errors.get(name, math.nan)
        out[name] = Estimate(
            value=values[name],
            std_error=float(error) if math.isfinite(error) else None,
            unit=p.unit,
            fixed=p.fixed,
            at_bound=name in local.at_bound,
        )
    return out

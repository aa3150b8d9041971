"""Fits to whole runs by which laws are compared, and what a law is worth there."""

from __future__ import annotations

import math

from diffthrust.diagnosis._admit import errors_between
from diffthrust.diagnosis._explained_share import Worth, explained_share
from diffthrust.diagnosis._findings import Stage
from diffthrust.diagnosis._innovations_fit import TrialFit
from diffthrust.diagnosis._search_state import SearchContext, few_substeps
from diffthrust.estimation._result import Fit
from diffthrust.models._base.model import Model

_FLOOR = 1.25
"""Whole runs err as one-step predictions do where by no more than so many times these' size, which
is that of a t-distribution: of Gaussian errors 0.87 of the standard deviation."""


def roughly(tools: SearchContext, baseline: Fit, model: Model, segments: bool = False) -> Fit:
    """A model fitted from its values on, with the fewest integrator steps that do for another."""
    few = few_substeps(baseline, tools.fitter.logs)
    fit = tools.refit(model, starts=1, segments=segments, substeps=few)
    if math.isfinite(fit.train.nrmse):
        return fit
    return tools.refit(model, starts=1, segments=segments)


def worth_between_fits(tools: SearchContext, baseline: Fit, updated: Fit) -> Worth:
    """What one fit removes of the whole-run errors of another, on unseen logs if there are any."""
    logs, trained = (tools.unseen, False) if tools.unseen else (tools.fitter.logs, True)
    return explained_share(
        errors_between(Stage((), baseline), Stage((), updated), logs, trained=trained)
    )


def surely_better(tools: SearchContext, fit: Fit, rival: Fit) -> bool:
    """Whether whole runs of training and unseen logs together are surely better with a fit."""
    stages = Stage((), rival), Stage((), fit)
    trained = errors_between(*stages, tools.fitter.logs, trained=True)
    return explained_share([*trained, *errors_between(*stages, tools.unseen)]).low > 0


def as_good(fit: Fit, reference: Fit, times: float) -> bool:
    """Whether whole runs err by no more than so many times as much, on unseen logs as well."""
    return fit.train.nrmse <= times * reference.train.nrmse and as_good_unseen(
        fit, reference, times
    )


def as_good_unseen(fit: Fit, reference: Fit, times: float) -> bool:
    """The same of unseen logs alone; of training logs, where none is unseen."""
    errors, allowed = (
        (fit.holdout, reference.holdout) if reference.holdout else (fit.train, reference.train)
    )
    return errors is not None and errors.nrmse <= times * allowed.nrmse


def all_explained(tools: SearchContext, trial: TrialFit, fit: Fit) -> bool:
    """Whether whole runs err as the one-step predictions of a trial do: none can do better."""
    sizes = dict(zip(tools.fitter.channels, trial.quadratic.sigma, strict=True))
    return all(fit.train.channels[n].rmse <= _FLOOR * size for n, size in sizes.items())

"""Fits of a model with a learned law: whether whole runs are as good, what a law is worth there."""

from __future__ import annotations

from diffthrust.diagnosis._admit import errors_between
from diffthrust.diagnosis._findings import Stage
from diffthrust.diagnosis._search import Tools
from diffthrust.diagnosis._worth import Worth, worth_of
from diffthrust.estimation._result import Fit


def worth_between_fits(tools: Tools, before: Fit, after: Fit) -> Worth:
    """What one fit removes of the whole-run errors of another, on unseen logs if there are any."""
    logs, trained = (tools.unseen, False) if tools.unseen else (tools.trials.logs, True)
    return worth_of(errors_between(Stage((), before), Stage((), after), logs, trained=trained))


def surely_better(tools: Tools, fit: Fit, other: Fit) -> bool:
    """Whether whole runs of training and unseen logs together are surely better with a fit."""
    stages = Stage((), other), Stage((), fit)
    trained = errors_between(*stages, tools.trials.logs, trained=True)
    return worth_of([*trained, *errors_between(*stages, tools.unseen)]).low > 0


def as_good(fit: Fit, other: Fit, times: float = 1.0) -> bool:
    """Whether whole runs err by no more than so many times as much, on unseen logs as well."""
    pairs = [(fit.train, other.train)]
    if fit.holdout and other.holdout:
        pairs.append((fit.holdout, other.holdout))
    return all(one.nrmse <= times * than.nrmse for one, than in pairs)

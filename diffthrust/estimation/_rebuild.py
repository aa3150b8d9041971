"""The estimation problem of a finished fit, from its own logs or from others."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust.estimation._arguments import WORDS, likelihood_of, listed
from diffthrust.estimation._arrange import build, restarts
from diffthrust.estimation._laws import Gaussian
from diffthrust.estimation._likelihood import errors_at
from diffthrust.estimation._noise import White
from diffthrust.estimation._observer import uncorrected
from diffthrust.estimation._one_step import with_clip
from diffthrust.estimation._problem import Problem
from diffthrust.estimation._residuals import Innovations
from diffthrust.estimation._result import Fit
from diffthrust.estimation._solver import solve
from diffthrust.estimation._status import Status
from diffthrust.logs._log import Log
from diffthrust.simulation._record import Record, bind

_SAME = 1e-6
"""The likelihood is that of the fit where it differs by no more than this times its samples."""


def mark_of(fit: Fit) -> str:
    """A short mark of a fit, by which a posterior of it is known."""
    facts = [fit.log_likelihood, fit.likelihood, fit.loss, fit.noise_model]
    facts += [(n, e.value, e.fixed) for n, e in sorted(fit.parameters.items())]
    return hashlib.sha256(repr((str(fit.model), facts)).encode()).hexdigest()[:16]


def check_mark(post: Any, fit: Fit, what: str) -> None:
    """Raise `InputError` for a posterior of another fit; one without a mark is taken on trust."""
    mark = getattr(post.posterior, "attrs", {}).get("fit")
    if mark is not None and mark != mark_of(fit):
        raise InputError(
            f"{what}: this posterior was drawn from another fit (other estimates, logs or noise).",
            "Give the fit that was sampled, or sample this one.",
        )


def problem_of(fit: Fit, logs: Log | Sequence[Log]) -> tuple[Problem, np.ndarray]:
    """The problem whose optimum a fit is, and the coordinates of that optimum.

    The coordinates are the free parameters (those of the model first, then the noise's), followed
    by the initial states of the logs; see `Problem`. The logs are the training logs of the fit, in
    their order.

    Raises:
        InputError: a failed fit, or logs that are not those of the fit.
    """
    logs = listed(logs)
    if fit.status is Status.SIMULATION_FAILED:
        raise InputError(
            f"This fit failed, so that nothing can be said of its parameters. {fit.message}",
            "Fit again, from other values or with narrower bounds.",
        )
    if len(logs) != len(fit.initial):
        raise InputError(
            f"The fit was made of {len(fit.initial)} training logs, given are {len(logs)}.",
            "Give the training logs of the fit, in their order.",
        )
    silent = [n for n, p in fit.model.parameters.items() if not p.fixed and n not in fit.free]
    records = bind(fit.model, logs)
    words = {name: getattr(fit, name) for name in WORDS}
    problem = build(
        fit.model.fix(*silent) if silent else fit.model,
        records,
        substeps=fit.substeps,
        initial="estimate" if fit.begins_freely else "measured",
        segmented=fit.horizon is not None,
        likelihood=likelihood_of(fit.model, records, **words),
    )
    problem = restarts(_as_fitted(problem, fit), fit.horizon, hold=fit.held)
    begin = problem.coordinates_by_log(fit.initial)
    z = np.concatenate([problem.start()[: problem.shared], begin])
    cost = solve(problem, z, budget=1).cost
    samples = float(np.sum(problem.numbers.counts))
    if not math.isclose(cost, -fit.log_likelihood, rel_tol=0, abs_tol=_SAME * samples):
        raise InputError(
            f"These are not the training logs of the fit: it reports a log-likelihood of "
            f"{fit.log_likelihood:.6g}, on these logs it is {-cost:.6g}.",
            "Give the training logs of the fit, in their order, or fit the model to these.",
        )
    return problem, z


def one_step(fit: Fit, records: Sequence[Record], substeps: int = 1) -> list[dict[str, np.ndarray]]:
    """Errors of the one-step predictions of a fit on any records, from their measured states on.

    Measured minus predicted, ``(T,)`` by log and channel; NaN where nothing was measured. A channel
    that the fit did not know corrects nothing.

    Raises:
        InputError: the logs measure no state.
    """
    likelihood = Innovations.of(fit.model, records, White(), Gaussian())
    problem = build(
        fit.model, records, substeps=substeps, initial="measured", likelihood=likelihood
    )
    problem = _as_fitted(problem, fit)
    errors = errors_at(problem, problem.start())
    return [
        {name: record.at_samples(series) for name, series in by_channel.items()}
        for record, by_channel in zip(records, errors, strict=True)
    ]


def _as_fitted(problem: Problem, fit: Fit) -> Problem:
    """The problem with a fit's gains, memories and limits; a channel new to it corrects nothing."""
    values = uncorrected(problem.nuisance) if problem.layout.likelihood.corrects else {}
    values |= {name: estimate.value for name, estimate in (fit.disturbance or {}).items()}
    nuisance = {n: p.with_value(values.get(n, p.value)) for n, p in problem.nuisance.items()}
    problem = replace(problem, nuisance=nuisance)
    if fit.limits is None:
        return problem
    limits = [fit.limits.get(name, np.inf) for name in problem.layout.channels]
    return with_clip(problem, limits, fit.reach)

"""A fit in the innovations form: its observer, its one-step predictions and what it tells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from diffthrust.estimation._arrange import build
from diffthrust.estimation._laws import Gaussian
from diffthrust.estimation._likelihood import errors_at
from diffthrust.estimation._multistart import Search
from diffthrust.estimation._noise import White
from diffthrust.estimation._observer import CLIP, REAL, WIDE, is_memory
from diffthrust.estimation._one_step import with_clip
from diffthrust.estimation._problem import Problem
from diffthrust.estimation._residuals import Innovations
from diffthrust.estimation._result import Estimate, Fit
from diffthrust.simulation._record import Record


def refined(search: Search, problem: Problem) -> tuple[Search, Problem]:
    """The search of a fit with large errors limited where the law forgives."""
    if problem.layout.likelihood.law.forgiving:
        return _clipped(search, problem)
    return search, problem


def _clipped(search: Search, problem: Problem) -> tuple[Search, Problem]:
    """The search carried on with errors limited to a few times what they are.

    A spike then moves the states no further than a large error does. Where large errors are no
    spikes, they move the states further.
    """
    for _ in range(2):
        problem = with_clip(problem, CLIP * search.best.quadratic.sigma)
        search = search.followed(problem)
    wide = with_clip(problem, problem.numbers.clip, reach=WIDE)
    freer = search.followed(wide)
    if freer.best.quadratic.cost < search.best.quadratic.cost - REAL:
        return freer, wide
    return search, problem


def disturbance_of(problem: Problem, z: np.ndarray) -> dict[str, Estimate]:
    """The observer's gains and memories, without standard errors."""
    values = problem.values(z)
    estimates = {}
    for name, p in problem.nuisance.items():
        touching = any(np.isclose(values[name], end, rtol=1e-9, atol=1e-9) for end in p.limits)
        estimates[name] = Estimate(values[name], None, p.unit, fixed=False, at_bound=touching)
    return estimates


def limits_of(problem: Problem) -> dict[str, float]:
    """By channel the size of a large error."""
    return dict(zip(problem.layout.channels, map(float, problem.numbers.clip), strict=True))


def one_step(fit: Fit, records: Sequence[Record], substeps: int = 1) -> list[dict[str, np.ndarray]]:
    """Errors of the one-step predictions of a fit on any records, from their measured states on.

    Measured minus predicted, ``(T,)`` by log and channel; NaN where nothing was measured.

    A channel that the fit did not know corrects nothing.

    Raises:
        InputError: the logs measure no state.
    """
    estimates = fit.disturbance or {}
    problem = build(
        fit.model,
        records,
        substeps=substeps,
        initial="measured",
        likelihood=Innovations.of(fit.model, records, White(), Gaussian()),
    )
    nuisance = {}
    for name, p in problem.nuisance.items():
        absent = p.value if is_memory(name) else 0.0
        nuisance[name] = p.with_value(estimates[name].value if name in estimates else absent)
    problem = replace(problem, nuisance=nuisance)
    if fit.limits is not None:
        large = [fit.limits.get(name, np.inf) for name in problem.layout.channels]
        problem = with_clip(problem, large, fit.reach)
    errors = errors_at(problem, problem.start())
    return [
        {name: record.at_samples(series) for name, series in by_channel.items()}
        for record, by_channel in zip(records, errors, strict=True)
    ]

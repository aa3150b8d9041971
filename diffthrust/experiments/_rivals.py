"""Rival models, with prior knowledge of their parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust.estimation._arrange import build
from diffthrust.estimation._result import Fit
from diffthrust.estimation._solver import solve
from diffthrust.estimation._status import examine
from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model
from diffthrust.simulation._record import bind


@dataclass(frozen=True)
class Rival:
    """A model that may be true.

    Args:
        model: at its estimated values.
        free: the parameters it may move to imitate another.
        precision: prior knowledge: inverse covariance in the optimiser's coordinates, ``(k, k)``;
            zero without any.
    """

    model: Model
    free: tuple[str, ...]
    precision: np.ndarray = field(repr=False)

    @property
    def start(self) -> np.ndarray:
        """Coordinates of the estimated values, ``(k,)``."""
        named = self.model.parameters
        return np.array([float(named[n].to_coordinate(named[n].value)) for n in self.free])

    @property
    def limits(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper limits of the coordinates."""
        pairs = [self.model.parameters[n].coordinate_limits() for n in self.free]
        low, high = np.array(pairs, float).reshape(-1, 2).T
        return low, high


def models_of(rivals: Any) -> tuple[Model, ...]:
    """The models among models and fits."""
    if not isinstance(rivals, Sequence) or len(rivals) < 2:
        count = f"{len(rivals)}" if isinstance(rivals, Sequence) else repr(rivals)
        raise InputError(
            f"rivals: expected two models or fits at least, found {count}.",
            "Give a list such as [lag, delay].",
        )
    for rival in rivals:
        if not isinstance(rival, Model | Fit):
            raise InputError(
                f"rivals: expected models or fits, found {rival!r}.",
                "Give instances, such as dft.Thruster() or the result of dft.fit.",
            )
    return tuple(rival.model if isinstance(rival, Fit) else rival for rival in rivals)


def names_of(models: Sequence[Model]) -> tuple[str, ...]:
    """Names of the models; duplicates are numbered."""
    names = [str(model) for model in models]
    return tuple(
        f"{name} ({names[: i + 1].count(name)})" if names.count(name) > 1 else name
        for i, name in enumerate(names)
    )


def rival_of(source: Model | Fit, model: Model, logs: Sequence[Log]) -> Rival:
    """A model with prior knowledge from its fit, the logs, or its priors."""
    free = tuple(name for name, p in model.parameters.items() if not p.fixed)
    if isinstance(source, Fit):
        return Rival(model, free, _precision(model, free, source.free, source.covariance))
    if logs and free:
        problem = build(model, bind(model, logs))
        z = problem.start()
        local = examine(problem, z, solve(problem, z, budget=1).quadratic)
        return Rival(model, free, _precision(model, free, problem.free, local.covariance))
    with_prior = [n for n in free if model.parameters[n].prior is not None]
    variances = [p.std**2 for n in with_prior if (p := model.parameters[n].prior) is not None]
    return Rival(model, free, _precision(model, free, with_prior, np.diag(variances)))


def _precision(
    model: Model, free: Sequence[str], names: Sequence[str], covariance: np.ndarray
) -> np.ndarray:
    """Inverse covariance in the optimiser's coordinates; zero without knowledge."""
    out = np.zeros((len(free), len(free)))
    spread = np.sqrt(np.diagonal(covariance)) if len(names) else np.zeros(0)
    kept = [i for i, name in enumerate(names) if name in free and 0 < spread[i] < math.inf]
    if not kept:
        return out
    slopes = [_slope(model, names[i]) for i in kept]
    size = spread[kept]
    # the inverse is taken of the correlation: units of 1e3 between parameters would fall below
    # rcond
    correlation = covariance[np.ix_(kept, kept)] / np.outer(size, size)
    weight = np.array(slopes) / size
    # directions that the logs do not determine get no weight: the rival may move along them freely
    inverse = np.linalg.pinv(correlation, rcond=1e-13, hermitian=True)
    where = [list(free).index(names[i]) for i in kept]
    out[np.ix_(where, where)] = inverse * np.outer(weight, weight)
    return out


def _slope(model: Model, name: str) -> float:
    """d(value)/d(coordinate) of a parameter."""
    p = model.parameters[name]
    return p.value if p.transform == "log" else p.scale

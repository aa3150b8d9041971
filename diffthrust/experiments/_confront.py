"""Rival models: what is known of their parameters, and their outputs under designs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from diffthrust._support._running.programs import program
from diffthrust._support.errors import InputError
from diffthrust.estimation._arrange import build
from diffthrust.estimation._result import Fit
from diffthrust.estimation._solver import solve
from diffthrust.estimation._status import examine
from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model
from diffthrust.simulation._record import bind
from diffthrust.simulation._trajectory import Grid, Key, trajectory


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


InputSeries = Mapping[str, Float[np.ndarray, "designs time"]]
CHUNK = 16
"""Designs per batch, whatever their number: one compilation serves all."""


@dataclass(frozen=True)
class Conditions:
    """Conditions common to all designs.

    Args:
        time: sample instants [s], ``(T,)``.
        noise: standard deviation of each measured channel.
        unsigned: channels whose sensor reports the absolute value.
        substeps: integrator steps per sample.
        correlation: of the noise from one sample to the next.
    """

    time: np.ndarray
    noise: Mapping[str, float]
    unsigned: frozenset[str]
    substeps: int
    correlation: float


class _Layout(NamedTuple):
    """The static part, which fixes the compiled code."""

    key: Key
    grid: Grid
    free: tuple[str, ...]
    transforms: tuple[str, ...]
    channels: tuple[str, ...]
    unsigned: frozenset[str]


class Confronted(NamedTuple):
    """A model compared with targets: outputs, cost, gradient and Gram matrix for each design.

    Args:
        outputs: of the model.
        cost: sum of squared whitened differences; infinite where a simulation failed.
        slope: J' r.
        gram: J' J.
    """

    outputs: Float[np.ndarray, "designs channels time"]
    cost: Float[np.ndarray, " designs"]
    slope: Float[np.ndarray, "designs free"]
    gram: Float[np.ndarray, "designs free free"]


def against(
    rival: Rival,
    conditions: Conditions,
    inputs: InputSeries,
    z: Float[np.ndarray, "designs free"],
    target: Float[np.ndarray, "designs channels time"],
) -> Confronted:
    """Simulate a rival under every design, by coordinates for each, and compare it to targets."""
    named = rival.model.parameters
    hold = tuple((name, "zero") for name in sorted(inputs))
    layout = _Layout(
        Key(rival.model.bind({})),
        Grid(hold, conditions.substeps),
        rival.free,
        tuple(named[n].transform for n in rival.free),
        tuple(conditions.noise),
        conditions.unsigned,
    )
    arrays = {
        "values": {n: np.asarray(p.value, float) for n, p in named.items()},
        "scales": np.array([named[n].scale for n in rival.free]),
        "time": conditions.time,
        "sigma": np.array(list(conditions.noise.values())),
        "correlation": np.asarray(conditions.correlation, float),
    }
    count, passes = z.shape[0], []
    for begin in range(0, count, CHUNK):
        # the last chunk is filled up with its last design
        rows = np.minimum(np.arange(begin, begin + CHUNK), count - 1)
        series = {name: values[rows] for name, values in inputs.items()}
        chunk = _chunk(layout, arrays, series, z[rows], target[rows])
        passes.append([np.array(array)[: count - begin] for array in chunk])
    outputs, cost, slope, gram = (np.concatenate(chunks) for chunks in zip(*passes, strict=True))
    fine = np.isfinite(cost) & np.isfinite(gram).all(axis=(1, 2)) & np.isfinite(slope).all(axis=1)
    return Confronted(outputs, np.where(fine, cost, np.inf), slope, gram)


@program(1)
def _chunk(layout: _Layout, arrays: Any, inputs: Any, z: Any, target: Any) -> tuple[Any, ...]:
    def confront(design: Any) -> tuple[Any, ...]:
        series, point, goal = design
        steps = jnp.eye(point.shape[0])

        def fn(p: Any) -> Any:
            return _outputs(layout, arrays, series, p)

        if layout.free:
            y, slopes = jax.vmap(lambda v: jax.jvp(fn, (point,), (v,)), out_axes=(None, 0))(steps)
        else:
            y = fn(point)
            slopes = jnp.zeros((0, *y.shape))
        residual = _white(arrays, goal - y).reshape(-1)
        rows = jax.vmap(partial(_white, arrays))(slopes).reshape(len(layout.free), residual.size)
        return y, residual @ residual, rows @ residual, rows @ rows.T

    # one after the other: vmap over whole trajectories leaves the processor's cache (256 of them
    # took 397 ms, mapped 144)
    return jax.lax.map(confront, (inputs, z, target))


def _outputs(layout: _Layout, arrays: Any, inputs: Any, z: Any) -> Any:
    values = dict(arrays["values"])
    for i, (name, transform) in enumerate(zip(layout.free, layout.transforms, strict=True)):
        values[name] = jnp.exp(z[i]) if transform == "log" else z[i] * arrays["scales"][i]
    model = layout.key.model.bind(values)
    modelled, _ = trajectory(model, layout.grid, arrays["time"], inputs, {}, {})
    rows = [jnp.abs(modelled[n]) if n in layout.unsigned else modelled[n] for n in layout.channels]
    return jnp.stack(rows)


def _white(arrays: Any, series: Any) -> Any:
    """Whiten series ``(C, T)`` with first-order noise, to unit variance."""
    phi = arrays["correlation"]
    later = (series[:, 1:] - phi * series[:, :-1]) / jnp.sqrt(1.0 - phi**2)
    return jnp.concatenate([series[:, :1], later], axis=1) / arrays["sigma"][:, None]


def outputs_of(
    rival: Rival, conditions: Conditions, inputs: InputSeries
) -> Float[np.ndarray, "designs channels time"]:
    """Predictions of a rival with its estimated parameters."""
    count = next(iter(inputs.values())).shape[0]
    blank = np.zeros((count, len(conditions.noise), conditions.time.size))
    return against(rival, conditions, inputs, np.tile(rival.start, (count, 1)), blank).outputs

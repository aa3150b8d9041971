"""How well a test discriminates two models, after one has imitated the other.

The separation of a truth A from an imitator B under some inputs is

    min over theta of  sum |y_A - y_B(theta)|^2 / sigma^2 + (theta - theta_B)' P (theta - theta_B)

over all channels and samples, with P the information of the logs to which B was fitted: the
T-criterion of Atkinson & Fedorov 1975 (Biometrika 62, 57 and 289), with prior knowledge of the
imitator's parameters. Half of it is the expected log-likelihood ratio. The minimum is found by
Gauss-Newton steps with forward-mode Jacobians; since every accepted step is verified by simulation,
the result is always attained by an actual imitation, hence an upper bound. Angles are not wrapped:
all runs start equal, and jumps at a full turn would create false minima.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from diffthrust._support._running.programs import program
from diffthrust.models._base.model import Model
from diffthrust.simulation._trajectory import Grid, Key, trajectory

InputSeries = Mapping[str, Float[np.ndarray, "designs time"]]
CHUNK = 16
"""Designs per batch, whatever their number: one compilation serves all."""
_SCREEN, _THOROUGH = 12, 30
"""Most steps of an imitation, in the search for designs and to verify one."""
_SETTLED = 1e-3
"""An imitation ends if a step gains less than this, relative to 1 + criterion."""
_SCATTER = 0.5
"""Largest spread of further starts in a parameter's coordinate."""


@dataclass(frozen=True)
class Rival:
    """A model that may be true, at its estimated values."""

    model: Model
    free: tuple[str, ...]  # the parameters that it may move to imitate another
    precision: np.ndarray = field(repr=False)
    """Prior knowledge: inverse covariance in the optimiser's coordinates, ``(k, k)``, or zero."""

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


@dataclass(frozen=True)
class Conditions:
    """Conditions common to all designs."""

    time: np.ndarray  # sample instants [s], (T,)
    noise: Mapping[str, float]  # standard deviation of each measured channel
    unsigned: frozenset[str]  # channels whose sensor reports the absolute value
    substeps: int  # integrator steps per sample
    correlation: float  # of the noise from one sample to the next


class _Layout(NamedTuple):
    """The static part, which fixes the compiled code."""

    key: Key
    grid: Grid
    free: tuple[str, ...]
    transforms: tuple[str, ...]
    channels: tuple[str, ...]
    unsigned: frozenset[str]


class Confronted(NamedTuple):
    """A model compared with targets; r are the whitened differences, J their derivatives."""

    outputs: Float[np.ndarray, "designs channels time"]
    cost: Float[np.ndarray, " designs"]  # r' r; infinite where a simulation failed
    slope: Float[np.ndarray, "designs free"]  # J' r
    gram: Float[np.ndarray, "designs free free"]  # J' J


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


class Imitation(NamedTuple):
    """The best imitation of a truth under each design."""

    separation: Float[np.ndarray, " designs"]  # remaining difference; NaN if a simulation failed
    outputs: Float[np.ndarray, "designs channels time"]  # of the imitator at its best


def imitated(
    rival: Rival,
    conditions: Conditions,
    inputs: InputSeries,
    truth: Float[np.ndarray, "designs channels time"],
    starts: Float[np.ndarray, "designs free"] | None = None,
    steps: int = _SCREEN,
) -> Imitation:
    """Let a rival imitate outputs by moving its parameters, separately for each design."""
    low, high = rival.limits
    z = np.tile(rival.start, (truth.shape[0], 1)) if starts is None else starts.copy()
    best = against(rival, conditions, inputs, z, truth)
    cost = best.cost + _penalty(rival, z)
    # nearly plain Gauss-Newton at first: rivals often differ little, and one step suffices
    damping = np.full(z.shape[0], 1e-8)
    busy = np.isfinite(cost)
    for _ in range(steps if z.shape[1] else 0):
        on = np.flatnonzero(busy)
        slope = np.nan_to_num(best.slope - (z - rival.start) @ rival.precision)[on]
        normal = np.nan_to_num(best.gram + rival.precision)[on]
        held = ((z[on] <= low) & (slope < 0)) | ((z[on] >= high) & (slope > 0))
        move = _newton(normal, np.where(held, 0.0, slope), held, damping[on])
        # the linear prediction of the gain: a simulation that could gain nothing is not run
        ahead = np.sum(move * slope, axis=1) > 0.1 * _SETTLED * (1.0 + cost[on])
        busy[on] = ahead
        if not ahead.any():
            break
        on, trial = on[ahead], np.clip(z[on] + move, low, high)[ahead]
        series = {name: values[on] for name, values in inputs.items()}
        new = against(rival, conditions, series, trial, truth[on])
        price = new.cost + _penalty(rival, trial)
        better = price < cost[on]
        settled = better & (cost[on] - price < _SETTLED * (1.0 + price))
        damping[on] *= np.where(better, 0.1, np.maximum(30.0, 1e-3 / damping[on]))
        busy[on] = ~settled & (damping[on] < 1e6)
        kept = on[better]
        z[kept], cost[kept] = trial[better], price[better]
        for old, fresh in zip(best, new, strict=True):
            old[kept] = fresh[better]
    return Imitation(np.where(np.isfinite(cost), cost, np.nan), best.outputs)


def _penalty(rival: Rival, z: np.ndarray) -> np.ndarray:
    away = z - rival.start
    return np.einsum("di,ij,dj->d", away, rival.precision, away)


def _newton(
    normal: np.ndarray, slope: np.ndarray, held: np.ndarray, damping: np.ndarray
) -> np.ndarray:
    """Damped Gauss-Newton moves ``(D, k)``; coordinates held at a bound stay."""
    size = slope.shape[1]
    free = ~held[:, :, None] & ~held[:, None, :]
    diagonal = np.maximum(np.einsum("dii->di", normal), 1e-300)
    unit = 1.0 / np.sqrt(diagonal)
    scaled = np.where(free, normal * unit[:, :, None] * unit[:, None, :], 0.0)
    scaled = scaled + (damping[:, None, None] + held[:, :, None]) * np.eye(size)
    return np.linalg.solve(scaled, (slope * unit)[:, :, None])[:, :, 0] * unit


def pairs_of(rivals: Sequence[Rival]) -> list[tuple[int, int]]:
    """The pairs (truth, imitator) that a test must separate.

    A rival that extends another by effects imitates it perfectly, with the effects at their null;
    such a pair counts only with the larger model as the truth.
    """
    many = range(len(rivals))
    return [(i, j) for i in many for j in many if i != j and not _extends(rivals[j], rivals[i])]


def _extends(larger: Rival, smaller: Rival) -> bool:
    more, fewer = ({e.structure for e in rival.model.effects} for rival in (larger, smaller))
    return fewer < more and type(larger.model) is type(smaller.model)


def separations(
    rivals: Sequence[Rival], conditions: Conditions, inputs: InputSeries
) -> dict[tuple[int, int], Float[np.ndarray, " designs"]]:
    """Separation of every pair (truth, imitator) under each design."""
    pairs = pairs_of(rivals)
    truths = {i: outputs_of(rivals[i], conditions, inputs) for i in {i for i, _ in pairs}}
    return {(i, j): imitated(rivals[j], conditions, inputs, truths[i]).separation for i, j in pairs}


def imitated_from_afar(
    rival: Rival,
    conditions: Conditions,
    inputs: InputSeries,
    truth: Float[np.ndarray, "1 channels time"],
    seed: int,
) -> Imitation:
    """The best imitation under one design, from several starts.

    The first start is the rival itself; the others are drawn from its prior knowledge.
    """
    low, high = rival.limits
    spread = np.linalg.inv(rival.precision + np.eye(low.size) / _SCATTER**2)
    draws = np.random.default_rng(seed).standard_normal((CHUNK, low.size))
    # the estimate itself is among the starts: more starts never raise a separation
    draws[0] = 0.0
    starts = np.clip(rival.start + draws @ np.linalg.cholesky(spread).T, low, high)
    series = {name: np.repeat(values, CHUNK, axis=0) for name, values in inputs.items()}
    imitations = imitated(
        rival, conditions, series, np.repeat(truth, CHUNK, axis=0), starts, _THOROUGH
    )
    best = int(np.argmin(np.nan_to_num(imitations.separation, nan=np.inf)))
    return Imitation(imitations.separation[best : best + 1], imitations.outputs[best : best + 1])

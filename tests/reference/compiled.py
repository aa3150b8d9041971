"""Whole runs by compiled loops: the judge of measured sets, where NumPy alone takes too long.

The equations of a boat and of a thruster, with every effect that a diagnosis has named on measured
logs, written out once more for numba; SciPy fits them to whole runs from several starts. An effect
is absent where its parameters are at their null, so that one compiled function serves all of them.

    from reference import compiled, measured_runs

    train, unseen = measured_runs.otter()
    fitted = compiled.fit(compiled.BOAT, train, [*compiled.HULL, "q_surge"], starts=8)
    compiled.errors(compiled.BOAT, unseen, fitted.values)    # {"surge": 0.6, ..., "all": 0.7}

Runs, errors and weights are those of `whole_runs`. Needs numba (``pip install numba``).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numba
import numpy as np
from scipy.optimize import least_squares

from . import whole_runs as wr

Array = np.ndarray
_MOST_SUBSTEPS = 400


class Parameter(NamedTuple):
    """Where a fit starts it, its bounds, and the value at which it does nothing."""

    start: float
    low: float
    high: float
    null: float = 0.0


@dataclass(frozen=True)
class Plant:
    """Equations: ``rates(x, u, p, dx)`` and ``fastest(p)`` compiled, ``outputs`` with NumPy.

    The inputs have a fixed order; those that a run has not are zero.
    """

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    parameters: Mapping[str, Parameter]
    rates: Callable[..., Any]
    fastest: Callable[[Mapping[str, float]], float]
    outputs: Callable[[Mapping[str, Array], Mapping[str, Array], Mapping[str, float]], Mapping]
    before: Callable[[wr.Run, Mapping[str, float]], Mapping[str, Array]] = lambda run, p: run.inputs
    first: Callable[[Mapping[str, float], Array, Mapping[str, float]], Mapping[str, float]] = (
        lambda x, u, p: x
    )
    angles: frozenset[str] = frozenset()

    @property
    def null(self) -> dict[str, float]:
        """Every parameter where it does nothing, or where a fit starts it."""
        return {n: r.start if np.isnan(r.null) else r.null for n, r in self.parameters.items()}


@numba.njit
def _integrate(rates, time, u, linear, x, p, substeps):  # pragma: no cover - compiled
    """States at every sample, by the classical Runge-Kutta method."""
    count, size = len(time), len(x)
    out = np.empty((count, size))
    a, b, c, d = np.empty(size), np.empty(size), np.empty(size), np.empty(size)
    now = np.empty(u.shape[1])
    for k in range(count):
        out[k] = x
        if k == count - 1:
            break
        h = (time[k + 1] - time[k]) / substeps
        for m in range(substeps):
            for stage in range(4):
                share = (m + (0.0, 0.5, 0.5, 1.0)[stage]) / substeps
                for i in range(u.shape[1]):
                    now[i] = u[k, i] + (share * (u[k + 1, i] - u[k, i]) if linear[i] else 0.0)
                if stage == 0:
                    rates(x, now, p, a)
                elif stage == 1:
                    rates(x + 0.5 * h * a, now, p, b)
                elif stage == 2:
                    rates(x + 0.5 * h * b, now, p, c)
                else:
                    rates(x + h * c, now, p, d)
            x = x + h / 6.0 * (a + 2.0 * b + 2.0 * c + d)
    return out


def simulate(plant: Plant, run: wr.Run, values: Mapping[str, float]) -> dict[str, Array]:
    """Channels of a run from its first measured state."""
    given = {**run.inputs, **plant.before(run, values)}
    u = np.stack([np.asarray(given.get(n, np.zeros(len(run.time)))) for n in plant.inputs], axis=1)
    linear = np.array([n in run.linear for n in plant.inputs])
    x = plant.first({s: wr.beginning(run, s) for s in plant.states}, u[0], values)
    spacing = float(np.max(np.diff(run.time)))
    substeps = int(np.clip(np.ceil(spacing * plant.fastest(values)), 1, _MOST_SUBSTEPS))
    p = np.array([values[n] for n in plant.parameters])
    begin = np.array([x[s] for s in plant.states])
    states = _integrate(plant.rates, run.time, u, linear, begin, p, substeps)
    by_name = dict(zip(plant.states, states.T, strict=True))
    inputs = dict(zip(plant.inputs, u.T, strict=True))
    inputs["time"] = run.time
    channels = {n: x for n, x in plant.outputs(by_name, inputs, values).items()}
    return channels | {c: np.abs(channels[c]) for c in run.unsigned}


def _differences(plant: Plant, runs: Sequence[wr.Run], values: Mapping[str, float]) -> dict:
    """Modelled less measured, by channel over all runs, where it was measured."""
    modelled = [simulate(plant, run, values) for run in runs]
    out = {}
    for c in runs[0].measured:
        parts = []
        for run, channels in zip(runs, modelled, strict=True):
            seen = np.isfinite(run.measured[c])
            part = (channels[c] - run.measured[c])[seen]
            parts.append((part + np.pi) % (2 * np.pi) - np.pi if c in plant.angles else part)
        out[c] = np.concatenate(parts)
    return out


def errors(plant: Plant, runs: Sequence[wr.Run], values: Mapping[str, float]) -> dict[str, float]:
    """NRMSE by channel over whole runs, and ``all``: their root mean square."""
    spread = wr.spreads(plant, runs)  # pyright: ignore[reportArgumentType]
    differences = _differences(plant, runs, {**plant.null, **values})
    by_channel = {c: float(np.sqrt(np.mean(d**2)) / spread[c]) for c, d in differences.items()}
    return by_channel | {"all": float(np.sqrt(np.mean(np.square(list(by_channel.values())))))}


class Fitted(NamedTuple):
    """The lowest cost of all starts, the sum of the channels' squared NRMSE; and the others."""

    values: dict[str, float]
    errors: dict[str, float]
    costs: list[float]


def fit(
    plant: Plant,
    runs: Sequence[wr.Run],
    free: Sequence[str],
    *,
    held: Mapping[str, float] | None = None,
    first: Mapping[str, float] | None = None,
    ranges: Mapping[str, tuple[float, float]] | None = None,
    starts: int = 8,
    seed: int = 0,
    most: int = 100,
) -> Fitted:
    """Least squares of whole runs, every channel by its standard deviation, from several starts.

    Args:
        plant: the equations.
        runs: to fit.
        free: the parameters that are estimated; the others are at ``held``, or do nothing.
        held: values of others.
        first: the first start; the others are drawn about it.
        ranges: other bounds.
        starts: how many.
        seed: of the starts.
        most: evaluations of one start.
    """
    base = {**plant.null, **(held or {})}
    limits = {n: (plant.parameters[n].low, plant.parameters[n].high) for n in free}
    limits |= {n: r for n, r in (ranges or {}).items() if n in limits}
    low, high = (np.array([limits[n][i] for n in free]) for i in (0, 1))
    begin = np.array([(first or {}).get(n, plant.parameters[n].start) for n in free])
    size = np.maximum(np.abs(begin), np.abs([plant.parameters[n].start for n in free])) + 1e-9
    spread = wr.spreads(plant, runs)  # pyright: ignore[reportArgumentType]

    def residuals(theta: Array) -> Array:
        values = {**base, **dict(zip(free, theta, strict=True))}
        with np.errstate(all="ignore"):
            parts = _differences(plant, runs, values)
        scaled = [d / (spread[c] * np.sqrt(len(d))) for c, d in parts.items()]
        return np.clip(np.nan_to_num(np.concatenate(scaled), nan=10.0), -10.0, 10.0)

    rng = np.random.default_rng(seed)
    best, costs = None, []
    for k in range(starts):
        theta = wr.begun(rng if k else None, begin, size, low, high)
        found = least_squares(
            residuals, theta, bounds=(low, high), x_scale=size, max_nfev=most, ftol=1e-9
        )
        costs.append(float(2.0 * found.cost))
        if best is None or found.cost < best.cost:
            best = found
    assert best is not None
    values = {**base, **{n: float(v) for n, v in zip(free, best.x, strict=True)}}
    return Fitted(values, errors(plant, runs, values), sorted(costs))

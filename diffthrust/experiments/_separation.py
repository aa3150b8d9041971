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

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from diffthrust.experiments._confront import (
    CHUNK,
    Conditions,
    InputSeries,
    Rival,
    against,
    outputs_of,
)

_SCREEN, _THOROUGH = 12, 30
"""Most steps of an imitation, in the search for designs and to verify one."""
_SETTLED = 1e-3
"""An imitation ends if a step gains less than this, relative to 1 + criterion."""
_SCATTER = 0.5
"""Largest spread of further starts in a parameter's coordinate."""


class Imitation(NamedTuple):
    """The best imitation of a truth under each design.

    Args:
        separation: remaining difference; NaN if a simulation failed.
        outputs: of the imitator at its best.
    """

    separation: Float[np.ndarray, " designs"]
    outputs: Float[np.ndarray, "designs channels time"]


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
    larger_model, smaller_model = larger.model, smaller.model
    inside = {e.structure for e in smaller_model.effects} < {
        e.structure for e in larger_model.effects
    }
    return inside and type(larger_model) is type(smaller_model)


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

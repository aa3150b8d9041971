"""Integration of plants with held inputs and dry friction, without losing accuracy at kinks.

The solver restarts at every input sample, and where the shaft passes through rest: between these
instants the right-hand side is smooth, so DOP853 keeps its order. At rest the shaft is either
carried off by a push greater than the break-away level or it sticks, as in D. Karnopp, "Computer
simulation of stick-slip friction", J. Dyn. Sys. Meas. Control 107 (1985), pp. 100-103, but with
the instants found by root-finding, in place of a band of speeds that counts as rest.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

Array = np.ndarray
Rates = Callable[[float, Sequence[float], Sequence[float], int], Sequence[float]]

RTOL, ATOL = 1e-10, 1e-12
_MOST_PHASES = 50


@dataclass(frozen=True)
class Piece:
    """Inputs between two stops: value and slope of each."""

    start: float
    values: tuple[float, ...]
    slopes: tuple[float, ...] | None

    def __call__(self, t: float) -> tuple[float, ...]:
        """Inputs at time ``t``."""
        if self.slopes is None:
            return self.values
        dt = t - self.start
        return tuple(v + s * dt for v, s in zip(self.values, self.slopes, strict=True))


@dataclass(frozen=True)
class Rotor:
    """A state that dry friction can hold at rest.

    Attributes:
        index: which state is the speed.
        push: acceleration at rest, friction left out, as a function of time, state and inputs.
        breakaway: the push that friction can bear, in the unit of ``push``.
    """

    index: int
    push: Callable[[float, Sequence[float], Sequence[float]], float]
    breakaway: float


def stops(*times: Array) -> Array:
    """Join instants into one increasing series; of near-equal ones the earliest listed stays."""
    joined = times[0]
    low, high = joined[0], joined[-1]
    nearness = 1e-9 * (high - low) / max(len(joined) - 1, 1)
    for extra in times[1:]:
        extra = extra[(extra > low) & (extra < high)]
        at = np.clip(np.searchsorted(joined, extra), 1, len(joined) - 1)
        gap = np.minimum(np.abs(extra - joined[at - 1]), np.abs(joined[at] - extra))
        joined = np.union1d(joined, extra[gap > nearness])
    return joined


def pieces(at: Array, channels: Sequence[tuple[Array, Array]], hold: str) -> list[Piece]:
    """Cut sampled inputs at the stops ``at``; ``hold`` is ``"zero"`` or ``"linear"``.

    Before its first sample an input has the first value, after its last sample the last.
    """
    if hold not in ("zero", "linear"):
        raise ValueError(f"hold: expected 'zero' or 'linear', found {hold!r}")
    middle = 0.5 * (at[1:] + at[:-1])
    values, slopes = [], []
    for time, samples in channels:
        samples = np.asarray(samples, float)
        i = np.clip(np.searchsorted(time, middle, side="right") - 1, 0, len(time) - 1)
        if hold == "zero":
            values.append(samples[i])
            continue
        slope = np.append(np.diff(samples) / np.diff(time), 0.0)[i]
        slope = np.where(middle < time[0], 0.0, slope)
        values.append(samples[i] + slope * (at[:-1] - time[i]))
        slopes.append(slope)
    columns = np.array(values).T.tolist()
    gradients = np.array(slopes).T.tolist() if hold == "linear" else [None] * len(columns)
    return [
        Piece(float(start), tuple(v), None if s is None else tuple(s))
        for start, v, s in zip(at[:-1], columns, gradients, strict=True)
    ]


def solve(
    rates: Rates,
    inputs: Sequence[Piece],
    at: Array,
    start: Sequence[float],
    *,
    rotor: Rotor | None = None,
    method: str = "dop853",
    substeps: int = 8,
) -> Array:
    """Integrate ``rates(t, x, u, direction)`` over the stops ``at``.

    Args:
        rates: time derivative of the state; ``direction`` is the sign of the rotor's motion, kept
            constant over a step so that no step sees a jump (0: it sticks).
        inputs: one piece for each interval.
        at: instants at which the state is returned; the first is the start.
        start: the state at ``at[0]``.
        rotor: the state that dry friction can hold, if there is one.
        method: ``"dop853"`` (relative tolerance 1e-10, the reference) or ``"rk4"`` (quick).
        substeps: steps of ``"rk4"`` in each interval.

    Returns:
        States, one row for each stop.

    A shaft that passes rest and comes back within one interval is not seen to pass.
    """
    advance: Any = {"dop853": _dop853, "rk4": lambda *a: _rk4(*a, substeps)}[method]
    state = [float(v) for v in start]
    rows = [state]
    for piece, t, end in zip(inputs, at[:-1].tolist(), at[1:].tolist(), strict=True):
        if rotor is None:
            state = advance(rates, piece, t, end, state, 0)
        else:
            state = _with_friction(advance, rates, piece, t, end, state, rotor)
        rows.append(state)
    return np.array(rows)


def _with_friction(
    advance: Any, rates: Rates, piece: Piece, t: float, end: float, state: list, rotor: Rotor
) -> list[float]:
    """One interval, cut where the shaft comes to rest or breaks away."""
    forced = 0
    for _ in range(_MOST_PHASES):
        if state[rotor.index] != 0.0:
            direction = _sign(state[rotor.index])
        elif forced:
            direction = forced
        else:
            push = rotor.push(t, state, piece(t))
            direction = _sign(push) if abs(push) > rotor.breakaway else 0
        new = advance(rates, piece, t, end, state, direction)
        span, base, forced = end - t, state, 0

        def left(s: float, x: Any, t=t, direction=direction) -> float:
            """How far the phase is from its end, ``s`` seconds in; positive while it lasts."""
            if direction:
                return direction * x[rotor.index]
            return rotor.breakaway - abs(rotor.push(t + s, x, piece(t + s)))

        def margin(s: float, t=t, base=base, direction=direction, left=left) -> float:
            x = advance(rates, piece, t, t + s, base, direction) if s > 0.0 else base
            return left(s, x)

        if left(span, new) >= 0.0:
            return new
        if not direction:
            forced = _sign(rotor.push(end, new, piece(end)))
        least = 1e-6 * span if base[rotor.index] == 0.0 and direction else 0.0
        cut: Any = brentq(margin, least, span, xtol=1e-15) if margin(least) > 0.0 else least
        if cut > 0.0:
            state = advance(rates, piece, t, t + cut, base, direction)
            state[rotor.index] = 0.0
        t += cut
        if t >= end:
            return state
    raise RuntimeError(f"more than {_MOST_PHASES} stops of the shaft within one sample at {t} s")


def _dop853(rates: Rates, piece: Piece, t: float, end: float, state: list, direction: int) -> list:
    """One interval by the eighth-order method with step control."""
    result = solve_ivp(
        lambda s, x: rates(s, x.tolist(), piece(s), direction),
        (t, end),
        state,
        method="DOP853",
        rtol=RTOL,
        atol=ATOL,
        first_step=end - t,
        t_eval=[end],
    )
    if not result.success:
        raise RuntimeError(f"the reference did not get past {t} s: {result.message}")
    return result.y[:, -1].tolist()


def _rk4(
    rates: Rates, piece: Piece, t: float, end: float, state: list, direction: int, steps: int
) -> list[float]:
    """One interval by the classical method in equal steps."""
    h = (end - t) / steps
    x = state
    for k in range(steps):
        s = t + k * h
        u0, u1, u2 = piece(s), piece(s + 0.5 * h), piece(s + h)
        k1 = rates(s, x, u0, direction)
        k2 = rates(s + 0.5 * h, [a + 0.5 * h * b for a, b in zip(x, k1)], u1, direction)  # noqa: B905
        k3 = rates(s + 0.5 * h, [a + 0.5 * h * b for a, b in zip(x, k2)], u1, direction)  # noqa: B905
        k4 = rates(s + h, [a + h * b for a, b in zip(x, k3)], u2, direction)  # noqa: B905
        x = [a + h / 6.0 * (b + 2.0 * c + 2.0 * d + e) for a, b, c, d, e in zip(x, k1, k2, k3, k4)]  # noqa: B905
    return x


def _sign(value: float) -> int:
    return int(value > 0.0) - int(value < 0.0)

"""How the speeds of a vessel approach their steady values: time constants, one after the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from diffthrust._support.results import Brief
from diffthrust.logs._log import Log
from diffthrust.papers._steady import Steady

SCREW, ANGLE = ("propeller_speed", "rev/s"), ("rudder_angle", "rad")
SURGE, SWAY, YAW = ("surge", "m/s"), ("sway", "m/s"), ("yaw_rate", "rad/s")
AMIDSHIPS = 1e-3
"""Radians: a propeller this far from amidships counts as straight."""

_Course = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Time, measured and fitted, ``(n,)`` each."""


@dataclass(frozen=True, repr=False)
class Transient(Brief):
    """A time constant, from how a speed approaches its steady value.

    Args:
        time_constant: [s].
        runs: ``(time, measured, fitted)`` of the runs it was fitted to, from the step on.
        others: the same of the runs it was verified on.

    Example:
        >>> found = dft.papers.siramdasu.sequential(*manoeuvred)
        >>> found.yaw.time_constant > 0
        True
    """

    time_constant: float
    runs: tuple[_Course, ...] = field(repr=False)
    others: tuple[_Course, ...] = field(repr=False)


def surge_transient(
    runs: Sequence[Log], others: Sequence[Log], exponent: float, d11: float
) -> Transient:
    """The time constant that all runs from rest have in common, equation (12)."""
    from scipy.optimize import least_squares

    def rising(log: Log) -> tuple[np.ndarray, np.ndarray, float]:
        n, u = log.values(*SCREW), log.values(*SURGE)
        begin = int(np.argmax(n > 0))
        finite = np.isfinite(u[begin:])
        time = (log.time[begin:] - log.time[begin])[finite]
        return time, u[begin:][finite], float(np.median(n[begin:])) ** exponent / d11

    def course(time: np.ndarray, u: np.ndarray, end: float, lag: float) -> np.ndarray:
        return end + (u[0] - end) * np.exp(-time / lag)

    data = [rising(log) for log in runs]

    def residual(x: np.ndarray) -> np.ndarray:
        return np.concatenate([course(t, u, end, np.exp(x[0])) - u for t, u, end in data])

    lag = float(np.exp(least_squares(residual, [0.0]).x[0]))

    def shown(logs: Sequence[Log]) -> tuple[_Course, ...]:
        return tuple((t, u, course(t, u, e, lag)) for t, u, e in map(rising, logs))

    return Transient(lag, shown(runs), shown(others))


def yaw_transient(
    circles: Sequence[Log],
    ends: Sequence[Steady],
    fitted: np.ndarray,
    values: dict[str, float],
    exponent: float,
    lever_arm: float,
    first: float,
) -> Transient:
    """The time constant of turning in, equation (16), with exponentials for surge and sway.

    Only the ``first`` seconds from the step of the angle on are looked at.
    """
    from scipy.optimize import least_squares

    def turning(log: Log, end: Steady) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        angle, n, r = log.values(*ANGLE), log.values(*SCREW), log.values(*YAW)
        held = np.abs(angle - end.mean(*ANGLE)) < AMIDSHIPS
        begin = int(np.argmax(held))
        stop = int(np.searchsorted(log.time, log.time[begin] + first + 1e-9))
        portion = slice(begin, stop)
        time = log.time[portion] - log.time[begin]
        u, v = (_exponential(time, log.values(*c)[portion]) for c in (SURGE, SWAY))
        moment = (values["m11"] - values["m22"]) * u * v
        moment -= lever_arm * n[portion] ** exponent * np.sin(angle[portion])
        return time, r[portion], moment / values["d33"]

    def course(time: np.ndarray, r: np.ndarray, target: np.ndarray, lag: float) -> np.ndarray:
        """A first-order lag behind a target that is straight between the samples."""
        out = np.empty(time.size)
        out[0] = r[np.isfinite(r)][0]
        for k, h in enumerate(np.diff(time)):
            # the exact answer to a ramp: no error of integration enters the time constant
            kept, slope = np.exp(-h / lag), (target[k + 1] - target[k]) / h
            out[k + 1] = target[k + 1] - slope * lag + kept * (out[k] - target[k] + slope * lag)
        return out

    chosen = [i for i in range(len(circles)) if abs(ends[i].mean(*ANGLE)) > AMIDSHIPS]
    data = {i: turning(circles[i], ends[i]) for i in chosen}

    def residual(x: np.ndarray) -> np.ndarray:
        each = [course(t, r, g, np.exp(x[0])) - r for i, (t, r, g) in data.items() if fitted[i]]
        joined = np.concatenate(each)
        return joined[np.isfinite(joined)]

    lag = float(np.exp(least_squares(residual, [0.0]).x[0]))
    shown = {i: (t, r, course(t, r, g, lag)) for i, (t, r, g) in data.items()}
    return Transient(
        lag,
        tuple(run for i, run in shown.items() if fitted[i]),
        tuple(run for i, run in shown.items() if not fitted[i]),
    )


def _exponential(time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The course of an exponential through samples, equations (17) and (18)."""
    from scipy.optimize import least_squares

    finite = np.isfinite(values)
    t, y = time[finite], values[finite]

    def course(x: np.ndarray, t: np.ndarray) -> np.ndarray:
        return x[0] * np.exp(-np.exp(x[1]) * t) + x[2]

    # a decay rate is fitted as its logarithm: it cannot turn into a growth
    start = [y[0] - y[-1], 0.0, y[-1]]
    return course(least_squares(lambda x: course(x, t) - y, start).x, time)

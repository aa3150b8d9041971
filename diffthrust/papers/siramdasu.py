"""Siramdasu & Fahimi 2013, section 3: a vessel's ratios to A, one after the other.

Scenario 1, straight runs from rest at several propeller speeds, gives the exponent, d11 and m11;
scenario 2, circles at one propeller speed and several angles after a straight stretch, gives m22,
d22, d33 and i33. Each value enters the next line, and so does its error; a simultaneous fit
(`diffthrust.fit`) of the same records does not pass errors on in this way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.figures import Figure, showing
from diffthrust._support.results import Brief
from diffthrust._support.validation import finite
from diffthrust._support.warned import warn
from diffthrust.estimation._arguments import listed
from diffthrust.logs._log import Log
from diffthrust.models import Vessel
from diffthrust.papers._line import Approach, FittedLine, Transient, fit_line, fit_transient
from diffthrust.papers._steady import Steady, records, steady_portions
from diffthrust.simulation._runs import simulate

__all__ = ["Sensitivity", "Sequential", "Transient", "sensitivity", "sequential"]

_SCREW, _ANGLE = ("propeller_speed", "rev/s"), ("rudder_angle", "rad")
_SURGE, _SWAY, _YAW = ("surge", "m/s"), ("sway", "m/s"), ("yaw_rate", "rad/s")
_AMIDSHIPS = 1e-3
"""Radians: a propeller this far from amidships counts as straight."""


@dataclass(frozen=True, repr=False)
class Sequential(Brief):
    """The ratios that the two scenarios give, with every line on the way.

    Args:
        vessel: the vessel with the values found.
        steady_speed: ln of the steady surge against ln of the propeller speed (figure 3).
        surge: how surge approaches it: m11 / d11 (figure 4).
        m22: its line (figure 5).
        d22: its line (figure 6).
        d33: its line (figure 7).
        yaw: how the yaw rate turns in: i33 / d33 (figure 10).
        verification: by parameter, the points of the circles that were not fitted, ``(x, y)``.
        notes: what speaks against the values, also given out as a warning.

    Example:
        >>> result = dft.papers.siramdasu.sequential(*manoeuvred)
        >>> round(result.vessel.d11, 1), result.surge.time_constant > 0
        (4.0, True)
        >>> figure = result.plot()
    """

    vessel: Vessel
    steady_speed: FittedLine
    surge: Transient
    m22: FittedLine
    d22: FittedLine
    d33: FittedLine
    yaw: Transient
    verification: dict[str, tuple[np.ndarray, np.ndarray]]
    notes: tuple[str, ...] = ()

    @showing
    def plot(self) -> Figure:
        """The paper's figures 3, 4, 5, 6, 7 and 10."""
        from diffthrust.papers._figures import sequential_figure

        lines = {"m22": self.m22, "d22": self.d22, "d33": self.d33}
        return sequential_figure(
            self.vessel, self.steady_speed, self.surge, lines, self.yaw, self.verification
        )


def sequential(
    straight: Sequence[Log],
    circles: Sequence[Log],
    *,
    lever_arm: float = 0.5,
    settle: float = 6.0,
    transient: float | None = None,
    verify: Sequence[Log] = (),
) -> Sequential:
    """The ratios of a vessel to A, one after the other.

    Exponentials stand in for surge and sway while a circle begins, as in the paper, and make i33
    too low: of the paper's boat by 2.3 % from circles of 15 s, by 0.3 % from the first 5 s, which
    the paper used. A vessel that does not keep its course turns in by no exponential; then i33 is
    further off, and a warning says so.

    Args:
        straight: runs from rest with the propeller amidships, at two or more propeller speeds.
        circles: runs at one propeller speed, first straight, then at a held angle; the largest
            angles to either side are fitted to, the others verify.
        lever_arm: distance of the propeller behind the centre of gravity [m].
        settle: how long the speeds take to come to rest [s].
        transient: how much of each circle i33 is found from, from the step of the angle on [s]; all
            of it where not given. The paper used 5 s.
        verify: straight runs that are not fitted to.

    Returns:
        The vessel, the lines and transients behind it, and a figure.

    Raises:
        InputError: fewer than two propeller speeds or no circle, a run without a steady end,
            values without a physical meaning (a negative damping).

    Source: Siramdasu & Fahimi 2013, section 3, equations (9) to (20).

    Example:
        >>> result = dft.papers.siramdasu.sequential(*manoeuvred)
        >>> round(result.vessel.d11, 1), round(dft.Vessel().d11, 1)
        (4.0, 4.0)
    """
    straight = records("sequential, straight", straight)
    first = np.inf
    if transient is not None:
        first = finite("sequential, transient", transient, lambda x: x > 0, "seconds, above zero")
    line, d11 = _steady_speed(straight, settle)
    exponent = line.slope
    rising, verified = (
        [_rising(log, exponent, d11) for log in logs] for logs in (straight, listed(verify))
    )
    surge = fit_transient("sequential, surge", rising, verified, _approaching)
    m11 = surge.time_constant * d11
    circles = listed(circles)
    ends = [_last(log, settle) for log in circles]
    angles = np.array([end.mean(*_ANGLE) for end in ends])
    turning = np.abs(angles) > _AMIDSHIPS
    if turning.sum() < 2:
        raise InputError(
            f"sequential: expected two or more circles at held angles, found {int(turning.sum())}.",
            "Give runs that end at a held angle, to either side.",
        )
    n, u, v, r = (np.array([end.mean(*c) for end in ends]) for c in (_SCREW, _SURGE, _SWAY, _YAW))
    push = n**exponent
    # the widest circles are fitted, where sway and yaw stand out most from their noise
    widest = turning & (np.abs(angles) > 0.95 * np.max(np.abs(angles)))
    remaining = turning & ~widest
    points: dict[str, tuple[np.ndarray, np.ndarray]] = {}

    def line_of(name: str, x: np.ndarray, y: np.ndarray) -> FittedLine:
        points[name] = (x[remaining], y[remaining])
        return fit_line(x[widest], y[widest], f"sequential, {name}", through_origin=True)

    m22 = line_of("m22", v * r, d11 * u - push * np.cos(angles))
    d22 = line_of("d22", v, push * np.sin(angles) - m11 * u * r)
    moment = (m11 - m22.slope) * u * v - lever_arm * push * np.sin(angles)
    d33 = line_of("d33", r, moment)
    values = {"m11": m11, "m22": m22.slope, "d11": d11, "d22": d22.slope, "d33": d33.slope}
    wrong = [name for name, value in values.items() if not value > 0]
    if wrong:
        raise InputError(
            f"sequential: {wrong[0]} came out as {values[wrong[0]]:.3g}, which has no meaning.",
            "Look at the signs of sway, yaw rate and angle (see dft.Vessel), and at the lines.",
        )
    vessel = Vessel(exponent=exponent, lever_arm=lever_arm).replace(values)
    turns, other_turns = (
        [_turning(circles[i], angles[i], vessel, first) for i in np.flatnonzero(chosen)]
        for chosen in (widest, remaining)
    )
    yaw = fit_transient("sequential, yaw rate", turns, other_turns, _lagging)
    vessel = vessel.replace(i33=yaw.time_constant * d33.slope)
    notes = _off_course(values, float(np.max(push[turning])) / d11)
    for note in notes:
        warn(note, UserWarning)
    return Sequential(vessel, line, surge, m22, d22, d33, yaw, points, notes)


def _off_course(values: dict[str, float], speed: float) -> tuple[str, ...]:
    """A note where sway and yaw of a straight course at this speed grow of themselves."""
    m11, m22, d22, d33 = (values[name] for name in ("m11", "m22", "d22", "d33"))
    # Routh: the linearized sway and yaw are stable where their determinant d22 d33 - m11 (m22 -
    # m11) u^2 is positive
    held, turned = d22 * d33, m11 * (m22 - m11) * speed**2
    if held > turned:
        return ()
    return (
        f"The vessel does not keep a straight course: d22 d33 = {held:.3g} is below "
        f"m11 (m22 - m11) u^2 = {turned:.3g} at {speed:.3g} m/s. Its sway and yaw turn in by no "
        "exponential, and i33 comes out too low.\n"
        "Mend: fit all runs together, dft.fit(found.vessel, runs, likelihood='innovations').",
    )


@dataclass(frozen=True, repr=False)
class Sensitivity(Brief):
    """How much the choice of the propeller speeds matters.

    Args:
        speeds: the propeller speeds of each selection [rev/s].
        vessels: what was found with each; the first with all speeds.
        paths: simulated ``(north, east)`` [m] of each, ``(2, n)``.
        spread: the largest distance between two of the paths at one instant [m].

    Example:
        >>> result = dft.papers.siramdasu.sensitivity(*manoeuvred)
        >>> len(result.vessels), result.spread >= 0
        (4, True)
    """

    speeds: tuple[tuple[float, ...], ...]
    vessels: tuple[Vessel, ...]
    paths: tuple[np.ndarray, ...] = field(repr=False)
    spread: float


def sensitivity(
    straight: Sequence[Log],
    circles: Sequence[Log],
    *,
    lever_arm: float = 0.5,
    settle: float = 6.0,
    angle: float = -np.pi * 24 / 180,
    propeller_speed: float = 98.0,
    duration: float = 20.0,
) -> Sensitivity:
    """`sequential` with every pair of the straight runs' speeds, and the paths that follow.

    Each vessel is simulated from rest: straight for 5 s, then at ``angle``.

    Args:
        straight: as for `sequential`, at three or more propeller speeds.
        circles: as for `sequential`.
        lever_arm: [m].
        settle: [s].
        angle: of the propeller from 5 s on [rad].
        propeller_speed: [rev/s].
        duration: of the simulation [s].

    Raises:
        InputError: fewer than three propeller speeds, or what `sequential` refuses.

    Source: Siramdasu & Fahimi 2013, section 4, table 3 and figure 11.

    Example:
        >>> dft.papers.siramdasu.sensitivity(*manoeuvred).speeds
        ((69.2, 98.0, 120.0), (69.2, 98.0), (69.2, 120.0), (98.0, 120.0))
    """
    straight = listed(straight)
    levels = np.array([_last(log, settle).mean(*_SCREW) for log in straight])
    each = np.unique(np.round(levels, 3))
    if each.size < 3:
        raise InputError(
            "sensitivity: expected straight runs at three or more propeller speeds, of which pairs "
            f"can be chosen, found {each.size}.",
            "Give runs at more speeds.",
        )
    chosen = [tuple(map(float, each)), *(tuple(map(float, p)) for p in combinations(each, 2))]
    time = np.arange(0.0, duration + 0.025, 0.05)
    record = Log(
        time=time,
        inputs={
            "propeller_speed": np.full(time.size, propeller_speed),
            "rudder_angle": np.where(time >= 5.0, angle, 0.0),
        },
        units={"propeller_speed": "rev/s", "rudder_angle": "rad"},
    )
    vessels, paths = [], []
    for speeds in chosen:
        picked = [log for log, n in zip(straight, levels, strict=True)
                  if np.any(np.abs(n - np.array(speeds)) < 1e-2)]  # fmt: skip
        vessel = sequential(picked, circles, lever_arm=lever_arm, settle=settle).vessel
        outputs = simulate(vessel, record)
        vessels.append(vessel)
        paths.append(np.stack([outputs["north"], outputs["east"]]))
    apart = max(float(np.max(np.hypot(*(a - b)))) for a, b in combinations(paths, 2))
    return Sensitivity(tuple(chosen), tuple(vessels), tuple(paths), apart)


def _last(log: Log, settle: float) -> Steady:
    """The steady end of a run."""
    inputs = (_SCREW[0], _ANGLE[0])
    return steady_portions(log, settle=settle, least=0.5, inputs=inputs)[-1]


def _steady_speed(straight: Sequence[Log], settle: float) -> tuple[FittedLine, float]:
    ends = [_last(log, settle) for log in straight]
    n, u = (np.array([end.mean(*c) for end in ends]) for c in (_SCREW, _SURGE))
    if np.any(n <= 0) or np.any(u <= 0):
        raise InputError(
            "sequential: expected straight runs ahead, found steady propeller speeds from "
            f"{n.min():.3g} rev/s and surge from {u.min():.3g} m/s.",
            "Leave out runs at rest or astern.",
        )
    # n^C = d11 u in the steady state: its logarithm is a line of slope C with the intercept -ln d11
    line = fit_line(np.log(n), np.log(u), "sequential, exponent and d11")
    return line, float(np.exp(-line.intercept))


def _rising(log: Log, exponent: float, d11: float) -> Approach:
    """The surge of a run from rest, and what it comes to."""
    n, u = log.values(*_SCREW), log.values(*_SURGE)
    begin = int(np.argmax(n > 0))
    _check_measured(log, _SURGE, slice(begin, None))
    finite = np.isfinite(u[begin:])
    time = (log.time[begin:] - log.time[begin])[finite]
    return time, u[begin:][finite], float(np.median(n[begin:])) ** exponent / d11


def _approaching(time: np.ndarray, u: np.ndarray, end: float, lag: float) -> np.ndarray:
    """The course of the surge, equation (12)."""
    return end + (u[0] - end) * np.exp(-time / lag)


def _turning(log: Log, angle: float, vessel: Vessel, first: float) -> Approach:
    """The yaw rate of the ``first`` seconds of a circle, and what it follows, equation (16).

    Surge and sway are exponentials there.
    """
    angles, n, r = log.values(*_ANGLE), log.values(*_SCREW), log.values(*_YAW)
    begin = int(np.argmax(np.abs(angles - angle) < _AMIDSHIPS))
    stop = int(np.searchsorted(log.time, log.time[begin] + first + 1e-9))
    portion = slice(begin, stop)
    time = log.time[portion] - log.time[begin]
    for channel in (_SURGE, _SWAY, _YAW):
        _check_measured(log, channel, portion)
    u, v = (_exponential(time, log.values(*c)[portion]) for c in (_SURGE, _SWAY))
    moment = (vessel.m11 - vessel.m22) * u * v
    moment -= vessel.lever_arm * n[portion] ** vessel.exponent * np.sin(angles[portion])
    return time, r[portion], moment / vessel.d33


def _check_measured(log: Log, channel: tuple[str, str], portion: slice) -> None:
    """Raise `InputError` where a portion of a run measures nothing of a channel."""
    if not np.isfinite(log.values(*channel)[portion]).any():
        begin, end = log.time[portion][[0, -1]]
        raise InputError(
            f"sequential, {log.name}: expected measurements of {channel[0]} from {begin:.4g} to "
            f"{end:.4g} s, after the step, found none.",
            "Give runs that measure it while they change, or a longer transient.",
        )


def _lagging(time: np.ndarray, r: np.ndarray, target: np.ndarray, lag: float) -> np.ndarray:
    """A first-order lag behind a target that is straight between the samples."""
    out = np.empty(time.size)
    out[0] = r[np.isfinite(r)][0]
    for k, h in enumerate(np.diff(time)):
        # the exact answer to a ramp: no error of integration enters the time constant
        kept, slope = np.exp(-h / lag), (target[k + 1] - target[k]) / h
        out[k + 1] = target[k + 1] - slope * lag + kept * (out[k] - target[k] + slope * lag)
    return out


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

"""Records of free sailing, sorted into the portions that an identification step by step needs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.results import Brief
from diffthrust._support.validation import finite
from diffthrust.logs._log import Log
from diffthrust.papers._steady import records, steady_portions, true_stretches


@dataclass(frozen=True, repr=False)
class Manoeuvres(Brief):
    """Portions of records, each a log of its own.

    Args:
        steady: straight on, at a speed that hardly changes.
        accelerating: straight on, while the speed changes.
        turning: all else that lasts.

    Example:
        >>> found = dft.papers.manoeuvres(boat_log, least=2.0)
        >>> len(found.steady), len(found.turning) > 0
        (0, True)
        >>> print(found.summary)
        0 steady (0 s), 0 accelerating (0 s), 4 turning (18 s)
    """

    steady: tuple[Log, ...] = field(repr=False)
    accelerating: tuple[Log, ...] = field(repr=False)
    turning: tuple[Log, ...] = field(repr=False)

    @property
    def summary(self) -> str:
        """How many portions there are, and how long they are together."""
        parts = (f"{len(logs)} {name} ({sum(log.duration for log in logs):.0f} s)"
                 for name, logs in vars(self).items())  # fmt: skip
        return ", ".join(parts)


def manoeuvres(
    logs: Log | Sequence[Log],
    *,
    least: float = 5.0,
    smoothing: float = 1.0,
    straight: float = 0.1,
    steady: float = 0.1,
) -> Manoeuvres:
    """Sort records of free sailing into steady, accelerating and turning portions.

    The planned runs of Siramdasu & Fahimi (2013, section 3) hold the propeller and its angle;
    records of free sailing do not, so portions are recognised by what the vessel does, not by its
    inputs. It runs straight where its yaw rate is small against the largest one in all records,
    and steadily where its surge would need long to change.

    Args:
        logs: records with ``surge`` and ``yaw_rate``.
        least: the shortest portion [s].
        smoothing: length of the running mean over both [s].
        straight: yaw rate of a straight line, as a share of the largest.
        steady: change of the surge over ``least`` seconds that counts as none, as a share of the
            largest surge.

    Returns:
        The portions in the order of the records; each kind may be empty.

    Raises:
        InputError: no record, a channel that is missing, or a length that is not positive.

    Example:
        >>> found = dft.papers.manoeuvres(boat_log, least=2.0)
        >>> len(found.turning) > 0
        True
    """
    for name, value in (("least", least), ("smoothing", smoothing)):
        finite(f"manoeuvres, {name}", value, lambda x: x > 0, "seconds, more than zero")
    logs = records("manoeuvres", logs)
    surge, yaw = (
        [without_noise(log.time, log.values(name, unit), smoothing) for log in logs]
        for name, unit in (("surge", "m/s"), ("yaw_rate", "rad/s"))
    )
    fastest = max(float(np.max(np.abs(u))) for u in surge)
    ahead = straight * max(float(np.max(np.abs(r))) for r in yaw)
    by_kind: dict[str, list[Log]] = {"steady": [], "accelerating": [], "turning": []}
    for log, u, r in zip(logs, surge, yaw, strict=True):
        line = np.abs(r) <= ahead
        # the mean slope over a portion's length: a single gust does not end a steady run
        change = least * without_noise(log.time, np.gradient(u, log.time), least)
        even = np.abs(change) <= steady * fastest
        kinds = {
            "steady": line & even & (np.abs(u) > steady * fastest),  # at rest there is no drag
            "accelerating": line & ~even,
            "turning": ~line,
        }
        for kind, where in kinds.items():
            by_kind[kind] += [
                cut_out(log, log.time[first], log.time[last])
                for first, last in true_stretches(where)
                if log.time[last] - log.time[first] >= least
            ]
    return Manoeuvres(**{kind: tuple(portions) for kind, portions in by_kind.items()})


_STRAIGHT = 0.01
"""Radians: a propeller this far from amidships is meant to push straight ahead."""


def undisturbed(
    logs: Log | Sequence[Log],
    *,
    least: float = 5.0,
    smoothing: float = 1.0,
    yaw_rate: float = 0.03,
    curvature: float = 0.15,
    settle: float = 5.0,
) -> list[Log]:
    """Cut out the portions that show no gust, by the criterion of the paper.

    With the propeller amidships the vessel is expected to run straight: where its yaw rate is not
    small, something else turned it. At a held angle it is expected to come to an arc of constant
    radius: where the curvature of its path leaves the median of that arc, likewise. While it still
    turns in there is no arc to judge by; that stretch is kept if the arc behind it is good.

    Args:
        logs: records with held ``propeller_speed`` and ``rudder_angle``, and with ``surge``,
            ``sway`` and ``yaw_rate``.
        least: the shortest portion [s].
        smoothing: length of the running mean over the yaw rate and the speeds [s].
        yaw_rate: allowed on a straight line [rad/s].
        curvature: allowed departure from that of the arc, as a share of it.
        settle: how long turning in takes [s].

    Returns:
        The portions, as logs of their own; `compare` holds a model against them.

    Raises:
        InputError: a channel that is missing, or no such portion.

    Source: Siramdasu & Fahimi 2013, section 5.

    Example:
        >>> try:  # a zigzag never holds its inputs for so long
        ...     dft.papers.undisturbed(boat_log, least=10.0)
        ... except dft.InputError as error:
        ...     print(error.mend)
        Hold each level longer, or lower settle.
    """
    portions = []
    for held in steady_portions(
        logs, settle=0.0, least=least, inputs=("propeller_speed", "rudder_angle")
    ):
        log = cut_out(held.log, held.start, held.stop)
        r, u, v = (
            without_noise(log.time, log.values(name, unit), smoothing)
            for name, unit in (("yaw_rate", "rad/s"), ("surge", "m/s"), ("sway", "m/s"))
        )
        if abs(held.mean("rudder_angle", "rad")) <= _STRAIGHT:
            good = np.abs(r) <= yaw_rate
        else:
            bend = r / np.maximum(np.hypot(u, v), 1e-6)
            arc = log.time >= log.time[0] + settle
            middle = np.median(bend[arc]) if arc.any() else np.nan
            good = np.abs(bend - middle) <= curvature * abs(middle)
            if arc.any() and good[np.argmax(arc)]:
                good |= ~arc
        portions += [
            cut_out(log, log.time[first], log.time[last])
            for first, last in true_stretches(good)
            if log.time[last] - log.time[first] >= least
        ]
    if not portions:
        raise InputError(
            f"undisturbed: no portion of {least:g} s runs straight or on one arc.",
            "Allow more (yaw_rate, curvature), or records of a calmer day.",
        )
    return portions


def cut_out(log: Log, start: float, stop: float) -> Log:
    """From one time stamp to another."""
    return log.slice(start - log.time[0] - 1e-9, stop - log.time[0] + 1e-9)


def without_noise(time: np.ndarray, values: np.ndarray, length: float) -> np.ndarray:
    """The running mean over ``length`` seconds, of what was measured."""
    finite = np.isfinite(values)
    # differences of running sums: any window at the cost of one pass, gaps counted out
    total = np.concatenate([[0.0], np.cumsum(np.where(finite, values, 0.0))])
    count = np.concatenate([[0], np.cumsum(finite)])
    first = np.searchsorted(time, time - 0.5 * length - 1e-9)
    end = np.searchsorted(time, time + 0.5 * length + 1e-9)
    return (total[end] - total[first]) / np.maximum(count[end] - count[first], 1)

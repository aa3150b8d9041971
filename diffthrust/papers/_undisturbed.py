"""Portions of open-loop records in which nothing but the propeller moves the vessel."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust.logs._log import Log
from diffthrust.papers._steady import steady_portions, true_stretches

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

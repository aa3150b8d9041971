"""Portions of records: with held inputs, of one kind of manoeuvre, without gusts."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from diffthrust._support.envelope import stretches
from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust._support.results import Brief
from diffthrust._support.validation import finite
from diffthrust.estimation._arguments import listed
from diffthrust.logs._log import Log

_STRAIGHT = 0.01
"""Radians: a propeller this far from amidships is meant to push straight ahead."""


@dataclass(frozen=True, repr=False)
class Steady(Brief):
    """One portion of a record over which the inputs were held.

    Args:
        log: the record.
        first: its first sample, after what the inputs changed had settled.
        end: the sample behind its last one.

    Example:
        >>> part = dft.papers.steady_portions(held, settle=3.0)[0]
        >>> round(part.start, 2), round(part.stop, 2), round(part.mean("speed", "rad/s"), 1)
        (3.0, 5.95, 33.7)
        >>> part.std_error("speed", "rad/s") < 0.1
        True
    """

    log: Log = field(repr=False)
    first: int
    end: int

    @property
    def start(self) -> float:
        """When it begins [s]."""
        return float(self.log.time[self.first])

    @property
    def stop(self) -> float:
        """Its last sample [s]."""
        return float(self.log.time[self.end - 1])

    def mean(self, channel: str, unit: str) -> float:
        """The mean of a channel, in ``unit``; NaN where nothing was measured."""
        values = self.log.values(channel, unit)[self.first : self.end]
        return float(np.nanmean(values)) if np.isfinite(values).any() else math.nan

    def std_error(self, channel: str, unit: str) -> float:
        """Standard error of the mean under white noise; NaN where fewer than two were measured."""
        values = self.log.values(channel, unit)[self.first : self.end]
        values = values[np.isfinite(values)]
        return float(np.std(values, ddof=1) / np.sqrt(values.size)) if values.size > 1 else math.nan


def steady_portions(
    logs: Log | Sequence[Log],
    *,
    settle: float,
    least: float = 0.0,
    inputs: Iterable[str] | None = None,
    tolerance: float = 1e-3,
) -> list[Steady]:
    """Where the inputs stay where they are, from ``settle`` seconds after they last moved.

    Args:
        logs: one record or several.
        settle: how long what is measured needs to come to rest [s].
        least: how long a portion must last at least, after that [s].
        inputs: which inputs have to be held; all of a record's where not given.
        tolerance: an input counts as held while it moves by less than this share of the range it
            has in all records.

    Returns:
        The portions in the order of the records.

    Raises:
        InputError: no record, one without such an input, no portion anywhere, a time that is
            negative.

    Example:
        >>> for part in dft.papers.steady_portions(held, settle=3.0):
        ...     print(part.mean("command", "V"), round(part.mean("speed", "rad/s"), 1))
        1.0 33.7
        2.0 47.6
    """
    logs = records("steady_portions", logs)
    for name, value in (("settle", settle), ("least", least)):
        finite(f"steady_portions, {name}", value, lambda x: x >= 0, "seconds, zero or more")
    names = list(inputs) if inputs is not None else sorted({n for g in logs for n in g.inputs})
    for log in logs:
        absent = [name for name in names if name not in log.inputs]
        if absent:
            raise InputError(
                f"{log.name}: expected the input {listing(absent)}, found {listing(log.inputs)}.",
                "Name the inputs that all records have: inputs=[...].",
            )
    allowed = {
        name: tolerance * max(1e-300, float(np.ptp(np.concatenate([g.inputs[name] for g in logs]))))
        for name in names
    }
    portions = []
    for log in logs:
        for begin, end in pairwise(_edges([(log.inputs[n], allowed[n]) for n in names])):
            # a sample exactly ``settle`` after the step counts, whatever the rounding of the clock
            first = int(np.searchsorted(log.time, log.time[begin] + settle - 1e-9))
            if end - first >= 2 and log.time[end - 1] - log.time[first] >= least - 1e-9:
                portions.append(Steady(log, first, end))
    if not portions:
        raise InputError(
            f"steady_portions: no stretch over which {listing(names)} were held for "
            f"{settle + least:g} s.",
            "Hold each level longer, or lower settle.",
        )
    return portions


def _edges(inputs: Sequence[tuple[np.ndarray, float]]) -> list[int]:
    """Where a held stretch begins, and the end: every sample is compared with the stretch's first.

    Compared with the sample before, a slow ramp would count as held.
    """
    edges = [0]
    samples = inputs[0][0].size
    for k in range(1, samples):
        if any(abs(u[k] - u[edges[-1]]) > allowed for u, allowed in inputs):
            edges.append(k)
    return [*edges, samples]


def records(what: str, logs: Any) -> tuple[Log, ...]:
    """One record or several as a tuple; ``what`` names the method that finds none."""
    several = listed(logs)
    if not several:
        raise InputError(f"{what}: no record was given.", "Give one log or a list of them.")
    return several


@dataclass(frozen=True, repr=False)
class Manoeuvres(Brief):
    """Portions of records, each a log of its own.

    Args:
        steady: straight on, at a speed that hardly changes.
        accelerating: straight on, while the speed changes.
        turning: all else that lasts.

    Example:
        >>> result = dft.papers.manoeuvres(boat_log, least=2.0)
        >>> len(result.steady), len(result.turning) > 0
        (0, True)
        >>> print(result.summary)
        0 steady (0 s), 0 accelerating (0 s), 4 turning (18 s)
    """

    steady: tuple[Log, ...] = field(repr=False)
    accelerating: tuple[Log, ...] = field(repr=False)
    turning: tuple[Log, ...] = field(repr=False)

    @property
    def summary(self) -> str:
        """How many portions there are, and how long they are together."""
        seconds = {kind: sum(log.duration for log in logs) for kind, logs in vars(self).items()}
        return ", ".join(f"{len(vars(self)[k])} {k} ({s:.0f} s)" for k, s in seconds.items())


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
        >>> result = dft.papers.manoeuvres(boat_log, least=2.0)
        >>> len(result.turning) > 0
        True
    """
    for name, value in (("least", least), ("smoothing", smoothing)):
        finite(f"manoeuvres, {name}", value, lambda x: x > 0, "seconds, more than zero")
    logs = records("manoeuvres", logs)
    surge, yaw = (
        [_smoothed(log.time, log.values(name, unit), smoothing) for log in logs]
        for name, unit in (("surge", "m/s"), ("yaw_rate", "rad/s"))
    )
    fastest = max(float(np.max(np.abs(u))) for u in surge)
    ahead = straight * max(float(np.max(np.abs(r))) for r in yaw)
    by_kind: dict[str, list[Log]] = {"steady": [], "accelerating": [], "turning": []}
    for log, u, r in zip(logs, surge, yaw, strict=True):
        line = np.abs(r) <= ahead
        # the mean slope over a portion's length: a single gust does not end a steady run
        change = least * _smoothed(log.time, np.gradient(u, log.time), least)
        even = np.abs(change) <= steady * fastest
        kinds = {
            "steady": line & even & (np.abs(u) > steady * fastest),  # at rest there is no drag
            "accelerating": line & ~even,
            "turning": ~line,
        }
        for kind, where in kinds.items():
            by_kind[kind] += _portions(log, where, least)
    return Manoeuvres(**{kind: tuple(portions) for kind, portions in by_kind.items()})


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
    inputs = ("propeller_speed", "rudder_angle")
    for held in steady_portions(logs, settle=0.0, least=least, inputs=inputs):
        log = _cut_out(held.log, held.start, held.stop)
        r, u, v = (
            _smoothed(log.time, log.values(name, unit), smoothing)
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
        portions += _portions(log, good, least)
    if not portions:
        raise InputError(
            f"undisturbed: no portion of {least:g} s runs straight or on one arc.",
            "Allow more (yaw_rate, curvature), or records of a calmer day.",
        )
    return portions


def _cut_out(log: Log, start: float, stop: float) -> Log:
    """From one time stamp to another."""
    return log.slice(start - log.time[0] - 1e-9, stop - log.time[0] + 1e-9)


def _portions(log: Log, where: np.ndarray, least: float) -> list[Log]:
    """The stretches of true values that last so long [s]."""
    times = [(float(log.time[begin]), float(log.time[end - 1])) for begin, end in stretches(where)]
    return [_cut_out(log, start, stop) for start, stop in times if stop - start >= least]


def _smoothed(time: np.ndarray, values: np.ndarray, length: float) -> np.ndarray:
    """The running mean over ``length`` seconds, of what was measured."""
    finite = np.isfinite(values)
    # differences of running sums: any window at the cost of one pass, gaps counted out
    total = np.concatenate([[0.0], np.cumsum(np.where(finite, values, 0.0))])
    count = np.concatenate([[0], np.cumsum(finite)])
    first = np.searchsorted(time, time - 0.5 * length - 1e-9)
    end = np.searchsorted(time, time + 0.5 * length + 1e-9)
    return (total[end] - total[first]) / np.maximum(count[end] - count[first], 1)

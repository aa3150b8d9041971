"""What came of a vessel's run along a path: errors, solution times, and its log."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from diffthrust._support.figures import showing
from diffthrust.control._assembly import VesselAssembly
from diffthrust.control._path import Path
from diffthrust.control._recorded import RunSignals, bounded
from diffthrust.logs._log import Log

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class PathError(NamedTuple):
    """How well a path was followed over a stretch of time, in metres.

    Args:
        rms: root mean square.
        mean: the mean: what a steady disturbance leaves.
        largest: the largest, whatever its sign.

    Example:
        >>> error = track.across()
        >>> bool(0 <= error.rms <= error.largest)
        True
    """

    rms: float
    mean: float
    largest: float


class SolveTime(NamedTuple):
    """Seconds that the controller took for a sample.

    Args:
        median: over the samples.
        largest: over the samples.
        period: between two samples: what a solution may take.
        compiling: of the call before the first sample, which compiles where nothing like it has
            run; it is in neither of the others.

    Example:
        >>> track.solve_time.period, track.solve_time.median <= track.solve_time.largest
        (0.5, True)
    """

    median: float
    largest: float
    period: float
    compiling: float

    def __str__(self) -> str:
        return (
            f"{1e3 * self.median:.2f} ms a step (median; largest {1e3 * self.largest:.2f} ms) of a "
            f"period of {1e3 * self.period:g} ms; {self.compiling:.2g} s to compile before them"
        )


@dataclass(frozen=True, eq=False, repr=False)
class TrackRun(RunSignals):
    """A vessel's run along a path.

    Args:
        loop: what was run.
        path: what was to be followed.
        time: samples of the controller [s], ``(n,)``.
        signals: at these samples, ``(n,)`` each: states, outputs, inputs, ``measured.CHANNEL``,
            ``reference.north`` and ``reference.east`` [m], ``point.north`` and ``point.east`` (of
            the point that follows the path [m]), ``along`` and ``across`` (its errors, of what is,
            not of what was measured, ahead of the wanted place and to starboard of it [m]),
            ``push.north``, ``push.east`` and ``push.yaw`` (accelerations estimated by the
            controller), ``late`` (how long the path has waited for the vessel [s]: the wanted
            place is that of so much earlier), ``cost``, ``iterations``, ``settled`` and
            ``solve_time`` [s].
        diverged: the time [s] of the first sample at which a signal was no longer finite, or
            larger than any that can be meant; ``None`` where the run stayed bounded.
        compiling: seconds of the controller's call before the first sample.

    Example:
        >>> bool(track.along().rms > 0), bool(track.across(start=1.0).rms > 0)
        (True, True)
        >>> track.solve_time.period, track.log.time.shape
        (0.5, (9,))
        >>> figure = track.plot()
    """

    loop: VesselAssembly
    path: Path
    time: np.ndarray
    signals: Mapping[str, np.ndarray]
    diverged: float | None
    compiling: float

    def along(self, start: float | None = None, stop: float | None = None) -> PathError:
        """Errors along the path, positive ahead of the wanted place.

        Args:
            start: when the approach counts as over [s]; by default a third of the run.
            stop: the end [s]; by default that of the run.

        Raises:
            InputError: no sample lies between them.
        """
        return self._error("along", start, stop)

    def across(self, start: float | None = None, stop: float | None = None) -> PathError:
        """Errors across the path, positive to starboard; arguments as of `along`."""
        return self._error("across", start, stop)

    def _error(self, name: str, start: float | None, stop: float | None) -> PathError:
        error = self[name][self.within(name, start, stop)]
        root = float(np.sqrt(np.mean(error**2)))
        return PathError(root, float(np.mean(error)), float(np.max(np.abs(error))))

    @property
    def solve_time(self) -> SolveTime:
        """How long the controller took for each sample, by the clock of this machine."""
        took, period = self["solve_time"], 1.0 / self.loop.controller.rate
        return SolveTime(float(np.median(took)), float(np.max(took)), period, self.compiling)

    @cached_property
    def log(self) -> Log:
        """The run as a recorded experiment on the vessel; everything that reads a log reads it.

        Inputs as they were sent, held between samples; measured channels with their noise.
        """
        vessel = self.loop.vessel
        inputs = {name: self[name] for name in (*vessel.inputs, *self.loop.given)}
        measured = {name: self[f"measured.{name}"] for name in vessel.outputs}
        units = {**vessel.inputs, **vessel.optional_inputs, **vessel.outputs}
        return Log(
            time=self.time,
            inputs=inputs,
            measured=measured,
            units={name: units[name] for name in (*inputs, *measured)},
            hold="zero",
            name="tracking",
            notes=self.notes_of("MPC"),
        )

    @showing
    def plot(self) -> Figure:
        """The path over the water; errors, inputs with their limits, and estimates over time."""
        from diffthrust.control._figures import track_figure

        return track_figure(self, self.loop)


def track_run_of(
    loop: VesselAssembly,
    path: Path,
    time: np.ndarray,
    signals: Mapping[str, np.ndarray],
    compiling: float,
) -> TrackRun:
    """The run with its errors, cut where it ran away."""
    wanted = path.at(time - signals["late"])
    ahead, heading = loop.controller.point, signals["heading"]
    place = signals["north"] + ahead * np.cos(heading), signals["east"] + ahead * np.sin(heading)
    north, east = place[0] - wanted.north, place[1] - wanted.east
    cos, sin = np.cos(wanted.course), np.sin(wanted.course)
    series = {
        **signals,
        "reference.north": wanted.north,
        "reference.east": wanted.east,
        "point.north": place[0],
        "point.east": place[1],
        "along": north * cos + east * sin,
        "across": east * cos - north * sin,
    }
    cost = series.pop("cost")  # of a start far away it is large, and nothing has run away
    time, series, diverged = bounded(
        time, series, "Look at the units of the initial states and inputs, and at the path."
    )
    series["cost"] = cost[: time.size]
    return TrackRun(loop, path, time, series, diverged, compiling)

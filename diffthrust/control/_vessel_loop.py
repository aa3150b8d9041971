"""A vessel under predictive control, in what the controller does not know: wind, current, lags."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from time import perf_counter
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from diffthrust._support._running.programs import program
from diffthrust._support.errors import InputError
from diffthrust._support.figures import Figure, showing
from diffthrust._support.names import listing
from diffthrust._support.validation import finite
from diffthrust.control._mpc import MPC
from diffthrust.control._one_sample import State, begin, check_vessel, one_sample
from diffthrust.control._recorded import (
    RUN_AWAY,
    RunSignals,
    bounded,
    check_noise,
    mapping,
    seeded,
)
from diffthrust.control._reference import Path, Reference, wanted_at
from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model
from diffthrust.models._base.signals import Signals
from diffthrust.simulation._trajectory import Key, arriving, checked_initial, read_out


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

    loop: VesselLoop
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
        return self.as_log(self.loop.controller, inputs, measured, units, "zero", "tracking")

    @showing
    def plot(self) -> Figure:
        """The path over the water; errors, inputs with their limits, and estimates over time."""
        from diffthrust.control._figures import track_figure

        return track_figure(self, self.loop.vessel, self.loop.controller)


_STEP = 0.05
"""Seconds: the longest step with which the vessel is integrated."""


@dataclass(frozen=True, eq=False, kw_only=True)
class VesselLoop:
    """A vessel that follows a path under a predictive controller.

    The vessel may carry effects that the controller's model does not: that is the disturbance. What
    is ``given`` to the vessel, a measured wind, say, the controller does not see.

    Args:
        vessel: what moves: a `Vessel` with its effects.
        controller: an `MPC`, at whose rate the loop is sampled.
        noise: standard deviations of the measured channels, in the model's units.
        given: other inputs of the vessel: constants, or a `Sinusoid`, `Step` or `Trajectory` over
            time (``{"wind_speed": dft.control.Sinusoid(1.0, 0.5, offset=3.0), ...}``).

    Raises:
        InputError: parts that do not fit together, a number that cannot be meant.

    Example:
        >>> boat = dft.Vessel() + dft.effects.WaterCurrent(to_east=0.1)
        >>> vessel_loop = dft.control.VesselLoop(vessel=boat, controller=mpc)
        >>> print(vessel_loop.vessel)
        vessel + water_current
    """

    vessel: Model
    controller: MPC
    noise: Mapping[str, float] = field(default_factory=dict)
    given: Mapping[str, float | Reference] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_vessel(self.vessel, "VesselLoop")
        if not isinstance(self.controller, MPC):
            raise InputError(
                f"VesselLoop: expected an MPC as controller, found {self.controller!r}.",
                "Write controller=dft.control.MPC(model=..., limits=...).",
            )
        if tuple(self.vessel.inputs) != tuple(self.controller.model.inputs):
            raise InputError(
                f"VesselLoop: the vessel has the inputs {listing(self.vessel.inputs)}, the "
                f"controller's model {listing(self.controller.model.inputs)}.",
                "Give both the same drive.",
            )
        check_noise("VesselLoop", self.noise, self.vessel.outputs)
        example = '{"wind_speed": 3.0, "wind_direction": 0.0}'
        mapping("VesselLoop, given", self.given, example, self.vessel.optional_inputs)
        expected = "a number or a Sinusoid, Step or Trajectory"
        for name, value in self.given.items():
            if not isinstance(value, Reference):
                finite(f"VesselLoop, given '{name}'", value, lambda x: True, expected)
        if len({"wind_speed", "wind_direction"} & {*self.given}) == 1:
            raise InputError(
                "VesselLoop, given: expected wind_speed and wind_direction, found "
                f"{listing(self.given)}.",
                f"Write given={example}.",
            )

    def simulate(
        self,
        path: Path,
        duration: float,
        *,
        seed: int = 0,
        initial: Mapping[str, float] | None = None,
    ) -> TrackRun:
        """Run the loop.

        The controller is called sample by sample, as on board, and each call is timed; one more
        before the first, whose plan is not used, compiles. Effects with states of their own (lags)
        begin settled at the first inputs, as in `simulate`.

        Args:
            path: where to be, and when.
            duration: how long [s]; whole samples of the controller are run.
            seed: of the measurement noise.
            initial: initial states by name; by default at rest with the controller's point at the
                path's beginning, heading along it.

        Returns:
            Signals, errors along and across the path, the time of each solution, and a log.

        Raises:
            InputError: an unknown state, a number that cannot be meant.

        Example:
            >>> vessel_loop = dft.control.VesselLoop(vessel=dft.Vessel(), controller=mpc)
            >>> run = vessel_loop.simulate(
            ...     dft.control.StraightPath(0.8), 4.0, initial={"east": 0.5}
            ... )
            >>> run.diverged is None
            True
        """
        finite("duration", duration, lambda x: x > 0, "seconds, above zero")
        if not isinstance(path, Path):
            raise InputError(
                f"path: expected a path, found {path!r}.",
                "Write dft.control.StraightPath(0.8).",
            )
        mpc, rate, rng = self.controller, self.controller.rate, seeded(seed)
        time = np.arange(max(1, round(duration * rate)) + 1) / rate
        wanted_at(path, time)
        rows = {
            name: value.at(time)[0] if isinstance(value, Reference)
            else np.full(time.size, float(value))
            for name, value in self.given.items()
        }  # fmt: skip
        inputs = {name: 0.5 * (low + high) for name, (low, high) in mpc.input_limits.items()}
        start = {**self._pose(path), **checked_initial(self.vessel, initial)}
        first = {name: row[0] for name, row in rows.items()}
        state = begin(self.vessel, {**inputs, **first}, start)
        noise = {
            name: self.noise.get(name, 0.0) * rng.standard_normal(time.size)
            for name in self.vessel.outputs
        }
        values = {name: jnp.asarray(p.value, float) for name, p in self.vessel.parameters.items()}
        ship = Key(self.vessel), max(1, math.ceil(1.0 / (rate * _STEP) - 1e-9))
        plan, records, compiling = None, [], 0.0
        for k, now in enumerate(time):
            constants = {name: row[k] for name, row in rows.items()}
            outputs = _readings(ship[0], values, state, {**inputs, **constants}, now)
            measured = {name: float(outputs[name]) + noise[name][k] for name in noise}
            if records and not all(abs(value) < RUN_AWAY for value in measured.values()):
                records.append(dict.fromkeys(records[0], math.nan))
                break
            # of a craft's outputs those that the controller's model has as states: no thrust
            seen = {n: value for n, value in measured.items() if n in mpc.model.all_states}
            late = 0.0 if plan is None else float(plan.late)
            ahead = wanted_at(path, now - late + mpc.ahead)
            if plan is None:  # this call compiles, so no timed one does; its plan is dropped
                plan, begin_time = mpc.start(seen, inputs), perf_counter()
                jax.block_until_ready(mpc.step(plan, seen, ahead))
                compiling = perf_counter() - begin_time
            begin_time = perf_counter()
            plan = jax.block_until_ready(mpc.step(plan, seen, ahead))
            solving = perf_counter() - begin_time
            inputs = {name: float(value) for name, value in plan.inputs.items()}
            if not records:  # a log that is simulated again begins settled at its first inputs
                state = begin(self.vessel, {**inputs, **constants}, start)
            records.append({
                **{name: float(value) for name, value in {**state, **outputs}.items()},
                **{f"measured.{name}": value for name, value in measured.items()},
                **inputs,
                **constants,
                **{f"push.{name}": float(value) for name, value in plan.push.items()},
                "late": late,
                "cost": float(plan.cost),
                "iterations": float(plan.iterations),
                "settled": float(plan.settled),
                "solve_time": solving,
            })  # fmt: skip
            state = _moved(*ship, values, state, {**inputs, **constants}, now, 1.0 / rate)
        signals = {name: np.array([row[name] for row in records]) for name in records[0]}
        return self._run(path, time[: len(records)], signals, compiling)

    def _pose(self, path: Path) -> dict[str, float]:
        """Where the controller's point is at the path's beginning, heading along it."""
        start = wanted_at(path, np.zeros(1))
        course, back = start.course[0], self.controller.point
        north = start.north[0] - back * math.cos(course)
        return {"north": north, "east": start.east[0] - back * math.sin(course), "heading": course}

    def _run(
        self, path: Path, time: np.ndarray, signals: Mapping[str, np.ndarray], compiling: float
    ) -> TrackRun:
        """The run with its errors, cut where it ran away."""
        wanted = path.at(time - signals["late"])
        ahead, heading = self.controller.point, signals["heading"]
        place = (
            signals["north"] + ahead * np.cos(heading),
            signals["east"] + ahead * np.sin(heading),
        )
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
        mend = "Look at the units of the initial states and inputs, and at the path."
        time, series, diverged = bounded(time, series, mend)
        series["cost"] = cost[: time.size]
        return TrackRun(self, path, time, series, diverged, compiling)


@program(2)
def _moved(
    key: Key,
    substeps: int,
    values: Mapping[str, Array],
    state: State,
    inputs: Mapping[str, Array],
    now: Array,
    period: Array,
) -> State:
    return one_sample(key.model.bind(values), state, inputs, now, period, substeps)


@program(1)
def _readings(
    key: Key, values: Mapping[str, Array], state: State, inputs: Mapping[str, Array], now: Array
) -> State:
    """What the sensors report at one sample, without noise."""
    model = key.model.bind(values)
    return read_out(model, Signals({**state, **arriving(model, now, inputs), "time": now}))

"""A closed loop: thruster, vehicle, controller, compensator, and what disturbs them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.figures import showing
from diffthrust._support.validation import finite, whole_number
from diffthrust.control._assembly import LoopAssembly, mapping, seeded
from diffthrust.control._faults import FaultNumbers
from diffthrust.control._loop_scan import compiled_loop
from diffthrust.control._plant import driven
from diffthrust.control._recorded import RunSignals, bounded
from diffthrust.control._reference import Reference
from diffthrust.logs._log import Log

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Tracking(NamedTuple):
    """How well a reference was followed, in the unit of the channel that followed.

    Args:
        rms: root mean square of the error.
        largest: the largest error.
        relative: ``rms`` over the standard deviation of the reference; NaN where it is constant.

    Example:
        >>> run.tracking(start=5.0)._fields
        ('rms', 'largest', 'relative')
    """

    rms: float
    largest: float
    relative: float


@dataclass(frozen=True, eq=False, repr=False)
class LoopRun(RunSignals):
    """A closed loop's run.

    Args:
        loop: what was run.
        time: recorded samples [s], ``(n,)``; up to where the loop ran away.
        signals: every signal at these samples, ``(n,)`` each: ``reference``, ``error`` (of what
            is, not of what was measured), ``wanted_thrust``, ``command`` (as it is sent; a log's
            input), ``motor_command`` (after faults and the effects on it), outputs and states by
            name, memories such as ``compensator.load_estimate``, ``measured.CHANNEL``.
        units: their units.
        diverged: the time [s] at which a signal was no longer finite, or larger than any that
            can be meant; ``None`` where the loop stayed bounded.

    Example:
        >>> sorted(run.units)[:3]
        ['command', 'error', 'measured.position']
        >>> run.tracking(start=5.0).rms < 0.1
        True
        >>> run.log.inputs.keys(), run.vehicle_log.inputs.keys()
        (dict_keys(['command', 'inflow']), dict_keys(['thrust']))
        >>> figure = run.plot()
    """

    loop: LoopAssembly
    time: np.ndarray
    signals: Mapping[str, np.ndarray]
    units: Mapping[str, str]
    diverged: float | None

    @cached_property
    def log(self) -> Log:
        """The run as a recorded experiment on the thruster.

        Inputs: ``command`` as it was sent, held between samples; ``inflow`` (the vehicle's
        velocity) where there is a vehicle; constant ones. Measured: what sensors report, with
        noise, of thruster and vehicle. Everything that reads a log reads this one.
        """
        thruster = self.loop.thruster
        inputs = {driven(thruster): self["command"]}
        inputs |= {n: np.full(self.time.size, float(v)) for n, v in self.loop.given.items()}
        if "velocity" in self.signals and "inflow" in thruster.optional_inputs:
            inputs["inflow"] = self["velocity"]
        units = {**thruster.inputs, **thruster.optional_inputs, **self.units}
        hold = {name: "linear" if name == "inflow" else "zero" for name in inputs}
        return self.as_log(self.loop.controller, inputs, self._measured(), units, hold)

    @cached_property
    def vehicle_log(self) -> Log:
        """The run as a recorded experiment on the vehicle: its input is the thrust as it was.

        Raises:
            InputError: the loop has no vehicle.
        """
        vehicle = self.loop.vehicle
        if vehicle is None:
            raise InputError("The loop has no vehicle.", "Use run.log.")
        measured = {n: v for n, v in self._measured().items() if n in vehicle.outputs}
        inputs = {"thrust": self["thrust"]}
        return self.as_log(self.loop.controller, inputs, measured, self.units, "linear")

    def _measured(self) -> dict[str, np.ndarray]:
        kind = "measured."
        return {n.removeprefix(kind): v for n, v in self.signals.items() if n.startswith(kind)}

    def tracking(self, start: float | None = None, stop: float | None = None) -> Tracking:
        """The error from one time to another.

        Args:
            start: when the transient counts as over [s]; by default a third of the run.
            stop: the end [s]; by default that of the run.

        Raises:
            InputError: no sample lies between them.
        """
        within = self.within("tracking", start, stop)
        error, size = self["error"][within], float(np.std(self["reference"][within]))
        rms = float(np.sqrt(np.mean(error**2)))
        # a constant reference leaves a standard deviation of rounding
        relative = rms / size if size > 1e-12 * (1.0 + rms) else float("nan")
        return Tracking(rms, float(np.max(np.abs(error))), relative)

    @showing
    def plot(self) -> Figure:
        """Reference and position, error, thrust, command and estimates over time."""
        from diffthrust.control._figures import run_figure

        return run_figure(self, self.loop, self.units)


def run_of(
    loop: LoopAssembly, rows: Mapping[str, np.ndarray], signals: Mapping[str, np.ndarray]
) -> LoopRun:
    """The run, cut where it ran away."""
    of = loop.controller.of
    signals = dict(signals)
    if loop.controller.gives != "thrust":
        del signals["wanted_thrust"]
    with np.errstate(invalid="ignore"):
        signals = {"reference": rows["wanted"], "error": rows["wanted"] - signals[of], **signals}
    time, signals, diverged = bounded(
        rows["time"],
        signals,
        "Look at the units of the gains, the rate of the controller and substeps.",
    )
    return LoopRun(loop, time, signals, _units(loop, signals), diverged)


def _units(loop: LoopAssembly, signals: Mapping[str, np.ndarray]) -> dict[str, str]:
    models = [model for model in (loop.thruster, loop.vehicle) if model is not None]
    units = {n: u for m in models for n, u in {**m.all_states, **m.outputs}.items()}
    units |= dict.fromkeys(("reference", "error"), units.get(loop.controller.of, ""))
    command = loop.thruster.inputs[driven(loop.thruster)]
    units |= {"command": command, "motor_command": command, "wanted_thrust": "N"}
    for name, block in (("controller", loop.controller), ("compensator", loop.compensator)):
        units |= {f"{name}.{n}": u for n, u in (block.states if block else {}).items()}
    return {name: units.get(name.removeprefix("measured."), "") for name in signals}


_STEP = 0.01
"""Seconds: the integrator's longest step unless ``substeps`` is given."""


class Loop(LoopAssembly):
    """A sampled controller around a thruster, and the vehicle that the thruster pushes.

    The controller reads its channels ``rate`` times a second and holds its output in between. The
    command arrives ``delay`` seconds after the sample it was worked out from.

    Args:
        thruster: any model with the input ``command``, with its effects; or a craft of one
            thruster, whose body and sensors are then in the loop.
        controller: a `Controller`; one that gives a thrust goes through the compensator.
        vehicle: any model with the input ``thrust``, or ``None`` for a loop around the thruster.
        compensator: a `Compensator`; without one the steady thrust of ``thruster`` is relied on.
        rate: samples of the controller in a second [Hz].
        delay: computational delay [s]; a multiple of the period, or of a simple part of it.
        noise: standard deviations of the measured channels, in their units.
        faults: `Change`, `Stuck`, `Limited`, or `duct_obstruction`.
        given: other inputs of the thruster, constant (``{"supply_voltage": 24.0}``).

    Raises:
        InputError: parts that do not fit together, a number that cannot be meant, an effect that
            cannot run within a loop.

    Example:
        >>> loop = dft.control.Loop(
        ...     thruster=dft.Thruster(ct=0.022),
        ...     vehicle=dft.AxisVehicle(),
        ...     controller=dft.control.PD(frequency=1.0, damping=0.707),
        ... )
        >>> result = loop.simulate(dft.control.Step(0.0), 10.0, initial={"position": 0.1})
        >>> result.diverged is None
        True
    """

    def prepared(
        self,
        reference: Reference,
        duration: float,
        seed: int = 0,
        initial: Mapping[str, float] | None = None,
        substeps: int | None = None,
    ) -> tuple[Any, ...]:
        """The arguments of `loop_signals` for this loop, as for `simulate`.

        Example:
            >>> prepared = loop.prepared(dft.control.Step(0.0), 10.0, initial={"position": 0.1})
        """
        finite("duration", duration, lambda x: x > 0, "seconds, above zero")
        if not isinstance(reference, Reference):
            raise InputError(
                f"reference: expected Sinusoid, Step or Trajectory, found {reference!r}.",
                "Write dft.control.Step(1.0).",
            )
        samples = self.samples
        step = 1.0 / (self.rate * samples)
        if substeps is None:
            substeps = max(1, math.ceil(step / _STEP - 1e-9))
        substeps = whole_number("substeps", substeps)
        time = step * np.arange(max(1, round(duration * self.rate)) * samples + 1)
        rng = seeded(seed)
        noise = {
            f"noise.{name}": jnp.asarray(self.noise[name] * rng.standard_normal(time.size))
            for name in self.plant.channels
            if self.noise.get(name, 0.0) > 0
        }
        wanted = zip(("wanted", "wanted_rate", "wanted_acceleration"), reference.at(time),
                     strict=True)  # fmt: skip
        rows = {"time": jnp.asarray(time), **{n: jnp.asarray(row) for n, row in wanted}, **noise}
        start = {}
        states = self.plant.states
        for name, value in mapping(
            "initial", initial or {}, '{"speed": 0.0}', states, "state"
        ).items():
            state = finite(f"initial, state '{name}'", value, lambda x: True, "a finite number")
            start[name] = jnp.asarray(state)
        parts = self.parts(substeps)
        values = {name: jnp.asarray(p.value, float) for name, p in self.parameters.items()}
        faults = FaultNumbers.of(tuple(self.faults))  # pyright: ignore[reportArgumentType]
        return parts, values, parts.plant.given, faults, rows, start

    def simulate(
        self,
        reference: Reference,
        duration: float,
        *,
        seed: int = 0,
        initial: Mapping[str, float] | None = None,
        substeps: int | None = None,
    ) -> LoopRun:
        """Run the loop from rest.

        Args:
            reference: `Sinusoid`, `Step` or `Trajectory`, for the channel that the controller is
                for.
            duration: how long [s]; whole periods of the controller are run.
            seed: of the measurement noise.
            initial: initial states by name, ``{"position": 0.1}``; others as the models have them
                at rest.
            substeps: steps of the integrator in one recorded sample; by default as many as make
                them 0.01 s or less.

        Returns:
            Every signal, a log, and where the loop ran away.

        Raises:
            InputError: an unknown state, a number that cannot be meant, or a loop that runs away
                at once.

        Example:
            >>> again = loop.simulate(dft.control.Step(0.0), 10.0, initial={"position": 0.1})
            >>> round(float(again["position"][0]), 3)
            0.1
        """
        arguments = self.prepared(reference, duration, seed, initial, substeps)
        signals = compiled_loop(*arguments)
        rows = {name: np.asarray(row) for name, row in arguments[4].items()}
        return run_of(self, rows, {name: np.asarray(value) for name, value in signals.items()})

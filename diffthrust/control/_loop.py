"""A closed loop: thruster, vehicle, controller, compensator, and what disturbs them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple, Self

import jax.numpy as jnp
import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.figures import Figure, showing
from diffthrust._support.names import listing
from diffthrust._support.validation import check_known, finite, whole_number
from diffthrust.control._compensators import Compensator, NoCompensator
from diffthrust.control._controllers import Controller
from diffthrust.control._faults import Fault, check_faults, fault_numbers
from diffthrust.control._loop_scan import Parts, compiled_loop
from diffthrust.control._plant import CommandPath, Plant, driven
from diffthrust.control._recorded import RunSignals, bounded, check_noise, mapping, seeded
from diffthrust.control._reference import Reference
from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model
from diffthrust.models._base.parameter import Parameter


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

    loop: Loop
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

        parts = [self.loop.controller, self.loop.compensator]
        faults: Any = self.loop.faults
        return run_figure(self, [block for block in parts if block is not None], faults, self.units)


_STEP = 0.01
"""Seconds: the integrator's longest step unless ``substeps`` is given."""
_MOST = 64
"""Recorded samples in one period of the controller."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Loop:
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
        >>> loop.parameters["controller.damping"].value
        0.707
        >>> result = loop.simulate(dft.control.Step(0.0), 10.0, initial={"position": 0.1})
        >>> result.diverged is None
        True
    """

    thruster: Model
    controller: Controller
    vehicle: Model | None = None
    compensator: Compensator | None = None
    rate: float = 50.0
    delay: float = 0.0
    noise: Mapping[str, float] = field(default_factory=dict)
    faults: Sequence[Fault] | Fault = ()
    given: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        plant = self._plant
        plant.check()
        finite("Loop, rate", self.rate, lambda x: x > 0, "samples in a second, above zero")
        finite("Loop, delay", self.delay, lambda x: x >= 0, "seconds, zero or more")
        check_noise("Loop", self.noise, plant.channels)
        plant.check_blocks(self.controller, self.compensator)
        if self.controller.gives == "thrust" and self.compensator is None:
            object.__setattr__(self, "compensator", NoCompensator.of(self.thruster))
        object.__setattr__(self, "faults", check_faults(self.faults, self.parameters))
        self._parts(1)  # refuses effects that cannot run in a loop, and delays

    @property
    def _plant(self) -> Plant:
        """Thruster and vehicle as one system."""
        constants = mapping("Loop, given", self.given, '{"supply_voltage": 24.0}')
        numbers = {
            name: jnp.asarray(finite(f"Loop, given '{name}'", value, lambda x: True, "a number"))
            for name, value in constants.items()
        }
        return Plant(self.thruster, self.vehicle, numbers)

    @property
    def _members(self) -> dict[str, Any]:
        names = ("thruster", "vehicle", "controller", "compensator")
        members = {name: getattr(self, name) for name in names}
        return {name: block for name, block in members.items() if block is not None}

    @property
    def parameters(self) -> dict[str, Parameter]:
        """All parameters and gains: ``thruster.alpha``, ``controller.bandwidth``, ..."""
        return {
            f"{member}.{name}": p
            for member, block in self._members.items()
            for name, p in block.parameters.items()
        }

    def replace(self, parameters: Mapping[str, Any] | None = None, /, **fields: Any) -> Self:
        """The loop with some parameters or some of its arguments changed.

        Args:
            parameters: full name to a value, a `Parameter`, or some fields of one.
            **fields: arguments of `Loop`.

        Raises:
            InputError: a name that the loop does not have, or a value outside its bounds.

        Example:
            >>> loop.replace({"controller.frequency": 2.0}, rate=100.0).rate
            100.0
        """
        described = self.parameters
        grouped: dict[str, dict[str, Any]] = {}
        for name, new in (parameters or {}).items():
            check_known(name, described, "The loop has no parameter")
            member, _, short = name.partition(".")
            grouped.setdefault(member, {})[short] = new
        for name in fields:
            if name not in self.__dataclass_fields__:
                raise InputError(
                    f"Loop has no argument '{name}'; it has {listing(self.__dataclass_fields__)}.",
                    'Give parameters by their full names: replace({"thruster.ct": 0.02}).',
                )
        members = self._members
        changed = {member: members[member].replace(**named) for member, named in grouped.items()}
        return replace(self, **changed, **fields)

    def _parts(self, substeps: int) -> Parts:
        """What fixes the compiled code."""
        samples = self._samples
        late = round(self.delay * self.rate * samples)
        path = CommandPath(self.thruster, 1.0 / (self.rate * samples))
        blocks = self._plant, self.controller, self.compensator
        return Parts(*blocks, path, samples, substeps, late)

    @property
    def _samples(self) -> int:
        """The fewest recorded samples in a period such that the delay is a multiple of it."""
        for samples in range(1, _MOST + 1):
            late = self.delay * self.rate * samples
            if abs(late - round(late)) <= 1e-6 * max(1.0, late):
                return samples
        raise InputError(
            f"Loop, delay: expected a simple part of the controller's period, "
            f"{1.0 / self.rate:g} s, found {self.delay:g} s.",
            f"Give {round(self.delay * self.rate * 10) / 10 / self.rate:g} s, for one.",
        )

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
        samples = self._samples
        step = 1.0 / (self.rate * samples)
        if substeps is None:
            substeps = max(1, math.ceil(step / _STEP - 1e-9))
        parts = self._parts(whole_number("substeps", substeps))
        time = step * np.arange(max(1, round(duration * self.rate)) * samples + 1)
        rng = seeded(seed)
        rows: dict[str, np.ndarray] = {
            f"noise.{name}": self.noise[name] * rng.standard_normal(time.size)
            for name in parts.plant.channels
            if self.noise.get(name, 0.0) > 0
        }
        names = ("time", "wanted", "wanted_rate", "wanted_acceleration")
        rows |= dict(zip(names, (time, *reference.at(time)), strict=True))
        states = mapping("initial", initial or {}, '{"speed": 0.0}', parts.plant.states, "state")
        start = {
            name: finite(f"initial, state '{name}'", value, lambda x: True, "a finite number")
            for name, value in states.items()
        }
        values = {name: jnp.asarray(p.value, float) for name, p in self.parameters.items()}
        faults = fault_numbers(self.faults)  # pyright: ignore[reportArgumentType]
        traced = ({n: jnp.asarray(value) for n, value in row.items()} for row in (rows, start))
        return parts, values, parts.plant.given, faults, *traced

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
        signals = {name: np.asarray(value) for name, value in compiled_loop(*arguments).items()}
        if self.controller.gives != "thrust":
            del signals["wanted_thrust"]
        time, wanted = (np.asarray(arguments[4][name]) for name in ("time", "wanted"))
        with np.errstate(invalid="ignore"):
            error = wanted - signals[self.controller.of]
        time, signals, diverged = bounded(
            time,
            {"reference": wanted, "error": error, **signals},
            "Look at the units of the gains, the rate of the controller and substeps.",
        )
        units = self._units()
        known_units = {n: units.get(n.removeprefix("measured."), "") for n in signals}
        return LoopRun(self, time, signals, known_units, diverged)

    def _units(self) -> dict[str, str]:
        units = {**self._plant.states, **self._plant.channels}
        units |= dict.fromkeys(("reference", "error"), units.get(self.controller.of, ""))
        command = self.thruster.inputs[driven(self.thruster)]
        units |= {"command": command, "motor_command": command, "wanted_thrust": "N"}
        for name, block in (("controller", self.controller), ("compensator", self.compensator)):
            units |= {f"{name}.{n}": u for n, u in (block.states if block else {}).items()}
        return units

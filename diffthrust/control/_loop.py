"""A closed loop: thruster, vehicle, controller, compensator, and what disturbs them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

import jax.numpy as jnp
import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing, nearest
from diffthrust._support.validation import finite
from diffthrust.control._base import Controller
from diffthrust.control._command_path import CommandPath
from diffthrust.control._compensators import Compensator, NoCompensator
from diffthrust.control._faults import Fault, Numbers, check_faults
from diffthrust.control._loop_check import check_blocks, check_numbers, mapping, seeded
from diffthrust.control._loop_result import LoopRun, run_of
from diffthrust.control._loop_scan import Parts, Timing, compiled
from diffthrust.control._plant import Plant
from diffthrust.control._reference import Reference
from diffthrust.models._base.model import Model
from diffthrust.models._base.parameter import Parameter

_MOST = 64
"""Recorded samples in one period of the controller."""
_STEP = 0.01
"""Seconds: the integrator's longest step unless ``substeps`` is given."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Loop:
    """A sampled controller around a thruster, and the vehicle that the thruster pushes.

    The controller reads its channels ``rate`` times a second and holds its output in between. The
    command arrives ``delay`` seconds after the sample it was worked out from.

    Args:
        thruster: any model with the input ``command``, with its effects.
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
        >>> run = loop.simulate(dft.control.Step(0.0), 60.0, initial={"position": 0.1})
        >>> fit = dft.fit(dft.Thruster(), run.log)
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
        check_numbers(plant, self.rate, self.delay, self.noise)
        check_blocks(plant, self.controller, self.compensator)
        if self.controller.gives == "thrust" and self.compensator is None:
            object.__setattr__(self, "compensator", NoCompensator.of(self.thruster))
        object.__setattr__(self, "faults", check_faults(self.faults, self.parameters))
        self._parts(1)  # refuses effects that cannot run in a loop, and delays

    # -- parameters by their full names ------------------------------------------------------------

    @property
    def _plant(self) -> Plant:
        given = mapping("Loop, given", self.given, '{"supply_voltage": 24.0}')
        numbers = {
            name: finite(f"Loop, given '{name}'", value, lambda x: True, "a number")
            for name, value in given.items()
        }
        arrays = {name: jnp.asarray(value) for name, value in numbers.items()}
        return Plant(self.thruster, self.vehicle, arrays)

    @property
    def _members(self) -> dict[str, Any]:
        members = {name: getattr(self, name) for name in
                   ("thruster", "vehicle", "controller", "compensator")}  # fmt: skip
        return {name: part for name, part in members.items() if part is not None}

    @property
    def parameters(self) -> dict[str, Parameter]:
        """All parameters and gains: ``thruster.alpha``, ``controller.bandwidth``, ..."""
        return {
            f"{member}.{name}": p
            for member, part in self._members.items()
            for name, p in part.parameters.items()
        }

    def replace(self, parameters: Mapping[str, Any] | None = None, /, **fields: Any) -> Self:
        """The loop with some parameters or some of its arguments changed.

        Args:
            parameters: full name to a value, a `Parameter`, or some fields of one.
            **fields: arguments of `Loop`.

        Raises:
            InputError: a name that the loop does not have, or a value outside its bounds.

        Example:
            >>> loop.replace({"controller.bandwidth": 2.0}, rate=100.0)
        """
        known = self.parameters
        grouped: dict[str, dict[str, Any]] = {}
        for name, new in (parameters or {}).items():
            if name not in known:
                near = nearest(name, known)
                raise InputError(
                    f"The loop has no parameter '{name}'{f' ({near})' if near else ''}; "
                    f"it has {listing(known)}.",
                    "Correct the name.",
                )
            member, _, own = name.partition(".")
            grouped.setdefault(member, {})[own] = new
        for name in fields:
            if name not in self.__dataclass_fields__:
                raise InputError(
                    f"Loop has no argument '{name}'; it has {listing(self.__dataclass_fields__)}.",
                    'Give parameters by their full names: replace({"thruster.ct": 0.02}).',
                )
        changed = {}
        for member, named in grouped.items():
            part = self._members[member]
            model = isinstance(part, Model)
            changed[member] = part.replace(named) if model else part.replace(**named)
        return replace(self, **changed, **fields)

    # -- running it --------------------------------------------------------------------------------

    def _parts(self, substeps: int) -> Parts:
        samples = self._samples()
        late = round(self.delay * self.rate * samples)
        path = CommandPath(self.thruster, 1.0 / (self.rate * samples))
        timing = Timing(samples, substeps, late)
        return Parts(self._plant, self.controller, self.compensator, path, timing)

    def _samples(self) -> int:
        """The fewest recorded samples in a period of which the delay is a multiple."""
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
        """The arguments of `_march.march` for this loop, as for `simulate`."""
        finite("duration", duration, lambda x: x > 0, "seconds, above zero")
        if not isinstance(reference, Reference):
            raise InputError(
                f"reference: expected Sinusoid, Step or Trajectory, found {reference!r}.",
                "Write dft.control.Step(1.0).",
            )
        samples = self._samples()
        step = 1.0 / (self.rate * samples)
        if substeps is None:
            substeps = max(1, math.ceil(step / _STEP - 1e-9))
        elif isinstance(substeps, bool) or not isinstance(substeps, int) or substeps < 1:
            raise InputError(
                f"substeps: expected a whole number, 1 or more, found {substeps!r}.", "Correct it."
            )
        time = step * np.arange(max(1, round(duration * self.rate)) * samples + 1)
        rng = seeded(seed)
        noise = {
            f"noise.{name}": jnp.asarray(self.noise[name] * rng.standard_normal(time.size))
            for name in self._plant.channels
            if self.noise.get(name, 0.0) > 0
        }
        wanted = zip(("wanted", "wanted_rate", "wanted_acceleration"), reference.at(time),
                     strict=True)  # fmt: skip
        rows = {"time": jnp.asarray(time), **{n: jnp.asarray(row) for n, row in wanted}, **noise}
        start = {}
        states = self._plant.states
        for name, value in mapping(
            "initial", initial or {}, '{"speed": 0.0}', states, "state"
        ).items():
            state = finite(f"initial, state '{name}'", value, lambda x: True, "a finite number")
            start[name] = jnp.asarray(state)
        parts = self._parts(substeps)
        values = {name: jnp.asarray(p.value, float) for name, p in self.parameters.items()}
        faults = Numbers.of(tuple(self.faults))  # pyright: ignore[reportArgumentType]
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
        """
        arguments = self.prepared(reference, duration, seed, initial, substeps)
        found = compiled(*arguments)
        rows = {name: np.asarray(row) for name, row in arguments[4].items()}
        return run_of(self, rows, {name: np.asarray(value) for name, value in found.items()})

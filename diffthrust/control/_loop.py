"""A closed loop: thruster, vehicle, controller, compensator, and what disturbs them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.validation import finite
from diffthrust.control._assembly import LoopAssembly
from diffthrust.control._faults import FaultNumbers
from diffthrust.control._loop_check import mapping, seeded
from diffthrust.control._loop_result import LoopRun, run_of
from diffthrust.control._loop_scan import compiled_loop
from diffthrust.control._reference import Reference

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
        elif isinstance(substeps, bool) or not isinstance(substeps, int) or substeps < 1:
            raise InputError(
                f"substeps: expected a whole number, 1 or more, found {substeps!r}.", "Correct it."
            )
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

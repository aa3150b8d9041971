"""The body on which a craft is built, and the parts on it."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust.models._base.component import Component, Mounted
from diffthrust.models._base.effect import Ports
from diffthrust.models._base.model import Model
from diffthrust.models._base.signals import Rate, RatesAndOutputs, Signal, Signals
from diffthrust.models._craft.actuators import PUSH, PUSH_WORDS, Actuators
from diffthrust.models._craft.kinematics import Kinematics, kinematics_of
from diffthrust.models._craft.placed import prefixed
from diffthrust.models._craft.sensor import Sensor, Sensors
from diffthrust.models._craft.six import Six


class Body(Component):
    """A hull under the forces of the actuators on it: the part of a `Craft` that moves.

    A subclass names ``states``, ``outputs``, ``optional_inputs`` and ``ports`` as a `Model` does,
    declares its parameters, and implements `motion` and `equations`. Names must not have a dot.

    Example:
        >>> class Cart(dft.bodies.Body):
        ...     '''A cart on rails.'''
        ...
        ...     name = "cart"
        ...     states = outputs = {"velocity": "m/s"}
        ...     ports = {"force": "net force [N]"}
        ...     mass: float = dft.parameter(10.0, "kg", bounds=(0, None))
        ...
        ...     def motion(self, s, port):
        ...         return dft.bodies.Six(surge=s.velocity)
        ...
        ...     def equations(self, s, port, water, forces):
        ...         rate = port("force", forces.surge) / self.mass
        ...         return {"velocity": rate}, {"velocity": s.velocity}
        >>> cart = dft.Craft(Cart(), fan=dft.Thruster().at((0, 0, 0)))
        >>> list(cart.parameters)[:4]
        ['mass', 'fan.alpha', 'fan.beta', 'fan.ct']
        >>> s = dft.models.Signals({"velocity": 0.5, "position": 2.0})
        >>> dft.bodies.Axis().motion(s, dft.models.Ports((), s)).surge, Cart().initial(s)
        (0.5, {})
        >>> dft.bodies.Axis().kinematics(s, {"velocity": 0.1}).acceleration.surge
        0.1
    """

    library: ClassVar[dict[str, type[Body]]] = {}
    states: ClassVar[Mapping[str, str]] = {}
    outputs: ClassVar[Mapping[str, str]] = {}
    optional_inputs: ClassVar[Mapping[str, str]] = {}
    ports: ClassVar[Mapping[str, str]] = {}
    angles: ClassVar[tuple[str, ...]] = ()
    time_scales: ClassVar[tuple[float, float]] = (0.05, 40.0)
    horizon: ClassVar[float | None] = None
    start_outputs: ClassVar[tuple[str, ...]] = ()
    quaternions: ClassVar[tuple[tuple[str, ...], ...]] = ()

    def motion(self, s: Signals, port: Ports) -> Six:
        """The velocities through the water, along and about the body's axes."""
        raise self._lacks("motion(self, s, port): return Six(surge=s.surge)")

    def equations(self, s: Signals, port: Ports, water: Six, forces: Six) -> RatesAndOutputs:
        """Rates and outputs of the body.

        Args:
            s: the signals.
            port: the ports.
            water: what `motion` returned.
            forces: forces and moments of all actuators about the origin.

        Example:
            >>> s = dft.models.Signals({"velocity": 0.0, "position": 0.0})
            >>> body, port = dft.bodies.Axis(mass=2.0), dft.models.Ports((), s)
            >>> rates, _ = body.equations(s, port, dft.bodies.Six(), dft.bodies.Six(surge=4.0))
            >>> float(rates["velocity"])
            2.0
        """
        raise self._lacks("equations(self, s, port, water, forces): return {...}, {...}")

    def kinematics(self, s: Signals, rates: Mapping[str, Rate]) -> Kinematics:
        """How it moves over ground, for the sensors on it: by states of the usual names.

        A body whose states have others must define it.

        Args:
            s: the signals.
            rates: of its states.
        """
        return kinematics_of(s, rates)

    def initial(self, s: Signals) -> Mapping[str, Signal | float]:
        """Initial states where nothing gives them, as `Model.initial`."""
        return {}

    def start_from(self, first: Mapping[str, Any]) -> Mapping[str, Any]:
        """States at the start that follow from first measurements of outputs; see `Model`.

        Where a sensor on the craft tells the attitude, its quaternion is among them.

        Example:
            >>> first = {"qw": 0.0, "qx": 0.0, "qy": 0.0, "qz": -1.0}
            >>> round(float(dft.bodies.Planar().start_from(first)["heading"]), 6)
            -3.141593
        """
        if "qw" not in first or "heading" not in self.states:
            return {}
        maths = jnp if isinstance(first["qw"], jax.Array) else np
        heading = 2.0 * maths.arctan2(first["qz"], first["qw"])
        # one of the headings that are two turns apart, which have this quaternion and not -1 times
        measured = first.get("heading", heading)
        turns = maths.round((heading - measured) / (2.0 * np.pi))
        return {"heading": measured + 2.0 * np.pi * turns}

    def _telling(self, channels: Collection[str]) -> tuple[str, ...]:
        """As `Model._telling`; the craft asks its sensors, too."""
        return ()

    def _lacks(self, line: str) -> InputError:
        return InputError(f"Body '{self.name}' has no equations.", f"Define def {line}.")


BODIES = Body.library
"""The library's bodies, by name."""


def check_body(body: object) -> None:
    """Raise `InputError` for what is no body."""
    if isinstance(body, Body):
        return
    what = f"the class {body.__name__}" if isinstance(body, type) else f"{body!r:.60}"
    raise InputError(
        f"Craft: expected a body first, found {what}.",
        "Give one of dft.bodies: dft.bodies.Planar().",
    )


def sorted_parts(parts: Mapping[str, Any], body: Body) -> tuple[dict[str, Mounted[Model]], Sensors]:
    """Actuators and sensors at their places, by name; a sensor alone is at the origin.

    Raises:
        InputError: something else, a name of the body's, or a body whose motion no sensor reads.
    """
    mounts: dict[str, Any] = {
        name: Mounted(part, (0.0, 0.0, 0.0)) if isinstance(part, Sensor) else part
        for name, part in parts.items()
    }
    for name, mounted in mounts.items():
        _check_part(name, mounted, body)
    sensors = Sensors({n: m for n, m in mounts.items() if isinstance(m.model, Sensor)})
    usual = {"surge", "sway", "heave"} & {*body.states}
    if sensors and not usual and type(body).kinematics is Body.kinematics:
        raise InputError(
            f"Craft: {listing(sensors)} would read nothing of the body '{body.name}', whose "
            f"states are {listing(body.states)}; expected surge, sway or heave among them.",
            "Define def kinematics(self, s, rates): return dft.sensors.Kinematics(...) in it.",
        )
    return {n: m for n, m in mounts.items() if n not in sensors}, sensors


def _check_part(name: str, mounted: object, body: Body) -> None:
    if not isinstance(mounted, Mounted):
        raise InputError(
            f"Craft, {name}: expected an actuator or a sensor at its place, found {mounted!r:.60}.",
            f"Write {name}=dft.Thruster().at((x, y, z)) or {name}=dft.sensors.GNSS().at((x, y, "
            "z)); numbers of the body are given with the body: dft.bodies.Planar(m11=36.0).",
        )
    taken = {*body.states, *body.outputs, *body.ports, *body.declared, "body", "share", "command"}
    if name in taken or name.startswith("_"):
        raise InputError(
            f"Craft: a part cannot be called '{name}', which the body has already.",
            "Call it by its place: port, starboard, bow, t1; or by what it is: gps, dvl, imu.",
        )


def merged(body: Body, actuators: Actuators, sensors: Sensors) -> dict[str, Any]:
    """What a craft has of its parts, behind their names: channels, ports, scales, parameters."""
    models = {name: mounted.model for name, mounted in actuators.items()}
    carried = {name: mounted.model for name, mounted in sensors.items()}
    channels: dict[str, Any] = {"inputs": {}}
    for kind in ("optional_inputs", "states", "outputs", "ports"):
        channels[kind] = dict(getattr(body, kind))
    for name, model in models.items():
        for kind in ("inputs", "optional_inputs", "states", "outputs", "ports"):
            channels[kind] |= prefixed(name, getattr(model, kind))
        channels["ports"][f"{name}.{PUSH}"] = PUSH_WORDS
    for name, sensor in carried.items():
        channels["outputs"] |= prefixed(name, sensor.outputs)
    scales = [body.time_scales, *(model.time_scales for model in models.values())]
    # one word for all commands, where all can be given in the same units
    choices = {(m.commands, m.command) for m in models.values() if m.commands}
    commands = next(iter(choices))[0] if len(choices) == 1 else ()
    commanded = tuple(f"{n}.{c}" for n, m in models.items() for c in m.commanded)
    turning = (f"{n}.{angle}" for n, p in {**models, **carried}.items() for angle in p.angles)
    turned = {n: sensor for n, sensor in carried.items() if sensor.quaternions}
    return {
        **channels,
        "declared": {**body._parameters, **actuators.parameters(), **sensors.parameters()},
        "angles": (*body.angles, *turning),
        "time_scales": (min(s[0] for s in scales), max(s[1] for s in scales)),
        "horizon": body.horizon,
        "start_outputs": (
            *body.start_outputs,
            *(f"{n}.{output}" for n, p in turned.items() for output in p.outputs),
        ),
        "quaternions": (
            *body.quaternions,
            *(tuple(f"{n}.{q}" for q in each) for n, p in turned.items() for each in p.quaternions),
        ),
        "commands": commands,
        "commanded": commanded if commands else (),
    }

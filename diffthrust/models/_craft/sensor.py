"""What a craft carries to measure with: a sensor at its place."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any, ClassVar, Self

from diffthrust._support.errors import InputError
from diffthrust._support.names import nearby
from diffthrust.models._base.component import Component, Mounted
from diffthrust.models._base.parameter import Parameter
from diffthrust.models._base.signals import Signal
from diffthrust.models._craft.attitude import Quaternion
from diffthrust.models._craft.kinematics import QUATERNION, Kinematics
from diffthrust.models._craft.placed import place_of, place_parameters


class Sensor(Component):
    """A sensor on a `Craft`: what it reads of the motion at its place.

    A subclass names its ``outputs``, declares its parameters, and implements `read`. Readings are
    outputs of the craft behind the sensor's name: ``gps.north`` of ``gps=dft.sensors.GNSS()``. One
    whose readings depend on the axes in which they are given lists the words for these in
    ``frames``, the library's own first, and takes one as ``frame``.

    Args:
        frame: the axes of its readings; by default those of the library.
        **parameters: values by name.

    Raises:
        InputError: axes or a parameter that it does not have.

    Example:
        >>> class Log(dft.sensors.Sensor):
        ...     '''A wheel in the water, which reads the speed ahead.'''
        ...
        ...     name = "log"
        ...     outputs = {"speed": "m/s"}
        ...     scale: float = dft.parameter(1.0, bounds=(0, None), fixed=True)
        ...
        ...     def read(self, moving):
        ...         return {"speed": self.scale * moving.velocity.surge}
        >>> boat = dft.Craft(dft.bodies.Planar(), wheel=Log().at((0.2, 0, 0.1)))
        >>> list(boat.outputs)[-1], list(boat.parameters)[-4:]
        ('wheel.speed', ['wheel.scale', 'wheel.x', 'wheel.y', 'wheel.z'])
        >>> moving = dft.sensors.Kinematics(dft.bodies.Six(surge=0.5))
        >>> Log().read(moving), Log().attitude_from({"speed": 0.5})
        ({'speed': 0.5}, None)
    """

    library: ClassVar[dict[str, type[Sensor]]] = {}
    options: ClassVar[tuple[str, ...]] = ("frame",)
    outputs: ClassVar[Mapping[str, str]] = {}
    angles: ClassVar[tuple[str, ...]] = ()
    quaternions: ClassVar[tuple[tuple[str, ...], ...]] = ()
    frames: ClassVar[tuple[str, ...]] = ("",)
    placed: ClassVar[bool] = True
    """Whether it matters where on the craft it is."""

    frame: str = ""

    def __init__(self, *, frame: str = "", **parameters: float | Parameter) -> None:
        super().__init__(**parameters)
        frame = frame or self.frames[0]
        if frame not in self.frames:
            raise InputError(
                f"{type(self).__name__}: expected the axes of its readings, found {frame!r}; "
                f"{nearby(frame, self.frames)}.",
                f"Write frame={self.frames[-1]!r}, or leave it out for {self.frames[0]!r}."
                if self.frames[-1]
                else "Leave frame out: the names of its readings say their directions.",
            )
        self._set(frame=frame)

    def at(self, place: Sequence[float]) -> Mounted[Self]:
        """The sensor at a place of a craft: forward, to starboard and down of its origin [m].

        Raises:
            InputError: a place that is none.
        """
        return Mounted(self, (*place,))  # pyright: ignore[reportArgumentType]

    def read(self, moving: Kinematics) -> Mapping[str, Signal]:
        """Its readings, by name, from the motion of its place."""
        raise InputError(
            f"Sensor '{self.name}' has no readings.",
            "Define def read(self, moving): return {name: moving.velocity.surge}.",
        )

    def as_of_body(self, readings: Mapping[str, Any]) -> Mapping[str, Any]:
        """What readings say of the body's own channels, at this place; nothing by default.

        So logs can be held against the axes that are declared.

        Args:
            readings: those that a log has, by their short names, ``(n,)`` each.

        Example:
            >>> backwards = dft.sensors.DVL(frame="FLU").as_of_body({"sway": np.array([0.5])})
            >>> backwards["sway"]
            array([-0.5])
        """
        return {}

    def _telling(self, channels: Collection[str]) -> tuple[str, ...]:
        """Those of its readings from which `attitude_from` tells the attitude, at any sample."""
        return ()

    def attitude_from(self, first: Mapping[str, float]) -> Quaternion | None:
        """The attitude of the craft by first readings, from its axes to north, east, down.

        Nothing where these do not tell it.
        """
        return None


SENSORS = Sensor.library
"""The library's sensors, by name."""


class Sensors(dict[str, Mounted[Sensor]]):
    """The sensors of a craft at their places, by name."""

    def parameters(self) -> dict[str, Parameter]:
        """Their numbers, and the places of those for which these matter."""
        named: dict[str, Parameter] = {}
        for name, mounted in self.items():
            sensor = mounted.model
            named |= {f"{name}.{k}": p for k, p in sensor._parameters.items()}
            named |= place_parameters(name, mounted.place) if sensor.placed else {}
        return named

    def readings(self, moving: Kinematics, values: Mapping[str, Any]) -> dict[str, Signal]:
        """What they read while the craft moves so, by the (possibly traced) values of the craft."""
        readings = {}
        for name, mounted in self.items():
            sensor = mounted.model
            numbers = {k: values[f"{name}.{k}"] for k in sensor._parameters}
            at_place = moving.at(place_of(name, values)) if sensor.placed else moving
            read = sensor._bound(numbers).read(at_place)
            readings |= {f"{name}.{k}": v for k, v in read.items()}
        return readings

    def with_attitude(self, first: Mapping[str, Any]) -> Mapping[str, Any]:
        """First measurements, among them the quaternion that readings of a sensor tell."""
        for name, mounted in self.items():
            prefix = f"{name}."
            short = {n.removeprefix(prefix): v for n, v in first.items() if n.startswith(prefix)}
            if (q := mounted.model.attitude_from(short)) is not None:
                first = {**dict(zip(QUATERNION, q, strict=True)), **first}
        return first

    def telling(self, channels: Collection[str], least: int) -> tuple[str, ...]:
        """The channels, of one sensor and this many at least, that tell the attitude."""
        for name, mounted in self.items():
            prefix = f"{name}."
            short = [n.removeprefix(prefix) for n in channels if n.startswith(prefix)]
            read = mounted.model._telling(short)
            if len(read) >= least:
                return tuple(prefix + each for each in read)
        return ()

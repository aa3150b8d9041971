"""What a craft carries to measure with: a sensor at its place."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any, ClassVar, Self

from diffthrust._support.errors import InputError
from diffthrust._support.names import nearby
from diffthrust.models._base.component import Component
from diffthrust.models._base.mounted import Mounted
from diffthrust.models._base.parameter import Parameter
from diffthrust.models._base.signals import Signal
from diffthrust.models._craft.attitude import Quaternion
from diffthrust.models._craft.kinematics import Kinematics


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

        Example:
            >>> dft.sensors.GNSS().at((0.3, 0.0, -1.0)).place
            (0.3, 0.0, -1.0)
        """
        return Mounted(self, (*place,))  # pyright: ignore[reportArgumentType]

    def read(self, moving: Kinematics) -> Mapping[str, Signal]:
        """Its readings, by name, from the motion of its place.

        Example:
            >>> moving = dft.sensors.Kinematics(dft.bodies.Six(surge=0.5))
            >>> dft.sensors.DVL().read(moving)["surge"]
            0.5
        """
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

        Example:
            >>> dft.sensors.DVL().attitude_from({"surge": 0.5}) is None
            True
        """
        return None


SENSORS = Sensor.library
"""The library's sensors, by name."""

"""A thruster at its place on a craft."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from diffthrust._support.errors import InputError
from diffthrust._support.names import short_repr
from diffthrust.models._base.component import Component

_M = TypeVar("_M", bound=Component)
Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Mounted(Generic[_M]):
    """A model of a thruster with the place where it pushes; made by `Model.at`.

    Axes are those of the craft: x forward, y to starboard, z down, from its origin.

    Args:
        model: the thruster, or another actuator: any model with an output ``thrust`` [N].
        place: where the force acts [m].
        pointing: direction of a positive thrust, of length one.
        reaction: torque about ``pointing`` per thrust [m], which the propeller leaves on the hull;
            positive where it turns the hull clockwise, seen along ``pointing``. ``None`` for none.

    Example:
        >>> dft.Thruster().at((-0.35, 0.28, 0), pointing=(2, 0, 0)).pointing
        (1.0, 0.0, 0.0)
    """

    model: _M
    place: Vector
    pointing: Vector = (1.0, 0.0, 0.0)
    reaction: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "place", _vector("place", self.place))
        pointing = _vector("pointing", self.pointing)
        length = math.hypot(*pointing)
        if length < 1e-9:
            raise InputError(
                f"at: expected a direction for pointing, found {self.pointing!r}.",
                "Say where a positive thrust pushes: (1, 0, 0) is ahead, (0, 0, 1) down.",
            )
        # + 0.0: no minus zero, which would be another structure and another program
        unit = tuple(round(each / length, 12) + 0.0 for each in pointing)
        object.__setattr__(self, "pointing", unit)


def _vector(what: str, given: Sequence[float]) -> Vector:
    """Three numbers."""
    try:
        x, y, z = (float(each) for each in given)
    except (TypeError, ValueError):
        raise InputError(
            f"at: expected three numbers for {what}, found {short_repr(given)}.",
            "Give x forward, y to starboard and z down [m]: (-0.35, 0.28, 0).",
        ) from None
    if not all(map(math.isfinite, (x, y, z))):
        raise InputError(f"at: expected finite numbers for {what}, found {given!r}.", "Correct it.")
    return x, y, z

"""The sensors of a craft in a spec file."""

from __future__ import annotations

from diffthrust._support.errors import InputError
from diffthrust._support.names import nearby
from diffthrust.models._base.model import Model
from diffthrust.models._craft.craft import Craft
from diffthrust.sensors import SENSORS
from diffthrust.specs._parts import SensorPart


def with_sensor(model: Model, name: str, part: SensorPart) -> Craft:
    """A craft with one more of its sensors.

    Raises:
        InputError: no craft, a model of a sensor that is not known, or a place or axes of none.
    """
    if not isinstance(model, Craft):
        raise InputError(
            f"[sensors] belongs to a craft, and the model is '{model.name}'.",
            'Write model = "craft" with its body and [thrusters], or remove [sensors].',
        )
    if part.model not in SENSORS:
        raise InputError(
            f"the model {part.model!r} of a sensor is not known; {nearby(part.model, SENSORS)}.",
            "Correct the name.",
        )
    return model.with_sensors(**{name: SENSORS[part.model](frame=part.frame).at(part.at)})

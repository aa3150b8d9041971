"""The parts of a craft: what they must be, and the channels and parameters that they bring."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust.models._base.model import Model
from diffthrust.models._base.mounted import Mounted
from diffthrust.models._craft.actuators import PUSH, PUSH_WORDS, Actuators
from diffthrust.models._craft.body import Body
from diffthrust.models._craft.scope import prefixed
from diffthrust.models._craft.sensor import Sensor, Sensors


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

"""What a craft is made of, checked: a body, actuators at their places, and groups of equal ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust.models._base.model import Model
from diffthrust.models._base.mounted import Mounted
from diffthrust.models._craft.body import Body
from diffthrust.models._craft.sensor import Sensor


def groups_of(
    actuators: Mapping[str, Mounted[Model]], share: Sequence[Sequence[str]]
) -> tuple[tuple[str, ...], ...]:
    """The groups of actuators that share their numbers, each of more than one of equal models."""
    groups = tuple(tuple(group) for group in share)
    seen: set[str] = set()
    for group in groups:
        for name in group:
            if name not in actuators or name in seen:
                problem = "is in two groups" if name in seen else "is no actuator"
                raise InputError(
                    f"share: {name!r} {problem}; there are {listing(actuators)}.",
                    'Name each once: share=[("port", "starboard")].',
                )
            seen.add(name)
        kinds = {name: actuators[name].model.structure for name in group}
        for name in group:
            if kinds[name] != kinds[group[0]]:
                raise InputError(
                    f"share: expected one model for {listing(group)}, found "
                    f"{actuators[group[0]].model} and {actuators[name].model}.",
                    "Share numbers among actuators of one model only.",
                )
    return tuple(group for group in groups if len(group) > 1)


def check_body(body: object) -> None:
    """Raise `InputError` for what is no body."""
    if isinstance(body, Body):
        return
    what = f"the class {body.__name__}" if isinstance(body, type) else f"{body!r:.60}"
    raise InputError(
        f"Craft: expected a body first, found {what}.",
        "Give one of dft.bodies: dft.bodies.Planar().",
    )


def sorted_parts(
    parts: Mapping[str, Any], body: Body
) -> tuple[dict[str, Mounted[Model]], dict[str, Mounted[Sensor]]]:
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
    sensors = {n: m for n, m in mounts.items() if isinstance(m.model, Sensor)}
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

"""The channels of a craft: those of its body and, behind their names, of its actuators."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from diffthrust.models._base.model import Model
from diffthrust.models._craft.body import Body
from diffthrust.models._craft.scope import prefixed
from diffthrust.models._craft.sensor import Sensor

PUSH = "push"
"""The port of an actuator's force on the craft, which is not the net ``force`` of a body: an effect
on that, such as buoyancy, acts on no thruster."""
PUSH_WORDS = "force of the actuator along its axis [N]"


def merged_channels(
    body: Body, models: Mapping[str, Model], sensors: Mapping[str, Sensor]
) -> dict[str, Any]:
    """Inputs, states, outputs, ports and time scales of body, actuators and sensors."""
    merged: dict[str, Any] = {"inputs": {}}
    for kind in ("optional_inputs", "states", "outputs", "ports"):
        merged[kind] = dict(getattr(body, kind))
    for name, model in models.items():
        for kind in ("inputs", "optional_inputs", "states", "outputs", "ports"):
            merged[kind] |= prefixed(name, getattr(model, kind))
        merged["ports"][f"{name}.{PUSH}"] = PUSH_WORDS
    for name, sensor in sensors.items():
        merged["outputs"] |= prefixed(name, sensor.outputs)
    scales = [body.time_scales, *(model.time_scales for model in models.values())]
    # one word for all commands, where all can be given in the same units
    choices = {(m.commands, m.command) for m in models.values() if m.commands}
    commands = next(iter(choices))[0] if len(choices) == 1 else ()
    commanded = tuple(f"{n}.{c}" for n, m in models.items() for c in m.commanded)
    turning = (f"{n}.{angle}" for n, p in {**models, **sensors}.items() for angle in p.angles)
    turned = {n: part for n, part in sensors.items() if part.quaternions}
    return {
        **merged,
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

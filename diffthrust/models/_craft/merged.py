"""The channels of a craft: those of its body and, behind their names, of its actuators."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from diffthrust.models._base.model import Model
from diffthrust.models._craft.body import Body
from diffthrust.models._craft.scope import prefixed

FORCE = "force of the actuator along its axis [N]"


def merged_channels(body: Body, models: Mapping[str, Model]) -> dict[str, Any]:
    """Inputs, states, outputs, ports and time scales of the body and of all actuators."""
    merged: dict[str, Any] = {"inputs": {}}
    for kind in ("optional_inputs", "states", "outputs", "ports"):
        merged[kind] = dict(getattr(body, kind))
    for name, model in models.items():
        for kind in ("inputs", "optional_inputs", "states", "outputs", "ports"):
            merged[kind] |= prefixed(name, getattr(model, kind))
        merged["ports"][f"{name}.force"] = FORCE
    scales = [body.time_scales, *(model.time_scales for model in models.values())]
    # one word for all commands, where all can be given in the same units
    choices = {(m.commands, m.command) for m in models.values() if m.commands}
    commands = next(iter(choices))[0] if len(choices) == 1 else ()
    commanded = tuple(f"{n}.{c}" for n, m in models.items() for c in m.commanded)
    turning = (f"{n}.{angle}" for n, m in models.items() for angle in m.angles)
    return {
        **merged,
        "angles": (*body.angles, *turning),
        "time_scales": (min(s[0] for s in scales), max(s[1] for s in scales)),
        "horizon": body.horizon,
        "start_outputs": body.start_outputs,
        "commands": commands,
        "commanded": commanded if commands else (),
    }

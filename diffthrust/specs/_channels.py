"""The channels of a spec file: their roles (input or measured) and columns."""

from __future__ import annotations

from collections.abc import Mapping

from diffthrust._support.names import listing, nearest
from diffthrust.logs._columns import Column
from diffthrust.models._base.model import Model
from diffthrust.specs._file import SpecText
from diffthrust.specs._parts import ChannelPart, SpecFile


def roles_of(model: Model, file: SpecFile, source: SpecText) -> dict[str, str]:
    """The role of each channel, decided by the model."""
    needs = [name for effect in model.effects for name in effect.needs]
    inputs = {*model.inputs, *model.optional_inputs, *model.states, *needs}
    # A thruster without a command: its speed becomes an input, and only the thrust is fitted.
    undriven = bool(model.inputs) and not set(model.inputs) & set(file.channels)
    roles = {}
    for name, channel in file.channels.items():
        loc = ("channels", name)
        if name not in inputs and name not in model.outputs:
            names = (*model.inputs, *model.optional_inputs, *needs, *model.outputs)
            raise source.error(
                loc,
                f"the model '{model}' has no channel {name!r}{nearest(name, names, '; ')}.",
                "Name the column under [logs] time."
                if name == "time"
                else f"Correct the name; there are {listing(dict.fromkeys(names))}.",
            )
        driving = name in model.inputs or name in needs or name not in model.outputs
        driving = driving or (undriven and name in model.optional_inputs)
        roles[name] = channel.role or ("input" if driving else "measured")
        if name not in (inputs if roles[name] == "input" else model.outputs):
            raise source.error(
                (*loc, "role"),
                f"the model '{model}' does not {'read' if channel.role == 'input' else 'put out'} "
                f"the channel {name!r}.",
                "Remove the role.",
            )
        _check_keys(channel, roles[name], loc, source)
    _check_complete(model, roles, source)
    return roles


def _check_keys(channel: ChannelPart, role: str, loc: tuple[str, ...], source: SpecText) -> None:
    of_sensors = ("unsigned", "noise", "rails", "censored")
    kinds = {"input": "an input", "measured": "a measured channel"}
    for key in of_sensors if role == "input" else ("hold",):
        if getattr(channel, key) not in (None, False):
            opposite = "measured" if role == "input" else "input"
            raise source.error(
                (*loc, key),
                f"this channel is {kinds[role]}; {key!r} belongs to {kinds[opposite]}.",
                f'Remove {key}, or give role = "{opposite}".',
            )


def _check_complete(model: Model, roles: Mapping[str, str], source: SpecText) -> None:
    driving = [name for name, role in roles.items() if role == "input"]
    prescribed = [name for name in driving if name in model.states]
    missing = [name for name in model.inputs if name not in driving]
    if missing and not prescribed:
        name = missing[0]
        present = listing(driving) if driving else "no inputs"
        raise source.error(
            ("channels",),
            f"the model '{model}' needs the input {name!r}; given are {present}.",
            f"Add [channels.{name}] with its column.",
        )
    for effect in model.effects:
        for name in (name for name in effect.needs if name not in driving):
            raise source.error(
                ("channels",),
                f"the effect '{effect.name}' needs the input {name!r}, which has no column.",
                f"Add [channels.{name}], or leave the effect out.",
            )
    if "measured" not in roles.values():
        outputs = listing(name for name in model.outputs if name not in driving)
        raise source.error(
            ("channels",),
            f"nothing is measured; the model '{model}' puts out {outputs}.",
            "Add the channel of one of these.",
        )


def columns_of(file: SpecFile, role: str, roles: Mapping[str, str]) -> dict[str, Column]:
    """The columns of the channels of a role, "input" or "measured"."""
    return {
        name: channel.as_column() for name, channel in file.channels.items() if roles[name] == role
    }

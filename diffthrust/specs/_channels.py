"""The channels of a spec file: their roles (input or measured) and columns."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing, nearest
from diffthrust.logs._columns import Column
from diffthrust.models._base.model import Model
from diffthrust.specs._file import line_of
from diffthrust.specs._parts import ChannelPart, SpecFile


def roles_of(model: Model, file: SpecFile, text: str, path: Path) -> dict[str, str]:
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
            raise InputError(
                f"{line_of(text, path, loc)}: the model '{model}' has no channel {name!r}"
                f"{nearest(name, names, '; ')}.",
                "Name the column under [logs] time."
                if name == "time"
                else f"Correct the name; there are {listing(dict.fromkeys(names))}.",
            )
        if channel.role is None:
            driving = name in model.inputs or name in needs or name not in model.outputs
            driving = driving or (undriven and name in model.optional_inputs)
            roles[name] = "input" if driving else "measured"
        else:
            roles[name] = channel.role
            if name not in (inputs if channel.role == "input" else model.outputs):
                raise InputError(
                    f"{line_of(text, path, (*loc, 'role'))}: the model '{model}' does not "
                    f"{'read' if channel.role == 'input' else 'put out'} the channel {name!r}.",
                    "Remove the role.",
                )
        _check_keys(channel, roles[name], text, path, loc)
    _check_complete(model, roles, text, path)
    return roles


def _check_keys(
    channel: ChannelPart, role: str, text: str, path: Path, loc: tuple[str, ...]
) -> None:
    of_sensors = ("unsigned", "noise", "rails", "censored")
    for key in of_sensors if role == "input" else ("hold",):
        if getattr(channel, key) not in (None, False):
            opposite = "measured channel" if role == "input" else "input"
            kind = "an input" if role == "input" else "a measured channel"
            raise InputError(
                f"{line_of(text, path, (*loc, key))}: this channel is {kind}; {key!r} belongs to "
                f"{'an' if opposite == 'input' else 'a'} {opposite}.",
                f'Remove {key}, or give role = "{opposite.split()[0]}".',
            )


def _check_complete(model: Model, roles: Mapping[str, str], text: str, path: Path) -> None:
    driving = [name for name, role in roles.items() if role == "input"]
    prescribed = [name for name in driving if name in model.states]
    missing = [name for name in model.inputs if name not in driving]
    if missing and not prescribed:
        name = missing[0]
        raise InputError(
            f"{line_of(text, path, ('channels',))}: the model '{model}' needs the input {name!r}; "
            f"given are {listing(driving) if driving else 'no inputs'}.",
            f"Add [channels.{name}] with its column.",
        )
    for effect in model.effects:
        for name in effect.needs:
            if name not in driving:
                raise InputError(
                    f"{line_of(text, path, ('channels',))}: the effect '{effect.name}' needs the "
                    f"input {name!r}, which has no column.",
                    f"Add [channels.{name}], or leave the effect out.",
                )
    if "measured" not in roles.values():
        raise InputError(
            f"{line_of(text, path, ('channels',))}: nothing is measured; the model '{model}' puts "
            f"out {listing(name for name in model.outputs if name not in driving)}.",
            "Add the channel of one of these.",
        )


def columns_of(file: SpecFile, role: str, roles: Mapping[str, str]) -> dict[str, Column]:
    """The columns of the channels of a role, "input" or "measured"."""
    return {
        name: channel.as_column() for name, channel in file.channels.items() if roles[name] == role
    }

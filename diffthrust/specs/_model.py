"""The model that a spec file describes: its effects, the roles of its channels, its parameters."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing, nearest
from diffthrust.estimation._estimate import shown_unit
from diffthrust.logs._units import convert_scale, same_quantity, si_unit
from diffthrust.logs._written import FURTHEST, ShownUnits, Written
from diffthrust.models._base.model import Model
from diffthrust.models._base.parameter import Normal
from diffthrust.models._craft.craft import Craft
from diffthrust.simulation._commands import command_kind
from diffthrust.specs._file import SpecText
from diffthrust.specs._parts import ChannelPart, ParameterPart, SpecFile
from diffthrust.specs._scripts import check_place, effect_of, model_class, model_with
from diffthrust.specs._thrusters import channels_of, craft_of, place_of, with_sensor

_QUANTITY = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?inf)\s*(.*?)\s*")
_PER = " per "
"""As in the unit ``rad/s per full effort``: what stands below a command that has no symbol."""


def with_commands(file: SpecFile) -> SpecFile:
    """A spec of a craft with the channels that its thrusters name as columns."""
    if file.thrusters is None:
        raise InputError(
            "the model 'craft' needs thrusters, found no [thrusters].",
            'Add [thrusters] with frame = "bluerov2", or [thrusters.port] with at = [x, y, z].',
        )
    return file.model_copy(update={"channels": {**channels_of(file), **file.channels}})


def spec_model(file: SpecFile, source: SpecText, trust: Sequence[Path | str]) -> Model:
    """The model of a spec with its effects, and with the parameters as the spec has them."""
    folder = source.path.parent
    options = dict(file.options)
    if file.model == Craft.name and file.thrusters is not None:
        with source.at("thrusters"):
            model = craft_of(file.body, file.thrusters)
    else:
        with source.at("model"):
            check_place(file.model, folder, trust)
            cls = model_class(file.model, folder)
        # Channels for two thrusters leave no choice of the drive.
        if "drive" in cls.options and {"left_force", "right_force"} & set(file.channels):
            options.setdefault("drive", "twin")
        with source.at("options", *list(file.options)[:1]):
            model = model_with(cls, options)
    for name, part in file.sensors.items():
        with source.at("sensors", name):
            model = with_sensor(model, name, part)
    if "command" not in options:
        for name in (name for name in model.commanded if name in file.channels):
            with source.at(*place_of(file, name, "unit")):
                unit = si_unit(file.channels[name].as_column().kept_unit, name)
                model = model.commanded_in(command_kind(model, unit))
    with source.at("effects"):
        for entry in file.effects:
            dotted = isinstance(entry, str) and "." in entry and ":" not in entry
            model = model + (entry if dotted else effect_of(entry, folder, trust))
    written = {name: channel.as_column().written for name, channel in file.channels.items()}
    for name, settings in file.parameters.items():
        with source.at("parameters", name):
            model = model.replace({name: _fields_of(settings, name, model, written)})
    with source.at("fit", "per_log"):
        return model.replace({name: {"per_log": True} for name in file.fit.per_log})


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


def _fields_of(
    settings: ParameterPart, name: str, model: Model, written: Mapping[str, Written]
) -> dict[str, Any]:
    """The fields that `Model.replace` takes; ``written`` says how logs wrote each channel."""
    parameter = model.parameters.get(name)
    if parameter is None:  # refused by `Model.replace`, which names the nearest
        return {}
    per, shown = shown_unit(parameter, model, ShownUnits((written,)))
    read = partial(_read, unit=parameter.unit, shown=shown, scale=1 / per)
    fields: dict[str, Any] = {}
    if settings.value is not None:
        fields["value"] = read(settings.value)
    if settings.bounds is not None:
        low, high = map(read, settings.bounds)
        infinite = float("inf")
        fields["bounds"] = (None if low == -infinite else low, None if high == infinite else high)
    fields |= {
        key: getattr(settings, key)
        for key in ("fixed", "per_log", "width")
        if getattr(settings, key) is not None
    }
    if settings.prior is not None:
        fields["prior"] = Normal(read(settings.prior.mean), read(settings.prior.std))
    return fields


def _read(number: float | str, unit: str, shown: str, scale: float) -> float:
    """A number of a unit, or one with its own; ``scale`` of the unit are one of that shown."""
    if isinstance(number, str):
        return _with_unit(number, unit, shown, scale)
    if unit == "effort" and FURTHEST < abs(number) < float("inf"):
        # 25 of a dead band that reports show as 25 us would start the fit at 25 full commands.
        raise InputError(
            f"expected a share of the full command, found {number:g} times it.",
            f'Give the unit with the number: "{number:g} {shown}".'
            if shown != unit
            else "Write 0.05 for 5 %.",
        )
    return number


def _with_unit(text: str, unit: str, shown: str, scale: float) -> float:
    match = _QUANTITY.fullmatch(text)
    if match is None or not match[2]:
        raise InputError(
            f"expected a number, or a number with its unit, found {text!r}.",
            f'Write it as in "0.05 {shown}".' if shown else "Write it as in 0.05.",
        )
    number, written = float(match[1]), match[2]
    sizes = {unit: 1.0, shown: scale}
    if written in sizes:
        return number * sizes[written]
    for target in (shown, unit):
        if convert := _conversion(written, target):
            return convert(number) * sizes[target]
    units = " or ".join(f"'{u}'" for u in dict.fromkeys((shown, unit)) if u)
    raise InputError(
        f"expected a number in {units or 'no unit'}, found {text!r}.",
        f"Write it in {shown!r}, as reports do." if shown else "Leave the unit out.",
    )


def _conversion(unit: str, target: str) -> Callable[[float], float] | None:
    """How numbers in one unit become those in another, if they can."""
    (above, _, below), (wanted, _, same) = unit.partition(_PER), target.partition(_PER)
    if below != same or not same_quantity(above, wanted):
        return None
    return lambda number: convert_scale(number, above, wanted, where="")

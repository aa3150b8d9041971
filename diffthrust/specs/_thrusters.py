"""The thrusters and sensors of a craft in a spec file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing, nearby
from diffthrust._support.report import Report
from diffthrust.actuators import ACTUATORS, Azimuth, RudderPropeller
from diffthrust.bodies import BODIES
from diffthrust.layouts import layout_named
from diffthrust.models import MODELS
from diffthrust.models._base.component import Mounted
from diffthrust.models._base.model import Model
from diffthrust.models._craft.craft import Craft
from diffthrust.sensors import SENSORS
from diffthrust.specs._file import SpecText, parse_toml, read_spec_text, validated
from diffthrust.specs._parts import (
    ChannelPart,
    CraftPart,
    SensorPart,
    SpecFile,
    ThrusterPart,
    ThrustersPart,
)

STEERED = {cls.name: cls for cls in (Azimuth, RudderPropeller)}
"""Actuators around the model of a thruster, which spec files give as ``on``."""


def craft_of(body: str, thrusters: ThrustersPart) -> Craft:
    """The craft that a spec file describes."""
    if thrusters.frame:
        layout = layout_named(thrusters.frame)
        if body and body != layout.body.name:
            raise InputError(
                f"the frame '{layout.name}' is a craft of the body '{layout.body.name}', "
                f"found body = {body!r}.",
                "Leave body out, or place the thrusters one by one.",
            )
        model = model_of(thrusters.model, thrusters.on) if thrusters.model else None
        craft = layout.craft(model)
        if thrusters.columns and len(thrusters.columns) != len(craft.actuators):
            raise InputError(
                f"expected {len(craft.actuators)} columns, one for each thruster of "
                f"'{layout.name}', found {len(thrusters.columns)}.",
                f"Name them in the order of {', '.join(craft.actuators)}.",
            )
        strengths = {f"{n}.strength": {"fixed": False} for n in [*craft.actuators][1:]}
        return craft.replace(strengths)
    if not thrusters.each:
        raise InputError(
            "expected a frame or thrusters with their places in [thrusters], found none.",
            'Write frame = "bluerov2" below [thrusters], or [thrusters.port] with at = [x, y, z].',
        )
    if body not in BODIES:
        raise InputError(
            f"expected the body of the craft, found {body!r}; {nearby(body, BODIES)}.",
            'Write body = "planar" at the top of the file.',
        )
    mounts: dict[str, Any] = _mounts(thrusters)
    return Craft(BODIES[body](), share=_groups(thrusters.each), **mounts)


def channels_of(file: SpecFile) -> dict[str, ChannelPart]:
    """The channels of the thrusters' commands that ``columns`` and ``input`` give."""
    thrusters = file.thrusters
    if thrusters is None:
        return {}
    craft = craft_of(file.body, thrusters)
    inputs = dict(zip(craft.actuators, thrusters.columns, strict=False))
    inputs |= {name: part.input for name, part in thrusters.each.items() if part.input}
    shared = {key: getattr(thrusters, key) for key in ("unit", "pwm", "effort")}
    channels = {}
    for name, column in inputs.items():
        part = thrusters.each.get(name)
        of_part = {key: getattr(part, key) for key in shared} if part else {}
        fields = {key: of_part.get(key) or shared[key] for key in shared}
        kept = {key: value for key, value in fields.items() if value}
        channel = next(iter(craft.actuators[name].model.inputs))
        channels[f"{name}.{channel}"] = ChannelPart(column=column, **kept)
    return channels


def place_of(file: SpecFile, channel: str, key: str) -> tuple[str, ...]:
    """Where a spec file gives the column of a channel, or another key of it: the path of keys."""
    if channel == "time":
        return ("logs", channel, key)
    thruster, thrusters = channel.rpartition(".")[0], file.thrusters
    column = file.channels[channel].column
    if thrusters is None or not thruster:
        return ("channels", channel, key)
    if column in thrusters.columns:
        return ("thrusters", "columns" if key == "column" else key)
    part = thrusters.each.get(thruster)
    if part is None or part.input != column:
        return ("channels", channel, key)
    if key == "column":
        return ("thrusters", thruster, "input")
    return ("thrusters", thruster, key) if getattr(part, key) else ("thrusters", key)


def craft_from(path: Path | str) -> Craft:
    """The craft of a spec file, or of a file with its tables alone: thrusters, sensors, and body.

    Raises:
        InputError: the file cannot be read, or describes no craft.

    Example:
        >>> with open("boat.toml", "w") as file:
        ...     _ = file.write('thrusters = { frame = "otter" }')
        >>> list(dft.specs.craft_from("boat.toml").actuators)
        ['port', 'starboard']
    """
    return described_craft(Path(path))[0]


def described_craft(path: Path) -> tuple[Craft, Report]:
    """The craft of a file as `craft_from` reads it, and what a person is shown of it.

    Of a ready layout also where its numbers are from: of an Otter nothing said what was estimated.
    """
    text = read_spec_text(path)
    tables = parse_toml(text, path)
    described = tables.get("thrusters")
    if not isinstance(described, Mapping):
        raise InputError(
            f"{path}: expected a table [thrusters], found {listing(tables)}.",
            'Write [thrusters] with frame = "bluerov2", or [thrusters.port] with at = [x, y, z].',
        )
    parts = {name: tables[name] for name in CraftPart.model_fields if name in tables}
    part = validated(CraftPart, parts, text, path)
    source = SpecText(text, path)
    with source.at("thrusters"):
        craft = craft_of(part.body, part.thrusters)
    for name, sensor in part.sensors.items():
        with source.at("sensors", name):
            craft = with_sensor(craft, name, sensor)
    report = craft.layout_report()
    if part.thrusters.frame:
        model = next(iter(craft.actuators.values())).model if part.thrusters.model else None
        report = Report(
            *report.sections, *layout_named(part.thrusters.frame).sources(model).sections
        )
    return craft, report


def _mounts(thrusters: ThrustersPart) -> dict[str, Mounted[Model]]:
    mounts = {}
    for name, part in thrusters.each.items():
        like = thrusters.each.get(part.like, part)
        kind, on = part.model or like.model or thrusters.model, part.on or like.on
        model = model_of(kind, on, f"[thrusters.{name}]: ")
        if part.at is None:
            raise InputError(f"[thrusters.{name}] has no place.", "Add at = [x, y, z] in metres.")
        mounts[name] = model.at(part.at, part.pointing, reaction=part.reaction)
    return mounts


def _groups(each: Mapping[str, ThrusterPart]) -> list[tuple[str, ...]]:
    """Who shares numbers with whom: ``like`` names the first of a group."""
    groups: dict[str, list[str]] = {}
    for name, part in each.items():
        if part.like and (part.like not in each or each[part.like].like or part.like == name):
            raise InputError(
                f"[thrusters.{name}]: like = {part.like!r} names no thruster with numbers "
                "of its own.",
                f"Name one of {listing(n for n, p in each.items() if not p.like and n != name)}.",
            )
        groups.setdefault(part.like or name, []).append(name)
    return [(first, *(n for n in members if n != first)) for first, members in groups.items()]


def model_of(name: str, on: str = "", where: str = "") -> Model:
    """A model of a thruster by its name, on an axis or before a rudder where ``on`` is its own."""
    models: dict[str, Any] = {**MODELS, **ACTUATORS}
    name = name or "static_thruster"
    for word in (name, *([on] if on else [])):
        if word not in models:
            raise InputError(
                f"{where}the model {word!r} of a thruster is not known; {nearby(word, models)}.",
                "Correct the name.",
            )
    if name in STEERED:
        return STEERED[name](model_of(on or "static_thruster", where=where))
    return models[name]()


def with_sensor(model: Model, name: str, part: SensorPart) -> Craft:
    """A craft with one more of its sensors."""
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

"""A craft whose thrusters the settings of an autopilot tell: its channels, and its spec file."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from diffthrust._support.names import listing
from diffthrust.layouts._recorded import RecordedLayout
from diffthrust.logs._contents import Field
from diffthrust.logs._written import PWM
from diffthrust.survey._choice import Choice, Pick, Pool
from diffthrust.survey._guess import SURE, Meaning
from diffthrust.survey._values import varies

# Fields of autopilots whose axes and units are documented (north, east, down; forward, right,
# down), the best first: unit and factor. Sources: ArduPilot's log messages (libraries/AP_Logger),
# MAVLink's common messages, PX4's uORB messages.
_MEASURED: Mapping[str, tuple[tuple[str, str, float], ...]] = {
    "roll": (("ATT.Roll", "deg", 1.0), ("ATTITUDE.roll", "rad", 1.0)),
    "pitch": (("ATT.Pitch", "deg", 1.0), ("ATTITUDE.pitch", "rad", 1.0)),
    "heading": (("ATT.Yaw", "deg", 1.0), ("ATTITUDE.yaw", "rad", 1.0)),
    "qw": (("vehicle_attitude.q[0]", "", 1.0),),
    "qx": (("vehicle_attitude.q[1]", "", 1.0),),
    "qy": (("vehicle_attitude.q[2]", "", 1.0),),
    "qz": (("vehicle_attitude.q[3]", "", 1.0),),
    **{
        f"{turn}_rate": (
            (f"IMU.Gyr{axis}", "rad/s", 1.0),
            (f"ATTITUDE.{turn}speed", "rad/s", 1.0),
            (f"vehicle_angular_velocity.xyz[{k}]", "rad/s", 1.0),
        )
        for k, (turn, axis) in enumerate((("roll", "X"), ("pitch", "Y"), ("yaw", "Z")))
    },
    "north": (("LOCAL_POSITION_NED.x", "m", 1.0), ("vehicle_local_position.x", "m", 1.0)),
    "east": (("LOCAL_POSITION_NED.y", "m", 1.0), ("vehicle_local_position.y", "m", 1.0)),
    # heights are counted up
    "depth": (
        ("CTUN.Alt", "m", -1.0),
        ("BARO.Alt", "m", -1.0),
        ("VFR_HUD.alt", "m", -1.0),
        ("vehicle_local_position.z", "m", 1.0),
    ),
}
_GUESSED = ("surge", "sway", "yaw_rate", "north", "east", "heading")
"""Channels that other columns may hold, by their names."""


def craft_choice(pool: Pool, plain: Choice, layout: RecordedLayout) -> Choice:
    """The craft of an autopilot's settings; a doubt and no model where commands are missing."""
    fields = {_bare(field.name): field for field in reversed(plain.contents.fields)}
    commands = {n: _command(n, layout, fields) for n in layout.thrusters}
    inputs = {f"{n}.command": pick for n, pick in commands.items() if pick is not None}
    measured = _measured(pool, fields, layout)
    if len(inputs) < len(commands) or not measured:
        missing = [n for n, pick in commands.items() if pick is None]
        lacks = f"the commands of {listing(missing)}" if missing else "its motion"
        word = f"By the settings it is a craft ({layout.title}), but the log lacks {lacks}."
        return plain.doubted(word)
    channels = {**inputs, **measured}
    craft = replace(plain, model="craft", channels=channels, craft=layout)
    return craft.doubted(*_doubts(layout))


def _bare(name: str) -> str:
    """The name of a field without its sender, and without the number of a first instance."""
    return re.sub(r"^(?:\d+/)*(\w+)\[0\]\.", r"\1.", re.sub(r"^(?:\d+/)+", "", name))


def _command(name: str, layout: RecordedLayout, fields: Mapping[str, Field]) -> Pick | None:
    for column, pwm in layout.thrusters[name].columns:
        if column in fields:
            unit = "effort" if pwm is None else "us"
            meaning = Meaning("command", unit, pwm, sure=SURE, why="the autopilot's settings")
            return Pick(fields[column], meaning, "input")
    return None


def _measured(pool: Pool, fields: Mapping[str, Field], layout: RecordedLayout) -> dict[str, Pick]:
    """The outputs of the body that the log has, of fields that move."""
    picks = {}
    for channel in layout.body.outputs:
        found = [
            Pick(fields[name], Meaning(channel, unit, sure=SURE, scale=scale), "measured")
            for name, unit, scale in _MEASURED.get(channel, ())
            if name in fields and varies(fields[name].values)
        ]
        if found:
            picks[channel] = found[0]
        elif channel in _GUESSED and (guess := pool.pick(channel, "measured")) is not None:
            picks[channel] = guess
    if "qw" in picks:  # angles beside the quaternion would count the same sensor twice
        picks = {n: pick for n, pick in picks.items() if n not in ("roll", "pitch", "heading")}
    return picks


def _doubts(layout: RecordedLayout) -> Iterator[str]:
    for fact in layout.facts:
        if fact.mark in ("rule of thumb", "unknown"):
            what = ", ".join(f"{name} {value}" for name, value in fact.values.items())
            yield f"{what} (a {fact.mark}): {fact.source}.".replace("a unknown", "unknown")
    held = "weight" if "weight" in layout.body.declared else "m11"
    yield (
        f"Without a sensor of force a mass must be known: {held} is held at the default of the "
        f"body '{layout.body.name}', write that of yours."
    )


def craft_tables(layout: RecordedLayout, channels: Mapping[str, Pick]) -> Iterator[str]:
    """``[thrusters]`` of a spec file."""
    names = list(layout.thrusters)
    meanings = [channels[f"{name}.command"].meaning for name in names]
    common = meanings[0] if all(m.pwm == meanings[0].pwm for m in meanings) else None
    yield "[thrusters]"
    yield 'model = "static_thruster"'
    if common:
        yield from _unit(common)
    for name, meaning in zip(names, meanings, strict=True):
        thruster = layout.thrusters[name]
        yield f"[thrusters.{name}]"
        if name != names[0]:
            yield f'like = "{names[0]}"'
        yield f"at = {_numbers(thruster.place)}"
        yield f"pointing = {_numbers(thruster.pointing)}"
        if thruster.reaction is not None:
            yield f"reaction = {thruster.reaction:.6g}"
        yield f'input = "{channels[f"{name}.command"].field.name}"'
        if not common:
            yield from _unit(meaning)


def craft_parameters(layout: RecordedLayout) -> Iterator[str]:
    """``[parameters]`` of a spec file: the mass that is held, and strengths that differ."""
    held = "weight" if "weight" in layout.body.declared else "m11"
    described = layout.body.declared[held]
    yield f"{held} = {{ value = {described.value:g}, fixed = true }} # [{described.unit}]"
    for name, thruster in layout.thrusters.items():
        if thruster.strength != 1.0:
            yield f'"{name}.strength" = {thruster.strength:.6g}'


def _unit(meaning: Meaning) -> Iterator[str]:
    if meaning.pwm is None:
        yield 'unit = "effort"'
    else:
        yield f"pwm = {pwm_text(meaning.pwm)}"


def pwm_text(pwm: PWM) -> str:
    """Widths of pulses as a spec file has them."""
    reverse = "" if pwm.reverse is None else f", reverse = {pwm.reverse:g}"
    return f"{{ stop = {pwm.stop:g}, full = {pwm.full:g}{reverse} }}"


def _numbers(values: Sequence[float]) -> str:
    return f"[{', '.join(f'{value:.6g}' for value in values)}]"

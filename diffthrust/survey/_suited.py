"""Choose the model that suits a file; that of a craft the settings of an autopilot tell."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust.layouts._in_log import recorded_layout
from diffthrust.layouts._layout import RecordedLayout
from diffthrust.logs._contents import Contents
from diffthrust.logs._log import Log
from diffthrust.logs._read import read_log
from diffthrust.logs._tables.table import Field
from diffthrust.logs._units import CHANNEL_UNITS
from diffthrust.models._base.model import MODELS
from diffthrust.soundness._doubts import doubts
from diffthrust.survey._choice import Choice, Pick, Pool
from diffthrust.survey._guess import SURE, Meaning, meanings
from diffthrust.survey._values import varies
from diffthrust.survey._vehicles import MOTION, POSE, thruster_choice, vessel_choice


def choice_of(contents: Contents) -> Choice:
    """The model that suits a file: the richest whose channels are complete."""
    guesses = meanings(contents.fields, ros=contents.kind.startswith("ROS"))
    columns = tuple(map(Pick, contents.fields, guesses))
    pool = Pool(columns)
    plain = _coarse(Choice(contents, columns, time=_clock(contents, pool), doubts=contents.notes))
    try:
        layout = recorded_layout(contents.parameters)
    except InputError as error:  # settings that are wrong are no reason not to look at the rest
        layout = None
        plain = plain.doubted(f"{error.problem} Mend: {error.mend}")
    if layout is not None:
        plain = _craft(pool, plain, layout)
        if plain.model is not None:
            return plain
    # From the richest to the plainest: a vessel's log also has what a thruster needs.
    for model in (vessel_choice, thruster_choice, _axis_vehicle, _linear_sensor):
        chosen = model(pool, plain)
        if chosen is not None:
            return _untimed(chosen)
    spare = pool.picks([name for name in pool.by if name in CHANNEL_UNITS], "")
    return replace(plain, spare=spare).doubted(_no_model(pool))


def _clock(contents: Contents, pool: Pool) -> Pick | None:
    if contents.messages:
        return None
    # of a table, whose columns have one length
    picks = [p for p in pool.all("time") if np.isfinite(p.field.values).mean() > 0.5]
    return picks[0].chosen("time", picks) if picks else None


def _coarse(plain: Choice) -> Choice:
    """Treat rows as evenly spaced if many share their time stamp."""
    stamps = plain.seconds
    if stamps is None or plain.time is None:
        return plain
    later = np.flatnonzero(np.diff(stamps) > 0)
    if later.size < 2 or later.size > 0.5 * stamps.size:
        return plain
    first, last = later[0] + 1, later[-1] + 1
    # From the first change of the stamp to the last: the ticks before and after are incomplete.
    step = float(f"{(stamps[last] - stamps[first]) / (last - first):.3g}")
    name = plain.time.field.name
    word = f"The stamps of '{name}' are coarser than the rows, which are taken as evenly spaced."
    return replace(plain, step=step).doubted(word)


def _axis_vehicle(pool: Pool, plain: Choice) -> Choice | None:
    drive = pool.pick("thrust", "input") or pool.pick("command", "input")
    measured = pool.picks(("position", "velocity"), "measured")
    if "velocity" not in measured and (surge := pool.pick("surge", "measured")) is not None:
        measured["velocity"] = surge
    if not measured and (depth := pool.pick("depth", "measured")) is not None:
        measured["position"] = depth
    if drive is None or not measured or plain.static:
        return None
    if drive.meaning.quantity == "command":
        word = "A command and no force: mass and drag are then per unit of it."
        drive = _plain_command(drive).doubted(word)
    return replace(plain, model="axis_vehicle", channels={"thrust": drive, **measured})


def _plain_command(drive: Pick) -> Pick:
    """A command as plain numbers, for a model without commands: pulse widths scaled to -1 ... 1."""
    meaning = drive.meaning
    if meaning.pwm is not None:
        reach = meaning.pwm.full - meaning.pwm.stop
        return drive.meant(scale=1 / reach, offset=-meaning.pwm.stop / reach, unit="", pwm=None)
    return drive.meant(unit="", scale=meaning.scale * (0.01 if meaning.unit == "percent" else 1))


def _linear_sensor(pool: Pool, plain: Choice) -> Choice | None:
    channels = {**pool.picks(("depth",), "input"), **pool.picks(("reading",), "measured")}
    return replace(plain, model="linear_sensor", channels=channels) if len(channels) == 2 else None


def _untimed(chosen: Choice) -> Choice:
    """A table without time. For a thruster, each row is held until it settles."""
    if not chosen.static or chosen.model == "linear_sensor":
        return chosen
    word = "No column of times was found. Where the rows were sampled at a fixed rate, write it: "
    if "command" not in chosen.channels:
        return chosen.doubted(f"{word}time = 0.02 is a step in seconds.")
    held = "alpha" if chosen.model == "thruster" else "time_constant"
    word += (
        "time is their step [s]. Taken for a static table, whose rows are held for half a second "
        f"each; it does not show how fast the thruster settles: {held} is not fitted."
    )
    return replace(chosen, held=(held,)).doubted(word)


def _no_model(pool: Pool) -> str:
    driven = pool.all("command") or pool.all("thrust")
    moves = any(pool.all(q, moving=True) for q in ("speed", "thrust", *MOTION, *POSE))
    needs = {"a command or a force": driven, "a speed, a thrust or a motion": moves}
    absent = [name for name, in_file in needs.items() if not in_file]
    verb = "are" if len(absent) > 1 else "is"
    what = f": {' and '.join(absent)} {verb} missing" if absent else ""
    return f"No model suits what was recognised{what}; name the columns yourself."


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


def _craft(pool: Pool, plain: Choice, layout: RecordedLayout) -> Choice:
    """The craft of an autopilot's settings; a doubt and no model where commands are missing."""
    fields = {_bare(field.name): field for field in reversed(plain.contents.fields)}
    commands = {n: _command(n, layout, fields) for n in layout.thrusters}
    inputs = {f"{n}.command": pick for n, pick in commands.items() if pick is not None}
    measured = _outputs(pool, fields, layout)
    if len(inputs) < len(commands) or not measured:
        missing = [n for n, pick in commands.items() if pick is None]
        lacks = f"the commands of {listing(missing)}" if missing else "its motion"
        word = f"By the settings it is a craft ({layout.title}), but the log lacks {lacks}."
        return plain.doubted(word)
    craft = replace(plain, model="craft", channels={**inputs, **measured}, craft=layout)
    return craft.doubted(*_craft_doubts(layout))


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


def _outputs(pool: Pool, fields: Mapping[str, Field], layout: RecordedLayout) -> dict[str, Pick]:
    """The outputs of the body that the log has, of fields that move."""
    picks = {}
    for channel in layout.body.outputs:
        documented = (
            Pick(fields[name], Meaning(channel, unit, sure=SURE, scale=scale), "measured")
            for name, unit, scale in _MEASURED.get(channel, ())
            if name in fields and varies(fields[name].values)
        )
        guess = pool.pick(channel, "measured") if channel in _GUESSED else None
        if (pick := next(documented, guess)) is not None:
            picks[channel] = pick
    # angles beside the quaternion would count the same sensor twice
    twice = ("roll", "pitch", "heading") if "qw" in picks else ()
    return {channel: pick for channel, pick in picks.items() if channel not in twice}


def _craft_doubts(layout: RecordedLayout) -> Iterator[str]:
    for fact in layout.facts:
        if fact.mark in ("rule of thumb", "unknown"):
            what = ", ".join(f"{name} {value}" for name, value in fact.values.items())
            yield f"{what} (a {fact.mark}): {fact.source}.".replace("a unknown", "unknown")
    yield (
        f"Without a sensor of force a mass must be known: {mass_of(layout)} is held at the default "
        f"of the body '{layout.body.name}', write that of yours."
    )


def mass_of(layout: RecordedLayout) -> str:
    """The parameter of a craft's body that is held, for want of a sensor of force."""
    return "weight" if "weight" in layout.body.declared else "m11"


def doubted(choice: Choice, paths: Sequence[Path]) -> Choice:
    """Add the findings of `soundness.doubts` on the channels in some files.

    A file that cannot be read adds its error message. Only tables are checked: messages of a robot
    have separate clocks, and a fit checks them once a time base is chosen.
    """
    if choice.model is None or choice.time is None:
        return choice
    logs, unread = [], []
    for path in paths:
        try:
            logs.append(_log(choice, choice.time, path))
        except InputError as error:
            unread.append(f"{error.problem} Mend: {error.mend}")
    channel_doubts = doubts(logs, MODELS[choice.model]())
    words = (f"{doubt.channel}: {doubt.evidence} Mend: {doubt.mend}" for doubt in channel_doubts)
    return choice.doubted(*unread, *words)


def _log(choice: Choice, clock: Pick, path: Path) -> Log:
    """The chosen channels of a file."""
    columns = {name: pick.column for name, pick in choice.channels.items()}
    inputs = {n: column for n, column in columns.items() if choice.channels[n].role == "input"}
    return read_log(
        path,
        time=clock.column if choice.step is None else choice.step,
        inputs=inputs,
        measured={n: column for n, column in columns.items() if n not in inputs},
        sheet=choice.contents.sheet or None,
        interpolate_inputs=True,
    )

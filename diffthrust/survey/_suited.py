"""Choose the model that suits a file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust.layouts._in_log import recorded_layout
from diffthrust.logs._channels import CHANNELS
from diffthrust.logs._columns import Column
from diffthrust.logs._contents import Contents
from diffthrust.logs._log import Log
from diffthrust.logs._read import read_log
from diffthrust.models._base.model import MODELS
from diffthrust.soundness._doubts import doubts
from diffthrust.survey._choice import Choice, Pick, Pool
from diffthrust.survey._crafts import craft_choice
from diffthrust.survey._guess import meanings
from diffthrust.survey._values import numbers_of
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
        plain = craft_choice(pool, plain, layout)
        if plain.model is not None:
            return plain
    # From the richest to the plainest: a vessel's log also has what a thruster needs.
    for model in (vessel_choice, thruster_choice, _axis_vehicle, _linear_sensor):
        chosen = model(pool, plain)
        if chosen is not None:
            return _untimed(chosen)
    spare = pool.picks([name for name in pool.by if name in CHANNELS], "")
    return replace(plain, spare=spare).doubted(_no_model(pool))


def _clock(contents: Contents, pool: Pool) -> Pick | None:
    if contents.messages:
        return None
    rows = contents.fields[0].values.size if contents.fields else 0
    picks = [p for p in pool.all("time") if numbers_of(p.field.values).size > 0.5 * rows]
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
    candidates = {
        "position": pool.pick("position", "measured"),
        "velocity": pool.pick("velocity", "measured") or pool.pick("surge", "measured"),
    }
    if not any(candidates.values()):
        candidates = {"position": pool.pick("depth", "measured")}
    measured = {name: pick for name, pick in candidates.items() if pick is not None}
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
        offset = -meaning.pwm.stop / reach
        return drive.meant(scale=1 / reach, offset=offset, unit="", pwm=None)
    share = 0.01 if meaning.unit == "percent" else 1
    return drive.meant(unit="", scale=meaning.scale * share)


def _linear_sensor(pool: Pool, plain: Choice) -> Choice | None:
    channels = {**pool.picks(("depth",), "input"), **pool.picks(("reading",), "measured")}
    if len(channels) < 2:
        return None
    return replace(plain, model="linear_sensor", channels=channels)


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
    what = (
        f": {' and '.join(absent)} {'are' if len(absent) > 1 else 'is'} missing" if absent else ""
    )
    return f"No model suits what was recognised{what}; name the columns yourself."


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
    columns = {name: _column(pick) for name, pick in choice.channels.items()}
    inputs = [name for name, pick in choice.channels.items() if pick.role == "input"]
    return read_log(
        path,
        time=_column(clock) if choice.step is None else choice.step,
        inputs={name: columns[name] for name in inputs},
        measured={name: column for name, column in columns.items() if name not in inputs},
        sheet=choice.contents.sheet or None,
        interpolate_inputs=True,
    )


def _column(pick: Pick) -> Column:
    """The column as a spec file would describe it."""
    meaning = pick.meaning
    return Column(
        pick.field.name,
        unit=meaning.spec_unit,
        unsigned=pick.unsigned,
        scale=meaning.scale,
        offset=meaning.offset,
        pwm=meaning.pwm,
        effort=meaning.unit == "percent",
    )

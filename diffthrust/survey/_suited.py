"""Which model suits what is in a file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from diffthrust.logs._channels import CHANNELS
from diffthrust.logs._contents import Contents
from diffthrust.survey._choice import Choice, Pick, Pool
from diffthrust.survey._guess import Meaning, meanings
from diffthrust.survey._thrusters import thruster_choice
from diffthrust.survey._values import numbers_of
from diffthrust.survey._vessels import MOTION, POSE, vessel_choice


def choice_of(contents: Contents) -> Choice:
    """The model that suits the contents of a file, the richest that is complete."""
    fields = contents.fields
    found = meanings(fields, ros=contents.kind.startswith("ROS"))
    pool = Pool(fields, found)
    plain = _coarse(Choice(contents, found, time=_clock(contents, pool), doubts=contents.notes))
    for model in (vessel_choice, thruster_choice, _axis_vehicle, _linear_sensor):
        chosen = model(pool, plain)
        if chosen is not None:
            return _untimed(chosen)
    known = {name: pool.pick(name, "") for name in pool.by if name in CHANNELS}
    spare = {name: pick for name, pick in known.items() if pick is not None}
    return replace(plain, spare=spare, doubts=(*plain.doubts, _nothing(pool)))


def _clock(contents: Contents, pool: Pool) -> Pick | None:
    if contents.messages:
        return None
    rows = contents.fields[0].values.size if contents.fields else 0
    pairs = [p for p in pool.all("time") if numbers_of(p[0].values).size > 0.5 * rows]
    if not pairs:
        return None
    one, meaning = pairs[0]
    return Pick(
        one, meaning, "time", doubts=meaning.doubts, others=tuple(p[0].name for p in pairs[1:])
    )


def _coarse(plain: Choice) -> Choice:
    """Rows that share their stamps are taken as evenly spaced."""
    stamps = plain.seconds
    if stamps is None or plain.time is None:
        return plain
    later = np.flatnonzero(np.diff(stamps) > 0)
    if later.size < 2 or later.size > 0.5 * stamps.size:
        return plain
    first, last = later[0] + 1, later[-1] + 1
    step = float(f"{(stamps[last] - stamps[first]) / (last - first):.3g}")
    name = plain.time.field.name
    word = f"The stamps of '{name}' are coarser than the rows, which are taken as evenly spaced."
    return replace(plain, step=step, doubts=(*plain.doubts, word))


def _axis_vehicle(pool: Pool, plain: Choice) -> Choice | None:
    drive = pool.pick("thrust", "input") or pool.pick("command", "input")
    found = {
        "position": pool.pick("position", "measured"),
        "velocity": pool.pick("velocity", "measured") or pool.pick("surge", "measured"),
    }
    if not any(found.values()):
        found = {"position": pool.pick("depth", "measured")}
    measured = {name: pick for name, pick in found.items() if pick is not None}
    if drive is None or not measured or plain.static:
        return None
    if drive.meaning.quantity == "command":
        drive = replace(drive, meaning=_plain_command(drive.meaning))
        drive = drive.doubted("A command and no force: mass and drag are then per unit of it.")
    return replace(plain, model="axis_vehicle", channels={"thrust": drive, **measured})


def _plain_command(meaning: Meaning) -> Meaning:
    """A command as plain numbers, for a model that takes none: an effort from -1 to 1, or as is."""
    if meaning.pwm is not None:
        reach = meaning.pwm.full - meaning.pwm.stop
        scaled = replace(meaning, scale=1 / reach, offset=-meaning.pwm.stop / reach)
        return replace(scaled, unit="", pwm=None)
    return replace(
        meaning, unit="", scale=meaning.scale * (0.01 if meaning.unit == "percent" else 1)
    )


def _linear_sensor(pool: Pool, plain: Choice) -> Choice | None:
    channels = {**pool.picks(("depth",), "input"), **pool.picks(("reading",), "measured")}
    if len(channels) < 2:
        return None
    return replace(plain, model="linear_sensor", channels=channels)


def _untimed(chosen: Choice) -> Choice:
    """A table without time: of a thruster, each row is held for so long that it settles."""
    if not chosen.static or chosen.model == "linear_sensor":
        return chosen
    word = "No column of times was found. Where the rows were sampled at a fixed rate, write it: "
    if "command" not in chosen.channels:
        return replace(chosen, doubts=(*chosen.doubts, f"{word}time = 0.02 is a step in seconds."))
    held = "alpha" if chosen.model == "thruster" else "time_constant"
    word += (
        "time is their step [s]. Taken for a static table, whose rows are held for half a second "
        f"each; it tells nothing of how fast the thruster settles: {held} is not fitted."
    )
    return replace(chosen, doubts=(*chosen.doubts, word), held=(held,))


def _nothing(pool: Pool) -> str:
    known: dict[str, Callable[[], bool]] = {
        "a command or a force": lambda: bool(pool.all("command") or pool.all("thrust")),
        "a speed, a thrust or a motion": lambda: any(
            pool.all(q, moving=True) for q in ("speed", "thrust", *MOTION, *POSE)
        ),
    }
    absent = [name for name, there in known.items() if not there()]
    what = (
        f": {' and '.join(absent)} {'are' if len(absent) > 1 else 'is'} missing" if absent else ""
    )
    return f"No model suits what was recognised{what}; name the columns yourself."

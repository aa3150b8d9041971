"""Which model suits what is in a file, and which column is which of its channels."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from diffthrust.logs._channels import CHANNELS
from diffthrust.logs._contents import Contents, Field
from diffthrust.logs._units import convert, same_quantity
from diffthrust.survey._guess import LIKELY, PERHAPS, SURE, Meaning, meanings, plain_command
from diffthrust.survey._moves import correlated, difference, turning
from diffthrust.survey._values import numbers_of, one_sided, two_sided, varies

_RANK = {SURE: 0, LIKELY: 1, PERHAPS: 2}
_MOTION = ("surge", "sway", "yaw_rate")
_PLACE = ("north", "east", "heading")
_FIRMLY = 0.5
"""Correlation from which on two columns are said to move together."""


@dataclass(frozen=True)
class Pick:
    """A column chosen for a channel.

    Args:
        field: the column.
        meaning: what it is taken for.
        role: "input" or "measured".
        unsigned: it holds the size of what goes both ways.
        doubts: what else may be, one sentence each.
        others: columns that may be the channel just as well.
    """

    field: Field
    meaning: Meaning
    role: str
    unsigned: bool = False
    doubts: tuple[str, ...] = ()
    others: tuple[str, ...] = ()

    def doubted(self, *words: str) -> Pick:
        """The same with more doubts."""
        return replace(self, doubts=(*self.doubts, *words))


@dataclass(frozen=True)
class Choice:
    """The model that suits a file, and its channels.

    Args:
        contents: the file.
        meanings: what each of its fields is taken for.
        model: name of the model; None where none is suited.
        channels: the column of each channel.
        spare: columns that the model or its effects may use besides.
        time: the column of the time stamps; None in a static table, and where messages have stamps.
        step: of rows whose stamps are too coarse to tell them apart [s].
        doubts: what is to be settled by who knows, one sentence each.
        held: parameters that such a log tells nothing of.
    """

    contents: Contents
    meanings: tuple[Meaning, ...]
    model: str | None = None
    channels: Mapping[str, Pick] = field(default_factory=dict)
    spare: Mapping[str, Pick] = field(default_factory=dict)
    time: Pick | None = None
    step: float | None = None
    doubts: tuple[str, ...] = ()
    held: tuple[str, ...] = ()

    @property
    def static(self) -> bool:
        """Whether it is a table without time."""
        return self.time is None and not self.contents.messages

    @property
    def seconds(self) -> np.ndarray | None:
        """The time stamps of a table [s]; None of one without, and where messages have stamps."""
        if self.time is None:
            return None
        clock = self.time
        if self.step is not None:
            return self.step * np.arange(clock.field.values.size)
        return convert(clock.field.values, clock.meaning.unit or "s", "s", where=clock.field.name)


class _Pool:
    """The columns by quantity, the most likely first."""

    def __init__(self, fields: Sequence[Field], found: Sequence[Meaning]) -> None:
        self.by: dict[str, list[tuple[Field, Meaning]]] = {}
        for one, meaning in zip(fields, found, strict=True):
            if meaning.quantity and numbers_of(one.values).size:
                self.by.setdefault(meaning.quantity, []).append((one, meaning))
        for pairs in self.by.values():
            pairs.sort(
                key=lambda p: (not varies(p[0].values), "relative" in p[0].name, _RANK[p[1].sure])
            )

    def all(self, quantity: str, *, moving: bool = False) -> list[tuple[Field, Meaning]]:
        pairs = self.by.get(quantity, [])
        return [p for p in pairs if not moving or varies(p[0].values)]

    def pick(self, quantity: str, role: str) -> Pick | None:
        """The most likely column of a quantity; one that is measured must move."""
        pairs = self.all(quantity, moving=role == "measured")
        if not pairs:
            return None
        one, meaning = pairs[0]
        others = [other.name for other, _ in pairs[1:]]
        return Pick(one, meaning, role, doubts=meaning.doubts, others=tuple(others))

    def picks(self, quantities: Sequence[str], role: str) -> dict[str, Pick]:
        found = {name: self.pick(name, role) for name in quantities}
        return {name: pick for name, pick in found.items() if pick is not None}

    def sides(self, quantity: str) -> tuple[Pick, Pick] | None:
        """The left and the right one of a quantity."""
        found = []
        for side in ("left", "right"):
            pairs = [p for p in self.all(quantity) if p[1].side == side]
            if not pairs:
                return None
            one, meaning = pairs[0]
            found.append(Pick(one, meaning, "input", doubts=meaning.doubts))
        return found[0], found[1]


def choice_of(contents: Contents) -> Choice:
    """The model that suits the contents of a file, the richest that is complete."""
    fields = contents.fields
    found = meanings(fields, ros=contents.kind.startswith("ROS"))
    pool = _Pool(fields, found)
    plain = _coarse(Choice(contents, found, time=_clock(contents, pool), doubts=contents.notes))
    for model in (_vessel, _thruster, _axis_vehicle, _linear_sensor):
        chosen = model(pool, plain)
        if chosen is not None:
            return _untimed(chosen)
    known = {name: pool.pick(name, "") for name in pool.by if name in CHANNELS}
    spare = {name: pick for name, pick in known.items() if pick is not None}
    return replace(plain, spare=spare, doubts=(*plain.doubts, _nothing(pool)))


def _clock(contents: Contents, pool: _Pool) -> Pick | None:
    if contents.messages:
        return None
    rows = contents.fields[0].values.size if contents.fields else 0
    pairs = [p for p in pool.all("time") if numbers_of(p[0].values).size > 0.5 * rows]
    pairs.sort(key=lambda p: _RANK[p[1].sure])
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


def _vessel(pool: _Pool, plain: Choice) -> Choice | None:
    motion = pool.picks(_MOTION, "measured")
    if "surge" not in motion and (speed := pool.pick("velocity", "measured")) is not None:
        motion = {"surge": speed.doubted("Taken for the speed ahead."), **motion}
    place = pool.picks(_PLACE, "measured")
    if not motion and not place:
        return None
    turns = _turning(motion, place, plain)
    if "yaw_rate" in motion:
        motion["yaw_rate"] = _known_unit(motion["yaw_rate"], *turns)
    found = _twin(pool, motion, turns[0]) or _propeller(pool, motion)
    if found is None:
        return None
    drive, motion = found
    winds = pool.picks(("wind_speed", "wind_direction"), "input")
    arm = "lever_arm is not in a log: measure it on the vessel, and write it under [parameters]."
    return replace(
        plain,
        model="vessel",
        channels={**drive, **(motion or place)},
        spare={**(place if motion else {}), **winds},
        doubts=(*plain.doubts, arm),
    )


def _turning(
    motion: Mapping[str, Pick], place: Mapping[str, Pick], plain: Choice
) -> tuple[float, float]:
    """How firmly the heading turns at the yaw rate, and how many times as fast [rad/s]."""
    if "yaw_rate" not in motion or "heading" not in place:
        return 0.0, np.nan
    rate, heading = motion["yaw_rate"], place["heading"]
    clock = heading.field.time if plain.contents.messages else plain.seconds
    if clock is None:
        return 0.0, np.nan
    turn = 360.0 if heading.meaning.unit == "deg" else 2 * np.pi
    together, times = turning(heading.field, clock, turn, rate.field)
    return together * np.sign(rate.meaning.scale), times


def _known_unit(rate: Pick, together: float, times: float) -> Pick:
    """The yaw rate in the unit that the heading tells, where its name tells none."""
    for unit, factor in (("rad/s", 1.0), ("deg/s", np.pi / 180)):
        if abs(together) > _FIRMLY and 0.7 < abs(times) / factor < 1.4 and rate.meaning.doubts:
            told = replace(rate.meaning, unit=unit, sure=SURE, why="heading", doubts=())
            return replace(rate, meaning=told, doubts=())
    return rate


_Drive = tuple[dict[str, Pick], dict[str, Pick]]
"""What drives a vessel, and its motion."""


def _twin(pool: _Pool, motion: dict[str, Pick], turns: float) -> _Drive | None:
    """The forces or commands of two thrusters."""
    pair = pool.sides("thrust") or pool.sides("command")
    rate = motion.get("yaw_rate")
    if pair is None:
        moving = pool.all("command", moving=True)
        if len(moving) != 2 or rate is None or pool.all("speed", moving=True):
            return None
        left, right = (Pick(f, m, "input", doubts=m.doubts) for f, m in moving)
        word = "Which is left is guessed from the yaw rate: exchange the two columns if it is not."
        if _turned(left, right, rate) < 0:
            left, right = right, left
        return {"left_force": left.doubted(word), "right_force": right}, motion
    left, right = pair
    if rate is None or _turned(left, right, rate) > -_FIRMLY:
        return {"left_force": left, "right_force": right}, motion
    against = "The vessel turns to port where left exceeds right: "
    if turns > _FIRMLY:
        word = f"{against}exchanged here, as the heading turns at the yaw rate."
        return {"left_force": right.doubted(word), "right_force": left.doubted(word)}, motion
    word = f"{against}turned round by scale; it may be that left and right are exchanged."
    around = replace(rate, meaning=replace(rate.meaning, scale=-rate.meaning.scale))
    drive = {"left_force": left, "right_force": right}
    return drive, {**motion, "yaw_rate": around.doubted(word)}


def _turned(left: Pick, right: Pick, rate: Pick) -> float:
    return difference(left.field, right.field, rate.field) * float(np.sign(rate.meaning.scale))


def _propeller(pool: _Pool, motion: dict[str, Pick]) -> _Drive | None:
    drive = pool.picks(("speed", "rudder_angle"), "input")
    if len(drive) < 2:
        return None
    rudder, rate = drive["rudder_angle"], motion.get("yaw_rate")
    if rate is not None and correlated(rudder.field, rate.field) * rate.meaning.scale > _FIRMLY:
        rudder = replace(rudder, meaning=replace(rudder.meaning, scale=-rudder.meaning.scale))
        rudder = rudder.doubted(
            "Turned round by scale: here a positive angle turns to starboard, in the model to port."
        )
    return {"propeller_speed": drive["speed"], "rudder_angle": rudder}, motion


def _thruster(pool: _Pool, plain: Choice) -> Choice | None:
    measured = pool.picks(("speed", "thrust"), "measured")
    spare = pool.picks(("inflow", "supply_voltage"), "input")
    if not measured:
        return None
    commands = pool.all("command", moving=True)
    if any(meaning.effort for _, meaning in commands):
        volts = [p for p in commands if not p[1].effort]
        commands = [p for p in commands if p[1].effort]
        if volts and "supply_voltage" not in spare:
            one, meaning = volts[0]
            spare["supply_voltage"] = Pick(
                one, replace(meaning, quantity="supply_voltage"), "input"
            )
    if commands:
        chosen = _driven(pool, commands, measured)
        return replace(plain, model="thruster", channels=chosen, spare=spare)
    targets = [p for p in pool.all("set_point", moving=True) if same_quantity(p[1].unit, "rad/s")]
    if targets and "speed" in measured:
        chosen = _driven(pool, targets, measured)
        return replace(plain, model="speed_loop_thruster", channels=chosen, spare=spare)
    if len(measured) < 2:
        return None
    speed, thrust = measured["speed"], measured["thrust"]
    speed = replace(speed, role="input")
    if one_sided(speed.field.values) and not one_sided(thrust.field.values):
        if correlated(speed.field, thrust.field) < -_FIRMLY:
            speed = replace(speed, meaning=replace(speed.meaning, scale=-speed.meaning.scale))
            speed = speed.doubted(
                "It has no sign; turned round by scale, as the thrust falls where it rises."
            )
        else:
            speed = speed.doubted("It has no sign, and the thrust goes both ways: which, is open.")
    word = "No command was found: with the speed as input the thrust part alone is fitted."
    channels = {"speed": speed, "thrust": thrust}
    return replace(
        plain, model="thruster", channels=channels, spare=spare, doubts=(*plain.doubts, word)
    )


def _driven(
    pool: _Pool, commands: Sequence[tuple[Field, Meaning]], measured: Mapping[str, Pick]
) -> dict[str, Pick]:
    """The command, speed and thrust of one thruster: of several, those that move together."""
    best: tuple[float, tuple[Field, Meaning], dict[str, tuple[Field, Meaning]]] | None = None
    lead = next(iter(measured))
    for command in commands:
        for answer in pool.all(lead, moving=True):
            tied = _follows(command, answer)
            if best is None or tied > best[0] + 0.01:
                best = (tied, command, {lead: answer})
    assert best is not None
    _, command, answers = best
    for name in measured:
        if name not in answers:
            rivals = pool.all(name, moving=True)
            answers[name] = max(rivals, key=lambda rival: _follows(command, rival))
    chosen = {"command": _picked(command, "input", commands)}
    zero = command[1].pwm.stop if command[1].pwm else 0.0
    for name in ("speed", "thrust"):
        if name not in answers:
            continue
        pick = _picked(answers[name], "measured", pool.all(name, moving=True))
        both_ways = two_sided(command[0].values - zero)
        if name == "speed" and both_ways and one_sided(pick.field.values):
            word = "Never negative under a command that goes both ways: it has no sign."
            pick = replace(pick.doubted(word), unsigned=True)
        chosen[name] = pick
    if best[0] < _FIRMLY and command[0].values.size > 2:
        word = f"It hardly moves with '{command[0].name}' (correlation {best[0]:.2f})."
        chosen[lead] = chosen[lead].doubted(word)
    return chosen


def _picked(
    pair: tuple[Field, Meaning], role: str, rivals: Sequence[tuple[Field, Meaning]]
) -> Pick:
    others = tuple(rival.name for rival, _ in rivals if rival is not pair[0])
    return Pick(pair[0], pair[1], role, doubts=pair[1].doubts, others=others)


def _follows(command: tuple[Field, Meaning], answer: tuple[Field, Meaning]) -> float:
    """How firmly an answer follows a command, with the sign or without."""
    zero = command[1].pwm.stop if command[1].pwm else 0.0
    signed = correlated(command[0], answer[0], zero=zero)
    return max(abs(signed), correlated(command[0], answer[0], zero=zero, sizes=True))


def _axis_vehicle(pool: _Pool, plain: Choice) -> Choice | None:
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
        drive = replace(drive, meaning=plain_command(drive.meaning))
        drive = drive.doubted("A command and no force: mass and drag are then per unit of it.")
    return replace(plain, model="axis_vehicle", channels={"thrust": drive, **measured})


def _linear_sensor(pool: _Pool, plain: Choice) -> Choice | None:
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


def _nothing(pool: _Pool) -> str:
    known: dict[str, Callable[[], bool]] = {
        "a command or a force": lambda: bool(pool.all("command") or pool.all("thrust")),
        "a speed, a thrust or a motion": lambda: any(
            pool.all(q, moving=True) for q in ("speed", "thrust", *_MOTION, *_PLACE)
        ),
    }
    absent = [name for name, there in known.items() if not there()]
    what = (
        f": {' and '.join(absent)} {'are' if len(absent) > 1 else 'is'} missing" if absent else ""
    )
    return f"No model suits what was recognised{what}; name the columns yourself."

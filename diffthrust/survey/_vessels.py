"""Find the channels of a vessel among the columns of a file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from diffthrust.survey._choice import FIRMLY, Choice, Pick, Pool
from diffthrust.survey._guess import SURE
from diffthrust.survey._values import correlated, difference, turning

MOTION = ("surge", "sway", "yaw_rate")
POSE = ("north", "east", "heading")


def vessel_choice(pool: Pool, plain: Choice) -> Choice | None:
    """A vessel with two thrusters, or with propeller and rudder; None if neither fits."""
    motion = pool.picks(MOTION, "measured")
    if "surge" not in motion and (speed := pool.pick("velocity", "measured")) is not None:
        motion = {"surge": speed.doubted("Taken for the speed ahead."), **motion}
    place = pool.picks(POSE, "measured")
    fixes = pool.picks(("latitude", "longitude"), "measured")
    if len(fixes) == 2 and not {"north", "east"} & set(place):
        place = {"north": fixes["latitude"], "east": fixes["longitude"], **place}
    if not motion and not place:
        return None
    turns = _turning(motion, place, plain)
    if "yaw_rate" in motion:
        motion["yaw_rate"] = _unit_from_heading(motion["yaw_rate"], *turns)
    driven = _twin(pool, motion, turns[0]) or _propeller(pool, motion)
    if driven is None:
        return None
    drive, motion = driven
    winds = pool.picks(("wind_speed", "wind_direction"), "input")
    arm = "lever_arm is not in a log: measure it on the vessel, and write it under [parameters]."
    return replace(
        plain,
        model="vessel",
        channels={**drive, **(motion or place)},
        spare={**(place if motion else {}), **winds},
    ).doubted(arm)


def _turning(
    motion: Mapping[str, Pick], place: Mapping[str, Pick], plain: Choice
) -> tuple[float, float]:
    """Correlation of the heading's change with the yaw rate, and their ratio [rad/s]."""
    if "yaw_rate" not in motion or "heading" not in place:
        return 0.0, np.nan
    rate, heading = motion["yaw_rate"], place["heading"]
    clock = heading.field.time if plain.contents.messages else plain.seconds
    if clock is None:
        return 0.0, np.nan
    turn = 360.0 if heading.meaning.unit == "deg" else 2 * np.pi
    together, times = turning(heading.field, clock, turn, rate.field)
    return together * np.sign(rate.meaning.scale), times


def _unit_from_heading(rate: Pick, together: float, times: float) -> Pick:
    """Take the unit of the yaw rate from the heading if its name gives none."""
    for unit, factor in (("rad/s", 1.0), ("deg/s", np.pi / 180)):
        # The two units differ by a factor of 57: 0.7 to 1.4 leaves room for noise and a slow
        # sensor.
        if abs(together) > FIRMLY and 0.7 < abs(times) / factor < 1.4 and rate.meaning.doubts:
            return rate.meant(unit=unit, sure=SURE, why="heading", doubts=())
    return rate


_Drive = tuple[dict[str, Pick], dict[str, Pick]]
"""The drive channels of a vessel, and its motion channels."""


def _twin(pool: Pool, motion: dict[str, Pick], turns: float) -> _Drive | None:
    """The forces or commands of two thrusters."""
    pair = pool.sides("thrust") or pool.sides("command")
    rate = motion.get("yaw_rate")
    if pair is None:
        moving = pool.all("command", moving=True)
        if len(moving) != 2 or rate is None or pool.all("speed", moving=True):
            return None
        port, starboard = (pick.chosen("input") for pick in moving)
        word = "Which is left is guessed from the yaw rate: exchange the two columns if it is not."
        # More thrust to port turns a vessel to starboard, which counts positive.
        if _turning_sense(port, starboard, rate) < 0:
            port, starboard = starboard, port
        return {"left_force": port.doubted(word), "right_force": starboard}, motion
    port, starboard = pair
    if rate is None or _turning_sense(port, starboard, rate) > -FIRMLY:
        return {"left_force": port, "right_force": starboard}, motion
    against = "The vessel turns to port where left exceeds right: "
    # Heading and yaw rate agree, so the rate's sign is right, and the columns must be exchanged.
    if turns > FIRMLY:
        word = f"{against}exchanged here, as the heading turns at the yaw rate."
        return {"left_force": starboard.doubted(word), "right_force": port.doubted(word)}, motion
    word = f"{against}turned round by scale; it may be that left and right are exchanged."
    drive = {"left_force": port, "right_force": starboard}
    return drive, {**motion, "yaw_rate": rate.turned(word)}


def _turning_sense(port: Pick, starboard: Pick, rate: Pick) -> float:
    return difference(port.field, starboard.field, rate.field) * float(np.sign(rate.meaning.scale))


def _propeller(pool: Pool, motion: dict[str, Pick]) -> _Drive | None:
    drive = pool.picks(("speed", "rudder_angle"), "input")
    if len(drive) < 2:
        return None
    rudder, rate = drive["rudder_angle"], motion.get("yaw_rate")
    if rate is not None and correlated(rudder.field, rate.field) * rate.meaning.scale > FIRMLY:
        rudder = rudder.turned(
            "Turned round by scale: here a positive angle turns to starboard, in the model to port."
        )
    return {"propeller_speed": drive["speed"], "rudder_angle": rudder}, motion

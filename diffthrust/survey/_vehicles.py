"""Find the channels of a thruster, or of a vessel, among the columns of a file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from diffthrust.logs._units import same_quantity
from diffthrust.survey._choice import FIRMLY, Choice, Pick, Pool
from diffthrust.survey._guess import SURE, pulse_command
from diffthrust.survey._values import (
    correlated,
    difference,
    hardly_negative,
    numbers_of,
    one_sided,
    pulses_ahead,
    turning,
    two_sided,
)

MOTION = ("surge", "sway", "yaw_rate")
POSE = ("north", "east", "heading")


def thruster_choice(pool: Pool, plain: Choice) -> Choice | None:
    """A thruster with its command, or only thrust over speed; None if neither fits."""
    measured = pool.picks(("speed", "thrust"), "measured")
    spare = pool.picks(("inflow", "supply_voltage"), "input")
    if not measured:
        return None
    commands = pool.all("command", moving=True)
    if any(pick.meaning.effort for pick in commands):
        volts = [pick for pick in commands if not pick.meaning.effort]
        commands = [pick for pick in commands if pick.meaning.effort]
        # A log with an effort and a voltage: the voltage is that of the battery, not a second
        # command.
        if volts and "supply_voltage" not in spare:
            battery = volts[0].chosen("input").meant(quantity="supply_voltage", doubts=())
            spare["supply_voltage"] = battery
    if not commands and "speed" in measured:
        targets = pool.all("set_point", moving=True)
        commands = [target for target in targets if same_quantity(target.meaning.unit, "rad/s")]
    if commands:
        chosen = _driven(pool, commands, measured)
        meant = chosen["command"].meaning
        loop = meant.quantity == "set_point" or (meant.effort and _holds_speed(chosen))
        model = "speed_loop_thruster" if loop else "thruster"
        return replace(plain, model=model, channels=chosen, spare=spare)
    if len(measured) < 2:
        return None
    speed, thrust = replace(measured["speed"], role="input"), measured["thrust"]
    if one_sided(speed.field.values) and not one_sided(thrust.field.values):
        if correlated(speed.field, thrust.field) < -FIRMLY:
            word = "It has no sign; turned round by scale, as the thrust falls where it rises."
            speed = speed.turned(word)
        else:
            speed = speed.doubted("It has no sign, and the thrust goes both ways: which, is open.")
    word = "No command was found: with the speed as input the thrust part alone is fitted."
    channels = {"speed": speed, "thrust": thrust}
    return replace(plain, model="thruster", channels=channels, spare=spare).doubted(word)


def _driven(pool: Pool, commands: Sequence[Pick], measured: Mapping[str, Pick]) -> dict[str, Pick]:
    """Command, speed and thrust of one thruster; of several, those that move together."""
    rivals = {name: pool.all(name, moving=True) for name in measured}
    lead = next(iter(measured))
    tied, command, answers = -1.0, commands[0], {lead: rivals[lead][0]}
    for candidate in commands:
        for answer in rivals[lead]:
            # The margin keeps the first pair of equal ones (four thrusters under one command), in
            # the file's order.
            if (together := _follows(candidate, answer)) > tied + 0.01:
                tied, command, answers = together, candidate, {lead: answer}
    for name in measured:
        if name not in answers:
            answers[name] = max(rivals[name], key=lambda rival: _follows(command, rival))
    if _ahead_only(command, [*answers.values()]):
        word = ", as what is measured rises from the lowest widths on and is never negative"
        widths = pulses_ahead(command.field.values)
        command = replace(command, meaning=pulse_command(widths, word))
    chosen = {"command": command.chosen("input", commands)}
    for name in measured:
        pick = answers[name].chosen("measured", rivals[name])
        both_ways = two_sided(command.field.values - command.stop)
        if name == "speed" and both_ways and one_sided(pick.field.values):
            word = "Never negative under a command that goes both ways: it has no sign."
            pick = replace(pick.doubted(word), unsigned=True)
        chosen[name] = pick
    if tied < FIRMLY and command.field.values.size > 2:
        word = f"It hardly moves with '{command.field.name}' (correlation {tied:.2f})."
        chosen[lead] = chosen[lead].doubted(word)
    return chosen


def _ahead_only(command: Pick, answers: Sequence[Pick]) -> bool:
    """Whether pulse widths drive one way: below 1500, a larger width gives more speed.

    For a drive that goes both ways, the response is negative there, or falls if it has no sign.
    """
    values = command.field.values
    if command.meaning.pwm is None or not all(hardly_negative(a.field.values) for a in answers):
        return False
    low = np.where((values > 0) & (values < 1500), values, np.nan)
    if np.isfinite(low).sum() < 0.1 * numbers_of(values).size:
        return False
    below = replace(command.field, values=low)
    return all(correlated(below, answer.field) > FIRMLY for answer in answers)


def _holds_speed(chosen: Mapping[str, Pick]) -> bool:
    """Whether the command sets the speed (a controller) rather than the torque.

    The speed then follows the command instead of its square root; the thrust follows the square of
    the command instead of the command.
    """
    command, answer = chosen["command"], chosen.get("speed") or chosen["thrust"]
    drive = command.field.values - command.stop
    follower = answer.field
    if answer.unsigned:  # its sign is that of the drive
        ways = drive
        if follower.time is not None and command.field.time is not None:
            ways = np.interp(follower.time, command.field.time, drive)
        follower = replace(follower, values=np.abs(follower.values) * np.sign(ways))
    # In the steady state a torque u gives speed^2 ~ u and thrust ~ u, a speed loop speed ~ u and
    # thrust ~ u^2: the power that fits better decides.
    powers = (1.0, 0.5) if "speed" in chosen else (2.0, 1.0)
    laws = (np.sign(drive) * np.abs(drive) ** power for power in powers)
    held, torque = (abs(correlated(replace(command.field, values=law), follower)) for law in laws)
    return held > torque


def _follows(command: Pick, answer: Pick) -> float:
    """Correlation of a response with a command, with or without signs."""
    signed, sizes = (
        correlated(command.field, answer.field, zero=command.stop, sizes=sizes)
        for sizes in (False, True)
    )
    return max(abs(signed), sizes)


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
    together, ratio = _turning(motion, place, plain)
    if "yaw_rate" in motion:
        motion["yaw_rate"] = _unit_from_heading(motion["yaw_rate"], together, ratio)
    driven = _twin(pool, motion, together) or _propeller(pool, motion)
    if driven is None:
        return None
    drive, motion = driven
    winds = pool.picks(("wind_speed", "wind_direction"), "input")
    channels = {**drive, **(motion or place)}
    spare = {**(place if motion else {}), **winds}
    arm = "lever_arm is not in a log: measure it on the vessel, and write it under [parameters]."
    return replace(plain, model="vessel", channels=channels, spare=spare).doubted(arm)


def _turning(
    motion: Mapping[str, Pick], place: Mapping[str, Pick], plain: Choice
) -> tuple[float, float]:
    """Correlation of the heading's change with the yaw rate, and their ratio [rad/s]."""
    rate, heading = motion.get("yaw_rate"), place.get("heading")
    if rate is None or heading is None:
        return 0.0, np.nan
    clock = heading.field.time if plain.contents.messages else plain.seconds
    if clock is None:
        return 0.0, np.nan
    turn = 360.0 if heading.meaning.unit == "deg" else 2 * np.pi
    together, ratio = turning(heading.field, clock, turn, rate.field)
    return together * np.sign(rate.meaning.scale), ratio


def _unit_from_heading(rate: Pick, together: float, ratio: float) -> Pick:
    """Take the unit of the yaw rate from the heading if its name gives none."""
    for unit, factor in (("rad/s", 1.0), ("deg/s", np.pi / 180)):
        # The two units differ by a factor of 57: 0.7 to 1.4 leaves room for noise and a slow
        # sensor.
        if abs(together) > FIRMLY and 0.7 < abs(ratio) / factor < 1.4 and rate.meaning.doubts:
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
    if rate is not None and _turning_sense(port, starboard, rate) <= -FIRMLY:
        against = "The vessel turns to port where left exceeds right: "
        # Heading and yaw rate agree, so the rate's sign is right, and the columns must be
        # exchanged.
        if turns > FIRMLY:
            word = f"{against}exchanged here, as the heading turns at the yaw rate."
            port, starboard = starboard.doubted(word), port.doubted(word)
        else:
            word = f"{against}turned round by scale; it may be that left and right are exchanged."
            motion = {**motion, "yaw_rate": rate.turned(word)}
    return {"left_force": port, "right_force": starboard}, motion


def _turning_sense(port: Pick, starboard: Pick, rate: Pick) -> float:
    return difference(port.field, starboard.field, rate.field) * float(np.sign(rate.meaning.scale))


def _propeller(pool: Pool, motion: dict[str, Pick]) -> _Drive | None:
    drive = pool.picks(("speed", "rudder_angle"), "input")
    if len(drive) < 2:
        return None
    rudder, rate = drive["rudder_angle"], motion.get("yaw_rate")
    if rate is not None and correlated(rudder.field, rate.field) * rate.meaning.scale > FIRMLY:
        word = "here a positive angle turns to starboard, in the model to port."
        rudder = rudder.turned(f"Turned round by scale: {word}")
    return {"propeller_speed": drive["speed"], "rudder_angle": rudder}, motion

"""Find the channels of a thruster among the columns of a file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from diffthrust.logs._contents import Field
from diffthrust.logs._units import same_quantity
from diffthrust.survey._choice import FIRMLY, Choice, Pick, Pool
from diffthrust.survey._guess import pulse_command
from diffthrust.survey._values import (
    correlated,
    hardly_negative,
    numbers_of,
    one_sided,
    pulses_ahead,
    two_sided,
)


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
    if commands:
        chosen = _driven(pool, commands, measured)
        loop = chosen["command"].meaning.effort and _holds_speed(chosen)
        model = "speed_loop_thruster" if loop else "thruster"
        return replace(plain, model=model, channels=chosen, spare=spare)
    targets = [
        p for p in pool.all("set_point", moving=True) if same_quantity(p.meaning.unit, "rad/s")
    ]
    if targets and "speed" in measured:
        chosen = _driven(pool, targets, measured)
        return replace(plain, model="speed_loop_thruster", channels=chosen, spare=spare)
    if len(measured) < 2:
        return None
    speed, thrust = measured["speed"], measured["thrust"]
    speed = replace(speed, role="input")
    if one_sided(speed.field.values) and not one_sided(thrust.field.values):
        if correlated(speed.field, thrust.field) < -FIRMLY:
            speed = speed.turned(
                "It has no sign; turned round by scale, as the thrust falls where it rises."
            )
        else:
            speed = speed.doubted("It has no sign, and the thrust goes both ways: which, is open.")
    word = "No command was found: with the speed as input the thrust part alone is fitted."
    channels = {"speed": speed, "thrust": thrust}
    return replace(plain, model="thruster", channels=channels, spare=spare).doubted(word)


def _driven(pool: Pool, commands: Sequence[Pick], measured: Mapping[str, Pick]) -> dict[str, Pick]:
    """Command, speed and thrust of one thruster; of several, those that move together."""
    best: tuple[float, Pick, dict[str, Pick]] | None = None
    lead = next(iter(measured))
    for command in commands:
        for answer in pool.all(lead, moving=True):
            tied = _follows(command, answer)
            # The margin keeps the first pair of equal ones (four thrusters under one command), in
            # the file's order.
            if best is None or tied > best[0] + 0.01:
                best = (tied, command, {lead: answer})
    assert best is not None
    tied, command, answers = best
    for name in measured:
        if name not in answers:
            rivals = pool.all(name, moving=True)
            answers[name] = max(rivals, key=lambda rival: _follows(command, rival))
    if _ahead_only(command, [*answers.values()]):
        word = ", as what is measured rises from the lowest widths on and is never negative"
        widths = pulses_ahead(command.field.values)
        command = replace(command, meaning=pulse_command(widths, word))
    chosen = {"command": command.chosen("input", commands)}
    for name in ("speed", "thrust"):
        if name not in answers:
            continue
        pick = answers[name].chosen("measured", pool.all(name, moving=True))
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
    held, torque = (
        abs(correlated(_power(command.field, drive, power), follower))
        for power in ((1.0, 0.5) if "speed" in chosen else (2.0, 1.0))
    )
    return held > torque


def _power(field: Field, drive: np.ndarray, power: float) -> Field:
    return replace(field, values=np.sign(drive) * np.abs(drive) ** power)


def _follows(command: Pick, answer: Pick) -> float:
    """Correlation of a response with a command, with or without signs."""
    signed, sizes = (
        correlated(command.field, answer.field, zero=command.stop, sizes=sizes)
        for sizes in (False, True)
    )
    return max(abs(signed), sizes)

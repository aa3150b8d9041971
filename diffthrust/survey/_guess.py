"""Guess the meaning of a column: quantity, unit, certainty and reason."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from diffthrust.logs._tables.table import Field
from diffthrust.logs._units import same_quantity
from diffthrust.logs._written import PWM
from diffthrust.survey._names import (
    ANY_UNIT,
    UNIT_OF,
    bare_of,
    named_pwm,
    named_units,
    quantities_of,
    side_of,
    words_of,
)
from diffthrust.survey._values import (
    counts,
    increases,
    is_pwm,
    numbers_of,
    pulses,
    time_unit,
    varies,
)

SURE, LIKELY, PERHAPS = "sure", "likely", "perhaps"
_TURNS = {"heading": 6.2832, "rudder_angle": 1.571, "wind_direction": 6.2832, "yaw_rate": 3.5}
"""Largest value of an angle in radians (of a rate in rad/s)."""
_HARD_OVER = 35.0
"""Largest angle of most rudders [deg]."""
_ROW_NUMBERS = ("", "index", "row", "nr", "no", "sample", "unnamed", "unnamed 0", "0")
_COMMAND_UNITS = ("V", "mV", "percent", "us")
_BY_UNIT = {"rad/s": "speed", "N": "thrust", "V": "command", "m/s": "velocity", "s": "time"}


@dataclass(frozen=True)
class Meaning:
    """The assumed meaning of a column, and how sure it is.

    ``quantity`` is the name of a channel or another word, empty if unknown; the unit of a
    command may be "effort" or "percent". ``side`` is "left" or "right" if the name says so,
    ``why`` the evidence, ``doubts`` are other possible meanings, one sentence each.
    """

    quantity: str
    unit: str = ""
    pwm: PWM | None = None
    side: str = ""
    sure: str = PERHAPS
    why: str = ""
    doubts: tuple[str, ...] = ()
    scale: float = 1.0
    offset: float = 0.0

    @property
    def effort(self) -> bool:
        """Whether it is a command as a share of the full command."""
        return self.pwm is not None or self.unit in ("effort", "percent")

    @property
    def spec_unit(self) -> str:
        """The unit for the spec file: none for pulse widths, except those of a rudder's servo."""
        if self.pwm is None:
            return self.unit
        return "deg" if self.quantity == "rudder_angle" else ""


def meanings(fields: Sequence[Field], ros: bool = False) -> tuple[Meaning, ...]:
    """Guess the meaning of each field; axes of ROS have y and turns to port as positive."""
    # u, v and r together are the velocities of a vessel; u without v is a control signal.
    units = [(bare_of(field.name), named_units(field.name, field.unit)) for field in fields]
    names = {name for name, _ in units}
    unsaid = {name for name, spelt in units if not spelt}
    moving = {name for name, spelt in units if any(same_quantity(u, "m/s") for u in spelt)}
    vessel = {"u", "v"} <= (moving | unsaid if "r" in names else moving)
    speeds = {"u": "surge", "v": "sway"} if vessel else {}
    turned = {field.name[:-1] for field in fields if field.name.endswith(".w")}  # quaternions
    result = []
    for field in fields:
        meaning = Meaning("derived") if field.name[:-1] in turned else _meaning(field, speeds)
        if ros and meaning.quantity in ("sway", "yaw_rate"):
            doubts = (*meaning.doubts, "ROS counts it positive to port.")
            meaning = replace(meaning, scale=-1.0, doubts=doubts)
        result.append(replace(meaning, side=side_of(field.name)))
    return tuple(result)


def _meaning(field: Field, speeds: Mapping[str, str]) -> Meaning:
    words, bare = words_of(field.name), bare_of(field.name)
    if field.dates:
        formats = field.date_formats[1:]
        doubts = [f"Day and month are ambiguous: the dates may be {o!r}." for o in formats]
        return Meaning("time", "s", sure=SURE, why="dates", doubts=tuple(doubts))
    if not numbers_of(field.values).size:
        return Meaning("", why="no numbers")
    if counts(field.values) and words in _ROW_NUMBERS and field.time is None:
        return Meaning("derived", why="row numbers")
    units = named_units(field.name, field.unit)
    spellings = [words, bare]
    if field.time is None:  # the member's name in a struct
        spellings.append(words_of(field.name.rsplit(".", 1)[-1]))
    named = chain.from_iterable(map(quantities_of, dict.fromkeys(spellings)))
    for quantity in [speeds[bare]] if bare in speeds else named:
        if quantity in ANY_UNIT:
            unit = units[0] if units else "rpm" if "rpm" in words.split() else ""
            return Meaning(quantity, unit, sure=LIKELY)
        # "t" may be a thrust or a temperature: a time increases.
        if quantity == "time" and field.time is None and not increases(field.values):
            continue
        if quantity == "command":
            if not units or any(unit in _COMMAND_UNITS for unit in units):
                return _command(field.values, words, units)
            continue
        if quantity == "rudder_angle" and units in ((), ("us",)) and is_pwm(field.values):
            return _servo(field.values)
        fitting = [unit for unit in units if same_quantity(unit, UNIT_OF[quantity])]
        # A name such as "v" fits several quantities: the stated unit decides (volts, or metres a
        # second).
        if fitting or not units:
            return _named(quantity, field, fitting, short=len(bare) < 2)
    return _unnamed(field, units)


def _named(quantity: str, field: Field, units: Sequence[str], *, short: bool) -> Meaning:
    if units:
        return Meaning(quantity, units[0], sure=LIKELY if short else SURE, why="name and unit")
    largest = float(np.abs(numbers_of(field.values)).max())
    unit, why, doubt = UNIT_OF[quantity], "name", ""
    if quantity == "time":
        unit, why, doubted = time_unit(field.values)
        doubt = f"No unit is named; taken for {unit} because {why}." if doubted else ""
    elif quantity in _TURNS:
        per = "/s" if quantity == "yaw_rate" else ""
        in_degrees = largest > 1.05 * _TURNS[quantity]
        unit = f"{'deg' if in_degrees else 'rad'}{per}"
        doubt = "" if in_degrees else f"No unit is named: it may be deg{per}."
    elif quantity == "speed":
        unit, doubt = _speed_unit(words_of(field.name).split(), largest)
    elif quantity == "thrust":
        doubt = "No unit is named: it may be kgf, lbf or kN."
    elif quantity in ("latitude", "longitude"):
        unit = "deg"
    elif quantity == "supply_voltage" and largest > 1000:
        unit = "mV"
    doubts = (doubt,) if doubt else ()
    return Meaning(quantity, unit, sure=PERHAPS if short else LIKELY, why=why, doubts=doubts)


def _speed_unit(words: Sequence[str], largest: float) -> tuple[str, str]:
    """The unit of a shaft speed, from its name or else from its magnitude, and what is open."""
    if "erpm" in words:
        return "rpm", "Electrical turns: write scale = 1 / (pairs of poles)."
    if "rpm" in words or "rpms" in words:
        return "rpm", ""
    counted = words[0] == "n"  # n stands for revolutions
    # Thrusters turn at up to some 100 rev/s, 700 rad/s or 6000 rpm: what lies beyond one unit is
    # the next.
    unit = "rps" if counted and largest < 150 else "rpm" if counted or largest > 700 else "rad/s"
    alternatives = " or ".join(other for other in ("rad/s", "rpm", "rps") if other != unit)
    return unit, f"No unit is named: it may be {alternatives}."


def _command(values: np.ndarray, words: str, units: Sequence[str]) -> Meaning:
    """A command, its unit taken from the name or else from the numbers."""
    named = next((unit for unit in units if unit in _COMMAND_UNITS), "")
    largest = float(np.abs(numbers_of(values)).max())
    pulsed = is_pwm(values)
    if pulsed and named in ("", "us"):
        return pulse_command(pulses(values))
    if named and named != "us":
        return Meaning("command", named, sure=SURE, why="name and unit")
    sure, why, scale = PERHAPS, "numbers", 1.0
    # Arduino's analogWrite takes a duty of 0 to 255, and its users call it PWM.
    if named_pwm(words) and not pulsed and 1.05 < largest <= 255:
        unit, scale = "effort", 1 / 255
        doubt = "Called a pulse width, with numbers that are none: taken as counts to 255."
    elif largest <= 1.05:
        unit, sure = "effort", LIKELY
        doubt = "Nothing beyond 1: taken for a share of full drive; it may be volts."
    # Up to 60 V are common supplies of thrusters; "thr" and "duty" are shares wherever they occur.
    elif largest <= 60 and "thr" not in words and "duty" not in words:
        unit, doubt = "V", "No unit is named: taken for volts; it may be percent."
    elif largest <= 105:
        unit, doubt = "percent", "No unit is named: taken for percent of full drive."
    else:
        unit = ""
        why = "name"
        doubt = f"No unit is named, and numbers up to {largest:.4g} suggest none."
    return Meaning("command", unit, sure=sure, why=why, doubts=(doubt,), scale=scale)


def pulse_command(widths: PWM, because: str = "") -> Meaning:
    """A command in pulse widths."""
    doubt = (
        f"Pulse widths: {widths.stop:g} is taken for stop, {widths.full:g} for full ahead"
        f"{because}; your controller's settings say."
    )
    return Meaning("command", "us", widths, sure=LIKELY, why="pulse widths", doubts=(doubt,))


def _servo(values: np.ndarray) -> Meaning:
    """The angle of a rudder given as pulse widths of its servo."""
    widths = pulses(values)
    doubt = (
        f"Pulse widths of a servo: {widths.stop:g} is taken for amidships. That the rudder stands "
        f"at {_HARD_OVER:g} deg at {widths.full:g} is a guess: measure it, and correct scale."
    )
    servo = pulse_command(widths)
    return replace(servo, quantity="rudder_angle", doubts=(doubt,), scale=_HARD_OVER)


def _unnamed(field: Field, units: Sequence[str]) -> Meaning:
    """Guess from unit and numbers if the name gives no clue."""
    for unit in units:
        for standard, quantity in _BY_UNIT.items():
            if not same_quantity(unit, standard) or (
                quantity == "time" and not increases(field.values)
            ):
                continue
            if quantity == "command":
                return replace(_command(field.values, "", (unit,)), sure=PERHAPS, why="unit")
            return Meaning(quantity, unit, why="unit", doubts=("Its name says nothing.",))
    if "percent" in units:
        return replace(_command(field.values, "", units), sure=PERHAPS, why="unit")
    if (not units or "us" in units) and field.time is None:
        numbers = numbers_of(field.values)
        # Unnamed pulse widths are integers around 1500 that vary.
        if is_pwm(numbers) and varies(numbers) and np.all(numbers == np.round(numbers)):
            return replace(_command(field.values, "", ()), sure=PERHAPS)
    return Meaning("", units[0] if units else "")

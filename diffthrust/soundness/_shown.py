"""Numbers of a channel as the user's file has them."""

from __future__ import annotations

from diffthrust._support.words import number
from diffthrust.logs._log import Log
from diffthrust.logs._written import ShownUnits


def as_written(log: Log, channel: str, value: float) -> float:
    """A stored number in the unit in which the user wrote the channel."""
    return float(ShownUnits([log.written]).values(channel, value, log.units[channel]))


def width_as_written(log: Log, channel: str, width: float) -> float:
    """A difference of two stored numbers in that unit."""
    return ShownUnits([log.written]).size(channel, width, log.units[channel]).value


def value_shown(log: Log, channel: str, value: float, digits: int = 4) -> str:
    """A stored number as text, with the user's unit."""
    unit = ShownUnits([log.written]).unit(channel, log.units[channel])
    return f"{number(as_written(log, channel, value), digits)} {unit}".rstrip()


def width_shown(log: Log, channel: str, width: float) -> str:
    """A difference of two stored numbers as text, with the user's unit."""
    value, unit = ShownUnits([log.written]).size(channel, width, log.units[channel])
    return f"{number(value, 3)} {unit}".rstrip()

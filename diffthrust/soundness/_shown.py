"""Numbers of a channel as the user's file has them."""

from __future__ import annotations

from diffthrust._support.words import number
from diffthrust.logs._log import Log


def as_written(log: Log, channel: str, value: float) -> float:
    """A stored number in the unit in which the user wrote the channel."""
    way, stored = log.written.get(channel), log.units[channel]
    if way is None or not stored or not way.unit:
        return value
    return float(way.values([value], stored, f"channel {channel!r}")[0])


def width_as_written(log: Log, channel: str, width: float) -> float:
    """A difference of two stored numbers in that unit."""
    way, stored = log.written.get(channel), log.units[channel]
    if way is None or not stored or not way.unit:
        return width
    return float(way.width(width, stored, f"channel {channel!r}"))


def value_shown(log: Log, channel: str, value: float, digits: int = 4) -> str:
    """A stored number as text, with the user's unit."""
    return f"{number(as_written(log, channel, value), digits)} {_unit(log, channel)}".rstrip()


def width_shown(log: Log, channel: str, width: float) -> str:
    """A difference of two stored numbers as text, with the user's unit."""
    return f"{number(width_as_written(log, channel, width), 3)} {_unit(log, channel)}".rstrip()


def _unit(log: Log, channel: str) -> str:
    way = log.written.get(channel)
    return way.unit if way is not None and way.unit and log.units[channel] else log.units[channel]

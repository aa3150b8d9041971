"""Parse the name of a column: its words, its unit and its side."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import lru_cache

# Spellings at the end of a name or in brackets. A spelling may stand for several units ("ms" is m/s
# in speed_ms, a millisecond in time_ms): the quantity decides in `_guess`.
_SPELLINGS: dict[str, tuple[str, ...]] = {
    "rad/s": ("rad/s", "rad s", "rads", "radps", "rad per s", "rad s 1", "rad sec"),
    "deg/s": ("deg/s", "deg s", "degps", "dps", "deg per s", "deg sec"),
    "m/s": ("m/s", "m s", "mps", "ms", "m per s", "m s 1"),
    "km/h": ("km/h", "kmh", "km h", "kph"),
    "knot": ("knot", "knots", "kn", "kt", "kts"),
    "rpm": ("rpm", "rev/min", "r/min", "u/min", "1/min", "min 1"),
    "rps": ("rps", "rev/s", "rev s", "1/s"),
    "kgf": ("kgf", "kg", "kg f", "kilograms"),
    "gf": ("gf", "g", "grams", "gram"),
    "ozf": ("ozf", "oz"),
    "lbf": ("lbf", "lbs", "lb", "lb f"),
    "kN": ("kn",),
    "N": ("n", "newton", "newtons"),
    "N*m": ("nm", "n m", "n*m", "newton meters"),
    "V": ("v", "volt", "volts"),
    "mV": ("mv", "millivolt", "millivolts"),
    "A": ("a", "amp", "amps", "ampere"),
    "mA": ("ma", "milliamps"),
    "W": ("w", "watt", "watts"),
    "percent": ("%", "pct", "percent", "perc", "prozent"),
    "deg": ("deg", "degree", "degrees", "°", "degheading"),
    "rad": ("rad", "radian", "radians"),
    "us": ("us", "usec", "µs", "μs", "micros", "microseconds"),
    "ms": ("ms", "msec", "millis", "milliseconds"),
    "ns": ("ns", "nsec", "nanoseconds", "nanosec"),
    "min": ("min", "minutes"),
    "h": ("h", "hours"),
    "s": ("s", "sec", "secs", "second", "seconds"),
    "mm": ("mm",),
    "cm": ("cm",),
    "m": ("m", "meter", "meters", "metre", "metres"),
}
_UNITS: dict[str, tuple[str, ...]] = {}
for _unit, _words in _SPELLINGS.items():
    for _word in _words:
        _UNITS[_word] = (*_UNITS.get(_word, ()), _unit)

_BRACKETS = re.compile(r"[\[(]([^\])]*[^\])\d][^\])]*)[\])]\s*$")  # [0] is no unit
_SIDES = {
    "left": r"left|port|l|backbord|lhs|stb left",
    "right": r"right|starboard|stbd|r|steuerbord|rhs",
}


@lru_cache(maxsize=4096)
def words_of(name: str) -> str:
    """A name as lower-case words, without a unit in brackets.

    Example:
        >>> words_of("ESC[0].RPM"), words_of("leftThrust_kgf"), words_of("speed (rad/s)")
        ('esc 0 rpm', 'left thrust kgf', 'speed')
    """
    bracket = _BRACKETS.search(name)
    if bracket and bracket.start():
        name = name[: bracket.start()]
    # Words begin at a capital (leftThrust) and where letters meet digits (servo1_raw).
    name = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Za-z])(?=\d)|(?<=\d)(?=[A-Za-z])", " ", name)
    return " ".join(re.findall(r"[^\W_]+|%|°", name.lower()))


def named_units(name: str, file_unit: str = "") -> tuple[str, ...]:
    """The units at the end of a name, or stated in the file; several if a spelling is ambiguous.

    Args:
        name: of the column.
        file_unit: the unit stated in the file.

    Example:
        >>> named_units("thrust_kgf"), named_units("speed_ms"), named_units("t")
        (('kgf',), ('m/s', 'ms'), ())
    """
    bracket = _BRACKETS.search(name)
    for text in (file_unit, bracket[1] if bracket else ""):
        text = text.strip()
        if text:
            spelt = _UNITS.get(text.lower()) or _UNITS.get(words_of(text))
            return spelt or (text,)
    words = words_of(name.rsplit(".", 1)[-1]).split()  # a field of one letter, .x, is no unit
    return _ending(words)[1]


def bare_of(name: str) -> str:
    """The words of a name without a unit at its end.

    Example:
        >>> bare_of("u_mps"), bare_of("r [deg/s]"), bare_of("rpm")
        ('u', 'r', 'rpm')
    """
    words = words_of(name).split()
    count, _ = _ending(words)
    return " ".join(words[: len(words) - count] or words)


def _ending(words: Sequence[str]) -> tuple[int, tuple[str, ...]]:
    """The number of last words that spell a unit, and the possible units."""
    # Longest first: "rad per s" before "s". A name of one letter, t or v, is a quantity, not a
    # unit.
    for count in (3, 2, 1):
        if len(words) > count or (len(words) == count == 1 and len(words[0]) > 1):
            units = _UNITS.get(" ".join(words[-count:]))
            if units:
                return count, units
    return 0, ()


def side_of(name: str) -> str:
    """Side of a name: "left", "right" or empty.

    Example:
        >>> side_of("thr_left"), side_of("PortThrust"), side_of("rpm")
        ('left', 'left', '')
    """
    words = f" {words_of(name)} "
    for side, pattern in _SIDES.items():
        if re.search(rf" ({pattern}) ", words):
            return side
    return ""

"""Units of the standard channels, one each inside the library, and conversion to and from them."""

import math
import re
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from diffthrust._support.errors import InputError, Place
from diffthrust._support.names import nearest

CHANNEL_UNITS = {
    "command": "V",  # to the motor controller
    "speed": "rad/s",  # of the propeller shaft
    "thrust": "N",
    "inflow": "m/s",  # of the water that reaches the propeller
    "flow": "m/s",  # of the water that leaves the duct
    "supply_voltage": "V",
    "torque": "N m",  # on the propeller shaft
    "current": "A",
    "propeller_speed": "rev/s",
    "rudder_angle": "rad",  # of the rudder or of a steerable propeller
    "left_force": "N",  # of the port thruster
    "right_force": "N",  # of the starboard thruster
    "wind_speed": "m/s",
    "wind_direction": "rad",
    "surge": "m/s",  # forward
    "sway": "m/s",  # to starboard
    "yaw_rate": "rad/s",  # positive to starboard
    "north": "m",
    "east": "m",
    "heading": "rad",  # positive clockwise from north
    "position": "m",  # along one axis
    "velocity": "m/s",  # along one axis
}
"""The unit of each standard channel; a user's own model may have other channels."""

_FACTORS: dict[str, dict[str, float]] = {
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0, "h": 3600.0},
    "m": {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "km": 1e3},
    "m/s": {"m/s": 1.0, "km/h": 1 / 3.6, "knot": 1852 / 3600},
    "m/s^2": {"m/s^2": 1.0},
    "rad": {"rad": 1.0, "deg": math.pi / 180, "rev": 2 * math.pi},
    "rad/s": {
        "rad/s": 1.0, "deg/s": math.pi / 180, "rpm": math.pi / 30, "rev/min": math.pi / 30,
        "rev/s": 2 * math.pi,
    },
    "N": {"N": 1.0, "kN": 1e3, "kgf": 9.80665, "lbf": 4.4482216152605},
    "N*m": {"N*m": 1.0, "N m": 1.0, "kN*m": 1e3},
    "V": {"V": 1.0, "mV": 1e-3},
    "A": {"A": 1.0, "mA": 1e-3},
    "W": {"W": 1.0},
    "Pa": {"Pa": 1.0, "kPa": 1e3, "bar": 1e5},
    "kg": {"kg": 1.0, "g": 1e-3},
    "effort": {"effort": 1.0},
}  # fmt: skip
"""By SI unit what one of each common unit is in it. Logs in these are read without pint, whose
loading took an eighth of a small fit; tests hold the numbers to pint's."""
_IN_SI = {unit: (si, factor) for si, units in _FACTORS.items() for unit, factor in units.items()}
_COMMON = (*_IN_SI, "rps", "kg*m^2", "K", "degC", "percent", "dimensionless")
"""Offered first for a misspelt unit, before one of pint's thousand exotic ones."""
_NAMED_SI = (
    "s", "m", "kg", "rad", "rad/s", "rad/s^2", "m/s", "m/s^2", "N", "N*m", "V", "A", "W", "Pa", "K",
    "effort",
)  # fmt: skip
"""Coherent SI units with special names, to write 'N' and not 'kg*m/s**2'."""

# Unit strings reach pint's expression evaluator, which would compute 9**9**9 for a very long time.
_ALLOWED = re.compile(r"[\w%°·⋅*/^(). +\-²³¹⁻⁰Ωμµ]{1,80}")
_NUMBER = re.compile(
    r"(\^|\*\*)?\s*\(?\s*[+\-]?(?<![A-Za-z_\d])(\d+\.?\d*|\.\d+)\s*\)?\s*(\^|\*\*)?"
)


def is_finite(value: object) -> bool:
    """Whether a value is a finite number."""
    return isinstance(value, (int, float, np.number)) and math.isfinite(value)


@lru_cache(maxsize=1)
def _registry() -> Any:
    import pint  # late: it takes a third of a second

    registry = pint.UnitRegistry()
    registry.define("@alias turn = rev = revs")
    registry.define("@alias revolutions_per_minute = RPM")
    registry.define("@alias knot = kts")
    registry.define("@alias percent = pct")
    # Without this line pint reads 'Nm' as the metric count of a yarn.
    registry.define("newton_meter = newton * meter = Nm")
    # a share of the full command: its own dimension, being neither a voltage nor a speed
    registry.define("effort = [effort]")
    return registry


@lru_cache(maxsize=256)  # whether names of columns are units is asked at each reading
def _mend_unknown(word: str) -> str:
    if word.lower() in set(_registry()):  # 'Volt': only the case is wrong
        near = f"; the nearest is {word.lower()!r}"
    else:
        near = nearest(word, _COMMON, "; ") or nearest(word, _registry(), "; ")
    return f"write a unit such as 'rad/s', 'rpm', 'N' or 'ms'{near}."


@lru_cache(maxsize=256)
def _parse(unit: str) -> Any:
    """Parse one unit; raises InputError without a place, which the caller adds."""
    text = unit.strip() or "dimensionless"
    allowed = _ALLOWED.fullmatch(text) is not None
    # A tower of powers, 9^9^9, would be computed digit by digit; 12 suffices for any physical
    # power.
    for power, number, tower in _NUMBER.findall(text):
        small = float(number) <= 12 if power else float(number) == 1
        allowed = allowed and small and not tower
    if not allowed:
        raise InputError(f"{unit!r} is not a unit", _mend_unknown(text[:80]))
    if text == "1":
        text = "dimensionless"
    try:
        parsed = _registry().Unit(text.replace("·", "*").replace("⋅", "*"))
        _base(parsed)
        hash(parsed.dimensionality)  # some products parse and then have no dimension
        return parsed
    except Exception as error:  # pint raises a dozen kinds for text that is not a unit
        names = getattr(error, "unit_names", None)
        word = names if isinstance(names, str) else names[0] if names else text
        raise InputError(f"{unit!r} is not a known unit", _mend_unknown(str(word))) from None


def _unit_error(where: Place | str, problem: str, mend: str) -> InputError:
    """The error for a unit that is to blame, not the numbers."""
    place = replace(where, unit=True) if isinstance(where, Place) else where
    return InputError.at(place, problem, mend)


def _parsed(unit: str, where: Place | str) -> Any:
    if not isinstance(unit, str):
        problem = f"expected a unit as text, found {unit!r}."
        raise _unit_error(where, problem, "write it as in unit = 'rpm'.")
    try:
        return _parse(unit)
    except InputError as error:
        raise InputError.at(where, f"{error.problem}.", error.mend) from None


_WRITTEN = re.compile(r"[\[(<{]\s*([^\[\](){}<>]+?)\s*[\])>}]\s*$|\s/\s*([^\s/]+)$")
_LETTER = re.compile(r"[^\W\d_]|[%°]")
_SPELT = {
    "1/min": "rpm", "min-1": "rpm", "min^-1": "rpm", "u/min": "rpm", "r/min": "rpm",
    "µs": "us", "μs": "us", "µsec": "us", "usec": "us", "msec": "ms", "°": "deg", "°/s": "deg/s",
    "°c": "degC", "%": "percent", "d": "day", "kg f": "kgf", "amps": "A", "lbs": "lbf",
}  # fmt: skip


def unit_in(header: str) -> str:
    """The unit in a header: ``speed (rpm)``, ``speed [rpm]``, ``speed / rpm``; empty where none."""
    match = _WRITTEN.search(header)
    if match is None:
        return ""
    text = match[1] or match[2]
    # "thrust (filtered twice)", "motor (2)", "-0.051": a remark or a number.
    if len(text) > 12 or not _LETTER.search(text):
        return ""
    for spelling in (_SPELT.get(text.lower(), text), text.lower()):
        with suppress(InputError):
            _parse(spelling)
            return spelling
    return ""


def is_common(text: str) -> bool:
    """Whether a word is one of the common units, as written or in small letters."""
    return text in _IN_SI or text.lower() in _IN_SI


def _in_si(unit: Any) -> tuple[str, float] | None:
    """The SI unit of a common unit, and what one is in it; of no text, none."""
    return _IN_SI.get(unit) if isinstance(unit, str) else None


def same_unit(first: str, second: str) -> bool:
    """Whether two spellings mean the same unit; an unknown unit equals none."""
    try:
        return bool(first and second) and bool(_parse(first) == _parse(second))
    except InputError:
        return False


@lru_cache(maxsize=256)
def _base(unit: Any) -> tuple[Any, int]:
    """The SI base unit, and the power of the angle in it (pint counts an angle as a number)."""
    base = _registry().get_base_units(unit)[1]
    return base, dict(base._units).get("radian", 0)


def _check_same(unit_from: str, unit_to: str, where: Place | str) -> None:
    """Raise InputError unless the two units measure the same quantity."""
    source, target = _parsed(unit_from, where), _parsed(unit_to, where)
    if source.dimensionality != target.dimensionality:
        raise _unit_error(
            where,
            f"expected a unit that agrees with {unit_to!r} ({_dimension(target)}), "
            f"found {unit_from!r} ({_dimension(source)}).",
            f"give the unit in which the numbers are written, of the same kind as {unit_to!r}, "
            f"or choose another column.{_effort_hint(source)}",
        )
    if set(source.dimensionality) <= {"[time]"} and _base(source)[1] != _base(target)[1]:
        # pint takes 1 Hz for 1 rad/s, which is wrong by 2 pi for whoever means turns.
        if source.dimensionless:
            problem, mend = "one is an angle and the other a plain number", "write 'rad' or 'deg'."
        else:
            problem = "only one of them counts an angle, so turns or radians is undecided"
            mend = "write 'rev/s' or 'rad/s' (or 'rpm', 'deg/s') for a speed of rotation."
        problem = f"the unit {unit_from!r} is ambiguous where {unit_to!r} is expected: {problem}."
        raise InputError.at(where, problem, mend)


def _effort_hint(source: Any) -> str:
    """An extra hint where the unit looks like that of a vehicle's command."""
    if dict(source.dimensionality) == {"[time]": 1}:
        return " Widths of pulses are declared by pwm = {'stop': 1500, 'full': 1900}."
    if source.dimensionless and not _base(source)[1]:
        return " A share of the full command is declared by effort = True."
    return ""


def _dimension(unit: Any) -> str:
    text = str(unit.dimensionality)
    if text == "dimensionless":
        return "an angle" if _base(unit)[1] else "a plain number"
    return text


def same_quantity(unit: str, target: str) -> bool:
    """Whether numbers in one unit can be converted to another."""
    if unit == target and unit in _COMMON:  # without pint, as in `convert`
        return True
    if (source := _in_si(unit)) and (other := _in_si(target)):
        return source[0] == other[0]
    try:
        _check_same(unit, target, "")
    except InputError:
        return False
    return True


def convert(values: ArrayLike, unit_from: str, unit_to: str, *, where: Place | str) -> np.ndarray:
    """Convert numbers of any shape to a new float64 array; ``where`` is for messages."""
    numbers = np.array(values, dtype=np.float64)
    if unit_from == unit_to and unit_from in _COMMON:
        return numbers
    if (source := _in_si(unit_from)) and (target := _in_si(unit_to)) and source[0] == target[0]:
        with np.errstate(all="ignore"):  # an overflow gives inf, which the log refuses by name
            return np.asarray(numbers * (source[1] / target[1]))
    _check_same(unit_from, unit_to, where)
    try:
        with np.errstate(all="ignore"):
            return np.asarray(
                _registry().convert(numbers, _parse(unit_from), _parse(unit_to)), dtype=np.float64
            )
    except Exception as error:  # offset and logarithmic units in a product
        problem = f"numbers in {unit_from!r} cannot be converted to {unit_to!r} ({error})."
        mend = "write the log in a plain unit."
        raise InputError.at(where, problem, mend) from None


def convert_scale(value: float, unit_from: str, unit_to: str, *, where: Place | str) -> float:
    """Convert a difference, such as a standard deviation: offsets of units cancel."""
    scaled, zero = convert([1.0, 0.0], unit_from, unit_to, where=where)
    return float(value * (scaled - zero))


def si_unit(unit: str, channel: str = "", where: Place | str = "") -> str:
    """The unit in which the library keeps numbers given in ``unit``; empty where none is given.

    A standard channel keeps its own unit where that measures the same quantity: ``propeller_speed``
    stays in rev/s.

    Example:
        >>> si_unit("rpm", "speed"), si_unit("kN"), si_unit("rpm", "propeller_speed")
        ('rad/s', 'N', 'rev/s')
    """
    if unit == "":
        return ""
    where = where or (f"channel {channel!r}" if channel else "the unit")
    standard = CHANNEL_UNITS.get(channel)
    if unit == standard:
        return unit
    if (common := _in_si(unit)) and (standard is None or standard in _IN_SI):
        si = common[0]
        return standard if standard is not None and _IN_SI[standard][0] == si else si
    parsed = _parsed(unit, where)
    if standard is not None and parsed.dimensionality == _parse(standard).dimensionality:
        _check_same(unit, standard, where)
        return standard
    base, angle = _base(parsed)
    for name in _NAMED_SI:
        candidate = _base(_parse(name))
        if candidate[0].dimensionality == base.dimensionality and candidate[1] == angle:
            return name
    return f"{base:~C}" or "dimensionless"


_WRITTEN_FIRST = ("effort", "kg", "kgf", "N", "V", "A", "W", "Pa", "m", "rad", "s")


def product_unit(*powers: tuple[str, int]) -> str:
    """The unit of a product of powers; "" for a pure number, or if a factor is not a unit.

    Example:
        >>> product_unit(("rad/s^2", 1), ("rad/s", -2))
        '1/rad'
        >>> product_unit(("N*m", 1), ("rad/s", -1))
        'N m s/rad'
    """
    try:
        product = _parse("")
        for unit, power in powers:
            product = product * _parse(unit) ** power
    except InputError:
        return ""
    over, under = [], []
    for factor in f"{product:~C}".replace("**", "^").split("/"):
        (under if over else over).extend(factor.split("*"))
    over, under = (sorted(factors, key=_place_in_product) for factors in (over, under))
    top = " ".join(over).replace("dimensionless", "")
    bottom = " ".join(under)
    return f"{top}/{bottom if len(under) < 2 else f'({bottom})'}" if under else top


def _place_in_product(factor: str) -> int:
    """Where a factor of a unit is written: "N m s", where "m N s" reads as a millinewton."""
    name = factor.partition("^")[0]
    return _WRITTEN_FIRST.index(name) if name in _WRITTEN_FIRST else len(_WRITTEN_FIRST)

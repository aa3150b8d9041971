"""The names of columns: their words, units and sides, and the quantities that they may mean."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from functools import lru_cache

from diffthrust.logs._units import CHANNEL_UNITS

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
    """A name as lower-case words, without a unit in brackets."""
    bracket = _BRACKETS.search(name)
    if bracket and bracket.start():
        name = name[: bracket.start()]
    # Words begin at a capital (leftThrust) and where letters meet digits (servo1_raw).
    name = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Za-z])(?=\d)|(?<=\d)(?=[A-Za-z])", " ", name)
    return " ".join(re.findall(r"[^\W_]+|%|°", name.lower()))


def named_units(name: str, file_unit: str = "") -> tuple[str, ...]:
    """The units at the end of a name, or as the file states; several if a spelling is ambiguous."""
    bracket = _BRACKETS.search(name)
    for text in (file_unit, bracket[1] if bracket else ""):
        text = text.strip()
        if text:
            spelt = _UNITS.get(text.lower()) or _UNITS.get(words_of(text))
            return spelt or (text,)
    words = words_of(name.rsplit(".", 1)[-1]).split()  # a field of one letter, .x, is no unit
    return _ending(words)[1]


def bare_of(name: str) -> str:
    """The words of a name without a unit at its end."""
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
    """Side of a name: "left", "right" or empty."""
    words = f" {words_of(name)} "
    sides = (side for side, pattern in _SIDES.items() if re.search(rf" ({pattern}) ", words))
    return next(sides, "")


UNIT_OF: dict[str, str] = {
    **CHANNEL_UNITS,
    "time": "s",
    "latitude": "rad",
    "longitude": "rad",
    "depth": "m",
    "reading": "V",
    "power": "W",
}
"""The unit of each quantity, by the name of its channel if it has one."""

NO_CHANNEL = ("set_point", "derived", "latitude", "longitude", "power")
"""Quantities that are reported but not used."""

ANY_UNIT = ("set_point", "derived")
"""Those of them whose unit does not matter."""
_SCREW = r"(prop|propeller|shaft|motor|rotor|esc|engine)( \d+)?"
_PWM_WORDS = (
    r"\b(pwm|pulse ?width|rcou|rcout)\b|\bservo \d+ raw\b|\bservo raw\b|\bactuator outputs output\b"
)
# The order decides: the first matching rule gives the quantity, so that exceptions stand before
# general words ("desired speed", "speed error" and "yaw speed" before "speed").
_RULES: tuple[tuple[str, str], ...] = (
    (
        "time",
        r"^((current|original|system|log|header|sample|gps|unix|ros|rel|abs|elapsed|mission) )?"
        r"(t|time|times|timestamps?|stamps?|zeit|clock|date ?time|date|elapsed|sec|secs|seconds|"
        r"millis|micros|epoch|utc)\b",
    ),
    ("derived", r"^(prev|previous|observer) "),  # as it was, and where someone else stands
    ("set_point", r"\b(demand|desired|des|ref|reference|set ?points?|sp|target|goal|soll)\b"),
    ("set_point", r"\b(rpm|omega|speed|n) (cmd|command|commanded|set)\b"),
    ("set_point", r"\b(cmd|command|commanded|set) (rpm|omega|speed|n)\b"),
    ("set_point", r"\b(cmd vel|rcin|rc channels|manual control|chan \d+ raw)\b"),
    ("derived", r"\b(bias|zero|trim|errors?|err|std|sigma|var|variance|cov|covariance|limit)\b"),
    ("derived", r"\b(status|flags?|id|ids|seq|count|counter|index|idx|mode|quality|health)$"),
    ("derived", r"\b(temp|temperature|pressure|press|baro|alt|altitude|roll|pitch|mag)\b"),
    (
        "yaw_rate",
        r"\b(yaw ?(rate|speed|vel|velocity|dot)|psi dot|r ang ?vel(o|ocity)?|(gyro?|g) z|z gyro|"
        r"gyro xyz 2|angular( velocity)? z|w z|omega z|wz|heading rate|turn rate|rate of turn|rot|"
        r"angular velocity xyz 2|r (rad|deg))\b|^r$",
    ),
    (
        "derived",
        r"\b(linear z|angular [xy]|xyz [01]|gyro? [xy]|v ?z|orientation|quaternion|q [wxyz])\b",
    ),
    ("derived", r"\b(dot|acc|accel|acceleration|jerk|delta v|local position v[xyz]?)\b"),
    ("supply_voltage", r"\b(bat|batt|battery|supply|bus|pack)\b.*\b(volts?|voltage|v|u)\b"),
    ("supply_voltage", r"\b(v ?(bat|batt|supply|bus|cc|in|dc)|u (bat|batt|supply|dc))\b"),
    ("current", r"\b(current|curr|amps?|amperage|strom|i)\b"),
    ("power", r"\b(power|watts?|leistung)\b"),
    ("torque", r"\b(torque|moment|tau|q motor)\b"),
    ("wind_direction", r"\bwind\b.*\b(dir|direction|angle|heading|from)\b"),
    ("wind_speed", r"\bwind\b"),
    ("rudder_angle", r"\b(rudder|delta|steer|steering|azimuth|nozzle|helm|ruder)\b"),
    ("heading", r"\b(heading|yaw|psi|hdg|compass)\b"),
    ("latitude", r"\b(lat|latitude)\b"),
    ("longitude", r"\b(lon|lng|long|longitude)\b"),
    ("command", _PWM_WORDS),
    ("east", r"\bpose position x\b"),  # ROS: x is east, y is north
    ("north", r"\bpose position y\b"),
    ("north", r"\b(north|northing|x ned|ned x|pn|x pos(ition)?|pos(ition)? x)\b|^x$"),
    ("east", r"\b(east|easting|y ned|ned y|pe|y pos(ition)?|pos(ition)? y)\b|^y$"),
    (
        "surge",
        r"\b(surge|u (velo?|velocity|speed|body|m s)|linear x|body v ?x|v ?x|vel(ocity)? x|"
        r"(forward|fwd|boat|ground) ?(speed|velocity|vel)|sog|speed over ground|gps( \d+)? spd)\b",
    ),
    ("sway", r"\b(sway|vm|v (velo?|velocity|body)|linear y|body v ?y|v ?y|vel(ocity)? y)\b"),
    ("inflow", r"\b(inflow|flow|water (speed|velocity|current)|current|stw|advance)\b"),
    ("depth", r"\b(depth|tiefe)\b|^z$"),
    (
        "speed",
        rf"\b(rpms?|erpm|tacho?|tachometer|omega|ω|spin|revs?|drehzahl|n prop|"
        rf"{_SCREW} (speed|n|vel)|(rotational|angular|rotation) (speed|velocity)|shaft)\b|"
        r"^(n|w|n \d|w \d)$",
    ),
    ("reading", r"\b(reading|sensor (out|output|voltage|v))\b"),
    ("command", r"\b(cmd|command|commanded|throttle|thr|thro|duty|effort|ctrl|control)\b"),
    ("thrust", r"\b(thrusts?|forces?|load ?cell|fx|f x|schub|bollard|pull)\b|^(f|f \d)$"),
    (
        "command",
        r"\b(u|input|signal|drive|motors?|engine|esc|volts?|voltage|power|actuator|out|output|thrusters?|"
        r"stell\w*)\b",
    ),
    ("speed", r"\bspeed\b"),
    ("velocity", r"\b(velocity|vel|velo|speed|v)\b"),
    ("position", r"\b(position|pos|displacement|q)\b"),
)
_COMPILED = tuple((quantity, re.compile(pattern)) for quantity, pattern in _RULES)


def quantities_of(words: str) -> Iterator[str]:
    """The quantities that the words of a name may mean, the most likely first."""
    return (quantity for quantity, pattern in _COMPILED if pattern.search(words))


def named_pwm(words: str) -> bool:
    """Whether a name means pulse widths."""
    return re.search(_PWM_WORDS, words) is not None

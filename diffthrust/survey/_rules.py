"""Words in column names, and the quantities they stand for."""

from __future__ import annotations

import re
from collections.abc import Iterator

from diffthrust.logs._channels import CHANNELS

UNIT_OF: dict[str, str] = {
    **{name: channel.unit for name, channel in CHANNELS.items()},
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

_ANY_UNIT = ("set_point", "derived")
_SCREW = r"(prop|propeller|shaft|motor|rotor|esc|engine)( \d+)?"
_PWM_WORDS = (
    r"\b(pwm|pulse ?width|rcou|rcout)\b|\bservo \d+ raw\b|\bservo raw\b|\bactuator outputs output\b"
)
# The order decides: the first matching rule gives the quantity, so that exceptions stand before
# general words ("desired speed", "speed error" and "yaw speed" before "speed").
_RULES: tuple[tuple[str, str], ...] = (
    (
        "time",
        r"^((original|system|log|header|sample|gps|unix|ros|rel|abs|elapsed|mission) )?"
        r"(t|time|times|timestamps?|stamps?|zeit|clock|date ?time|date|elapsed|sec|secs|seconds|"
        r"millis|micros|epoch|utc)\b",
    ),
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
    """The quantities that the words of a name may mean, the most likely first.

    Example:
        >>> list(quantities_of("tach rad s")), next(quantities_of("thr left"))
        (['speed'], 'command')
    """
    for quantity, pattern in _COMPILED:
        if pattern.search(words):
            yield quantity


def takes_any_unit(quantity: str) -> bool:
    """Whether the unit does not matter, as the quantity is reported but not used."""
    return quantity in _ANY_UNIT


def named_pwm(words: str) -> bool:
    """Whether a name means pulse widths."""
    return re.search(_PWM_WORDS, words) is not None

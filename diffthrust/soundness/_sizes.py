"""Numbers that cannot be what their unit says, by size alone or by the name of their column."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.words import number
from diffthrust.logs._log import Log
from diffthrust.logs._units import convert
from diffthrust.soundness._doubt import Doubt
from diffthrust.soundness._mends import named_unit, unit_line, unit_reading
from diffthrust.soundness._record import TURNS, Record

_SIZES: dict[str, tuple[float, float, str, str]] = {
    # channel: (98th percentile of its size below which and above which it cannot be, and what
    # it is then taken for)
    "command": (2e-2, 1e3, "V, not mV", "mV"),
    "speed": (0.0, 1.5e3, "", "rpm"),
    "propeller_speed": (0.0, 200.0, "", "rpm"),
    "rudder_angle": (0.028, 1.7, "rad, not deg", "deg"),
    "yaw_rate": (0.0, 4.0, "", "deg/s"),
    "surge": (0.0, 40.0, "", "mm/s"),
}
"""No motor's controller takes below 20 mV or above a kilovolt; a shaft of 1500 rad/s turns at
14 300 rpm; a rudder beyond 97 deg, or one that never leaves 1.6 deg, steers nothing; a vessel that
turns at 4 rad/s goes round in 1.6 s."""
_NAMES = {
    "rpm": "rpm",
    "rps": "rev/s",
    "hz": "rev/s",
    "kgf": "kgf",
    "lbf": "lbf",
    "deg": "deg",
    "rad": "rad",
    "mv": "mV",
    "knots": "knot",
    "kn": "knot",
    "kts": "knot",
    "kmh": "km/h",
}
"""Units that columns have in their names."""


def missized(log: Log, r: Record | None) -> Iterator[Doubt]:
    """Doubts on units, from the numbers of one channel."""
    for channel, samples in {**log.inputs, **log.measured}.items():
        unit_written = log.units[channel]
        yield from _by_name(log, channel)
        turn = r.turns.get(channel) if r else None
        if turn in ("deg", "shrunk"):
            unit = "deg" if turn == "deg" else "rad, not deg"
            yield Doubt(
                channel,
                "unit",
                f"{log.name}: {channel} jumps by {number(TURNS[turn])} where it passes a full "
                f"turn, which in rad is {2 * np.pi:.4g}.",
                unit_line(channel, unit),
                named_unit(channel, unit),
            )
            continue
        if channel not in _SIZES or unit_written not in ("", "V", "rad", "rad/s", "rev/s", "m/s"):
            continue
        sizes = np.abs(samples[np.isfinite(samples)])
        if sizes.size < 20:
            continue
        least, most, below, above = _SIZES[channel]
        size = float(np.quantile(sizes, 0.98))
        unit = below if 0 < size < least else above if size > most else ""
        if channel == "command":
            if unit_written not in ("", "V"):
                continue
            if samples[np.isfinite(samples)].min() > 700 and size < 2300:
                yield Doubt(
                    channel,
                    "unit",
                    f"{log.name}: {channel} lies between {number(float(sizes.min()))} and "
                    f"{number(float(sizes.max()))}, as widths of pulses in microseconds do.",
                    "[channels.command] pwm = { stop = 1500, full = 1900 }, or "
                    'Column(..., pwm={"stop": 1500, "full": 1900}).',
                )
                continue
        if unit and np.ptp(sizes) > 0:
            yield Doubt(
                channel,
                "unit",
                f"{log.name}: {channel} reaches {number(size, 3)} {unit_written}".rstrip()
                + ", which no thruster or vessel does.",
                unit_line(channel, unit),
                named_unit(channel, unit),
            )


def _by_name(log: Log, channel: str) -> Iterator[Doubt]:
    """A column that is called rpm and said to be in rad/s."""
    written = log.written.get(channel)
    if written is None or not written.column or abs(written.scale) != 1:
        return
    unit = written.unit or log.units[channel]
    words = "".join(c if c.isalnum() else " " for c in written.column.lower()).split()
    for word in words:
        named = _NAMES.get(word, "")
        if named in ("deg", "rad") and unit.endswith("/s"):
            named += "/s"
        if named and unit and _differ(unit, named):
            yield Doubt(
                channel,
                "unit",
                f"{log.name}: the column of {channel} is called {written.column!r}, but its unit "
                f"is given as {unit!r}.",
                unit_line(channel, named),
                (unit_reading(channel, named, float(convert(1.0, named, unit, where="a unit"))),),
            )
            return


def _differ(first: str, second: str) -> bool:
    """Whether two units of one quantity are not the same."""
    try:
        return not np.isclose(convert([1.0], first, second, where="a unit")[0], 1.0)
    except InputError:
        return False  # of different kinds: the word in the name means something else

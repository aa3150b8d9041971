"""Numbers that cannot be what their unit says: by size, by column's name, by a propeller's load.

The shaft obeys ``d(speed)/dt = beta command - alpha speed |speed|``. In rad/s, ``alpha`` [1/rad]
is the propeller's torque over the inertia that it turns; both go with the fifth power
of its size: 1 / alpha is the angle over which a shaft that is let go loses half of its speed.
Counted in rpm it is 9.55 times smaller, in Hz 6.28 times larger. Thrust goes with the square of
the speed.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.words import number
from diffthrust.logs._log import Log
from diffthrust.logs._units import convert
from diffthrust.models._base.quadratic_load import QuadraticLoad
from diffthrust.soundness._doubt import (
    Doubt,
    exchange_line,
    unit_doubt,
    unit_line,
    unit_reading,
)
from diffthrust.soundness._record import (
    TURNS,
    Record,
    correlation,
    less,
    mean_over,
    record,
    trailing,
)

_SIZES: dict[str, tuple[float, float, str, str]] = {
    # channel: (98th percentile of its size below which and above which it cannot be, and what
    # it is then taken for)
    "command": (2e-2, 1e3, "V, not mV", "mV"),
    "speed": (0.0, 1.5e3, "", "rpm"),
    "propeller_speed": (0.0, 200.0, "", "rpm"),
    "rudder_angle": (0.028, 1.7, "rad, not deg", "deg"),
    "yaw_rate": (0.0, 7.0, "", "deg/s"),
    "surge": (0.0, 40.0, "", "mm/s"),
}
"""No motor's controller takes below 20 mV or above a kilovolt; a shaft of 1500 rad/s turns at
14 300 rpm; a rudder beyond 97 deg, or one that never leaves 1.6 deg, steers nothing; a vehicle that
turns at 7 rad/s goes round in 0.9 s, and one of eight thrusters reached 4.2."""
_NAMES = {
    **{unit: unit for unit in ("rpm", "kgf", "lbf", "deg", "rad")},
    **{"rps": "rev/s", "hz": "rev/s", "mv": "mV", "kmh": "km/h"},
    **dict.fromkeys(("knots", "kn", "kts"), "knot"),
}
"""Units that columns have in their names."""


def missized(log: Log, r: Record | None) -> Iterator[Doubt]:
    """Doubts on units, from the numbers of one channel."""
    for channel, samples in {**log.inputs, **log.measured}.items():
        yield from _by_name(log, channel)
        turn = r.turns.get(channel) if r else None
        if turn in ("deg", "shrunk"):
            evidence = (
                f"{channel} jumps by {number(TURNS[turn])} where it passes a full turn, which in "
                f"rad is {2 * np.pi:.4g}."
            )
            yield unit_doubt(channel, evidence, "deg" if turn == "deg" else "rad, not deg")
        else:
            yield from _by_size(channel, samples[np.isfinite(samples)], log.units[channel])


def _by_size(channel: str, values: np.ndarray, written: str) -> Iterator[Doubt]:
    """Numbers that no channel of its name has, in the unit in which it is written."""
    units = ("", "V") if channel == "command" else ("", "V", "rad", "rad/s", "rev/s", "m/s")
    if channel not in _SIZES or written not in units or values.size < 20:
        return
    sizes = np.abs(values)
    least, most, below, above = _SIZES[channel]
    size = float(np.quantile(sizes, 0.98))
    if channel == "command" and values.min() > 700 and size < 2300:
        evidence = (
            f"{channel} lies between {number(float(sizes.min()))} and "
            f"{number(float(sizes.max()))}, as widths of pulses in microseconds do."
        )
        mend = (
            "[channels.command] pwm = { stop = 1500, full = 1900 }, or "
            'Column(..., pwm={"stop": 1500, "full": 1900}).'
        )
        yield Doubt(channel, "unit", evidence, mend)
        return
    unit = below if 0 < size < least else above if size > most else ""
    if unit and np.ptp(sizes) > 0:
        reached = f"{channel} reaches {number(size, 3)} {written}".rstrip()
        yield unit_doubt(channel, f"{reached}, which no thruster or vessel does.", unit)


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
        if not (named and unit):
            continue
        try:
            factor = float(convert(1.0, named, unit, where="a unit"))
        except InputError:
            continue  # of different kinds: the word in the name means something else
        if not np.isclose(factor, 1.0):
            evidence = (
                f"the column of {channel} is called {written.column!r}, but its unit is given as "
                f"{unit!r}."
            )
            reading = unit_reading(channel, named, factor)
            yield Doubt(channel, "unit", evidence, reading.line, (reading,))
            return


_RANGE = (0.012, 0.16)
"""Where alpha lies: 0.037 for Jason's thruster, 0.083 to 0.105 for the small one of NGS, by log. A
factor of 1.5 to three either way is left, half-way to what another unit would make of these; an
actuator lag that the model lacks lowers the estimate by up to a third."""
_SURE = 4.0
"""Standard errors by which an estimate must exceed zero before it is believed."""
_INSTRUMENTS = (0.0, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)
"""Lags of the command [samples] by which noise of the speed is kept out of the estimate."""
_UNITS = ("rad/s", "rpm", "rev/s")
"""What tachometers write."""
_HALF = 2
"""Half of the intervals over which rates are taken."""
_KNEES = (0.1, 0.25, 0.5, 0.75)
"""Where the static curve may bend, as shares of the largest command."""


def misloaded(log: Log) -> Iterator[Doubt]:
    """A doubt on the unit of the speed, where a log tells the load of the propeller."""
    r = record(log)
    if r is None or not r.has("command", "speed") or "command" not in r.inputs or r.size < 100:
        return
    load, error = _alpha(r)
    if not load > _SURE * error:
        return
    low, high = _RANGE
    if low <= load + 2 * error and load - 2 * error <= high:
        return
    way = log.written.get("speed")
    unit_written = (way.unit if way is not None else "") or "rad/s"
    # the numbers as they stand, were they in another unit: the load goes with its inverse
    loads = {unit: load * float(convert(1.0, unit_written, unit, where="speed")) for unit in _UNITS}
    unit = min(loads, key=lambda name: abs(np.log(loads[name] / (low * high) ** 0.5)))
    if not low < loads[unit] < high:
        return
    evidence = (
        f"with the speed in {unit_written} the shaft would lose half of it in "
        f"{number(1 / load, 2)} rad once let go (alpha = {number(load, 2)} +- {number(error, 1)} "
        f"1/rad, which is free of a thruster's size; known ones have {low} to {high}); in {unit} "
        f"in {number(1 / loads[unit], 2)} rad."
    )
    loop = "Or the controller holds the speed, whatever the load: dft.SpeedLoopThruster()."
    yield Doubt("speed", "unit", evidence, f"{unit_line('speed', unit)} {loop}")


def _alpha(r: Record) -> tuple[float, float]:
    """Load of the propeller [1/rad] and its standard error, by instrumental variables.

    The command and lags of it are the instruments: noise of the speed has nothing of them (Ljung
    1999, section 7.6). Whatever static curve lies between command and torque (a dead band, a
    limit, a root) is taken out first, so that the load shows by what comes after a change, and a
    log of slow ramps says nothing. The error allows for residuals that last.
    """
    command, speed = r.values["command"], r.signed_speed()
    assert speed is not None  # as the command is there
    load = mean_over(QuadraticLoad.terms(command, speed)[1], _HALF)
    rate = (speed[2 * _HALF :] - speed[: -2 * _HALF]) / (2 * _HALF * r.step)
    curve = _basis([*_curve(command), np.ones(command.size)])
    beside = _basis([*_curve(command), *trailing(command, _INSTRUMENTS)])
    moved = less(curve, beside @ (beside.T @ load))
    power = float(moved @ moved)
    if not power > 1e-6 * float(load @ load):
        return 0.0, np.inf
    value = float(moved @ rate) / power
    scores = moved * less(curve, rate - value * load)
    return value, float(np.sqrt(_long_run(scores, min(60, rate.size // 5)))) / power


def _curve(command: np.ndarray) -> list[np.ndarray]:
    """A static curve of the command, odd or not, in pieces."""
    most = float(np.abs(command).max())
    ahead, astern = np.maximum(command, 0.0), np.maximum(-command, 0.0)
    pieces = [np.maximum(side - knee * most, 0.0) for knee in _KNEES for side in (ahead, astern)]
    return [np.sign(command), ahead, astern, *pieces]


def _basis(columns: list[np.ndarray]) -> np.ndarray:
    """An orthonormal basis of the means of some series over the intervals, ``(n - 4, k)``."""
    parts = np.stack([mean_over(column, _HALF) for column in columns], axis=1)
    sizes = np.linalg.norm(parts, axis=0)
    parts = parts[:, sizes > 0] / sizes[sizes > 0]
    values, vectors = np.linalg.eigh(parts.T @ parts)
    kept = values > 1e-10 * values[-1]
    return parts @ (vectors[:, kept] / np.sqrt(values[kept]))


def _long_run(scores: np.ndarray, lags: int) -> float:
    """Sum of the covariances of a series with itself, with falling weights (Newey & West 1987)."""
    power = np.abs(np.fft.rfft(scores, 2 ** (2 * scores.size - 1).bit_length())) ** 2
    covariances = np.fft.irfft(power)[:lags]
    weights = 1 - np.arange(lags) / lags
    return max(float(2 * weights @ covariances - covariances[0]), 0.0)


_EXPLAINED = 0.8
"""Share that the root must explain before it is believed."""
_HALVED = 0.5
"""The root must leave open half of what the square does. In 26 measured logs it left 0.69 or more
of it, but for one with a burst of the tachometer, of which it explained 0.70."""
_NEGATIVE = 0.2
"""A sensor without a sign that goes so far below zero, as a share of its largest, has one."""


def misshaped(r: Record) -> Iterator[Doubt]:
    """Doubts on speed and thrust, by the law between them and by what has no sign."""
    for channel in r.unsigned & {*r.values}:
        values = r.values[channel]
        low, most = np.quantile(values, 0.02), np.quantile(np.abs(values), 0.98)
        if low < -_NEGATIVE * most:
            yield _signed(r, channel)
            return
    speed = r.signed_speed() if r.has("speed", "thrust") else None
    if speed is None:
        return
    root, square = (
        correlation(np.sign(speed) * np.abs(speed) ** power, r.values["thrust"])
        for power in (0.5, 2.0)
    )
    root, square = root * abs(root), square * abs(square)  # what each explains
    if root > _EXPLAINED and 1 - root < _HALVED * (1 - square):
        evidence = (
            f"thrust goes with the root of the speed (which explains {root:.2f} of it), not with "
            f"its square ({square:.2f})."
        )
        yield Doubt("speed", "exchanged", evidence, exchange_line("speed", "thrust"))


def _signed(r: Record, channel: str) -> Doubt:
    """A channel that has a sign and should have none, and perhaps the one that it belongs to."""
    low, high = r.values[channel].min(), r.values[channel].max()
    evidence = f"{channel} is said to have no sign, but goes from {low:.3g} to {high:.3g}"
    for signed in ("thrust", "command"):
        if signed != channel and r.has(signed) and r.values[signed].min() >= 0:
            evidence += f", while {signed} is never below {r.values[signed].min():.3g}."
            return Doubt(channel, "exchanged", evidence, exchange_line(channel, signed))
    mend = (
        f"[channels.{channel}] unsigned = false, or Column(..., unsigned=False); or look whether "
        "it is the right column."
    )
    return Doubt(channel, "sign", f"{evidence}.", mend)

"""What the law of a thruster tells of a log: the unit of its speed, and what is its thrust.

The shaft obeys ``d(speed)/dt = beta command - alpha speed |speed|``. In rad/s, ``alpha`` [1/rad]
is the propeller's torque over the inertia that it turns; both go with the fifth power
of its size: 1 / alpha is the angle over which a shaft that is let go loses half of its speed.
Counted in rpm it is 9.55 times smaller, in Hz 6.28 times larger. Thrust goes with the square of
the speed.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from diffthrust._support.words import number
from diffthrust.logs._log import Log
from diffthrust.logs._units import convert
from diffthrust.models._base.quadratic_load import QuadraticLoad
from diffthrust.soundness._doubt import Doubt
from diffthrust.soundness._mends import exchange_line, unit_line
from diffthrust.soundness._record import Record, record
from diffthrust.soundness._ties import correlation, less, trailing

_RANGE = (0.012, 0.16)
"""Where alpha lies: 0.037 for Jason's thruster, 0.083 to 0.105 for the small one of NGS, by log. A
factor of 1.5 to three either way is left, half-way to what another unit would make of these; an
actuator lag that the model lacks lowers the estimate by up to a third."""
_SURE = 4.0
"""Standard errors by which an estimate must exceed zero before it is believed."""
_INSTRUMENTS = (0.0, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)
"""Lags of the command [samples] by which noise of the speed is kept out of the estimate."""


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
    yield Doubt(
        "speed",
        "unit",
        f"{r.name}: with the speed in {unit_written} the shaft would lose half of it in "
        f"{number(1 / load, 2)} rad once let go (alpha = {number(load, 2)} +- {number(error, 1)} "
        f"1/rad, which is free of a thruster's size; known ones have {low} to {high}); in {unit} "
        f"in {number(1 / loads[unit], 2)} rad.",
        f"{unit_line('speed', unit)} Or the controller holds the speed, whatever the load: "
        "dft.SpeedLoopThruster().",
    )


_UNITS = ("rad/s", "rpm", "rev/s")
"""What tachometers write."""


def _alpha(r: Record) -> tuple[float, float]:
    """Load of the propeller [1/rad] and its standard error, by instrumental variables.

    The command and lags of it are the instruments: noise of the speed has nothing of them (Ljung
    1999, section 7.6). Whatever static curve lies between command and torque (a dead band, a
    limit, a root) is taken out first, so that the load shows by what comes after a change, and a
    log of slow ramps says nothing. The error allows for residuals that last.
    """
    command, speed = r.values["command"], r.values["speed"]
    if "speed" in r.unsigned:
        speed = np.abs(speed) * np.sign(command)
    load = _means(QuadraticLoad.terms(command, speed)[1])
    rate = (speed[_SPAN:] - speed[:-_SPAN]) / (_SPAN * r.step)
    curve = _basis([*_curve(command), np.ones(command.size)])
    beside = _basis([*_curve(command), *trailing(command, _INSTRUMENTS)])
    moved = less(curve, beside @ (beside.T @ load))
    power = float(moved @ moved)
    if not power > 1e-6 * float(load @ load):
        return 0.0, np.inf
    value = float(moved @ rate) / power
    scores = moved * less(curve, rate - value * load)
    return value, float(np.sqrt(_long_run(scores, min(60, rate.size // 5)))) / power


_SPAN = 4
"""Intervals over which rates are taken."""
_KNEES = (0.1, 0.25, 0.5, 0.75)
"""Where the static curve may bend, as shares of the largest command."""


def _curve(command: np.ndarray) -> list[np.ndarray]:
    """A static curve of the command, odd or not, in pieces."""
    most = float(np.abs(command).max())
    ahead, astern = np.maximum(command, 0.0), np.maximum(-command, 0.0)
    pieces = [np.maximum(side - knee * most, 0.0) for knee in _KNEES for side in (ahead, astern)]
    return [np.sign(command), ahead, astern, *pieces]


def _means(values: np.ndarray) -> np.ndarray:
    """Means over the intervals of the rates."""
    inner = sum(values[k : values.size - _SPAN + k] for k in range(1, _SPAN))
    return (0.5 * (values[_SPAN:] + values[:-_SPAN]) + inner) / _SPAN


def _basis(columns: list[np.ndarray]) -> np.ndarray:
    """An orthonormal basis of the means of some series, ``(n - 4, k)``."""
    parts = np.stack([_means(column) for column in columns], axis=1)
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
    for channel in r.unsigned:
        if channel in r.values and _negative(r.values[channel]):
            yield _signed(r, channel)
            return
    evidence = _exchanged(r) if r.has("speed", "thrust") else ""
    if evidence:
        line = exchange_line("speed", "thrust")
        yield Doubt("speed", "exchanged", f"{r.name}: {evidence}", line)


def _signed(r: Record, channel: str) -> Doubt:
    """A channel that has a sign and should have none, and perhaps the one that it belongs to."""
    low, high = r.values[channel].min(), r.values[channel].max()
    evidence = f"{r.name}: {channel} is said to have no sign, but goes from {low:.3g} to {high:.3g}"
    for signed in ("thrust", "command"):
        if signed != channel and r.has(signed) and r.values[signed].min() >= 0:
            evidence += f", while {signed} is never below {r.values[signed].min():.3g}."
            return Doubt(channel, "exchanged", evidence, exchange_line(channel, signed))
    return Doubt(
        channel,
        "sign",
        f"{evidence}.",
        f"[channels.{channel}] unsigned = false, or Column(..., unsigned=False); or look "
        "whether it is the right column.",
    )


def _exchanged(r: Record) -> str:
    speed, thrust = r.values["speed"], r.values["thrust"]
    if "speed" in r.unsigned:
        if not r.has("command"):
            return ""
        speed = np.abs(speed) * np.sign(r.values["command"])
    root, square = (
        correlation(np.sign(speed) * np.abs(speed) ** power, thrust) for power in (0.5, 2.0)
    )
    root, square = root * abs(root), square * abs(square)  # what each explains
    if root > _EXPLAINED and 1 - root < _HALVED * (1 - square):
        return (
            f"thrust goes with the root of the speed (which explains {root:.2f} of it), not with "
            f"its square ({square:.2f})."
        )
    return ""


def _negative(values: np.ndarray) -> bool:
    low = np.quantile(values, 0.02)
    return bool(low < -_NEGATIVE * np.quantile(np.abs(values), 0.98))

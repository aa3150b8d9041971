"""Speed and thrust in each other's place: thrust goes with the square of the speed."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from diffthrust.soundness._doubt import Doubt
from diffthrust.soundness._mends import exchange_line
from diffthrust.soundness._record import Record

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
    root, square = (_explains(np.sign(speed) * np.abs(speed) ** p, thrust) for p in (0.5, 2.0))
    if root > _EXPLAINED and 1 - root < _HALVED * (1 - square):
        return (
            f"thrust goes with the root of the speed (which explains {root:.2f} of it), not with "
            f"its square ({square:.2f})."
        )
    return ""


def _explains(drive: np.ndarray, values: np.ndarray) -> float:
    if not np.ptp(drive) > 0:
        return 0.0
    together = float(np.corrcoef(drive, values)[0, 1])
    return together * abs(together)


def _negative(values: np.ndarray) -> bool:
    low = np.quantile(values, 0.02)
    return bool(low < -_NEGATIVE * np.quantile(np.abs(values), 0.98))

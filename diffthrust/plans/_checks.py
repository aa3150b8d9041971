"""Checks of a plan's limits and settling times, and of the excitation of recorded logs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model
from diffthrust.simulation._simulate import simulate

_LEFT = 0.01
"""Share of the change within which a signal counts as settled."""
_SAMPLES = 2000
MAX_REST = 1e4
"""Seconds beyond which a model counts as one that never settles."""
_PARTS = 8
"""Parts of the band, evenly spaced in the logarithm of frequency."""
_ENOUGH = 0.1
"""Share of the planned power in a part; a tenth is a third of the amplitude."""


def checked_limits(who: str, limits: Any, what: str = "command") -> tuple[float, float]:
    """Lowest and highest value, or an `InputError`."""
    try:
        low, high = (float(x) for x in limits)
    except (TypeError, ValueError):
        low, high = np.nan, np.nan
    if not (np.isfinite(low) and np.isfinite(high) and low < high):
        raise InputError(
            f"{who}, limits: expected a lowest and a highest {what}, found {limits!r}.",
            "Write limits=(0, 5), the lower one first.",
        )
    return low, high


def settling_time(
    model: Model, channels: Sequence[str], inputs: Mapping[str, float], first: float = 1.0
) -> float:
    """Time from rest until the last of some outputs is within a hundredth of its change [s].

    Args:
        model: at its present parameters.
        channels: outputs to look at.
        inputs: levels that they step to, in the model's units.
        first: a guess [s], which is doubled until everything has settled.

    Raises:
        InputError: the model does not settle within 10 000 s.

    Example:
        >>> round(dft.plans.settling_time(dft.Thruster(), ["speed"], {"command": 2.0}), 1)
        1.5
    """
    units = {name: {**model.inputs, **model.optional_inputs}[name] for name in inputs}

    def simulated(span: float) -> tuple[np.ndarray, ...]:
        time = np.linspace(0.0, span, _SAMPLES)
        rows = {name: np.full(time.size, level) for name, level in inputs.items()}
        outputs = simulate(model, Log(time, rows, units=units))
        return time, *(outputs[name] for name in channels)

    rested = time_to_rest(simulated, 20.0 * first)
    if rested is None:
        raise InputError(
            f"{model}: {', '.join(channels)} do not come to rest within {MAX_REST:g} s after a "
            f"step to {dict(inputs)}.",
            "Look at the parameters, or give settle.",
        )
    return rested[0]


def time_to_rest(
    simulated: Callable[[float], tuple[np.ndarray, ...]], span: float
) -> tuple[float, list[float]] | None:
    """Settling time, and last value of each series that a simulation over a span gives with time.

    The span is doubled until all have settled in its first half: the last value, from which the
    distance counts, is then the steady one.
    """
    while span <= MAX_REST:
        time, *series = simulated(span)
        settling = max(settled(time, values) for values in series)
        if settling < 0.5 * span:
            return settling, [float(values[-1]) for values in series]
        span *= 2.0
    return None


def settled(time: np.ndarray, values: np.ndarray) -> float:
    """Time from which values stay within a hundredth of their change about the last value [s]."""
    change = np.abs(values - values[-1])
    allowed = _LEFT * max(float(np.max(np.abs(values - values[0]))), 1e-12)
    beyond = np.flatnonzero(change > allowed)
    return float(time[beyond[-1] + 1]) if beyond.size and beyond[-1] + 1 < time.size else 0.0


def excited(
    log: Log, plan: Log, channel: str, unit: str, band: tuple[float, float]
) -> tuple[float, float] | None:
    """The widest part of a band [Hz] in which a log's input has enough of the planned power.

    ``None`` where no part is excited.
    """
    edges = np.geomspace(*band, _PARTS + 1)
    wanted, recorded = (_power(log_of, channel, unit, edges) for log_of in (plan, log))
    good = [*(recorded >= _ENOUGH * wanted), False]
    best, start = (0, 0), 0
    for k, here in enumerate(good):
        if not here:
            best, start = max(best, (start, k), key=lambda part: part[1] - part[0]), k + 1
    return (float(edges[best[0]]), float(edges[best[1]])) if best[1] > best[0] else None


def _power(log: Log, channel: str, unit: str, edges: np.ndarray) -> np.ndarray:
    """Mean square of a channel between frequencies; zero where the samples do not reach."""
    values, steps = log.values(channel, unit), np.diff(log.time)
    step = float(np.median(steps))
    # The transform needs even steps: the input is held between samples, as the plan means it.
    even = np.arange(log.time[0], log.time[-1] + 0.5 * step, step)
    held = values[np.clip(np.searchsorted(log.time, even + 1e-9, side="right") - 1, 0, None)]
    lines = np.abs(np.fft.rfft(held - held.mean())) ** 2 / held.size**2
    total = np.concatenate([[0.0], np.cumsum(lines)])
    frequency = np.fft.rfftfreq(held.size, step)
    ends = np.searchsorted(frequency, edges * (1.0 + 1e-9))
    return np.diff(total[ends])

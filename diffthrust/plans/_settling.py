"""What the levels of a plan follow from: limits, and how long a model takes to settle."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model
from diffthrust.simulation._runs import simulate

_LEFT = 0.01
"""Share of the change within which a signal counts as settled."""
_SAMPLES = 2000
MAX_REST = 1e4
"""Seconds beyond which a model counts as one that never settles."""


def checked_limits(who: str, limits: Any, what: str = "command") -> tuple[float, float]:
    """Lowest and highest value, or an `InputError`."""
    with suppress(TypeError, ValueError):
        low, high = (float(x) for x in limits)
        if np.isfinite(low) and np.isfinite(high) and low < high:
            return low, high
    raise InputError(
        f"{who}, limits: expected a lowest and a highest {what}, found {limits!r}.",
        "Write limits=(0, 5), the lower one first.",
    )


def settling_time(
    model: Model, channels: Sequence[str], inputs: Mapping[str, float], first: float = 1.0
) -> float:
    """Time from rest until the last of some outputs is within a hundredth of its change [s].

    Args:
        model: at its present parameters.
        channels: outputs to look at.
        inputs: levels that they step to, in the model's units.
        first: a guess [s], which is doubled until everything has settled; a hundredth of it is the
            step at which outputs are looked at.

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
        settling = max(_settled(time, values) for values in series)
        if settling < 0.5 * span:
            return settling, [float(values[-1]) for values in series]
        span *= 2.0
    return None


def _settled(time: np.ndarray, values: np.ndarray) -> float:
    """Time from which values stay within a hundredth of their change about the last value [s]."""
    change = np.abs(values - values[-1])
    allowed = _LEFT * max(float(np.max(np.abs(values - values[0]))), 1e-12)
    beyond = np.flatnonzero(change > allowed)
    return float(time[beyond[-1] + 1]) if beyond.size and beyond[-1] + 1 < time.size else 0.0

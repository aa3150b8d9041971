"""Plans for thrusters: the static test and the dynamic test."""

from __future__ import annotations

from typing import Any

import numpy as np

from diffthrust._errors import InputError
from diffthrust._log import Log
from diffthrust._model import Model
from diffthrust.control._reference import number
from diffthrust.papers._commands import lowpass_noise, staircase
from diffthrust.plans._plan import Plan
from diffthrust.plans._settling import settling_time

_OUTPUTS = ("speed", "thrust")
_SOURCE = "Yoerger, Cooke & Slotine 1990, section III"


def static_test(
    model: Model,
    limits: tuple[float, float],
    *,
    levels: int = 8,
    hold: float = 5.0,
    step: float = 0.05,
    settle: float | None = None,
) -> Plan:
    """Levels held until speed and thrust have come to rest, and ``hold`` seconds more.

    On each side of zero that the limits allow, ``levels`` lie evenly up to the limit, the largest
    last; zero is held behind them. The smallest level settles last, and sets the time.

    Args:
        model: a thruster, as it is believed to be.
        limits: lowest and highest command, in the model's unit.
        levels: how many on each side.
        hold: how long to measure at each [s].
        step: time between samples [s].
        settle: how long to wait at each [s]; by the model where not given.

    Raises:
        InputError: a model without a command, limits without a range, a model that does not settle.

    Source: Yoerger, Cooke & Slotine 1990, section III.

    Example:
        >>> dft.plans.static_test(dft.Thruster(), limits=(-5, 5)).save("plans")
    """
    low, high = _limits("static_test", model, limits)
    number("static_test, hold", hold, lambda x: x > 0, "seconds, above zero")
    count = int(number("static_test, levels", levels, lambda x: x >= 2, "2 or more"))
    ends = [end for end in (max(high, 0.0), min(low, 0.0)) if end != 0.0]
    heights = [x for end in ends for x in (*np.linspace(0.0, end, count + 1)[1:], 0.0)]
    if settle is None:
        smallest = min(abs(end) for end in ends) / count
        outputs = [name for name in _OUTPUTS if name in model.outputs]
        settle = settling_time(model, outputs, {"command": smallest})
    return Plan(
        name="static_test",
        source=_SOURCE,
        runs={"static_test": _run(model, *staircase(heights, settle + hold, step))},
        settle=settle,
        measure=_OUTPUTS,
    )


def dynamic_test(
    model: Model,
    limits: tuple[float, float],
    *,
    duration: float = 60.0,
    cutoff: float = 1.0,
    step: float = 0.02,
    seed: int = 0,
) -> Plan:
    """Noise through a low-pass, about the middle of the limits and up to them.

    Args:
        model: a thruster.
        limits: lowest and highest command, in the model's unit.
        duration: [s].
        cutoff: of the low-pass [Hz].
        step: time between samples [s].
        seed: of the noise.

    Raises:
        InputError: a model without a command, limits without a range, a cut-off beyond half the
            sample rate.

    Source: Yoerger, Cooke & Slotine 1990, section III.

    Example:
        >>> dft.plans.dynamic_test(dft.Thruster(), limits=(-5, 5)).save("plans")
    """
    low, high = _limits("dynamic_test", model, limits)
    time, noise = lowpass_noise(duration, step, 0.5 * (high - low), cutoff=cutoff, seed=seed)
    return Plan(
        name="dynamic_test",
        source=_SOURCE,
        runs={"dynamic_test": _run(model, time, 0.5 * (low + high) + noise)},
        settle=duration,  # nothing is held
        measure=_OUTPUTS,
    )


def _run(model: Model, time: np.ndarray, command: np.ndarray) -> Log:
    return Log(time, {"command": command}, units={"command": model.inputs["command"]})


def _limits(who: str, model: Any, limits: Any) -> tuple[float, float]:
    if not isinstance(model, Model) or "command" not in model.inputs:
        raise InputError(
            f"{who}: expected a thruster with the input 'command', found {model!s}.",
            "Give a model such as dft.Thruster().",
        )
    try:
        low, high = (float(x) for x in limits)
    except (TypeError, ValueError):
        low, high = np.nan, np.nan
    if not (np.isfinite(low) and np.isfinite(high) and low < high):
        raise InputError(
            f"{who}, limits: expected a lowest and a highest command, found {limits!r}.",
            "Write limits=(-5, 5).",
        )
    return low, high

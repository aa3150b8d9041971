"""How long a model takes to come to rest after a step of its inputs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model
from diffthrust.simulation._simulate import simulate

_LEFT = 0.01
"""Share of the change that may be left."""
_SAMPLES = 2000
LONGEST = 1e4
"""Seconds beyond which a model counts as one that never settles."""


def settling_time(
    model: Model, channels: Sequence[str], inputs: Mapping[str, float], first: float = 1.0
) -> float:
    """When the last of some outputs has come within a hundredth of its change, from rest [s].

    Args:
        model: at its present parameters.
        channels: outputs to look at.
        inputs: levels that they step to, in the model's units.
        first: a guess [s], which is doubled until everything has settled.

    Raises:
        InputError: the model does not settle within 10 000 s.
    """
    span = 20.0 * first
    while span <= LONGEST:
        time = np.linspace(0.0, span, _SAMPLES)
        rows = {name: np.full(time.size, level) for name, level in inputs.items()}
        units = {name: {**model.inputs, **model.optional_inputs}[name] for name in rows}
        found = simulate(model, Log(time, rows, units=units))
        times = [settled(time, found[name]) for name in channels]
        if max(times) < 0.5 * span:
            return max(times)
        span *= 2.0
    raise InputError(
        f"{model}: {', '.join(channels)} do not come to rest within {LONGEST:g} s after a step to "
        f"{dict(inputs)}.",
        "Look at the parameters, or give settle.",
    )


def settled(time: np.ndarray, values: np.ndarray) -> float:
    """When values have come within a hundredth of their largest change of the last one [s]."""
    change = np.abs(values - values[-1])
    allowed = _LEFT * max(float(np.max(np.abs(values - values[0]))), 1e-12)
    beyond = np.flatnonzero(change > allowed)
    return float(time[beyond[-1] + 1]) if beyond.size and beyond[-1] + 1 < time.size else 0.0

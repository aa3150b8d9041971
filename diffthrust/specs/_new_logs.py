"""Small made-up logs of each model, with which a new fit runs before its user has put in any."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model
from diffthrust.simulation._simulate import simulate

_OTHER = 1.15
"""The made-up system has so many times the parameters at which the search begins."""
_NOISE = 0.02
"""Noise of a channel, as a share of its spread."""


class _Run(NamedTuple):
    """How a model is driven: its inputs go to other levels within their ranges after each hold."""

    step: float
    hold: int
    samples: int
    ranges: Mapping[str, tuple[float, float]]


_RUNS = {
    "thruster": _Run(0.05, 25, 300, {"command": (-3.0, 3.0)}),
    "speed_loop_thruster": _Run(0.05, 25, 300, {"command": (-1.0, 1.0)}),
    "ducted_thruster": _Run(0.05, 25, 300, {"command": (-1.0, 1.0)}),
    "dc_motor_thruster": _Run(0.02, 40, 400, {"command": (-12.0, 12.0)}),
    "axis_vehicle": _Run(0.2, 25, 300, {"thrust": (-100.0, 100.0)}),
    "linear_sensor": _Run(1.0, 1, 20, {"depth": (0.0, 4.0)}),
    "vessel": _Run(0.2, 30, 300, {"propeller_speed": (60.0, 120.0), "rudder_angle": (-0.45, 0.45)}),
}


def example_table(model: Model, seed: int) -> str:
    """A log of a model as the text of a CSV file: time, inputs, and outputs with white noise.

    Args:
        model: a model of the catalogue, as it is by default.
        seed: of the levels of the inputs and of the noise.
    """
    run = _RUNS[model.name]
    rng = np.random.default_rng(seed)
    time = run.step * np.arange(run.samples)
    inputs = {
        name: np.repeat(rng.uniform(*ends, -(-run.samples // run.hold)), run.hold)[: run.samples]
        for name, ends in run.ranges.items()
    }
    other = {name: _OTHER * p.value for name, p in model.parameters.items() if not p.fixed}
    outputs = simulate(model.replace(other), Log(time, inputs, {}))
    noisy = {
        name: values + _NOISE * np.std(values) * rng.standard_normal(run.samples)
        for name, values in outputs.items()
        if name in model.outputs
    }
    columns = {"time": time, **inputs, **noisy}
    rows = (
        ",".join(f"{value:.5g}" for value in row) for row in zip(*columns.values(), strict=True)
    )
    return "\n".join([",".join(columns), *rows, ""])

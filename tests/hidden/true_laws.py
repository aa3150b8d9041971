"""The effects outside the catalogue as formulas, and how well each does once it is estimated.

What a plant did with its true numbers is one measure of what is learned; what its true law does
with numbers estimated from the same logs is the other. Where small errors grow along a run (of a
heading that steers itself), no law that begins at measured values comes near the first, not even
with the true numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import diffthrust as dft

from .sets import HiddenSet

_HUMPS = "(exp(-((x - b) / c)**2) - exp(-((x + b) / c)**2))"


class TrueLaw(NamedTuple):
    """An effect outside the catalogue as a formula, with what its parameters are called there."""

    port: str
    expression: str
    called: Mapping[str, tuple[str, str]]


TRUE_LAWS: Mapping[str, TrueLaw] = {
    "command_play": TrueLaw(
        "drive",
        "gain * (play(command, half_width) - command)",
        {"half_width": ("play", "V"), "gain": ("beta", "rad/(V s^2)")},
    ),
    "motor_heating": TrueLaw(
        "drive",
        "value * (1 - loss * lag((value / warm)**2, T, 0))",
        {"loss": ("loss", ""), "warm": ("warm", "rad/s^2"), "T": ("time_constant", "s")},
    ),
    "load_hump": TrueLaw(
        "load",
        f"a * {_HUMPS.replace('x ', 'speed ')}",
        {"a": ("height", "rad/s^2"), "b": ("middle", "rad/s"), "c": ("width", "rad/s")},
    ),
    "load_memory": TrueLaw(
        "load",
        "-relief * abs(speed) * lag(speed, T)",
        {"relief": ("relief", "1/rad"), "T": ("time_constant", "s")},
    ),
    "brush_loss": TrueLaw(
        "load",
        "loss * abs(command) * tanh(speed / rest)",
        {"loss": ("loss", "rad/(V s^2)"), "rest": ("rest", "rad/s")},
    ),
    "thrust_hollow": TrueLaw(
        "propeller",
        "value * (1 - depth * exp(-((abs(speed) - b) / c)**2))",
        {"depth": ("depth", ""), "b": ("middle", "rad/s"), "c": ("width", "rad/s")},
    ),
    "reverse_stall": TrueLaw(
        "propeller",
        "value * (1 - depth * (1 - tanh((speed + b) / (2 * c))) / 2)",
        {"depth": ("depth", ""), "b": ("middle", "rad/s"), "c": ("width", "rad/s")},
    ),
    "resistance_hump": TrueLaw(
        "surge_force",
        f"-a * {_HUMPS.replace('x ', 'surge ')}",
        {"a": ("height", "N"), "b": ("middle", "m/s"), "c": ("width", "m/s")},
    ),
    "bow_wave_turning": TrueLaw(
        "yaw_moment",
        "a * exp(-((surge - b) / c)**2)",
        {"a": ("moment", "N m"), "b": ("middle", "m/s"), "c": ("width", "m/s")},
    ),
    "heading_ripple": TrueLaw(
        "yaw_moment",
        "a * sin(k * heading)",
        {"a": ("moment", "N m"), "k": ("waves", "")},
    ),
}
"""By the name of the effect; each parameter with its name in the reference simulator."""
_LASTING: Mapping[str, float] = {"motor_heating": 15.0, "load_memory": 2.0}
"""Time constants [s], which are defaults of the reference simulator."""
_NULLS = ("gain", "loss", "a", "relief", "depth")
_FIXED = ("warm",)


def true_model(hidden: HiddenSet) -> dft.Model:
    """The basic model with the law that the plant of a set has, at its true numbers."""
    assert hidden.plant is not None
    ((name, told),) = hidden.plant.hidden.items()
    law = TRUE_LAWS[name]
    known = {**hidden.plant.parameters, **told}
    parameters = {}
    for own, (theirs, unit) in law.called.items():
        value = _LASTING[name] if theirs == "time_constant" else known[theirs]
        parameters[own] = {"unit": unit, "value": value}
        if own in _NULLS:
            parameters[own] |= {"null": 0.0, "size": abs(value)}
        if own in _FIXED:
            parameters[own] |= {"fixed": True}
    begin = {n: v for n, v in hidden.plant.parameters.items() if n in hidden.model.parameters}
    effect = dft.effects.Formula(law.port, law.expression, name="law", **parameters)
    return hidden.model.replace(begin) + effect


def estimated_error(hidden: HiddenSet) -> float:
    """NRMSE of the unseen log with the true law, all numbers estimated from the training logs."""
    fit = dft.fit(true_model(hidden), hidden.train, holdout=hidden.unseen, starts=1)
    assert fit.holdout is not None
    return fit.holdout.nrmse

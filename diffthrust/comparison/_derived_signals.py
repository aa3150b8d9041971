"""The signals that an error may depend on, and what follows from them: sizes, rates, times."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from diffthrust.models._base.model import Model
from diffthrust.simulation._errors import wrapped
from diffthrust.simulation._runs import Run

_JUMP = 0.1
"""An input jumps where it changes from one sample to the next by this share of its range."""


def signals_of(model: Model, run: Run) -> dict[str, np.ndarray]:
    """The signals of a run that its error may depend on, ``(n,)`` each, in `units_of` the run.

    Not where the vessel is, and where it points only if that is measured: a modelled heading
    with nothing to hold it is little more than a clock.
    """
    signals = {n: v for n, v in run.signals.items() if np.all(np.isfinite(v))}
    for name, unit in model.states.items():
        if unit == "m" or (name in model.angles and name not in run.channels):
            signals.pop(name, None)
        elif name in model.angles and name in signals:
            signals[name] = wrapped(signals[name])
    sizes = {name: run.shown.size(name, 1.0, run.units.get(name, "")) for name in signals}
    return {name: sizes[name].value * values for name, values in signals.items()}


def units_of(run: Run) -> dict[str, str]:
    """The unit of each of these signals; a command in pulses is counted from the stop."""
    return {name: run.shown.unit(name, unit) for name, unit in run.units.items()}


def derived_of(
    model: Model, run: Run, *, tabular: bool = False
) -> dict[str, tuple[np.ndarray, str]]:
    """The `derived_signals` of a run, which has no rates where it is a table."""
    time = None if tabular else run.time
    return derived_signals(time, signals_of(model, run), units_of(run), model.angles)


def derived_signals(
    time: np.ndarray | None,
    signals: Mapping[str, np.ndarray],
    units: Mapping[str, str],
    plain: Collection[str] = (),
) -> dict[str, tuple[np.ndarray, str]]:
    """The signals, and those that follow from them, with their units; the plainest come first.

    For each signal, ``(n,)``, its value, its size ``|x|`` where it takes both signs, its rate of
    change, and the rate of change of its size, which is positive while it speeds up and negative
    while it slows down. Besides ``time since the start`` and, for each signal that jumps, the time
    since it did. Of ``plain`` signals only the value; without time (a table) nothing has a rate.
    """
    derived = {name: (values, units.get(name, "")) for name, values in signals.items()}
    signals = {name: values for name, values in signals.items() if name not in plain}
    both = [name for name, values in signals.items() if values.min() < 0 < values.max()]
    derived |= {f"|{name}|": (np.abs(signals[name]), units.get(name, "")) for name in both}
    if time is None or time.size < 3:
        return derived
    derived["time since the start"] = (time - time[0], "s")
    for name, values in signals.items():
        jumped = np.abs(np.diff(values, prepend=values[0])) > _JUMP * np.ptp(values)
        rate, unit = np.gradient(values, time), _rate_unit(units.get(name, ""))
        if jumped.any():
            jumped[0] = True
            since = np.maximum.accumulate(np.where(jumped, time, time[0]))
            derived[f"time since {name} jumped"] = (time - since, "s")
        derived[f"d({name})/dt"] = (rate, unit)
        derived[f"|d({name})/dt|"] = (np.abs(rate), unit)
        if name in both:
            # positive while it speeds up to either side: friction and added mass differ by this,
            # not by the sign of the rate
            derived[f"d|{name}|/dt"] = (np.sign(values) * rate, unit)
    return derived


def _rate_unit(unit: str) -> str:
    """Unit of a rate of change: rad/s becomes rad/s^2, V becomes V/s, and nothing 1/s."""
    base, slash, below = unit.rpartition("/")
    return f"{base}/s^2" if slash and below == "s" else f"{unit or '1'}/s"

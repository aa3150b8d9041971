"""Signals that follow from others: sizes, rates of change, times since something happened."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

JUMP = 0.1
"""An input jumps where it changes from one sample to the next by this share of its range."""


def derived_signals(
    time: np.ndarray | None,
    signals: Mapping[str, np.ndarray],
    units: Mapping[str, str],
    plain: Collection[str] = (),
) -> dict[str, tuple[np.ndarray, str]]:
    """The signals, and those that follow from them, with their units; the plainest come first.

    For each signal its value, its size ``|x|`` where it takes both signs, its rate of change, and
    the rate of change of its size, which is positive while it speeds up and negative while it slows
    down. Besides ``time since the start`` and, for each signal that jumps, the time since it did.

    Args:
        time: time stamps [s], ``(n,)``; ``None`` for a table, where nothing has a rate.
        signals: values by name, ``(n,)`` each.
        units: unit of each signal.
        plain: signals of which only the value is wanted.

    Returns:
        Name to values ``(n,)`` and unit.

    Example:
        >>> sorted(derived_signals(t, {"speed": s}, {"speed": "rad/s"}))
        ['d(speed)/dt', 'd|speed|/dt', 'speed', 'time since the start', '|d(speed)/dt|', '|speed|']
    """
    found = {name: (values, units.get(name, "")) for name, values in signals.items()}
    signals = {name: values for name, values in signals.items() if name not in plain}
    both = [name for name, values in signals.items() if values.min() < 0 < values.max()]
    found |= {f"|{name}|": (np.abs(signals[name]), units.get(name, "")) for name in both}
    if time is None or time.size < 3:
        return found
    found["time since the start"] = (time - time[0], "s")
    for name, values in signals.items():
        jumped = np.abs(np.diff(values, prepend=values[0])) > JUMP * np.ptp(values)
        rate, unit = np.gradient(values, time), rate_unit(units.get(name, ""))
        if jumped.any():
            jumped[0] = True
            since = np.maximum.accumulate(np.where(jumped, time, time[0]))
            found[f"time since {name} jumped"] = (time - since, "s")
        found[f"d({name})/dt"] = (rate, unit)
        found[f"|d({name})/dt|"] = (np.abs(rate), unit)
        if name in both:
            found[f"d|{name}|/dt"] = (np.sign(values) * rate, unit)
    return found


def rate_unit(unit: str) -> str:
    """Unit of a rate of change.

    Example:
        >>> rate_unit("rad/s"), rate_unit("V"), rate_unit("")
        ('rad/s^2', 'V/s', '1/s')
    """
    if not unit:
        return "1/s"
    base, slash, below = unit.rpartition("/")
    if slash and below == "s":
        return f"{base}/s^2"
    return f"{unit}/s"

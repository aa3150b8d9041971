"""What a predictive controller is given, checked."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing, nearest


def measured_number(where: str, value: Any) -> float:
    """A number, which may be missing (NaN)."""
    try:
        return float(value)
    except (TypeError, ValueError):
        raise InputError(
            f"{where}: expected a number, found {value!r}.", "Give NaN for what was not measured."
        ) from None


def count_of(where: str, value: Any) -> int:
    """A whole number above zero."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 1:
        raise InputError(
            f"{where}: expected a whole number, 1 or more, found {value!r}.", "Correct it."
        )
    return int(value)


def check_names(what: str, by_name: Any, names: tuple[str, ...], example: str) -> None:
    """Raise `InputError` for what is no dictionary by these names."""
    if not isinstance(by_name, Mapping):
        raise InputError(
            f"MPC, {what}: expected a dictionary by name, found {by_name!r}.",
            f'Write {{"{names[0]}": {example}, ...}}.',
        )
    for name in by_name:
        if name not in names:
            near = nearest(str(name), names)
            raise InputError(
                f"MPC, {what}: the model has no '{name}'{f' ({near})' if near else ''}; it has "
                f"{listing(names)}.",
                "Correct the name.",
            )


def limit_pair(name: str, pair: Any, unit: str, *, open_: bool = False) -> tuple[float, float]:
    """Lowest and highest value of an input; of a state (``open_``) one side may be infinite."""
    try:
        low, high = (float(value) for value in pair)
    except (TypeError, ValueError):
        low, high = math.nan, math.nan
    ends = (math.isfinite(low), math.isfinite(high))
    if not (low < high and (any(ends) if open_ else all(ends))):
        raise InputError(
            f"MPC, limits: expected a lowest and a highest value of '{name}' [{unit}], found "
            f"{pair!r}.",
            f'Write limits={{"{name}": (LOWEST, HIGHEST)}}.',
        )
    if unit == "rad" and not open_ and max(-low, high) > 2.0 * math.pi:
        raise InputError(
            f"MPC, limits: expected '{name}' in rad, found {low:g} to {high:g}, more than a turn.",
            "Convert it: math.radians(24).",
        )
    return low, high

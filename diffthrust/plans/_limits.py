"""The limits that a user sets to a test."""

from __future__ import annotations

from typing import Any

import numpy as np

from diffthrust._support.errors import InputError


def limits_of(who: str, limits: Any, what: str = "command") -> tuple[float, float]:
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

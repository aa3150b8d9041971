"""When the fits of a fleet were made, as numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError


def times_of(times: Sequence[Any]) -> tuple[np.ndarray, str]:
    """Times as numbers and their unit; dates count in days since the first.

    Raises:
        InputError: something that is neither.
    """
    import pandas as pd

    if all(time is None for time in times):
        return np.full(len(times), np.nan), "unit of time"
    if all(isinstance(time, int | float | np.number) for time in times):
        numbers, unit = np.array(times, float), "unit of time"
    else:
        try:
            dates = pd.to_datetime(pd.Series(list(times)), utc=True, format="ISO8601")
        except (ValueError, TypeError) as error:
            raise InputError(
                f"time: expected numbers or dates, found what is neither ({error}).",
                "Write dates as 2026-05-01 or 2026-05-01T12:00.",
            ) from None
        numbers, unit = ((dates - dates.min()) / pd.Timedelta(days=1)).to_numpy(float), "day"
    if not np.isfinite(numbers).all():
        raise InputError(
            f"time: that of fit {int(np.argmin(np.isfinite(numbers))) + 1} is missing.",
            "Give a time for each fit, or for none.",
        )
    return numbers, unit

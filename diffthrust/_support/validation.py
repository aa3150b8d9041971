"""Arguments checked, with one sentence that says what was expected."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from diffthrust._support.errors import InputError


def number(where: str, value: Any, right: Callable[[float], bool], expected: str) -> float:
    """A finite number that meets a condition.

    Raises:
        InputError: it does not.
    """
    try:
        found = math.nan if isinstance(value, bool | str) else float(value)
    except (TypeError, ValueError):
        found = math.nan
    if not math.isfinite(found) or not right(found):
        raise InputError(f"{where}: expected {expected}, found {value!r}.", "Correct it.")
    return found

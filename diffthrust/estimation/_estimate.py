"""One parameter after a fit."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Estimate:
    """One parameter after a fit.

    Args:
        value: the value, in ``unit``.
        std_error: standard deviation of the estimate; ``None`` where the parameter was fixed, lies
            at a bound, or cannot be told apart from others.
        unit: unit of both.
        fixed: it was not estimated.
        at_bound: the data hold it at one of its bounds.
    """

    value: float
    std_error: float | None
    unit: str
    fixed: bool
    at_bound: bool

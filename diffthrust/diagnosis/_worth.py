"""What an effect is worth: how much of the error over whole runs it removes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Worth:
    """Share of the squared whole-run error that an effect removes, of unseen logs if there are any.

    Args:
        share: 0 changes nothing, 1 leaves no error, below 0 makes it larger.
        low: lower end of the 90 % interval.
        high: upper end.

    Example:
        >>> Worth(0.72, 0.6, 0.8).to_json()
        {'share': 0.72, 'interval': [0.6, 0.8]}
    """

    share: float
    low: float
    high: float

    def to_json(self) -> dict[str, Any]:
        """The worth as plain data."""
        return {"share": self.share, "interval": [self.low, self.high]}

"""The memory that a log may take: small files may unpack to more than there is."""

from __future__ import annotations

import os
from pathlib import Path

from diffthrust._support.errors import InputError

LARGEST = "DIFFTHRUST_LARGEST_LOG"
"""The environment variable that raises the limit [MB]."""
_USUAL = 512.0
_MB = 2**20


class MemoryBudget:
    """Bytes that a log may still take; reserved before they are allocated."""

    def __init__(self, path: Path) -> None:
        self._file = path.name
        self._most = _largest()
        self._taken = 0

    @property
    def remaining(self) -> int:
        """Bytes still available."""
        return self._most - self._taken

    def take(self, size: int) -> None:
        """Reserve bytes; InputError if fewer are available."""
        self._taken += size
        if self._taken > self._most:
            # Rounded up: 512.3 MB against a limit of 512 would print as equal.
            needed = -(-self._taken // _MB)
            raise InputError(
                f"{self._file}: expected a log of at most {self._most / _MB:g} MB in memory, found "
                f"one that unpacks to {needed} MB or more.",
                "check that it is the intended log; if it is, raise the limit by the "
                f"environment variable {LARGEST}, in MB.",
            )


def _largest() -> int:
    text = os.environ.get(LARGEST) or _USUAL
    try:
        return round(float(text) * _MB)
    except (ValueError, OverflowError):
        raise InputError(
            f"{LARGEST}: expected a number of MB, found {text!r}.",
            "correct the environment variable, or remove it.",
        ) from None

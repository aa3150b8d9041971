"""How large a log may be once it is unpacked: a small file can unpack to more than memory holds."""

from __future__ import annotations

import os
from pathlib import Path

from diffthrust._support.errors import InputError

LARGEST = "DIFFTHRUST_LARGEST_LOG"
"""The environment variable that raises the limit [MB]."""
_USUAL = 512.0
_MB = 2**20


class Room:
    """The bytes that a log may still take, spent before they are needed.

    Args:
        path: the file, which the message names.

    Raises:
        InputError: the environment gives no number for the limit.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.name
        self._most = _largest()
        self._taken = 0

    @property
    def left(self) -> int:
        """How many bytes are left."""
        return self._most - self._taken

    def take(self, size: int) -> None:
        """Spend some bytes.

        Raises:
            InputError: they are more than there are left.
        """
        self._taken += size
        if self._taken > self._most:
            needed = -(-self._taken // _MB)
            raise InputError(
                f"{self._file}: expected a log of at most {self._most / _MB:g} MB in memory, found "
                f"one that unpacks to {needed} MB or more.",
                "check that it is the log that you mean; if it is, raise the limit by the "
                f"environment variable {LARGEST}, in MB.",
            )


def _largest() -> int:
    given = os.environ.get(LARGEST) or _USUAL
    try:
        return round(float(given) * _MB)
    except (ValueError, OverflowError):
        raise InputError(
            f"{LARGEST}: expected a number of MB, found {given!r}.",
            "correct the environment variable, or remove it.",
        ) from None

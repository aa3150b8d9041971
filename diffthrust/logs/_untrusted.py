"""Files that may be damaged, or unpack to more memory than there is."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
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


@contextmanager
def reading(path: Path, kind: str) -> Iterator[None]:
    """What is raised of a damaged file becomes one error: its readers raise any kind."""
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        raise damaged(path, kind, error) from None


def damaged(path: Path, kind: str, error: Exception) -> InputError:
    """The error for a file that its reader cannot read."""
    reason = " ".join(str(error).split())[:160] or type(error).__name__
    return InputError(
        f"{path.name}: expected a {kind} file, found something that cannot be read ({reason}).",
        "check that the file is complete, and that its name ends as its content requires.",
    )

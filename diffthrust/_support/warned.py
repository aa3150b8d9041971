"""Warnings that also stand in a result: given out, unless many results are on their way."""

from __future__ import annotations

import warnings
from contextvars import ContextVar

_silent: ContextVar[bool] = ContextVar("silent", default=False)


def silence() -> None:
    """From here on, in this context, nothing is given out: each result has it in its notes."""
    _silent.set(True)


def warn(message: str, category: type[Warning]) -> None:
    """Give out a warning of the function that calls this, as seen from where that was called."""
    if not _silent.get():
        warnings.warn(message, category, stacklevel=3)

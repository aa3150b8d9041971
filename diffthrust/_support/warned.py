"""Warnings that also stand in a result: given out, unless many results are on their way."""

from __future__ import annotations

import sys
import warnings
from contextvars import ContextVar

from diffthrust._support import progress

_silent: ContextVar[bool] = ContextVar("silent", default=False)


def silence() -> None:
    """From here on, in this context, nothing is given out: each result has it in its notes."""
    _silent.set(True)


def warn(message: str, category: type[Warning]) -> None:
    """Give out a warning of the module that calls this, as seen from where that was called."""
    if _silent.get():
        return
    # neither the module's own functions nor the decorator of the progress were called by the user
    inner = (sys._getframe(1).f_globals.get("__name__"), progress.__name__)
    level, frame = 3, sys._getframe(2)
    while frame.f_back is not None and frame.f_globals.get("__name__") in inner:
        level, frame = level + 1, frame.f_back
    warnings.warn(message, category, stacklevel=level)

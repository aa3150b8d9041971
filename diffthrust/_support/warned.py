"""Warnings that are also noted in the result: issued, except where many results are computed."""

from __future__ import annotations

import sys
import warnings
from contextvars import ContextVar

from diffthrust._support import progress

_silent: ContextVar[bool] = ContextVar("silent", default=False)


def silence() -> None:
    """Issue no warnings in this context from here on; each result keeps them in its notes."""
    _silent.set(True)


def warn(message: str, category: type[Warning]) -> None:
    """Issue a warning, attributed to the user's line that called the calling module."""
    if _silent.get():
        return
    # Skip the frames of the calling module and of the `progressing` decorator: the first frame
    # outside both is the user's line.
    inner = (sys._getframe(1).f_globals.get("__name__"), progress.__name__)
    level, frame = 3, sys._getframe(2)
    while frame.f_back is not None and frame.f_globals.get("__name__") in inner:
        level, frame = level + 1, frame.f_back
    warnings.warn(message, category, stacklevel=level)

"""Progress of long work: reported to a function of the caller, or shown as a bar with a clock."""

from __future__ import annotations

import shutil
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import copy_context
from functools import wraps
from html import escape
from inspect import signature
from typing import ParamSpec, TypeVar

from diffthrust._support.errors import InputError
from diffthrust._support.names import short_repr
from diffthrust._support.visible import visible

Progress = Callable[[str, float], None]
ProgressOption = Progress | bool | None
"""Values of ``progress``: a function of a message and the completed share, or True for a bar."""
_TICK = 0.5
"""Seconds between two updates of the clock."""
_PAUSE = 0.05
"""Minimum number of seconds between two drawings."""
_WIDEST = 100
"""Characters of the widest bar."""
_SURE = 0.05
"""Completed share from which the remaining time is estimated."""
_P = ParamSpec("_P")
_R = TypeVar("_R")


def progressing(work: Callable[_P, _R]) -> Callable[_P, _R]:
    """Let a function with a keyword ``progress`` accept True, which shows a bar while it works."""

    @wraps(work)
    def run(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        _check(kwargs.get("progress"))
        if kwargs.get("progress") is not True:
            return work(*args, **kwargs)
        with bar() as report:
            kwargs["progress"] = report
            return work(*args, **kwargs)

    return run


def _check(progress: object) -> None:
    """Raise `InputError` for what cannot receive progress, before hours of work and not after."""
    if isinstance(progress, bool | None):
        return
    found = short_repr(progress)
    if callable(progress):
        try:
            signature(progress).bind("message", 0.0)
            return
        except ValueError:  # a built-in function that does not say what it takes
            return
        except TypeError:
            found = "a function that does not take two arguments"
    raise InputError(
        f"progress: expected True, or a function of a message and the share done, found {found}.",
        "Write progress=True, or progress=lambda message, share: print(message, share).",
    )


def reporter(progress: ProgressOption) -> Progress:
    """The function that receives progress; does nothing without one. Shares never decrease.

    Work that underestimates what remains may report a smaller share later; that is not passed on.
    """
    if not callable(progress):
        return lambda message, share: None
    report, most = progress, 0.0

    def rising(message: str, share: float) -> None:
        nonlocal most
        most = max(most, min(share, 1.0))
        report(message, most)

    return rising


def subtask(report: Progress, first: float, last: float) -> Progress:
    """Report the progress of a subtask that takes the work from one share to another."""
    return lambda message, share: report(message, first + (last - first) * min(share, 1.0))


@contextmanager
def bar(begin: str = "working") -> Iterator[Progress | None]:
    """A bar that never goes back, with a running clock, on a terminal or in a notebook.

    Yields:
        The function that receives progress; None where output goes to a file or a pipe.

    Example:
        >>> with bar() as report:
        ...     fit(model, logs, progress=report)
    """
    draw = _place_to_draw()
    if draw is None:
        yield None
        return
    message, share_done, drawn = begin, 0.0, 0.0
    start = time.monotonic()
    over, drawing = threading.Event(), threading.Lock()

    def redraw() -> None:
        nonlocal drawn
        with drawing:
            drawn = time.monotonic()
            draw(_line(message, share_done, time.monotonic() - start))

    def report(words: str, share: float) -> None:
        nonlocal message, share_done
        message, share_done = words, max(share_done, min(share, 1.0))
        if time.monotonic() - drawn > _PAUSE:
            redraw()

    def tick() -> None:
        while not over.wait(_TICK):
            redraw()

    redraw()
    # A copy of this context: a notebook finds by it the cell that the clock's output belongs to.
    clock = threading.Thread(target=copy_context().run, args=(tick,), daemon=True)
    clock.start()
    try:
        yield report
    finally:
        over.set()
        clock.join()
        draw("")


def _line(message: str, share: float, seconds: float) -> str:
    """The current step, its share and the time taken, as wide as the terminal."""
    clock = _clock(seconds)
    if _SURE <= share < 1.0:
        clock += f", {_clock(seconds * (1.0 - share) / share)} left"
    room = min(_WIDEST, shutil.get_terminal_size().columns) - 1
    words = visible(message)[: room // 2]
    full = max(room - len(words) - len(clock) - 11, 1)
    return f"{words}  {100 * share:3.0f} % [{'#' * int(share * full):{full}}] {clock}"


def _clock(seconds: float) -> str:
    return f"{int(seconds) // 60:02d}:{int(seconds) % 60:02d}"


def _place_to_draw() -> Callable[[str], None] | None:
    """A function that draws a line over the previous one."""
    if sys.stderr.isatty():

        def draw(line: str) -> None:
            wide = min(_WIDEST, shutil.get_terminal_size().columns) - 1
            sys.stderr.write(f"\r{line:{wide}}" if line else f"\r{'':{wide}}\r")
            sys.stderr.flush()

        return draw
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    if not hasattr(shell, "kernel"):
        return None
    from IPython.display import display

    def cell_content(line: str) -> dict[str, str]:
        return {"text/plain": line, "text/html": f"<pre>{escape(line)}</pre>" if line else ""}

    cell = display(cell_content(""), raw=True, display_id=True)
    assert cell is not None
    return lambda line: cell.update(cell_content(line), raw=True)

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
_EARLY = 2.0
"""Seconds before which no share foretells: compiled programs come from a disk, or not."""
_LINES = 10.0
"""Seconds between two lines in a file or a pipe: short work is silent, and hours are no novel."""
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
    given = short_repr(progress)
    if callable(progress):
        try:
            signature(progress).bind("message", 0.0)
            return
        except ValueError:  # a built-in function that does not say what it takes
            return
        except TypeError:
            given = "a function that does not take two arguments"
    raise InputError(
        f"progress: expected True, or a function of a message and the share done, found {given}.",
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
def bar(begin: str = "working") -> Iterator[Progress]:
    """A bar that never goes back, with a running clock, on a terminal or in a notebook.

    Yields the function that receives progress. Where the error stream goes to a file or a pipe, a
    line of it tells every ten seconds how far the work is.
    """
    draw, has_bar = _place_to_draw()
    message, share_done, drawn = begin, 0.0, 0.0
    start = time.monotonic()
    remaining = Remaining()
    over, drawing = threading.Event(), threading.Lock()

    def redraw() -> None:
        nonlocal drawn
        with drawing:
            drawn = time.monotonic()
            seconds = time.monotonic() - start
            seconds_left = remaining.after(seconds, share_done)
            draw(_line(message, share_done, seconds, seconds_left, has_bar))

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


class Remaining:
    """The time that is left, as each share done foretells it; what is shown never grows.

    Shares promise too much now and then (the last 8 % of a diagnosis took longer than all before).
    Then nothing is said until less is left than was shown.
    """

    def __init__(self) -> None:
        self._share, self._end, self._shown = 0.0, float("nan"), float("inf")

    def after(self, seconds: float, share: float) -> float | None:
        """Seconds left, ``None`` where nothing can be said."""
        if share != self._share:
            self._share = share
            early = seconds < _EARLY or share < _SURE
            self._end = float("nan") if early else seconds / share
        remaining = self._end - seconds
        if not 0.0 <= remaining <= self._shown or share >= 1.0:
            return None
        self._shown = remaining
        return remaining


def _line(
    message: str, share: float, seconds: float, remaining: float | None, has_bar: bool
) -> str:
    """The current step, its share and the time taken; with a bar, as wide as the terminal."""
    clock = _clock(seconds) + (f", {_clock(remaining)} left" if remaining is not None else "")
    if not has_bar:
        return f"{100 * share:3.0f} % {clock}  {visible(message)}"
    room = min(_WIDEST, shutil.get_terminal_size().columns) - 1
    words = visible(message)[: room // 2]
    full = max(room - len(words) - len(clock) - 11, 1)
    return f"{words}  {100 * share:3.0f} % [{'#' * int(share * full):{full}}] {clock}"


def _clock(seconds: float) -> str:
    return f"{int(seconds) // 60:02d}:{int(seconds) % 60:02d}"


def _place_to_draw() -> tuple[Callable[[str], None], bool]:
    """A function that draws a line, and whether over the previous one, as a bar is drawn."""
    if sys.stderr.isatty():

        def draw(line: str) -> None:
            wide = min(_WIDEST, shutil.get_terminal_size().columns) - 1
            sys.stderr.write(f"\r{line:{wide}}" if line else f"\r{'':{wide}}\r")
            sys.stderr.flush()

        return draw, True
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    if not hasattr(shell, "kernel"):
        last = time.monotonic()

        def print_now_and_then(line: str) -> None:
            nonlocal last
            if line and time.monotonic() - last > _LINES:
                last = time.monotonic()
                print(line, file=sys.stderr, flush=True)

        return print_now_and_then, False
    from IPython.display import display

    def cell_content(line: str) -> dict[str, str]:
        return {"text/plain": line, "text/html": f"<pre>{escape(line)}</pre>" if line else ""}

    cell = display(cell_content(""), raw=True, display_id=True)
    assert cell is not None
    return lambda line: cell.update(cell_content(line), raw=True), True

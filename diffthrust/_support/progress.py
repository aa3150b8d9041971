"""How long work tells how far it is: to a function of the caller, or by a bar with a clock."""

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
from typing import ParamSpec, TypeVar

from diffthrust._support.visible import visible

Progress = Callable[[str, float], None]
ProgressOption = Progress | bool | None
"""What a caller may give for ``progress``: a function of a message and the share done, or True."""
_TICK = 0.5
"""Seconds between two turns of the clock."""
_PAUSE = 0.05
"""Seconds between two drawings at least."""
_WIDEST = 100
"""Characters of the widest bar."""
_SURE = 0.05
"""Of less than this share nothing can be told of the time left."""
_P = ParamSpec("_P")
_R = TypeVar("_R")


def progressing(work: Callable[_P, _R]) -> Callable[_P, _R]:
    """Let a function with a keyword ``progress`` take True for it: a bar, while it works."""

    @wraps(work)
    def run(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        if kwargs.get("progress") is not True:
            return work(*args, **kwargs)
        with bar() as tell:
            kwargs["progress"] = tell
            return work(*args, **kwargs)

    return run


def teller(progress: ProgressOption) -> Progress:
    """The function to tell, of shares that never fall; it does nothing where none was given.

    Work that does not know how much is left may tell of too little, but takes nothing back.
    """
    if not callable(progress):
        return lambda message, share: None
    tell, most = progress, 0.0

    def rising(message: str, share: float) -> None:
        nonlocal most
        most = max(most, min(share, 1.0))
        tell(message, most)

    return rising


def part(tell: Progress, first: float, last: float) -> Progress:
    """What tells the progress of a part of the work, which goes from one share to another."""
    return lambda message, share: tell(message, first + (last - first) * min(share, 1.0))


@contextmanager
def bar(begin: str = "working") -> Iterator[Progress | None]:
    """A bar that never goes back, with a clock that runs, on a terminal or in a notebook.

    Yields:
        The function to tell, or None where nobody looks: in files and pipes.

    Example:
        >>> with bar() as tell:
        ...     fit(model, logs, progress=tell)
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

    def tell(words: str, share: float) -> None:
        nonlocal message, share_done
        message, share_done = words, max(share_done, min(share, 1.0))
        if time.monotonic() - drawn > _PAUSE:
            redraw()

    def tick() -> None:
        while not over.wait(_TICK):
            redraw()

    redraw()
    # in this context, or a notebook does not know to which cell the clock belongs
    clock = threading.Thread(target=copy_context().run, args=(tick,), daemon=True)
    clock.start()
    try:
        yield tell
    finally:
        over.set()
        clock.join()
        draw("")


def _line(message: str, share: float, seconds: float) -> str:
    """What is done, how much of it, and for how long, as wide as the terminal."""
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
    """What draws a line over the last one."""
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

    def shown(line: str) -> dict[str, str]:
        return {"text/plain": line, "text/html": f"<pre>{escape(line)}</pre>" if line else ""}

    cell = display(shown(""), raw=True, display_id=True)
    assert cell is not None
    return lambda line: cell.update(shown(line), raw=True)

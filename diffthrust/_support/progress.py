"""How long work tells how far it is: to a function of the caller, or by a bar with a clock."""

from __future__ import annotations

import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import ParamSpec, TypeVar

Progress = Callable[[str, float], None]
ProgressOption = Progress | bool | None
"""What a caller may give for ``progress``: a function of a message and the share done, or True."""
_TICK = 0.5
"""Seconds between two turns of the clock."""
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
    """The function to tell; one that does nothing where none was given."""
    return progress if callable(progress) else lambda message, share: None


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
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    if not (sys.stderr.isatty() or hasattr(shell, "kernel")):
        yield None
        return
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # without ipywidgets a notebook has the bar as text
        from tqdm.auto import tqdm

    class Bar(tqdm):
        monitor_interval = 0

    Bar.set_lock(threading.RLock())
    form = "{desc} {percentage:3.0f} % |{bar}| {elapsed}"
    over = threading.Event()
    with Bar(desc=begin, total=100, bar_format=form, leave=False, dynamic_ncols=True) as shown:

        def tell(message: str, share: float) -> None:
            shown.n = max(shown.n, min(100 * share, 100))
            shown.set_description_str(message)

        def tick() -> None:
            while not over.wait(_TICK):
                shown.refresh()

        clock = threading.Thread(target=tick, daemon=True)
        clock.start()
        try:
            yield tell
        finally:
            over.set()
            clock.join()

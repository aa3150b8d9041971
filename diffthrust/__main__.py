"""Entry point of ``diffthrust`` and ``python -m diffthrust``."""

import atexit
import os
import sys
from contextlib import suppress

from diffthrust.cli._interrupt import ended_soon


def entry() -> None:
    """Entry point of the ``diffthrust`` command; Ctrl-C works from the start."""
    # Before the import of _app, which takes a second: Ctrl-C would print a traceback.
    with ended_soon():
        from diffthrust.cli._app import main

        try:
            main()
        except SystemExit as ended:
            watched = sys.getprofile() or sys.gettrace() or sys.flags.interactive
            if watched or not isinstance(ended.code, int | None):
                raise
            _leave(ended.code or 0)


def _leave(status: int) -> None:
    """End the process without the interpreter's own end, which takes as long as a small fit.

    It frees one after the other what JAX has traced and compiled: a sixth of `diffthrust fit`.
    """
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError, AttributeError):  # closed, or none at all
            stream.flush()
    os._exit(status)


if __name__ == "__main__":
    entry()

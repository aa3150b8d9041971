"""Entry point of ``diffthrust`` and ``python -m diffthrust.cli``."""

import atexit
import os
import sys

from diffthrust.cli._interrupt import ended_soon


def entry() -> None:
    """Entry point of the ``diffthrust`` command; Ctrl-C works from the start."""
    # Before the import of _app, which takes a second: Ctrl-C would print a traceback.
    with ended_soon():
        from diffthrust.cli._app import main

        try:
            main()
        except SystemExit as ended:
            _leave(ended)


def _leave(ended: SystemExit) -> None:
    """End the process without the interpreter's own end, which takes as long as a small fit.

    It frees one after the other what JAX has traced and compiled: a sixth of `diffthrust fit`.
    """
    if isinstance(ended.code, str):
        raise ended
    atexit._run_exitfuncs()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(ended.code or 0)


if __name__ == "__main__":
    entry()

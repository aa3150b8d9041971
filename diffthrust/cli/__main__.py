"""Entry point of ``diffthrust`` and ``python -m diffthrust.cli``."""

from diffthrust.cli._interrupt import ended_soon


def entry() -> None:
    """Entry point of the ``diffthrust`` command; Ctrl-C works from the start."""
    # Before the import of _app, which takes a second: Ctrl-C would print a traceback.
    with ended_soon():
        from diffthrust.cli._app import main

        main()


if __name__ == "__main__":
    entry()

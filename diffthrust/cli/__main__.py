"""Entry point of ``diffthrust`` and ``python -m diffthrust.cli``."""

from diffthrust.cli._interrupt import ended_soon


def entry() -> None:
    """Entry point of the ``diffthrust`` command; an interrupt is heard while it loads as well."""
    with ended_soon():
        from diffthrust.cli._app import main

        main()


if __name__ == "__main__":
    entry()

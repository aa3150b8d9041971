"""The command ``diffthrust cache``: what is kept between runs, and how to clear it."""

from __future__ import annotations

from typing import Annotated

import typer

from diffthrust.cli._session import session, show


def cache_command(
    clear: Annotated[bool, typer.Option("--clear", help="Delete the traced programs.")] = False,
) -> None:
    """Show what is kept between runs so that nothing is traced twice, or clear it.

    The environment variable DIFFTHRUST_CACHE names another folder; "off" switches it off.
    """
    with session():
        from diffthrust._support._running.stored import program_store

        store = program_store()
        if store is None:
            text = "Nothing is kept: DIFFTHRUST_CACHE is off, or the folder cannot be written to."
        else:
            sizes = [size for _, _, size in store.files()]
            lines = [
                f"{store.folder}: {len(sizes)} traced programs, {sum(sizes) / 1e6:.1f} MB of at "
                f"most {store.largest / 1e6:.0f} MB."
            ]
            if clear:
                store.shrink()
                lines.append(
                    "The programs are deleted. What JAX has compiled stays: the folder may serve "
                    "other projects; delete it by hand where it does not."
                )
            text = "\n".join(lines)
    show(text)

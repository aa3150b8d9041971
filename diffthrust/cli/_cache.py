"""The command ``diffthrust cache``: what is kept between runs, and how to clear it."""

from __future__ import annotations

from typing import Annotated

import typer

from diffthrust.cli._session import session, show


def cache_command(
    clear: Annotated[bool, typer.Option("--clear", help="Delete what is kept.")] = False,
) -> None:
    """Show what is kept between runs so that nothing is traced and compiled twice, or clear it.

    The environment variable DIFFTHRUST_CACHE names another folder; "off" switches it off.
    """
    with session():
        from diffthrust._support._running.stored import program_store

        store = program_store()
        if store is None:
            text = "Nothing is kept: DIFFTHRUST_CACHE is off, or the folder cannot be written to."
        else:
            lines = [f"{store.folder}, at most {store.largest / 1e6:.0f} MB"]
            for name, files in store.contents().items():
                lines.append(f"  {name:16s} {files.number:5d} files {files.size / 1e6:8.1f} MB")
            if clear:
                store.shrink()
                lines.append("All of it is deleted; the next run traces and compiles anew.")
            text = "\n".join(lines)
    show(text)

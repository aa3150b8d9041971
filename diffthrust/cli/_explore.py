"""The command ``diffthrust explore``: the workbench in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from diffthrust.cli._session import TrustOption, session


def explore_command(
    what: Annotated[
        Path,
        typer.Argument(
            metavar="SPEC|LOG|FIT",
            help="A spec file or its folder, a log or a folder of logs, or a saved fit or "
            "diagnosis.",
        ),
    ],
    no_browser: Annotated[
        bool, typer.Option("--no-browser", help="Print the address, and open no browser.")
    ] = False,
    port: Annotated[
        int, typer.Option("--port", min=0, max=65535, help="Listen there; 0 for any free one.")
    ] = 0,
    trust: TrustOption = None,
) -> None:
    """Look at logs, drag, add what is missing, and watch the error fall: a page in the browser."""
    with session() as progress:
        from diffthrust.workbench import explore

        progress("opening the logs", 0.0)
        bench = explore(what, trust=trust or (), browser=not no_browser, wait=False, port=port)
    typer.echo(f"The workbench: {bench.address}")
    typer.echo("It ends by Ctrl-C, or an hour after its page was closed.")
    bench.wait()

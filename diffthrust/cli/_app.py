"""The command line: all commands, in the order of the help."""

from __future__ import annotations

import os
import sys
from typing import Annotated

import typer
from typer import Option

from diffthrust.cli._demo import demo_command
from diffthrust.cli._fit import (
    compare_command,
    diagnose_command,
    export_command,
    fit_command,
    sample_command,
)
from diffthrust.cli._folders import campaign_command, check_command
from diffthrust.cli._interrupt import ended_soon
from diffthrust.cli._lists import cache_command, datasets_command, effects_command
from diffthrust.cli._look import explore_command, look_command
from diffthrust.cli._map import map_command
from diffthrust.cli._new import new_command, new_effect_command
from diffthrust.cli._session import BAD_INPUT, DONE

app = typer.Typer(
    name="diffthrust",
    help="Fit models of underwater thrusters and small vessels to logs, and see what they lack. "
    "A spec may name scripts, and these are run, as a Makefile's commands are.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    # Without this default Typer imports pydantic (0.1 s) to convert the None of an absent --help.
    context_settings={"default_map": {"help": False}},
)


def main() -> None:
    """Run the command."""
    with ended_soon():
        try:
            app()
        # Only printing the result can fail here (a full disk, a closed pipe): `session` has
        # reported all earlier errors.
        except OSError as error:
            # Python flushes standard output once more as it exits, and would fail a second time.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            why = error.strerror or error
            typer.echo(f"Error: the result cannot be printed ({why}).", err=True)
            typer.echo(
                "Mend: Redirect the output to a place with free space; the requested files are "
                "written.",
                err=True,
            )
            raise SystemExit(BAD_INPUT) from None


@app.callback(invoke_without_command=True)
def _start(version: Annotated[bool, Option("--version", help="Show the version.")] = False) -> None:
    if version:
        from diffthrust import __version__

        typer.echo(f"diffthrust {__version__}")
        raise typer.Exit(DONE)


for _command in (
    look_command,
    fit_command,
    compare_command,
    diagnose_command,
    explore_command,
    sample_command,
    campaign_command,
    datasets_command,
    map_command,
    export_command,
    check_command,
    new_command,
    new_effect_command,
    demo_command,
    effects_command,
    cache_command,
):
    _name = _command.__name__.removesuffix("_command").replace("_", "-")
    app.command(_name)(_command)


if __name__ == "__main__":
    main()

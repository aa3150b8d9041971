"""The command ``diffthrust new-effect``: a class of an effect of one's own, with its tests."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from diffthrust.cli._session import session, show, written


def new_effect_command(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Of the effect, and of its files.")],
    formula: Annotated[
        str,
        typer.Option("--formula", metavar="TEXT", help='The law: "-a * speed * abs(speed)**p".'),
    ],
    port: Annotated[
        str, typer.Option("--port", metavar="PORT", help="Where it acts: diffthrust effects.")
    ],
    parameter: Annotated[
        list[str] | None,
        typer.Option(
            "--parameter",
            metavar="NAME=UNIT",
            help="A parameter; with fields, 'p={ value = 1.5, bounds = [0.5, 3] }'.",
        ),
    ] = None,
    doc: Annotated[
        str, typer.Option("--doc", metavar="TEXT", help="What happens, in a sentence.")
    ] = "",
    directory: Annotated[
        Path, typer.Option("--directory", metavar="DIR", help="Where the files go.")
    ] = Path(),
) -> None:
    """Write NAME.py with the class of an effect, and test_NAME.py with tests that pass."""
    with session():
        from diffthrust.effects import Formula
        from diffthrust.effects._class_text import class_name
        from diffthrust.specs._new_effect import at_home, new_effect, parameter_asked

        asked = dict(map(parameter_asked, parameter or []))
        effect = at_home(Formula(port, formula, name=name, **asked))
        files = new_effect(effect, doc=doc, directory=directory)
    written(*files)
    show(
        f'Next: name it beside a spec, effects = ["{name}.py:{class_name(name)}"], and run '
        f"diffthrust fit; its tests: pytest {files[1]}"
    )

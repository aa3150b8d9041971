"""The command ``diffthrust diagnose``: what a model lacks."""

from __future__ import annotations

from typing import Annotated

import typer

from diffthrust._support.files import write_json
from diffthrust.cli._session import (
    JsonPath,
    ReportPath,
    SavePath,
    SpecPath,
    TrustOption,
    effect_names,
    session,
    show,
    written,
)


def diagnose_command(
    spec: SpecPath,
    candidates: Annotated[
        str | None,
        typer.Option(
            "--candidates",
            metavar="A,B,...",
            help="Effects to try, also script.py:Class, and fixed constants of the model; "
            "'all', the default, is the catalogue and every constant.",
        ),
    ] = None,
    json: JsonPath = None,
    report: ReportPath = None,
    save: SavePath = None,
    trust: TrustOption = None,
) -> None:
    """Find what a model lacks: where it fails, which effect is missing, what is undecided."""
    with session() as progress:
        from diffthrust.specs._spec import load_spec

        loaded = load_spec(spec, trust=trust or ())
        diagnosis = loaded.diagnose(progress=progress, candidates=effect_names(candidates))
        if save:
            diagnosis.save(save)
        if json:
            write_json(json, diagnosis.to_json())
        if report:
            diagnosis.save(report, title=f"Diagnosis: {loaded.name}", spec=loaded.text)
    show(diagnosis)
    written(json, report, save)

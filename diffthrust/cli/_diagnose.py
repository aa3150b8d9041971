"""The command ``diffthrust diagnose``: what a model lacks."""

from __future__ import annotations

from typing import Annotated

import typer

from diffthrust._support.files import write_json
from diffthrust.cli._session import (
    FittedPath,
    JsonPath,
    ReportPath,
    SavePath,
    TrustOption,
    effect_names,
    session,
    show,
    written,
)


def diagnose_command(
    spec: FittedPath,
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
    brief: Annotated[
        bool, typer.Option("--brief", help="Print the answer alone, and propose no test.")
    ] = False,
    trust: TrustOption = None,
) -> None:
    """Find what a model lacks: where it fails, which effect is missing, what is undecided."""
    with session() as progress:
        from diffthrust._support.results import report_of
        from diffthrust.saved._spec_of_fit import fitted_spec

        loaded, fit = fitted_spec(spec, trust or ())
        names = effect_names(candidates)
        diagnosis = loaded.diagnose(
            progress=progress, candidates=names, fit=fit, experiment=not brief
        )
        if save:
            diagnosis.save(save)
        if json:
            write_json(json, diagnosis.to_json())
        if not brief:  # its tables take a while, after all that is sought is found
            progress("how much is left to explain", 1.0)
        answer = diagnosis.summary if brief else report_of(diagnosis)
        if report:
            progress("writing the page", 1.0)
            diagnosis.save(report, title=f"Diagnosis: {loaded.name}", spec=loaded.text)
    show(answer)
    written(json, report, save)

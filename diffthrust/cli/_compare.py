"""The command ``diffthrust compare``: compare a model with its logs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from diffthrust._support.files import write_json
from diffthrust.cli._session import (
    FittedPath,
    JsonPath,
    ReportPath,
    TrustOption,
    session,
    show,
    write_figure,
    written,
)


def compare_command(
    spec: FittedPath,
    no_fit: Annotated[
        bool, typer.Option("--no-fit", help="Take the parameters as the spec gives them.")
    ] = False,
    json: JsonPath = None,
    report: ReportPath = None,
    figure: Annotated[
        Path | None,
        typer.Option("--figure", metavar="FILE.png", help="Draw the unseen logs, or all if none."),
    ] = None,
    trust: TrustOption = None,
) -> None:
    """Compare a model with its logs, run by run, after a fit or without one."""
    with session() as progress:
        from diffthrust.comparison._compare import comparison_report
        from diffthrust.comparison._page import comparisons_of, write_comparison_page
        from diffthrust.saved._spec_of_fit import fitted_spec

        loaded, fit = fitted_spec(spec, trust or ())
        train, holdout = loaded.train_logs(), loaded.holdout_logs()
        if no_fit:
            fit = None
        elif fit is None:
            fit = loaded.fit(progress=progress, train=train, holdout=holdout)
        comparisons = comparisons_of(fit or loaded.model, train, holdout)
        if json:
            parts = {name.split()[0]: c.to_json() for name, c in comparisons.items()}
            # The two comparisons share model and effects: JSON states them once, and the errors per
            # part.
            head = {k: next(iter(parts.values()))[k] for k in ("schema", "model", "effects")}
            short = {k: {n: v[n] for n in ("errors", "runs")} for k, v in parts.items()}
            short = {"train": short["training"], "holdout": short.get("unseen")}
            status = fit.status.value if fit else None
            write_json(json, {**head, "status": status, **short})
        if report:
            write_comparison_page(
                report, title=loaded.name, spec=loaded.text, comparisons=comparisons, fit=fit
            )
        if figure:
            write_figure(figure, list(comparisons.values())[-1].plot)
    if fit:
        show(f"Status: {fit.status.value}. {fit.message}")
    for name, comparison in comparisons.items():
        show(comparison_report(comparison, name))
    written(json, report, figure)

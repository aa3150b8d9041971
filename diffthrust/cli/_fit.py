"""The commands that hold a model against logs: ``fit``, ``compare`` and ``diagnose``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from diffthrust._support.files import write_json
from diffthrust.cli._session import (
    FittedPath,
    JsonPath,
    NoFitOption,
    ReportPath,
    SavePath,
    SpecPath,
    TrustOption,
    effect_names,
    figure_option,
    session,
    show,
    write_figure,
    written,
)


def fit_command(
    spec: SpecPath,
    json: JsonPath = None,
    report: ReportPath = None,
    save: SavePath = None,
    trust: TrustOption = None,
) -> None:
    """Estimate the free parameters of a model from logs, and test it on unseen logs."""
    with session() as progress:
        from diffthrust.comparison._page import comparisons_of, write_comparison_page
        from diffthrust.specs._spec import load_spec

        loaded = load_spec(spec, trust=trust or ())
        train, holdout = loaded.train_logs(), loaded.holdout_logs()
        fit = loaded.fit(progress=progress, train=train, holdout=holdout)
        if save:
            fit.save(save)
        if json:
            write_json(json, fit.to_json())
        if report:
            comparisons = comparisons_of(fit, train, holdout)
            write_comparison_page(
                report, title=loaded.name, spec=loaded.text, comparisons=comparisons, fit=fit
            )
    show(fit)
    written(json, report, save)


def compare_command(
    spec: FittedPath,
    no_fit: NoFitOption = False,
    json: JsonPath = None,
    report: ReportPath = None,
    figure: Annotated[Path | None, figure_option("Draw the unseen logs, or all if none.")] = None,
    trust: TrustOption = None,
) -> None:
    """Compare a model with its logs, run by run, after a fit or without one."""
    with session() as progress:
        from diffthrust.comparison._compare import comparison_report
        from diffthrust.comparison._page import comparisons_of, write_comparison_page
        from diffthrust.saved._load import fitted_spec

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
        from diffthrust.saved._load import fitted_spec

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

"""The command ``diffthrust fit``: estimate parameters from logs."""

from __future__ import annotations

from diffthrust._support.files import write_json
from diffthrust.cli._session import (
    JsonPath,
    ReportPath,
    SavePath,
    SpecPath,
    TrustOption,
    session,
    show,
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

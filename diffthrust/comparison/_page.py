"""The page of a fit, or of a comparison: parameters, errors, and a figure for each set of logs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

from diffthrust._support.files import write_page
from diffthrust._support.live import Live
from diffthrust._support.page import page, spec_section
from diffthrust._support.report import (
    Line,
    Outcome,
    Part,
    Picture,
    Report,
    Rows,
    Section,
    Styled,
    closing_section,
    notes,
)
from diffthrust._support.words import capitalised
from diffthrust.comparison._compare import Comparison, compare
from diffthrust.estimation._estimate import parameter_rows
from diffthrust.estimation._origin import closing
from diffthrust.estimation._per_log import per_log_section
from diffthrust.estimation._result import Fit, doubt_lines, error_rows
from diffthrust.estimation._status import Status
from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model

_ERRORS = (
    "NRMSE is the RMSE over the standard deviation of the measured channel. Fit % is 100 for a "
    "perfect model and 0 for one no better than the mean."
)


def comparisons_of(
    fitted: Fit | Model, train: Sequence[Log], unseen: Sequence[Log]
) -> dict[str, Comparison]:
    """A fit, or a model as it stands, held against its training and unseen logs, by heading."""
    # where no simulation succeeded, there are no estimated initial states to begin at
    initial = fitted.initial if isinstance(fitted, Fit) and _succeeded(fitted) else None
    out = {"training logs": compare(fitted, train, initial=initial)}
    if unseen:
        out["unseen logs"] = compare(fitted, unseen)
    return out


def write_comparison_page(
    path: Path,
    *,
    title: str,
    spec: str,
    comparisons: Mapping[str, Comparison],
    fit: Fit | None = None,
) -> None:
    """Write a page: parameters, errors and a figure for each comparison, and the spec."""
    model = next(iter(comparisons.values())).model
    errors = error_rows((name, comparison.errors) for name, comparison in comparisons.items())
    figures = [
        Section(
            capitalised(name),
            Picture(
                c.plot, f"Measured and modelled channels with residuals, {name}.", partial(_live, c)
            ),
        )
        for name, c in comparisons.items()
    ]
    report = Report(
        Section("", Line(("Model: ", Styled(str(model), "strong"))), *_fit_parts(fit)),
        Section("Parameters", parameter_rows(fit.parameters if fit else {})),
        per_log_section(fit.per_log if fit else {}, "Numbers by log"),
        Section("Errors", errors, _ERRORS, *notes(fit.notes if fit else ())),
        *figures,
        Section("Checks", _check_rows(fit) if fit and _succeeded(fit) else ""),
        closing_section(_closing(comparisons, fit)),
        spec_section(spec),
    )
    write_page(path, page(report, title))


def _succeeded(fit: Fit) -> bool:
    return fit.status is not Status.SIMULATION_FAILED


def _live(comparison: Comparison) -> Live | None:
    from diffthrust.comparison._run_plots import live_runs

    return live_runs({str(comparison.model): comparison.runs})


def _fit_parts(fit: Fit | None) -> tuple[Part, ...]:
    if fit is None:
        return ()
    status = Styled(fit.status.value, "good" if fit.status.ok else "bad")
    return (*doubt_lines(fit.doubts), Outcome("Status", status, fit.message))


def _closing(comparisons: Mapping[str, Comparison], fit: Fit | None) -> tuple[str, ...]:
    """Where the page comes from: its fit, or where there was none the comparisons."""
    if fit:
        return closing(fit.origin, fit.model)
    return tuple(dict.fromkeys(line for c in comparisons.values() for line in c.closing))


def _check_rows(fit: Fit) -> Rows:
    c = fit.checks
    rows = [
        ("gradient at the end (0 at a stationary point)", f"{c.gradient:.1e}"),
        ("rank of the scaled Jacobian", f"{c.rank} of {c.free_parameters}"),
        ("its condition number", f"{c.condition:.3g}"),
        ("starts that ended in the best optimum", f"{c.starts_agreeing} of {c.starts}"),
    ]
    return Rows.of((), rows, numbers=(1,))

"""The report of a posterior, as data."""

from __future__ import annotations

from diffthrust._support.report import (
    Outcome,
    Report,
    Rows,
    Section,
    Styled,
    closing_section,
    notes,
)
from diffthrust._support.results import report_of
from diffthrust._support.words import with_error
from diffthrust.uncertainty._prediction.tables import interval_text
from diffthrust.uncertainty._sampling.convergence import Convergence
from diffthrust.uncertainty._sampling.summary import Sampled

NO_UNSEEN_LOG = "There is no unseen log to hold the predictions against."
_HEADINGS = (
    *("Parameter", "Median", "95 % from", "to", "Unit"),
    *("R-hat", "ESS bulk", "ESS tail", "Fit ± std error"),
)


def draw_rows(sampled: Sampled) -> Rows:
    """One row for each parameter, with the fit's estimate at the end."""
    rows = []
    for name, s in sampled.parameters.items():
        fitted = sampled.fit.parameters.get(name) or (sampled.fit.disturbance or {}).get(name)
        estimate = "-"
        if fitted is not None:
            value, error = with_error(*fitted.shown[:2])
            estimate = value if fitted.std_error is None else f"{value} ± {error}"
        interval = interval_text(*(s.per * x for x in (s.median, s.low, s.high)))
        mixing = f"{s.rhat:.3f}", f"{s.ess_bulk:.0f}", f"{s.ess_tail:.0f}"
        rows.append((name, *interval, s.shown_unit, *mixing, estimate))
    return Rows.of(_HEADINGS, rows, numbers=(1, 2, 3, 5, 6, 7, 8))


def sample_report(sampled: Sampled) -> Report:
    """Convergence, the parameters, and how the predictions of unseen logs came out.

    Pages add the figures, and what the words mean.
    """
    return Report(
        Section("", Styled(str(sampled.fit.model), "strong"), outcome(sampled.convergence)),
        Section("", draw_rows(sampled)),
        *report_of(sampled.intervals).sections,
        *(section for p in sampled.predictions for section in report_of(p).sections),
        Section("", "" if sampled.predictions else NO_UNSEEN_LOG),
        Section("", *notes(sampled.fit.notes)),
        closing_section(sampled.closing),
    )


def outcome(convergence: Convergence) -> Outcome:
    """How well the chains mixed."""
    style = "good" if convergence.status.ok else "bad"
    status = Styled(convergence.status.value, style)
    return Outcome("Status", status, convergence.message)

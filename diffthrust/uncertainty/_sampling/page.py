"""The report of a posterior, as data, and its page with figures."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from diffthrust._support.files import write_page
from diffthrust._support.page import glossary, page, spec_section
from diffthrust._support.report import (
    Line,
    OnPage,
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
from diffthrust._support.results import report_of
from diffthrust._support.words import percent, with_error
from diffthrust.uncertainty._prediction.tables import interval_text
from diffthrust.uncertainty._sampling.figures import plot_corner, plot_trace
from diffthrust.uncertainty._sampling.summary import INTERVAL_LEVEL, Sampled

_NONE_UNSEEN = (
    "There is no unseen log to hold the predictions against. A posterior says how well the "
    "training logs determine the parameters if the model is right, not whether it is."
)
_HEADINGS = (
    *("Parameter", "Median", "95 % from", "to", "Unit"),
    *("R-hat", "ESS bulk", "ESS tail", "Fit ± std error"),
)
_MOST = 10
"""Parameters of the corner plot: more cannot be read."""
_METHODS = (
    "Intervals of each parameter by four methods. Covariance: the curvature of the likelihood at "
    "the fit. Sandwich: the scatter of its slope along the logs, which holds where residuals are "
    "correlated. Profile: where the likelihood, all else refitted, has fallen as far as the level "
    "allows. Posterior: the draws."
)
_CHAINS = (
    "The parameters along the chains. Chains that have converged look alike from the first draw to "
    "the last, and their halves have one distribution."
)
_GLOSSARY = {
    f"{percent(INTERVAL_LEVEL)} interval": "It holds the parameter with that probability, given "
    "the logs, the priors, and that the model and its noise law are right.",
    "R-hat": "Spread of all chains over that within each; 1 where they agree, at most 1.01 is "
    "wanted.",
    "ESS": "Effective sample size: how many independent draws these are worth, for the middle "
    "(bulk) and for the ends of the interval (tail); 400 are wanted.",
    "Predictive band": "Where the model, its parameters' uncertainty, and the noise of the sensors "
    "lead one to expect a measurement. Far fewer samples inside than the level of the band: "
    "something is missing from the model, or its errors last from sample to sample.",
}


def write_posterior_page(
    sampled: Sampled, path: Path | str, *, title: str = "", spec: str = ""
) -> None:
    """Write a posterior as one page, with the text of a spec file at its end."""
    report = Report(*sample_report(sampled).sections, spec_section(spec))
    write_page(Path(path), page(report, title or f"Posterior of the {sampled.fit.model}"))


def sample_report(sampled: Sampled) -> Report:
    """Convergence, the parameters, and how the predictions of unseen logs came out.

    Pages add the figures, and what the words mean.
    """
    fit, convergence = sampled.fit, sampled.convergence
    model = Line(("Model: ", Styled(str(fit.model), "strong"), f". Sampled by {sampled.method}."))
    mixed = Styled(convergence.status.value, "good" if convergence.status.ok else "bad")
    fitted = Styled(fit.status.value, "good" if fit.status.ok else "bad")
    names = [name for name in sampled.parameters if not name.startswith("noise.")]
    return Report(
        Section("", model, Outcome("Status", mixed, convergence.message)),
        Section(
            "Parameters",
            _draw_rows(sampled),
            Line(("The fit that was sampled: ", fitted, f". {fit.message}")),
            *notes(fit.notes),
        ),
        Section("How far to trust them", Picture(sampled.intervals.plot, _METHODS)),
        *report_of(sampled.intervals).sections,
        Section("Unseen logs", *_prediction_parts(sampled)),
        Section(
            "Parameters two by two",
            Picture(
                lambda: plot_corner(sampled.post, fit, names=names[:_MOST]),
                "Histograms of the parameters and contours of every pair.",
            ),
            OnPage(f"Not shown: {', '.join(names[_MOST:])}." if names[_MOST:] else ""),
        ),
        Section("The chains", Picture(lambda: plot_trace(sampled.post), _CHAINS)),
        glossary(_GLOSSARY),
        closing_section(sampled.closing),
    )


def _prediction_parts(sampled: Sampled) -> Iterator[Part]:
    if not sampled.predictions:
        yield _NONE_UNSEEN
    shown = notes(sampled.fit.notes)  # below the parameters
    for prediction in sampled.predictions:
        for section in report_of(prediction).sections:
            yield from (part for part in section.parts if part not in shown)
        yield Picture(
            prediction.plot,
            f"{prediction.log}: what was measured, the median of the predictions and their "
            f"{percent(INTERVAL_LEVEL)} bands; below each channel the same with the median taken "
            "off.",
        )


def _draw_rows(sampled: Sampled) -> Rows:
    """One row for each parameter, with the fit's estimate at the end."""
    rows = []
    for name, s in ((name, s.shown) for name, s in sampled.parameters.items()):
        fitted = sampled.fit.parameters.get(name) or (sampled.fit.disturbance or {}).get(name)
        estimate = "-"
        if fitted is not None:
            value, error = with_error(*fitted.shown[:2])
            estimate = value if fitted.std_error is None else f"{value} ± {error}"
        interval = interval_text(s.median, s.low, s.high)
        mixing = f"{s.rhat:.3f}", f"{s.ess_bulk:.0f}", f"{s.ess_tail:.0f}"
        rows.append((name, *interval, s.unit, *mixing, estimate))
    return Rows.of(_HEADINGS, rows, numbers=(1, 2, 3, 5, 6, 7, 8))

"""The page of a posterior: intervals, convergence, predictions and figures."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from diffthrust._support.files import write_page
from diffthrust._support.page import glossary, page, spec_section
from diffthrust._support.report import (
    Line,
    OnPage,
    Part,
    Picture,
    Report,
    Section,
    Styled,
    closing_section,
    notes,
)
from diffthrust._support.results import report_of
from diffthrust._support.words import percent
from diffthrust.estimation._result import Fit
from diffthrust.uncertainty._prediction.predict import Prediction
from diffthrust.uncertainty._sampling.figures import plot_corner, plot_trace
from diffthrust.uncertainty._sampling.summary import INTERVAL_LEVEL, Sampled
from diffthrust.uncertainty._sampling.tables import NO_UNSEEN_LOG, draw_rows, outcome

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
    model = str(sampled.fit.model)
    names = [name for name in sampled.parameters if not name.startswith("noise.")]
    report = Report(
        Section(
            "",
            Line(("Model: ", Styled(model, "strong"), f". Sampled by {sampled.method}.")),
            outcome(sampled.convergence),
        ),
        Section("Parameters", draw_rows(sampled), *_fit_parts(sampled.fit)),
        Section("How far to trust them", Picture(sampled.intervals.plot, _METHODS)),
        *report_of(sampled.intervals).sections,
        Section("Unseen logs", *_prediction_parts(sampled.predictions)),
        Section(
            "Parameters two by two",
            Picture(
                lambda: plot_corner(sampled.post, sampled.fit, names=names[:_MOST]),
                "Histograms of the parameters and contours of every pair.",
            ),
            OnPage(f"Not shown: {', '.join(names[_MOST:])}." if names[_MOST:] else ""),
        ),
        Section("The chains", Picture(lambda: plot_trace(sampled.post), _CHAINS)),
        glossary(_GLOSSARY),
        closing_section(sampled.closing),
        spec_section(spec),
    )
    write_page(Path(path), page(report, title or f"Posterior of the {model}"))


def _fit_parts(fit: Fit) -> tuple[Part, ...]:
    status = Styled(fit.status.value, "good" if fit.status.ok else "bad")
    return Line(("The fit that was sampled: ", status, f". {fit.message}")), *notes(fit.notes)


def _prediction_parts(predictions: tuple[Prediction, ...]) -> Iterator[Part]:
    if not predictions:
        yield (
            f"{NO_UNSEEN_LOG} A posterior says how well the training logs determine the parameters "
            "if the model is right, not whether it is."
        )
    for prediction in predictions:
        yield prediction.sentence
        yield from notes(prediction.notes)
        yield Picture(
            prediction.plot,
            f"{prediction.log}: what was measured, the median of the predictions and their "
            f"{percent(INTERVAL_LEVEL)} bands; below each channel the same with the median taken "
            "off.",
        )

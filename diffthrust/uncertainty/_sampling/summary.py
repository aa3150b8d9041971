"""A posterior summarised: parameters, convergence and predictions, its report and its page."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

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
from diffthrust._support.results import Brief, report_of
from diffthrust._support.saved_file import Decoder
from diffthrust._support.words import percent, with_error
from diffthrust.estimation._origin import Origin, closing
from diffthrust.estimation._result import Fit
from diffthrust.logs._log import Log
from diffthrust.uncertainty._intervals import Intervals, intervals
from diffthrust.uncertainty._prediction.draws import posterior_data, scalars_of
from diffthrust.uncertainty._prediction.predict import Prediction, predict
from diffthrust.uncertainty._sampling.arviz import shown_in
from diffthrust.uncertainty._sampling.convergence import Convergence, convergence
from diffthrust.uncertainty._tables import interval_text
from diffthrust.uncertainty._values import Shown, central

INTERVAL_LEVEL = 0.95


@dataclass(frozen=True)
class Summary(Shown):
    """The draws of one parameter: a 95 % interval of equal tails, and how well the chains mixed."""

    _in_unit = ("median", "low", "high", "mean", "sd")

    median: float
    low: float
    high: float
    mean: float
    sd: float
    rhat: float
    ess_bulk: float
    ess_tail: float
    unit: str
    per: float
    shown_unit: str

    def to_json(self) -> dict[str, Any]:
        """Plain data, in the parameter's unit and in the display unit."""
        mixing = {name: getattr(self, name) for name in ("rhat", "ess_bulk", "ess_tail")}
        return mixing | self._json(*self._in_unit, "unit")


@dataclass(frozen=True, repr=False)
class Sampled(Brief):
    """The content of the report of ``diffthrust sample``.

    A `Summary` of each parameter of the model and its noise, posterior intervals next to the other
    ones, and a prediction of each unseen log.
    """

    post: Any = field(repr=False)
    fit: Fit = field(repr=False)
    convergence: Convergence
    parameters: Mapping[str, Summary]
    intervals: Intervals
    predictions: tuple[Prediction, ...]

    @property
    def method(self) -> str:
        """The sampler."""
        return str(posterior_data(self.post).attrs.get("method", ""))

    @property
    def closing(self) -> tuple[str, ...]:
        """The last lines of the report: date, versions, hashes, and sources of the effects."""
        text = posterior_data(self.post).attrs.get("origin")
        origin = Decoder({}, {}, {}).decoded(Origin, json.loads(text)) if text else None
        return closing(origin, self.fit.model)

    @property
    def coverage(self) -> dict[str, float]:
        """Share of the samples of all unseen logs inside their bands, by channel."""
        counts: dict[str, list[tuple[float, int]]] = {}
        for prediction in self.predictions:
            for name, band in prediction.channels.items():
                if band.samples:
                    counts.setdefault(name, []).append((band.coverage, band.samples))
        return {
            name: sum(share * n for share, n in parts) / sum(n for _, n in parts)
            for name, parts in counts.items()
        }

    def to_json(self) -> dict[str, Any]:
        """The posterior's summary, as written by ``diffthrust sample --json``."""
        coverage = None
        if self.predictions:
            coverage = {
                "level": INTERVAL_LEVEL,
                "channels": self.coverage,
                "logs": [p.to_json() for p in self.predictions],
            }
        return {
            "schema": 1,
            "model": self.fit.model.name,
            "effects": [effect.name for effect in self.fit.model.effects],
            "status": self.convergence.status.value,
            "message": self.convergence.message,
            "method": self.method,
            "draws": self.convergence.draws,
            "parameters": {name: s.to_json() for name, s in self.parameters.items()},
            "intervals": self.intervals.to_json(),
            "coverage": coverage,
        }

    def _line(self) -> str:
        return f"{self.fit.model}: {self.convergence.status}, {len(self.parameters)} parameters"


def sampled(
    post: Any, fit: Fit, logs: Sequence[Log], unseen: Sequence[Log], *, seed: int = 0
) -> Sampled:
    """Summarise what `sample` gave, and compare its predictions with unseen logs, if any."""
    posterior = posterior_data(post)
    judged = convergence(post)
    parameters = {}
    for name, values in scalars_of(posterior).items():
        low, median, high = map(float, central(values, INTERVAL_LEVEL))
        mean, sd = float(values.mean()), float(values.std(ddof=1))
        mixing = judged.r_hat[name], judged.ess_bulk[name], judged.ess_tail[name]
        unit, size = str(posterior[name].attrs.get("unit", "")), shown_in(posterior[name])
        parameters[name] = Summary(median, low, high, mean, sd, *mixing, unit, *size)
    bands = tuple(predict(post, fit, log, level=INTERVAL_LEVEL, seed=seed) for log in unseen)
    side_by_side = intervals(fit, logs, post, level=INTERVAL_LEVEL)
    return Sampled(post, fit, judged, parameters, side_by_side, bands)


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
    from diffthrust.uncertainty._sampling.figures import plot_corner, plot_trace

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

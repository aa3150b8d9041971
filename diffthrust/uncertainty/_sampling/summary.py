"""A posterior summarised: intervals, convergence, and the coverage of its predictions."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from diffthrust._support.lossless import Decoder
from diffthrust._support.results import Brief
from diffthrust.estimation._origin import Origin, closing
from diffthrust.estimation._result import Fit
from diffthrust.logs._log import Log
from diffthrust.uncertainty._intervals import Intervals, intervals
from diffthrust.uncertainty._prediction.draws import posterior_data, scalars_of
from diffthrust.uncertainty._prediction.predict import Prediction, predict
from diffthrust.uncertainty._sampling.arviz import shown_in
from diffthrust.uncertainty._sampling.convergence import Convergence, convergence
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

"""A posterior summarised: intervals, convergence, and the coverage of its predictions."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from diffthrust._support.lossless import Decoder
from diffthrust._support.results import Brief
from diffthrust.estimation._origin import Origin, closing
from diffthrust.estimation._result import Fit
from diffthrust.logs._log import Log
from diffthrust.uncertainty._intervals import intervals
from diffthrust.uncertainty._prediction.draws import posterior_data
from diffthrust.uncertainty._prediction.predict import Prediction, predict
from diffthrust.uncertainty._results import Intervals
from diffthrust.uncertainty._sampling.arviz import shown_in
from diffthrust.uncertainty._sampling.convergence import Convergence, convergence
from diffthrust.uncertainty._values import Shown

INTERVAL_LEVEL = 0.95


@dataclass(frozen=True)
class Summary(Shown):
    """The draws of one parameter, in ``unit``.

    Args:
        median: of the draws.
        low: lower end of the 95 % interval, with equal tails.
        high: upper end.
        mean: of the draws.
        sd: their standard deviation.
        rhat: 1 where the chains agree.
        ess_bulk: effective samples for the mean.
        ess_tail: effective samples for the ends of the interval.
        unit: of the first five.
        per: number of ``shown_unit`` per ``unit``.
        shown_unit: display unit.
    """

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
        kept = {k: v for k, v in vars(self).items() if k not in ("per", "shown_unit")}
        written = {k: getattr(self.shown, k) for k in (*self._in_unit, "unit")}
        return {**kept, "written": written}


@dataclass(frozen=True, repr=False)
class Sampled(Brief):
    """The content of the report of ``diffthrust sample``.

    Args:
        post: the posterior.
        fit: the fit that was sampled.
        convergence: how well the chains mixed.
        parameters: a `Summary` by name, for parameters of the model and its noise.
        intervals: posterior intervals next to covariance, sandwich and profile.
        predictions: one for each unseen log.
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
    for name, variable in posterior.data_vars.items():
        if set(variable.dims) != {"chain", "draw"}:
            continue
        values, size = np.asarray(variable.values, float), shown_in(variable)
        ends = [0.5 * (1 - INTERVAL_LEVEL), 0.5, 0.5 * (1 + INTERVAL_LEVEL)]
        low, median, high = np.quantile(values, ends)
        parameters[str(name)] = Summary(
            median=float(median),
            low=float(low),
            high=float(high),
            mean=float(values.mean()),
            sd=float(values.std(ddof=1)),
            rhat=judged.r_hat.get(str(name), float("nan")),
            ess_bulk=judged.ess_bulk.get(str(name), float("nan")),
            ess_tail=judged.ess_tail.get(str(name), float("nan")),
            unit=str(variable.attrs.get("unit", "")),
            per=size.value,
            shown_unit=size.unit,
        )
    bands = tuple(predict(post, fit, log, level=INTERVAL_LEVEL, seed=seed) for log in unseen)
    side_by_side = intervals(fit, logs, post, level=INTERVAL_LEVEL)
    return Sampled(post, fit, judged, parameters, side_by_side, bands)

"""Missing signals: what would have to act at a port, whatever its form, and what it depends on."""

from __future__ import annotations

from typing import Any

import numpy as np

from diffthrust._diagnosis import Missing
from diffthrust._places import Place, slopes_along
from diffthrust._smoother import Errors, smoothed
from diffthrust._structure import bases, ratio_of, signals_at, unknown
from diffthrust._trials import Trial, Trials, side_by_side

Curve = tuple[np.ndarray, np.ndarray, np.ndarray]


def missing_signals(trials: Trials, trial: Trial) -> tuple[Missing, ...]:
    """The missing signal at each place, the one that explains most first."""
    found = []
    for place in trials.places:
        signals = signals_at(trials, place, trial)
        runs = _runs(trials, place, trial)
        wobble = np.concatenate([signal for _, signal, _ in runs])
        nothing = (np.empty(0), np.empty(0), np.empty(0))
        best: tuple[float, str | None, float, float, Curve] = (1.0, None, 0.0, 0.0, nothing)
        tests = bases(signals)

        def tested(series: list[np.ndarray], port: str = place.port) -> Any:
            return unknown(trials, port, trial, series)

        answers = side_by_side(tested, [series for series, _ in tests.values()])
        for (name, (series, knots)), answer in zip(tests.items(), answers, strict=True):
            p, coefficients, covariance = answer
            if p < best[0]:
                fitted = np.concatenate([coefficients @ s for s in series])
                share = _alike(fitted, wobble)
                gain = ratio_of(coefficients, covariance)
                errors = np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
                best = (p, name, share, gain, (knots, coefficients, errors))
        p, name, share, gain, curve = best
        adjusted = min(1.0, p * max(1, len(tests)))
        depends = name if adjusted < 0.05 else None
        found.append(
            Missing(
                port=place.port,
                unit=unit_at(trials, place),
                runs=tuple(runs),
                depends_on=depends,
                dependence_unit=unit_of(trials, depends) if depends else "",
                share=share if depends else 0.0,
                p_value=adjusted,
                curve=curve if depends else nothing,
                logs=tuple(log.name for log in trials.logs),
                gain=gain if depends else 0.0,
            )
        )
    return tuple(sorted(found, key=lambda m: (-m.gain, m.p_value)))


def _alike(fitted: np.ndarray, signal: np.ndarray) -> float:
    """Share of a signal's variance that goes with another."""
    seen = np.isfinite(signal)
    both = np.array([fitted[seen], signal[seen]])
    (own, cross), (_, whole) = np.cov(both) if seen.sum() > 1 else np.zeros((2, 2))
    return float(cross**2 / (own * whole)) if own * whole > 0 else 0.0


def _runs(
    trials: Trials, place: Place, trial: Trial
) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Time, missing signal and its standard error of each log, in the unit of the port."""
    model = trials.with_values(trials.model, trial.values)
    channel = place.target
    paths, runs = trials.path(trial), []
    for path, log in zip(paths, trials.problem.logs, strict=True):
        step = np.diff(path["time"], append=2 * path["time"][-1] - path["time"][-2])
        decay, push = slopes_along(model, path, place)
        still = np.zeros_like(step)
        if channel not in log.measured:
            runs.append(Errors(np.full_like(step, np.nan), still, still, still, still))
            continue
        seen = np.where(np.isnan(log.measured[channel]), np.nan, path[f"rest.{channel}"])
        if place.output:
            runs.append(Errors(seen, still, still, still, push))
            continue
        turned = (path[channel] < 0) & (channel in log.unsigned)
        grown = np.expm1(np.clip(decay * step, -50.0, 1.0))
        within = np.where(grown == 0, step, grown / np.where(decay == 0, 1.0, decay))
        kept, seen = 1.0 + grown, np.where(turned, -seen, seen)
        undone = kept * path.get(f"moved.{channel}", 0.0) + within * path.get(
            f"pushed.{channel}", 0.0
        )
        runs.append(Errors(seen, kept, undone, within * push, still))
    step = trials.logs[0].step
    lasting = float(np.exp(-step / trial.values.get(f"noise.{channel}.correlation", step)))
    found = smoothed(runs, lasting)
    return [(path["time"], *one) for path, one in zip(paths, found, strict=True)]


def unit_at(trials: Trials, place: Place) -> str:
    """The unit of what passes a port: the one that its description ends with."""
    text = trials.model.ports[place.port]
    return text[text.rfind("[") + 1 : -1] if text.endswith("]") else ""


def unit_of(trials: Trials, signal: str) -> str:
    """The unit of an input, state or output, or of its rate."""
    units = {**trials.model.inputs, **trials.model.optional_inputs, **trials.model.all_states}
    units |= {f"d({n})/dt": f"{u}/s" for n, u in trials.model.states.items()}
    return {**units, "time": "s"}.get(signal, "")

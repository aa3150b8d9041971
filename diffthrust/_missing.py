"""Missing signals: what would have to act at a port, whatever its form, and what it depends on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from diffthrust._diagnosis import Missing, Remaining
from diffthrust._places import Place, hats, knots_of, slopes_along
from diffthrust._smoother import Errors, smoothed
from diffthrust._trials import Trial, Trials

Curve = tuple[np.ndarray, np.ndarray, np.ndarray]

LEVEL = 0.01
"""False alarms of "unexplained", over all ports and signals together."""
LEAST = 0.01
"""Structure that explains less of the squared one-step errors is not worth a word: the difference
between two ways to integrate the same physics comes to as much."""


def signals_at(trials: Trials, place: Place, trial: Trial) -> dict[str, list[np.ndarray]]:
    """The signals on which something missing at a place may depend, log by log.

    All are known before the sample whose error they are to explain (a smoothed rate would contain
    that very error): the rate is the one that the model predicts.
    """
    paths = trials.path(trial)
    model = trials.model
    names = [n for n in (*model.inputs, *model.optional_inputs) if n in paths[0]]
    names += [n for n in model.states if n in paths[0] and n in trials.problem.layout.channels]
    out = {n: [path[n] for path in paths] for n in dict.fromkeys(names)}
    if place.state:
        rates = [one[place.port] for one in trials.readings(paths)]
        out[f"d({place.state})/dt"] = [np.asarray(rate) for rate in rates]
    out["time"] = [path["time"] - path["time"][0] for path in paths]
    return out


def bases(
    signals: Mapping[str, Sequence[np.ndarray]],
) -> dict[str, tuple[list[np.ndarray], np.ndarray]]:
    """For each signal its piecewise-linear basis log by log, and the knots."""
    out = {}
    for name, series in signals.items():
        pooled = np.concatenate(series)
        if np.ptp(pooled) <= 1e-9 * (1.0 + np.max(np.abs(pooled))):
            continue  # a constant
        knots = knots_of(pooled)
        out[name] = ([hats(one, knots) for one in series], knots)
    return out


def missing_signals(trials: Trials, trial: Trial) -> tuple[Missing, ...]:
    """The missing signal at each place, the one that explains most first."""
    found = []
    for place in trials.places:
        signals = signals_at(trials, place, trial)
        runs = _runs(trials, place, trial)
        wobble = np.concatenate([signal for _, signal, _ in runs])
        nothing = (np.empty(0), np.empty(0), np.empty(0))
        best: tuple[float, str | None, float, Curve] = (1.0, None, 0.0, nothing)
        tests = bases(signals)
        for name, (series, knots) in tests.items():
            p, coefficients, covariance = trials.unknown(place.port, trial, series)
            if p < best[0]:
                fitted = np.concatenate([coefficients @ s for s in series])
                share = float(np.var(fitted) / max(np.var(wobble), np.var(fitted), 1e-300))
                errors = np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
                best = (p, name, share, (knots, coefficients, errors))
        p, name, share, curve = best
        adjusted = min(1.0, p * max(1, len(tests)))
        depends = name if adjusted < 0.05 else None
        found.append(
            Missing(
                port=place.port,
                unit=trials.unit_at(place),
                runs=tuple(runs),
                depends_on=depends,
                dependence_unit=trials.unit_of(depends) if depends else "",
                share=share if depends else 0.0,
                p_value=adjusted,
                curve=curve if depends else nothing,
            )
        )
    return tuple(sorted(found, key=lambda m: (-m.share, m.p_value)))


def remaining_structure(trials: Trials, trial: Trial) -> Remaining | None:
    """The place and signal on which the errors still depend, if they do."""
    found = []
    for place in trials.places:
        for name, (series, _) in bases(signals_at(trials, place, trial)).items():
            p, coefficients, covariance = trials.unknown(place.port, trial, series)
            gain = float(coefficients @ np.linalg.pinv(covariance, hermitian=True) @ coefficients)
            found.append((p, place.port, name, gain))
    seen = [
        (gain, port, name, 1.0 - float(np.exp(-gain / trials.samples)))
        for p, port, name, gain in found
        if p < LEVEL / len(found)
    ]
    worth = [one for one in seen if one[3] >= LEAST]
    if not worth:
        return None
    _, port, name, share = max(worth)
    return Remaining(port, name, share)


def _runs(
    trials: Trials, place: Place, trial: Trial
) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Time, missing signal and its standard error of each log, in the unit of the port."""
    model = trials.with_values(trials.model, trial.values)
    channel = place.state or place.output
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
        undone = kept * path[f"moved.{channel}"] + within * path.get(f"pushed.{channel}", 0.0)
        runs.append(Errors(seen, kept, undone, within * push, still))
    step = trials.logs[0].step
    lasting = float(np.exp(-step / trial.values.get(f"noise.{channel}.correlation", step)))
    found = smoothed(runs, lasting)
    return [(path["time"], *one) for path, one in zip(paths, found, strict=True)]

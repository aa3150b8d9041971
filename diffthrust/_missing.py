"""Missing signals: what would have to act at a port, whatever its form, and what it depends on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from diffthrust._diagnosis import Missing, Remaining
from diffthrust._places import Place, hats, knots_of, slopes_at
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
    rates, outputs = slopes_at(trials.model, trials.logs[0])
    target = place.state or place.output or ""
    slope = float((rates if place.state else outputs)[target][1][place.port])
    out = []
    for path in trials.path(trial):
        time = path["time"]
        if place.state:
            step = np.diff(time, append=2 * time[-1] - time[-2])
            gain = trial.values.get(f"noise.{place.state}.gain.{place.state}", 0.0)
            error = path.get(f"error.{place.state}", np.zeros_like(time))
            raw = path.get(f"drift.{place.state}", np.zeros_like(time)) + gain * error / step
        else:
            raw = path[f"rest.{target}"]
        smooth, spread = _smooth(raw / slope)
        out.append((time, smooth, spread))
    return out


def _smooth(raw: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Smoothed series and its standard error: a running mean as wide as cross-validation likes."""
    best: tuple[float, np.ndarray, np.ndarray] | None = None
    for half in (1, 2, 4, 8, 16, 32):
        if 4 * half + 2 > raw.size:
            break
        weights = np.hanning(2 * half + 3)[1:-1]
        weights /= weights.sum()
        wide = np.convolve(np.pad(raw, half, mode="edge"), weights, mode="valid")
        own = weights[half]
        left_out = (raw - wide) / (1.0 - own)
        score = float(np.mean(left_out**2))
        if best is None or score < best[0]:
            noise = np.sqrt(np.mean((raw - wide) ** 2) / max(1e-9, (1.0 - own)))
            error = np.full(raw.size, noise * np.sqrt(np.sum(weights**2)))
            best = (score, wide, error)
    if best is None:
        return raw, np.zeros_like(raw)
    return best[1], best[2]

"""Missing signals: what would have to act at a port, whatever its form, and what it depends on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from diffthrust._diagnosis import Missing, Remaining
from diffthrust._places import Place, hats, knots_of, slopes_along
from diffthrust._smoother import Errors, smoothed
from diffthrust._trials import Trial, Trials, side_by_side

NAMED = 0.05
"""Once there is structure, it is told by the largest that a single test would find."""
PAST = (20, 100)
"""Samples over which the past of a signal is remembered."""

Curve = tuple[np.ndarray, np.ndarray, np.ndarray]

LEVEL = 0.01
"""False alarms of "unexplained", over all ports and signals together."""
LEAST = 0.01
"""Structure that explains less of the squared one-step errors is not worth a word: the difference
between two ways to integrate the same physics comes to as much."""


def signals_at(trials: Trials, place: Place, trial: Trial) -> dict[str, list[np.ndarray]]:
    """The signals on which something missing at a place may depend, log by log.

    All are known before the sample whose error they are to explain (a smoothed rate would contain
    that very error): the rate of a state is the one that the model predicts.
    """
    paths = trials.path(trial)
    model = trials.model
    names = [n for n in (*model.inputs, *model.optional_inputs) if n in paths[0]]
    names += [n for n in model.states if n in paths[0] and n in trials.problem.layout.channels]
    out = {n: [path[n] for path in paths] for n in dict.fromkeys(names)}
    ports = trials.readings(paths)
    for other in trials.places:
        if other.state and place.state in (other.state, None):
            out[f"d({other.state})/dt"] = [np.asarray(one[other.port]) for one in ports]
    for name in model.states:  # one that the log prescribes moves as it was recorded
        if name in trials.logs[0].inputs:
            out[name] = [path[name] for path in paths]
            out[f"d({name})/dt"] = [np.gradient(path[name], path["time"]) for path in paths]
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

        def tested(series: list[np.ndarray], port: str = place.port) -> Any:
            return trials.unknown(port, trial, series)

        answers = side_by_side(tested, [series for series, _ in tests.values()])
        for (name, (series, knots)), answer in zip(tests.items(), answers, strict=True):
            p, coefficients, covariance = answer
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
                logs=tuple(log.name for log in trials.logs),
            )
        )
    return tuple(sorted(found, key=lambda m: (-m.share, m.p_value)))


def remaining_structure(trials: Trials, trial: Trial) -> Remaining | None:
    """The place and signal on which the errors still depend, if they do.

    At each place a sum with a function of one signal is tried, and at each port behind it a factor
    that is one; of the signals as they are, and of their recent past, which tells of states that
    the model lacks.
    """
    paths = trials.path(trial)
    ports = trials.readings(paths)
    tests = []
    for place in trials.places:
        signals = signals_at(trials, place, trial)
        factors = _factors(trials.behind(place), ports)
        for name, (series, _) in bases({**signals, **_past(signals, paths)}).items():
            tests.append((place, place.port, name, "adds", series))
            for port, factor in factors.items():
                scaled = [s * f for s, f in zip(series, factor, strict=True)]
                tests.append((place, port, name, "scales", scaled))

    def tested(test: Any) -> tuple[float, float, Remaining]:
        place, port, name, manner, series = test
        p, coefficients, covariance = trials.unknown(place.port, trial, series)
        if np.isnan(covariance).any():  # nothing of it shows beside the estimated parameters
            return 0.0, 1.0, Remaining(port, name, 0.0, manner)
        gain = float(coefficients @ np.linalg.pinv(covariance, hermitian=True) @ coefficients)
        share = 1.0 - float(np.exp(-gain / trials.samples_at(place)))
        return gain, p, Remaining(port, name, share, manner)

    found = side_by_side(tested, tests)
    worth = [one for one in found if one[2].share >= LEAST]
    if not any(p < LEVEL / len(found) for _, p, _ in worth):
        return None
    gain, _, left = max((one for one in worth if one[1] < NAMED), key=lambda one: one[0])
    return replace(left, gain=gain)


def _factors(
    names: Sequence[str], ports: Sequence[Mapping[str, np.ndarray]]
) -> dict[str, list[np.ndarray]]:
    """What passes some ports, log by log and of unit size; of several that go alike, the first."""
    found: dict[str, list[np.ndarray]] = {}
    for name in names:
        level = np.sqrt(np.mean(np.concatenate([one[name] for one in ports]) ** 2))
        unit = [one[name] / max(level, 1e-300) for one in ports]
        joined = np.concatenate(unit)
        alike = (abs(np.mean(joined * np.concatenate(other))) for other in found.values())
        if level > 0 and not any(one > 1.0 - 1e-9 for one in alike):
            found[name] = unit
    return found


def _past(
    signals: Mapping[str, Sequence[np.ndarray]], paths: Sequence[Mapping[str, np.ndarray]]
) -> dict[str, list[np.ndarray]]:
    """The running means of inputs and states over some recent samples, log by log."""
    found = {}
    for name, series in signals.items():
        if name == "time" or name.startswith("d("):
            continue
        for samples in PAST:
            told = f"the last {samples * _step(paths[0]):.2g} s of {name}"
            found[told] = [_recent(one, samples) for one in series]
    return found


def _step(path: Mapping[str, np.ndarray]) -> float:
    return float(np.median(np.diff(path["time"])))


def _recent(series: np.ndarray, samples: int) -> np.ndarray:
    """Mean of the past of a series that forgets over so many samples."""
    from scipy.signal import lfilter  # slow to import

    kept = np.exp(-1.0 / samples)
    return lfilter([1.0 - kept], [1.0, -kept], series, zi=[kept * series[0]])[0]


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
        undone = kept * path[f"moved.{channel}"] + within * path.get(f"pushed.{channel}", 0.0)
        runs.append(Errors(seen, kept, undone, within * push, still))
    step = trials.logs[0].step
    lasting = float(np.exp(-step / trial.values.get(f"noise.{channel}.correlation", step)))
    found = smoothed(runs, lasting)
    return [(path["time"], *one) for path, one in zip(paths, found, strict=True)]

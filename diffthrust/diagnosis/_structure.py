"""Structure that remains in the errors: at which place, and on which signal it depends."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from diffthrust.diagnosis._ports import KNOTS, Place, hats, knots_of
from diffthrust.diagnosis._result import Remaining
from diffthrust.diagnosis._score_test import score_test
from diffthrust.diagnosis._trials import Trial, Trials, side_by_side
from diffthrust.estimation._solver import solve
from diffthrust.simulation._linearise import slopes_at

LEVEL = 0.01
"""False alarms of "unexplained", over all ports and signals together."""
LEAST = 0.01
"""Structure that explains less of the squared one-step errors is not worth a word: the difference
between two ways to integrate the same physics comes to as much."""
NAMED = 0.05
"""Once there is structure, it is told by the largest that a single test would find."""
PAST = (20, 100)
"""Samples over which the past of a signal is remembered."""


def signals_at(trials: Trials, place: Place, trial: Trial) -> dict[str, list[np.ndarray]]:
    """The signals on which something missing at a place may depend, log by log.

    All are known before the sample whose error they are to explain (a smoothed rate would contain
    that very error): the rate of a state is the one that the model predicts.
    """
    paths = trials.path(trial)
    model = trials.model
    everywhere = set.intersection(*(set(path) for path in paths))
    names = [n for n in (*model.inputs, *model.optional_inputs) if n in everywhere]
    names += [n for n in model.states if n in everywhere and n in trials.problem.layout.channels]
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


def unknown(
    trials: Trials, port: str, trial: Trial, series: Sequence[np.ndarray]
) -> tuple[float, np.ndarray, np.ndarray]:
    """Test given series at a port: do the errors contain any combination of them?

    Args:
        trials: the fits.
        port: the port.
        trial: the present model.
        series: for each log ``(KNOTS, T)``.

    Returns:
        The p-value of the score test, robust to correlation within blocks of time; the
        estimated coefficients; their covariance.
    """
    names = [f"unknown_{port}.c{i}" for i in range(KNOTS)]
    given = trials.unknowns[port].needs
    # errors that are white say of the observer's gains nothing that they say of a mean
    known = [n for n in trial.names if n not in trials.nuisance]
    names = names[: (trials.problem.layout.width or 0) - len(known)]
    problem = trials.problem.focus((*known, *names), trial.values, trial.begin)
    batches = []
    for batch, indices in zip(problem.numbers.batches, problem.order, strict=True):
        length = batch.time.shape[1]
        rows = np.zeros((KNOTS, len(indices), length))
        for row, index in enumerate(indices):
            rows[:, row, : series[index].shape[1]] = series[index]
        anew = {name: rows[i] for i, name in enumerate(given)}
        batches.append(replace(batch, inputs={**batch.inputs, **anew}))
    problem = replace(problem, numbers=replace(problem.numbers, batches=batches))
    q = solve(problem, problem.start(), budget=1).quadratic
    p, found, covariance = score_test(q, len(known), len(names))
    beyond = KNOTS - len(names)  # hats for which so many effects left no room
    return p, np.pad(found, (0, beyond)), np.pad(covariance, (0, beyond))


class Suspect(NamedTuple):
    """Something that may be missing: where, on what it depends, and the series that tell."""

    place: Place
    port: str
    signal: str
    manner: Literal["adds", "scales"]
    series: list[np.ndarray]


def remaining_structure(trials: Trials, trial: Trial) -> Remaining | None:
    """The place and signal on which the errors still depend, if they do.

    At each place a sum with a function of one signal is tried, and at each port behind it a factor
    that is one; of the signals as they are, and of their recent past, which tells of states that
    the model lacks.
    """

    def tested(suspect: Suspect) -> tuple[float, Remaining]:
        p, gain = _gain(trials, trial, suspect)
        share = 1.0 - float(np.exp(-gain / samples_at(trials, suspect.place)))
        return p, Remaining(suspect.port, suspect.signal, share, suspect.manner, gain)

    found = side_by_side(tested, _suspects(trials, trial))
    worth = [one for one in found if one[1].share >= LEAST]
    if not any(p < LEVEL / len(found) for p, _ in worth):
        return None
    return max((left for p, left in worth if p < NAMED), key=lambda left: left.gain)


def gain_of(trials: Trials, trial: Trial, left: Remaining) -> float:
    """The likelihood ratio that given structure promises beside a trial."""
    named = (left.port, left.depends_on, left.manner)
    alike = (s for s in _suspects(trials, trial) if (s.port, s.signal, s.manner) == named)
    return max((_gain(trials, trial, suspect)[1] for suspect in alike), default=0.0)


def _suspects(trials: Trials, trial: Trial) -> list[Suspect]:
    paths = trials.path(trial)
    ports = trials.readings(paths)
    suspects = []
    for place in trials.places:
        signals = signals_at(trials, place, trial)
        factors = _factors(behind(trials, place), ports)
        for name, (series, _) in bases({**signals, **_past(signals, paths)}).items():
            suspects.append(Suspect(place, place.port, name, "adds", series))
            for port, factor in factors.items():
                scaled = [s * f for s, f in zip(series, factor, strict=True)]
                suspects.append(Suspect(place, port, name, "scales", scaled))
    return suspects


def _gain(trials: Trials, trial: Trial, suspect: Suspect) -> tuple[float, float]:
    """p-value and likelihood ratio of a suspect."""
    p, found, covariance = unknown(trials, suspect.place.port, trial, suspect.series)
    if np.isnan(covariance).any():  # nothing of it shows beside the estimated parameters
        return 1.0, 0.0
    return p, ratio_of(found, covariance)


def ratio_of(coefficients: np.ndarray, covariance: np.ndarray) -> float:
    """The likelihood ratio of coefficients that were estimated with a covariance."""
    return float(coefficients @ np.linalg.pinv(covariance, hermitian=True) @ coefficients)


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


def behind(trials: Trials, place: Place) -> tuple[str, ...]:
    """The ports whose signal drives what a place drives, and nothing else; itself included."""
    rates, outputs = slopes_at(trials.model, trials.logs[0])
    part = rates if place.state else outputs
    others = [part[n][1] for n in part if n != place.target]
    own = part[place.target][1]
    return tuple(p for p in own if own[p] != 0 and all(other[p] == 0 for other in others))


def samples_at(trials: Trials, place: Place) -> float:
    """Measurements of what a place drives; all of them where it drives a state unmeasured."""
    counts = np.asarray(trials.problem.numbers.counts)
    channels = trials.problem.layout.channels
    if place.target not in channels:
        return trials.samples
    return float(counts[channels.index(place.target)])

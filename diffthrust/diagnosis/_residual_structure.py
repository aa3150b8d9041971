"""Waves along a position: how many there are, read off the one-step errors.

A ripple of so many per turn, of the teeth of a gear or the poles of a motor, has more waves over a
log than a curve has pieces. The periodogram of the one-step errors over the position, which need
not be sampled evenly (Schuster 1898), tells how long they are and where they begin.

Structure that remains in the errors: at which place, and on which signal it depends.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np

from diffthrust.diagnosis._findings import Remaining, SignalForm
from diffthrust.diagnosis._innovations_fit import CandidateFitter, TrialFit, side_by_side
from diffthrust.diagnosis._ports import DrivingPort, hats, knots_of
from diffthrust.diagnosis._score_test import score_test
from diffthrust.simulation._linearise import slopes_at

_FEWEST_WAVES = 4.0
"""Fewer waves over the range of a position are in reach of a curve."""
_MOST_NUMBERS = 1000
"""More wave numbers are not looked at."""
_REFINED_NUMBERS = 41
"""Wave numbers that are looked at about the best."""
_POWER_MARGIN = 10.0
"""A wave is tried where its power is this far above what white errors reach anywhere."""


class Wave(NamedTuple):
    """A wave along a position x, ``sin(number * x + phase)``, and how far its number may be off."""

    number: float
    phase: float
    off: float

    @property
    def length(self) -> float:
        """From one wave to the next, in the unit of x."""
        return 2.0 * math.pi / self.number


def wave_along(trial: TrialFit, name: str) -> Wave | None:
    """The wave along a state that one-step errors show most, if any stands out.

    Args:
        trial: the model, fitted in the innovations form.
        name: the state.
    """
    ran = trial.passed
    sigma = np.asarray(trial.quadratic.sigma)[:, None]
    along = [log.path[name][:-1] for log in ran]
    errors = [np.nan_to_num(log.errors[:, 1:] / sigma) for log in ran]
    numbers = _wave_numbers(along)
    if not numbers.size:
        return None
    power, angle = _periodogram(along, errors, numbers)
    if power.max() < np.log(power.size) + _POWER_MARGIN:
        return None
    peak = numbers[int(np.argmax(power.max(axis=0)))]
    beside = 0.5 * np.pi / max(float(np.ptp(np.concatenate(along))), 1e-300)
    near = np.linspace(peak - beside, peak + beside, _REFINED_NUMBERS)
    power, angle = _periodogram(along, errors, near)
    at = np.unravel_index(int(np.argmax(power)), power.shape)
    return Wave(float(near[at[1]]), float(angle[at] + 0.5 * np.pi), beside)


def _periodogram(
    along: Sequence[np.ndarray], errors: Sequence[np.ndarray], numbers: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Power and angle of errors over a position, by channel and wave number ``(C, K)``.

    Of white errors the power at a wave number is exponentially distributed, of mean one.
    """
    sums = np.zeros((len(errors[0]), numbers.size), complex)
    level = np.zeros((len(errors[0]), 1))
    for x, residual in zip(along, errors, strict=True):
        sums += residual @ np.exp(-1j * np.outer(x, numbers))
        level += np.sum(residual**2, axis=1, keepdims=True)
    return np.abs(sums) ** 2 / np.maximum(level, 1e-300), np.angle(sums)


def _wave_numbers(along: Sequence[np.ndarray]) -> np.ndarray:
    """Wave numbers: from a few waves over the range to two samples a wave, half a wave apart."""
    pooled = np.concatenate(along)
    span = float(np.ptp(pooled))
    steps = np.abs(np.concatenate([np.diff(x) for x in along]))
    moved = steps[steps > 0]
    if not span > 0 or not moved.size:
        return np.empty(0)
    apart = np.pi / span
    highest = min(np.pi / float(np.median(moved)), _MOST_NUMBERS * apart)
    return np.arange(2.0 * np.pi * _FEWEST_WAVES / span, highest, apart)


_FALSE_ALARMS = 0.01
"""False alarms of "unexplained", over all ports and signals together."""
_LEAST_STRUCTURE = 0.01
"""Structure that explains less of the squared one-step errors is not worth a word: the difference
between two ways to integrate the same physics comes to as much."""
_REPORTED_LEVEL = 0.05
"""Once there is structure, it is told by the largest that a single test would find."""
_MEAN_SAMPLES = (20, 100)
"""Samples over which the past of a signal is remembered;"""
_HEAT_SAMPLES = 300
"""and over which that of its square is, which warms what is cold at first."""


class ObservedSignals(NamedTuple):
    """What a trial sees of the training logs, log by log; each ``(T,)``.

    Args:
        paths: inputs and states, predicted one step ahead.
        ports: what passes each port of the model as it was given.
    """

    paths: Sequence[Mapping[str, np.ndarray]]
    ports: Sequence[Mapping[str, np.ndarray]]


def observed_signals(trials: CandidateFitter, trial: TrialFit) -> ObservedSignals:
    """What a trial sees of the training logs."""
    return ObservedSignals(trial.path, trials.readings(trial))


def candidate_signals(
    trials: CandidateFitter, place: DrivingPort, logs: ObservedSignals
) -> dict[SignalForm, list[np.ndarray]]:
    """The signals on which something missing at a place may depend, log by log.

    All are known before the sample whose error they are to explain (a smoothed rate would contain
    that very error): the rate of a state is the one that the model predicts.
    """
    paths, model = logs.paths, trials.model
    everywhere = set.intersection(*(set(path) for path in paths))
    names = [n for n in (*model.inputs, *model.optional_inputs) if n in everywhere]
    names += [n for n in model.states if n in everywhere and n in trials.channels]
    out = {SignalForm(n): [path[n] for path in paths] for n in dict.fromkeys(names)}
    for driving in trials.places:
        if driving.state and place.state in (driving.state, None):
            rate = SignalForm(driving.state, rate=True)
            out[rate] = [np.asarray(ports[driving.port]) for ports in logs.ports]
    for name in model.states:  # one that the log prescribes moves as it was recorded
        if name in trials.logs[0].inputs:
            out[SignalForm(name)] = [path[name] for path in paths]
            rate = SignalForm(name, rate=True)
            out[rate] = [np.gradient(path[name], path["time"]) for path in paths]
    out[SignalForm("time")] = [path["time"] - path["time"][0] for path in paths]
    return out


def hat_bases(
    signals: Mapping[SignalForm, Sequence[np.ndarray]],
) -> dict[SignalForm, tuple[list[np.ndarray], np.ndarray]]:
    """For each signal its piecewise-linear basis log by log, and the knots."""
    out = {}
    for form, series in signals.items():
        pooled = np.concatenate(series)
        if np.ptp(pooled) <= 1e-9 * (1.0 + np.max(np.abs(pooled))):
            continue  # a constant
        knots = knots_of(pooled)
        out[form] = ([hats(values, knots) for values in series], knots)
    return out


def score_at_port(
    trials: CandidateFitter, port: str, trial: TrialFit, series: Sequence[np.ndarray]
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
    response = trial.response
    return _score_of(trials, trial, response.to(port, response.batched(series)))


def _score_of(
    trials: CandidateFitter, trial: TrialFit, answers: Sequence[np.ndarray]
) -> tuple[float, np.ndarray, np.ndarray]:
    """Score test of coordinates that the errors answer so, by batch ``(B, K, C, T)``."""
    # errors that are white say of the observer's gains nothing that they say of a mean
    estimated = [i for i, name in enumerate(trial.names) if name not in trials.nuisance]
    information, scores = trial.response.scores(estimated, answers)
    return score_test(information, scores, len(estimated))


class Suspect(NamedTuple):
    """Something that may be missing: where, on what it depends, and the series that tell."""

    place: DrivingPort
    port: str
    signal: SignalForm
    manner: Literal["adds", "scales"]
    series: list[np.ndarray]


def remaining_structure(trials: CandidateFitter, trial: TrialFit) -> Remaining | None:
    """The place and signal on which the errors still depend, if they do.

    At each place a sum with a function of one signal is tried, and at each port behind it a factor
    that is one; of the signals as they are, of their recent past and that of their squares, which
    tell of states that the model lacks, and of waves along them.
    """

    def tested(suspect: Suspect) -> tuple[float, Remaining]:
        p, gain = _gain(trials, trial, suspect)
        share = 1.0 - float(np.exp(-gain / samples_at(trials, suspect.place)))
        return p, Remaining(suspect.port, suspect.signal, share, suspect.manner, gain)

    answers = side_by_side(tested, _suspects(trials, trial))
    worth = [answer for answer in answers if answer[1].share >= _LEAST_STRUCTURE]
    if not any(p < _FALSE_ALARMS / len(answers) for p, _ in worth):
        return None
    return max(
        (remaining for p, remaining in worth if p < _REPORTED_LEVEL),
        key=lambda remaining: remaining.gain,
    )


def gain_of(trials: CandidateFitter, trial: TrialFit, remaining: Remaining) -> float:
    """The likelihood ratio that given structure promises beside a trial."""
    named = (remaining.port, remaining.signal, remaining.manner)
    matching = (s for s in _suspects(trials, trial) if (s.port, s.signal, s.manner) == named)
    return max((_gain(trials, trial, suspect)[1] for suspect in matching), default=0.0)


def _suspects(trials: CandidateFitter, trial: TrialFit) -> list[Suspect]:
    logs = observed_signals(trials, trial)
    step = float(np.median(np.diff(logs.paths[0]["time"])))
    suspects, waves = [], _waves(trials, trial, logs)
    for place in trials.places:
        signals = candidate_signals(trials, place, logs)
        factors = _factors(downstream_ports(trials, place), logs.ports)
        shapes = {
            form: basis
            for form, (basis, _) in hat_bases({**signals, **_past(signals, step)}).items()
        }
        for form, series in {**shapes, **waves}.items():
            suspects.append(Suspect(place, place.port, form, "adds", series))
            for port, factor in factors.items():
                scaled = [s * f for s, f in zip(series, factor, strict=True)]
                suspects.append(Suspect(place, port, form, "scales", scaled))
    return suspects


def _waves(
    trials: CandidateFitter, trial: TrialFit, logs: ObservedSignals
) -> dict[SignalForm, list[np.ndarray]]:
    """The waves that stand out along states: sine and cosine, log by log ``(2, T)``."""
    names = [n for n in trials.model.states if all(n in path for path in logs.paths)]
    return {
        SignalForm(name, wave=wave.length): [
            np.stack([np.sin(wave.number * path[name]), np.cos(wave.number * path[name])])
            for path in logs.paths
        ]
        for name in names
        if (wave := wave_along(trial, name))
    }


def _gain(trials: CandidateFitter, trial: TrialFit, suspect: Suspect) -> tuple[float, float]:
    """p-value and likelihood ratio of a suspect."""
    p, estimated, covariance = score_at_port(trials, suspect.place.port, trial, suspect.series)
    if np.isnan(covariance).any():  # nothing of it shows beside the estimated parameters
        return 1.0, 0.0
    return p, likelihood_ratio(estimated, covariance)


def likelihood_ratio(coefficients: np.ndarray, covariance: np.ndarray) -> float:
    """The likelihood ratio of coefficients that were estimated with a covariance."""
    return float(coefficients @ np.linalg.pinv(covariance, hermitian=True) @ coefficients)


def _factors(
    names: Sequence[str], ports: Sequence[Mapping[str, np.ndarray]]
) -> dict[str, list[np.ndarray]]:
    """What passes some ports, log by log and of unit size; of several that go alike, the first."""
    factors: dict[str, list[np.ndarray]] = {}
    for name in names:
        level = np.sqrt(np.mean(np.concatenate([passing[name] for passing in ports]) ** 2))
        unit = [passing[name] / max(level, 1e-300) for passing in ports]
        joined = np.concatenate(unit)
        correlations = (
            abs(np.mean(joined * np.concatenate(factor))) for factor in factors.values()
        )
        if level > 0 and not any(passing > 1.0 - 1e-9 for passing in correlations):
            factors[name] = unit
    return factors


def _past(
    signals: Mapping[SignalForm, Sequence[np.ndarray]], step: float
) -> dict[SignalForm, list[np.ndarray]]:
    """The running means of inputs and states, and of their squares, over some recent samples."""
    plain = {f.name: s for f, s in signals.items() if f.name != "time" and not f.rate}
    out = {
        SignalForm(name, past=samples * step): [
            exponential_mean(values, samples) for values in series
        ]
        for name, series in plain.items()
        for samples in _MEAN_SAMPLES
    }
    for name, series in plain.items():
        warm = [
            exponential_mean(np.concatenate([[0.0], values**2]), _HEAT_SAMPLES)[1:]
            for values in series
        ]
        out[SignalForm(f"{name}**2", past=_HEAT_SAMPLES * step)] = warm
    return out


def exponential_mean(series: np.ndarray, samples: int) -> np.ndarray:
    """Mean of the past of a series that forgets over so many samples."""
    from scipy.signal import lfilter  # slow to import

    kept = np.exp(-1.0 / samples)
    return lfilter([1.0 - kept], [1.0, -kept], series, zi=[kept * series[0]])[0]


def downstream_ports(trials: CandidateFitter, place: DrivingPort) -> tuple[str, ...]:
    """The ports whose signal drives what a place drives, and nothing else; itself included."""
    rates, outputs = slopes_at(trials.model, trials.logs[0])
    derivatives = rates if place.state else outputs
    remaining = [derivatives[n][1] for n in derivatives if n != place.target]
    of_target = derivatives[place.target][1]
    return tuple(
        p for p in of_target if of_target[p] != 0 and all(slopes[p] == 0 for slopes in remaining)
    )


def samples_at(trials: CandidateFitter, place: DrivingPort) -> float:
    """Measurements of what a place drives; all of them where it drives a state unmeasured."""
    return trials.counts.get(place.target, trials.samples)

"""Structure that remains in one-step errors: at which place, and on which signal it depends.

At each place a function of one signal is tried, with as few assumptions as possible: a sum of
piecewise-linear hats, whose coefficients are tested together (`score_test`). Signals are taken as
they are, from their recent past, and as the heat of their squares. A ripple with
a fixed number of waves per turn, from the teeth of a gear or the poles of a motor, has more waves
over a log than the function has pieces: the periodogram of the errors over the position gives
their length (Schuster 1898).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from diffthrust._support.lag import lagged
from diffthrust.diagnosis._candidates import DrivingPort
from diffthrust.diagnosis._innovations_fit import CandidateFitter, TrialFit, side_by_side
from diffthrust.diagnosis._linear_response import ABREAST, score_test
from diffthrust.diagnosis._missing import Remaining, SignalForm, after_effects
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.models._base.effect import Effect
from diffthrust.simulation._linearise import slopes_at
from diffthrust.simulation._record import are_tables

_MEAN_SAMPLES = (20, 100)
"""Numerics: samples over which the past of a signal is averaged: states that the model lacks follow
it so."""
_HEAT_SAMPLES = 300
"""Numerics: the same for its square, which heats what is cold at the start of a log: a slow state
that shows in nothing else."""
_MOST_NUMBERS = 1000
"""Numerics: wave numbers that are looked at: the periodogram is a product of as many columns."""
_REFINED_NUMBERS = 41
"""Numerics: wave numbers about the best: a fortieth of the way between neighbours."""


class ObservedSignals(NamedTuple):
    """What a trial observes of the training logs, log by log; each ``(T,)``.

    Args:
        paths: inputs and states, predicted one step ahead.
        ports: the signal at each port of the model as it was given.
        effects: those of the trial: inputs on the paths have gone through them.
    """

    paths: Sequence[Mapping[str, np.ndarray]]
    ports: Sequence[Mapping[str, np.ndarray]]
    effects: Sequence[Effect] = ()


class Suspect(NamedTuple):
    """Something that may be missing: where, on what it depends, and the series of its basis."""

    place: DrivingPort
    port: str
    signal: SignalForm
    manner: Literal["adds", "scales"]
    series: list[np.ndarray]


class Wave(NamedTuple):
    """A wave along a position x, ``sin(number * x + phase)``, and how far its number may be off."""

    number: float
    phase: float
    uncertainty: float

    @property
    def length(self) -> float:
        """From one wave to the next, in the unit of x."""
        return 2.0 * math.pi / self.number


def remaining_structure(fitter: CandidateFitter, trial: TrialFit) -> Remaining | None:
    """The place and signal on which the errors still depend, if they do.

    At each place a sum with a function of one signal is tried, and at each port downstream a factor
    that is such a function.
    """

    def tested(group: Sequence[Suspect]) -> list[tuple[float, Remaining]]:
        out = []
        for suspect, (p, gain) in zip(group, _gains(trial, group), strict=True):
            share = 1.0 - float(np.exp(-gain / samples_at(fitter, suspect.place)))
            out.append((p, Remaining(suspect.port, suspect.signal, share, suspect.manner, gain)))
        return out

    groups = side_by_side(tested, _abreast(_suspects(fitter, trial)))
    answers = [answer for group in groups for answer in group]
    large = [answer for answer in answers if answer[1].share >= SETTINGS.structure.least_share]
    if not any(p < SETTINGS.structure.false_alarms / len(answers) for p, _ in large):
        return None
    # the surest is often a shadow of the largest: of correlated signals the small one is surer
    sure = (remaining for p, remaining in large if p < SETTINGS.structure.naming_level)
    return max(sure, key=lambda remaining: remaining.gain)


def gain_of(fitter: CandidateFitter, trial: TrialFit, remaining: Remaining) -> float:
    """The likelihood ratio that some structure promises beside a trial."""
    wanted = (remaining.port, remaining.signal, remaining.manner)
    matching = [s for s in _suspects(fitter, trial) if (s.port, s.signal, s.manner) == wanted]
    groups = (_gains(trial, group) for group in _abreast(matching))
    return max((gain for group in groups for _, gain in group), default=0.0)


def scores_at_port(
    port: str, trial: TrialFit, sets: Sequence[Sequence[np.ndarray]]
) -> list[tuple[float, np.ndarray, np.ndarray]]:
    """Test sets of series at a port: do the errors contain any combination of one set?

    For each set, of ``(knots, T)`` a log, the answer of the `score_test`: all go through the logs
    together.
    """
    count, scored = trial.scores(port, sets)
    return [score_test(*of_set, count) for of_set in scored]


def likelihood_ratio(coefficients: np.ndarray, covariance: np.ndarray) -> float:
    """The likelihood ratio of coefficients that were estimated with a covariance."""
    return float(coefficients @ np.linalg.pinv(covariance, hermitian=True) @ coefficients)


def observed_signals(fitter: CandidateFitter, trial: TrialFit) -> ObservedSignals:
    """What a trial observes of the training logs."""
    effects = (
        *fitter.model.effects,
        *(fitter.candidates[n] for n in trial.effects if n in fitter.candidates),
    )
    return ObservedSignals(trial.path, fitter.readings(trial), effects)


def candidate_signals(
    fitter: CandidateFitter, place: DrivingPort, observed: ObservedSignals
) -> dict[SignalForm, list[np.ndarray]]:
    """The signals on which something missing at a place may depend, log by log.

    All are known before the sample whose error they are to explain: the rate of a state is the one
    that the model predicts, as a smoothed rate would contain that very error. Of static tables
    neither rates nor the time.
    """
    paths, model = observed.paths, fitter.model
    common = set.intersection(*(set(path) for path in paths))
    names = [n for n in (*model.inputs, *model.optional_inputs) if n in common]
    names += [n for n in model.states if n in common and n in fitter.channels]
    out = {
        SignalForm(n, after=after_effects(model, observed.effects, [n])): [p[n] for p in paths]
        for n in dict.fromkeys(names)
    }
    if are_tables(fitter.records):
        return out
    for driving in fitter.places:
        if driving.state and place.state in (driving.state, None):
            rate = SignalForm(driving.state, rate=True)
            out[rate] = [np.asarray(ports[driving.port]) for ports in observed.ports]
    for name in model.states:
        if name in fitter.records[0].inputs:  # prescribed by the log: it moves as it was recorded
            out[SignalForm(name)] = [path[name] for path in paths]
            rate = SignalForm(name, rate=True)
            out[rate] = [np.gradient(path[name], path["time"]) for path in paths]
    out[SignalForm("time")] = [path["time"] - path["time"][0] for path in paths]
    return out


def varies(values: np.ndarray) -> bool:
    """Whether a signal is more than a constant."""
    return bool(np.ptp(values) > 1e-9 * (1.0 + np.max(np.abs(values))))


def knots_of(values: np.ndarray) -> np.ndarray:
    """Knots over a signal, halfway between even spacing and even shares of the samples."""
    low, high = np.quantile(values, [0.01, 0.99])
    even = np.linspace(low, high, SETTINGS.structure.knots)
    shares = np.quantile(values, np.linspace(0.01, 0.99, SETTINGS.structure.knots))
    # a signal that rests for most of a log has all its shares at one value: knots must differ
    return 0.5 * (even + shares) + 1e-9 * (high - low) * np.arange(SETTINGS.structure.knots)


def hats(values: np.ndarray, knots: np.ndarray) -> np.ndarray:
    """Piecewise-linear basis over a signal, ``(knots, T)``; its rows sum to one."""
    return np.stack([np.interp(values, knots, row) for row in np.eye(len(knots))])


def hat_bases(
    signals: Mapping[SignalForm, Sequence[np.ndarray]],
) -> dict[SignalForm, tuple[list[np.ndarray], np.ndarray]]:
    """For each signal that varies its piecewise-linear basis log by log, and the knots."""
    out = {}
    for form, series in signals.items():
        pooled = np.concatenate(series)
        if varies(pooled):
            knots = knots_of(pooled)
            out[form] = ([hats(values, knots) for values in series], knots)
    return out


def exponential_mean(series: np.ndarray, samples: int) -> np.ndarray:
    """Mean of the past of a series, with weights that decay over some samples."""
    decay = np.full(series.size - 1, np.exp(-1.0 / samples))
    return lagged(series[:1], series[1:, None], decay)[:, 0]


def downstream_ports(fitter: CandidateFitter, place: DrivingPort) -> tuple[str, ...]:
    """The ports whose signal drives what a place drives, and nothing else; itself included."""
    rates, outputs = slopes_at(fitter.model, fitter.records[0])
    derivatives = rates if place.state else outputs
    of_target = derivatives[place.target][1]
    elsewhere = [by_port for n, (_, by_port, *_) in derivatives.items() if n != place.target]
    return tuple(p for p in of_target if of_target[p] != 0 and all(d[p] == 0 for d in elsewhere))


def place_of(fitter: CandidateFitter, port: str) -> DrivingPort | None:
    """The place that a port belongs to or is downstream of: one that drives a state, if any."""
    near = (p for p in fitter.places if port in (p.port, *downstream_ports(fitter, p)))
    return next(near, None)


def samples_at(fitter: CandidateFitter, place: DrivingPort) -> float:
    """Measurements of what a place drives; all of them if that is an unmeasured state."""
    return fitter.counts.get(place.target, fitter.samples)


def wave_along(trial: TrialFit, name: str) -> Wave | None:
    """The wave along a state that one-step errors show most, if any stands out."""
    passed = trial.passed
    sigma = np.asarray(trial.quadratic.sigma)[:, None]
    positions = [log.path[name][:-1] for log in passed]
    errors = [np.nan_to_num(log.errors[:, 1:] / sigma) for log in passed]
    numbers = _wave_numbers(positions)
    if not numbers.size:
        return None
    power, _ = _periodogram(positions, errors, numbers)
    if power.max() < np.log(power.size) + SETTINGS.structure.wave_power:
        return None
    peak = numbers[int(np.argmax(power.max(axis=0)))]
    half_step = 0.5 * np.pi / max(float(np.ptp(np.concatenate(positions))), 1e-300)
    near = np.linspace(peak - half_step, peak + half_step, _REFINED_NUMBERS)
    power, angle = _periodogram(positions, errors, near)
    at = np.unravel_index(int(np.argmax(power)), power.shape)
    return Wave(float(near[at[1]]), float(angle[at] + 0.5 * np.pi), half_step)


def _periodogram(
    positions: Sequence[np.ndarray], errors: Sequence[np.ndarray], numbers: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Power and angle of errors over a position, by channel and wave number ``(C, K)``.

    The power of white errors is exponentially distributed, with mean one. Positions need not be
    even.
    """
    sums = np.zeros((len(errors[0]), numbers.size), complex)
    level = np.zeros((len(errors[0]), 1))
    for x, residual in zip(positions, errors, strict=True):
        sums += residual @ np.exp(-1j * np.outer(x, numbers))
        level += np.sum(residual**2, axis=1, keepdims=True)
    return np.abs(sums) ** 2 / np.maximum(level, 1e-300), np.angle(sums)


def _wave_numbers(positions: Sequence[np.ndarray]) -> np.ndarray:
    """Wave numbers: from a few waves over the range to two samples a wave, half a wave apart."""
    span = float(np.ptp(np.concatenate(positions)))
    steps = np.abs(np.concatenate([np.diff(x) for x in positions]))
    moving = steps[steps > 0]
    if not span > 0 or not moving.size:
        return np.empty(0)
    spacing = np.pi / span
    highest = min(np.pi / float(np.median(moving)), _MOST_NUMBERS * spacing)
    return np.arange(2.0 * np.pi * SETTINGS.structure.least_waves / span, highest, spacing)


def _suspects(fitter: CandidateFitter, trial: TrialFit) -> list[Suspect]:
    observed = observed_signals(fitter, trial)
    step = float(np.median(np.diff(observed.paths[0]["time"])))
    suspects, waves = [], _waves(fitter, trial, observed)
    for place in fitter.places:
        signals = candidate_signals(fitter, place, observed)
        factors = _factors(downstream_ports(fitter, place), observed.ports)
        past = {} if are_tables(fitter.records) else _past(signals, step)
        functions = hat_bases({**signals, **past})
        bases = {form: series for form, (series, _) in functions.items()}
        for form, series in {**bases, **waves}.items():
            suspects.append(Suspect(place, place.port, form, "adds", series))
            for port, factor in factors.items():
                scaled = [s * f for s, f in zip(series, factor, strict=True)]
                suspects.append(Suspect(place, port, form, "scales", scaled))
    return suspects


def _waves(
    fitter: CandidateFitter, trial: TrialFit, observed: ObservedSignals
) -> dict[SignalForm, list[np.ndarray]]:
    """The waves that stand out along states: sine and cosine, log by log ``(2, T)``."""
    names = [n for n in fitter.model.states if all(n in path for path in observed.paths)]
    return {
        SignalForm(name, wave=wave.length, unit=fitter.model.states[name]): [
            np.stack([np.sin(wave.number * path[name]), np.cos(wave.number * path[name])])
            for path in observed.paths
        ]
        for name in names
        if (wave := wave_along(trial, name))
    }


def _abreast(suspects: Sequence[Suspect]) -> list[list[Suspect]]:
    """Those of one place together, as many as go through a log at the cost of one."""
    groups: list[list[Suspect]] = []
    for suspect in suspects:
        group = groups[-1] if groups and groups[-1][0].place == suspect.place else []
        width = sum(len(other.series[0]) for other in [*group, suspect])
        if not group or width > ABREAST:
            groups.append([suspect])
        else:
            group.append(suspect)
    return groups


def _gains(trial: TrialFit, suspects: Sequence[Suspect]) -> list[tuple[float, float]]:
    """p-value and likelihood ratio of each of some suspects of one place."""
    port, out = suspects[0].place.port, []
    sets = [suspect.series for suspect in suspects]
    for p, estimated, covariance in scores_at_port(port, trial, sets):
        impossible = np.isnan(covariance).any()  # the estimated parameters can do all of it
        out.append((1.0, 0.0) if impossible else (p, likelihood_ratio(estimated, covariance)))
    return out


def _factors(
    names: Sequence[str], ports: Sequence[Mapping[str, np.ndarray]]
) -> dict[str, list[np.ndarray]]:
    """The signals at some ports, log by log and of unit size; of proportional ones the first."""
    factors: dict[str, list[np.ndarray]] = {}
    for name in names:
        level = np.sqrt(np.mean(np.concatenate([signals[name] for signals in ports]) ** 2))
        unit = [signals[name] / max(level, 1e-300) for signals in ports]
        joined = np.concatenate(unit)
        correlations = (abs(np.mean(joined * np.concatenate(f))) for f in factors.values())
        if level > 0 and not any(correlation > 1.0 - 1e-9 for correlation in correlations):
            factors[name] = unit
    return factors


def _past(
    signals: Mapping[SignalForm, Sequence[np.ndarray]], step: float
) -> dict[SignalForm, list[np.ndarray]]:
    """Running means of inputs and states, and of their squares, over some recent samples."""
    plain = {f: s for f, s in signals.items() if f.name != "time" and not f.rate}
    out = {
        replace(form, past=samples * step): [exponential_mean(v, samples) for v in series]
        for form, series in plain.items()
        for samples in _MEAN_SAMPLES
    }
    for form, series in plain.items():
        # from zero, for what is cold at the start
        squares = (np.concatenate([[0.0], values**2]) for values in series)
        heat = [exponential_mean(values, _HEAT_SAMPLES)[1:] for values in squares]
        out[replace(form, name=f"{form.name}**2", past=_HEAT_SAMPLES * step)] = heat
    return out

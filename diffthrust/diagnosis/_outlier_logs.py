"""Logs that disagree with the others, by the size of their errors and by their parameters.

The parameters are tested log by log: do the one-step errors of a log support another value than
those of all other logs? The gradient of their likelihood is projected onto what neither the shared
parameters nor the log's own initial states explain (Neyman 1959). Its scatter over blocks of time
gives its standard error, and the scatter of the other logs how much logs differ anyway.

Beside each stands where it goes and the others do not: what a model lacks shows most there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from diffthrust._support.words import humanize, joined, number, percent
from diffthrust.comparison._agreement import beside_others, outstanding
from diffthrust.comparison._derived_signals import signals_of, units_of
from diffthrust.diagnosis._findings import OddLog
from diffthrust.diagnosis._innovations_fit import CandidateFitter, TrialFit
from diffthrust.diagnosis._linear_response import without_overflow
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.estimation._laws import TAIL, Law
from diffthrust.estimation._one_step import Pass, passes, settled_start
from diffthrust.estimation._problem import Problem
from diffthrust.models._base.model import Model
from diffthrust.simulation._runs import Run

_NAMED = 2
"""Display: signals that are named beyond which a log goes; the others mostly follow from these."""
_MARGIN = 0.05
"""Numerics: share of what the other logs cover by which their ends count as wider."""
_SHARES = 0.1, 2.0
"""Numerics: range, in steps that slopes promise, within which a log's value is searched."""
_FAR = 3.0
"""Display: a parameter that is off by more of itself is not given in per cent."""
_STEP = 1e-4
"""Numerics: share of a coordinate over which derivatives are differences."""
_DIVERGED = 1e100
"""Numerics: derivatives of a run that diverges; the squares of larger ones overflow."""
_BLIND = 1e-6
"""Numerics: a log with less than this share of all information on a parameter does not determine
it."""


def odd_logs(
    fitter: CandidateFitter, trial: TrialFit, runs: Sequence[Run], structure: bool = False
) -> tuple[OddLog, ...]:
    """The logs that deviate from the others.

    Either the error over the whole run stands out, or the one-step errors support another value of
    a parameter than those of all other logs, and with it the error over the whole run falls.

    Args:
        fitter: the fits.
        trial: the last model.
        runs: its runs over all logs, training logs first, at its whole-run parameters.
        structure: the one-step errors show that the model lacks something. The error of a whole
            run then stands out where that is felt most (of a pendulum, in the log that goes over
            the top), and is held against a log only where its one-step errors stand out, too.

    Returns:
        The odd logs, those that carry most of the error first.
    """
    if len(runs) < SETTINGS.outlier_logs.fewest_logs:
        return ()
    channels: dict[int, str] = {}
    words_of: dict[int, list[str]] = {}
    at_once = _one_step_ratios(fitter, trial) if structure else {}
    for outlier in sorted(outstanding(runs), key=lambda outlier: -outlier.ratio):
        if not structure or _larger(at_once.get((outlier.channel, outlier.place), 1.0)):
            channels.setdefault(outlier.place, outlier.channel)
    for off in deviating_logs(fitter, trial, len(runs)):
        channels.setdefault(off.log, fitter.channels[off.channel])
        words_of[off.log] = [_parameter_words(fitter, trial, off)]
    odd = []
    for k, channel in channels.items():
        outlier = next(
            (outlier for outlier in beside_others(runs, channel) if outlier.place == k), None
        )
        if outlier is None:  # it does not measure this channel
            continue
        times = f"{number(outlier.ratio, 2)} times that of the median log"
        words = [f"its {humanize(channel)} error is {times}"] if _larger(outlier.ratio) else []
        peers = [run for i, run in enumerate(runs[: len(fitter.records)]) if i != k]
        beyond = _beyond_others(fitter.model, runs[k], peers)
        evidence = joined(words + words_of.get(k, []))
        odd.append(OddLog(outlier.run, channel, evidence, outlier.share, beyond))
    return tuple(sorted(odd, key=lambda log: -log.share))


def _larger(ratio: float) -> bool:
    return ratio > SETTINGS.outlier_logs.least_error_ratio


def _beyond_others(model: Model, run: Run, others: Sequence[Run]) -> tuple[str, ...]:
    """Where a log goes and most of the other logs do not, in words: "command below 0.3 V".

    Where a model lacks something, its error shows most there, and the log is accused of nothing: of
    six runs the only astern one errs four times as much with one thrust coefficient for both ways.
    The signals that are for long beyond what the others reach, or half of them, the plainest first.
    Inputs are held against each other and states as the model follows them: what was measured may
    itself be what is odd about the log.
    """
    least = SETTINGS.outlier_logs.least_time_beyond
    words = []
    by_log = [signals_of(model, peer) for peer in others]
    for name, values in signals_of(model, run).items():
        peers = [signals[name] for signals in by_log if name in signals]
        if not peers:
            continue
        lows, highs = (np.sort([end(peer) for peer in peers]) for end in (np.min, np.max))
        margin = _MARGIN * float(highs[-1] - lows[0])
        unit = units_of(run).get(name, "")
        # what any of them reaches, or else at least half of them: of a T200's maps that at 20 V
        # goes above the 16 V of the highest other one, not only above 12 V
        below = (lows[0], lows[(len(peers) - 1) // 2])
        above = (highs[-1], highs[len(peers) // 2])
        for side, sign, ends in (("below", -1.0, below), ("above", 1.0, above)):
            beyond = (end for end in ends if np.mean(sign * (values - end) > margin) > least)
            if (end := next(beyond, None)) is not None:
                words.append(f"{humanize(name)} {side} {number(float(end), 2)} {unit}".rstrip())
    return tuple(words[:_NAMED])


def _one_step_ratios(fitter: CandidateFitter, trial: TrialFit) -> dict[tuple[str, int], float]:
    """The one-step error of each log over that of the median log, by channel and place."""
    problems = [trial.at_values, *([settled_start(trial.unseen)] if trial.unseen else [])]
    logs = [log for problem in problems for log in passes(problem, problem.start())]
    squares = np.array(
        [[np.mean(e[np.isfinite(e)] ** 2) for e in log.errors] for log in logs]
    )  # NaN where a log does not measure a channel
    ratios = np.sqrt(squares / np.nanmedian(squares, axis=0))
    return {(name, k): float(r) for c, name in enumerate(fitter.channels)
            for k, r in enumerate(ratios[:, c])}  # fmt: skip


def error_ratio(odd: OddLog, runs: Sequence[Run]) -> float:
    """The error of an odd log over that of the median log, by the runs of some model."""
    every = beside_others(runs, odd.channel)
    return next((entry.ratio for entry in every if entry.run == odd.log), np.nan)


def no_longer_odd(odd: Sequence[OddLog], baseline: Sequence[Run], updated: Sequence[Run]) -> bool:
    """Whether odd logs that err more than the others with one model no longer do with another."""
    least = SETTINGS.outlier_logs.least_error_ratio
    return all(error_ratio(log, baseline) > least >= error_ratio(log, updated) for log in odd)


def deviating_logs(fitter: CandidateFitter, trial: TrialFit, count: int) -> list[Deviation]:
    """The logs whose parameters differ from those of the others by what matters in whole runs.

    None of a trial that cannot be simulated: it has no noise to hold errors against, and two boats'
    diagnoses ended in an error.
    """
    if not np.isfinite(trial.cost):
        return []
    by_log = slopes(fitter, trial)
    if len(by_log) != count:
        return []
    sigma, deviating = np.asarray(trial.quadratic.sigma), []
    for deviation in deviations(by_log):
        deviation = _refitted(_passing(fitter, trial, deviation.log), deviation, sigma)
        simulation = replace(trial, values={**trial.values, **fitter.uncorrected})
        if (
            _fall(_passing(fitter, simulation, deviation.log), deviation)
            < SETTINGS.outlier_logs.most_error_left
        ):
            deviating.append(deviation)
    return deviating


def _passing(fitter: CandidateFitter, trial: TrialFit, row: int) -> Callable[[np.ndarray], Pass]:
    """The pass over one log as a function of how far the parameters are moved, ``(P,)``."""
    problem = trial.at_values
    if row >= len(fitter.records):
        assert trial.unseen is not None
        row, problem = row - len(fitter.records), trial.unseen
    places = [i for i, n in enumerate(trial.names) if n not in fitter.nuisance]
    low, high = problem.limits()

    def passed(move: np.ndarray) -> Pass:
        z = problem.start()
        z[places] += move
        return passes(problem, np.clip(z, low, high))[row]

    return passed


def _refitted(
    passed: Callable[[np.ndarray], Pass], deviation: Deviation, sigma: np.ndarray
) -> Deviation:
    """The deviation that fits its log best, the other parameters being those of the other logs.

    What the slopes promise is one step of Gauss and Newton from where all logs agree: it may be
    twice as far as it is.
    """
    from scipy.optimize import minimize_scalar  # slow to import

    def cost(share: float) -> float:
        errors = (
            passed(deviation.others + share * (deviation.own - deviation.others)).errors
            / sigma[:, None]
        )
        with np.errstate(over="ignore"):  # of a run that diverges
            return float(np.sum(np.log1p(errors[~np.isnan(errors)] ** 2 / TAIL)))

    optimum: Any = minimize_scalar(cost, bounds=_SHARES, method="bounded", options={"xatol": 0.01})
    share = float(optimum.x)
    return replace(deviation, size=share * deviation.size, error=share * deviation.error)


def _fall(passed: Callable[[np.ndarray], Pass], deviation: Deviation) -> float:
    """The squared whole-run error of a log with its own parameters, over that with the others'."""
    sums = []
    for move in (deviation.others, deviation.own):
        errors = passed(move)
        size = np.nanvar(errors.measured, axis=1)
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            sums.append(float(np.nansum(np.nanmean(errors.errors**2, axis=1) / size)))
    return sums[1] / sums[0] if 0 < sums[0] < np.inf else 1.0


def _parameter_words(fitter: CandidateFitter, trial: TrialFit, deviation: Deviation) -> str:
    names = [n for n in trial.names if n not in fitter.nuisance]
    name = names[deviation.parameter]
    p, way = trial.problem.named[name], "higher" if deviation.size > 0 else "lower"
    value = trial.values[name]
    if p.transform == "log":
        share = np.exp(deviation.size) - 1
    else:
        share = deviation.size * p.scale / value if value else np.inf
    by = f"some {percent(abs(share))} " if abs(share) < _FAR else ""
    errors = number(abs(deviation.size) / deviation.error, 2)
    return f"it asks for {name} {by}{way} than the others ({errors} standard errors)"


# -- the test of each parameter of each log --------------------------------------------------------


@dataclass(frozen=True)
class Slopes:
    """What one log says of the shared parameters, its initial states projected out.

    Args:
        information: Fisher information, ``(P, P)``.
        scores: the gradient of the cost by blocks of time, ``(P, blocks)``.
        channels: the gradient by channel, ``(P, C)``.
    """

    information: np.ndarray
    scores: np.ndarray
    channels: np.ndarray


@dataclass(frozen=True)
class Deviation:
    """How far a parameter of one log is from that of the other logs, in coordinates of the fit.

    Args:
        log: index of the log.
        parameter: index of the parameter.
        size: optimum of this log minus optimum of the others.
        error: standard error of ``size``.
        freedom: degrees of freedom of the error.
        channel: index of the channel that contributes most.
        others: distance of the other logs' optimum from the current values, ``(P,)``.
    """

    log: int
    parameter: int
    size: float
    error: float
    freedom: float
    channel: int
    others: np.ndarray

    @property
    def own(self) -> np.ndarray:
        """Distance of this log's optimum from the current values, ``(P,)``."""
        return self.others + self.size * np.eye(self.others.size)[self.parameter]

    @property
    def p_value(self) -> float:
        """The p-value of this single test."""
        from scipy.special import stdtr  # slow to import

        return float(2 * stdtr(self.freedom, -abs(self.size) / self.error))


def deviations(logs: Sequence[Slopes]) -> list[Deviation]:
    """The logs in which a parameter differs from that of all other logs, the most certain first.

    Each is left out of the further tests. Fewer than half of the logs can deviate.
    """
    deviating: list[Deviation] = []
    remaining = list(range(len(logs)))
    level = SETTINGS.outlier_logs.false_alarms / (len(logs) * max(1, len(logs[0].scores)))
    while 2 * (len(deviating) + 1) < len(logs):
        near = [deviation for deviation in tested(logs, remaining) if deviation.p_value < level]
        sure = [
            deviation
            for deviation in (widened(logs, remaining, deviation) for deviation in near)
            if deviation.p_value < level
        ]
        if not sure:
            break
        deviating.append(max(sure, key=lambda deviation: abs(deviation.size) / deviation.error))
        remaining.remove(deviating[-1].log)
    return deviating


def tested(logs: Sequence[Slopes], among: Sequence[int]) -> Iterator[Deviation]:
    """Every parameter of every log against the other logs."""
    joint = without_overflow(np.sum([logs[k].information for k in among], axis=0))
    length = np.sqrt(np.maximum(np.diagonal(joint), 1e-300))
    scaled = joint / np.outer(length, length)
    inverse = np.linalg.pinv(scaled, rcond=1e-11, hermitian=True) / np.outer(length, length)
    slope = np.sum([logs[k].scores.sum(axis=1) for k in among], axis=0)
    for k in among:
        information = logs[k].information
        for j in range(len(length)):
            through = information[j] @ inverse
            projected = information[j, j] - through @ information[:, j]
            if not projected > _BLIND * joint[j, j]:
                continue
            blocks = [-through @ logs[m].scores for m in among]
            blocks[among.index(k)] = blocks[among.index(k)] + logs[k].scores[j]
            total = sum(float(block.sum()) for block in blocks)
            size = -total / projected
            yield Deviation(
                log=k,
                parameter=j,
                size=size,
                error=max(sum(map(_scatter, blocks)), projected) ** 0.5 / projected,
                freedom=max(1, sum(block.size - 1 for block in blocks)),
                channel=int(np.argmax(logs[k].channels[j] * np.sign(total))),
                others=-inverse @ (slope + size * information[:, j]),
            )


def _scatter(block: np.ndarray) -> float:
    """Variance of the sum of some values, by how they scatter about their mean."""
    return float(np.var(block, ddof=1)) * block.size if block.size > 1 else 0.0


def widened(logs: Sequence[Slopes], among: Sequence[int], deviation: Deviation) -> Deviation:
    """A deviation whose standard error includes how much the other logs differ among each other.

    By the moments of DerSimonian and Laird (1986), with the degrees of freedom of Satterthwaite
    (1946).
    """
    remaining = [k for k in among if k != deviation.log]
    peers = [d for d in tested(logs, remaining) if d.parameter == deviation.parameter]
    if len(peers) < 2:
        return deviation
    sizes, weights = (
        np.array(x) for x in zip(*((d.size, d.error**-2) for d in peers), strict=True)
    )
    between = max(0.0, float(weights @ sizes**2) - len(peers)) / float(weights.sum())
    within = deviation.error**2
    share = within**2 / deviation.freedom + between**2 / (len(peers) - 1)
    return replace(
        deviation, error=(within + between) ** 0.5, freedom=(within + between) ** 2 / share
    )


def slopes(fitter: CandidateFitter, trial: TrialFit) -> list[Slopes]:
    """The slopes of each log, training logs first, then unseen ones."""
    problems = [trial.at_values]
    if trial.unseen is not None:
        problems.append(settled_start(trial.unseen))
    places = [i for i, n in enumerate(trial.names) if n not in fitter.nuisance]
    sigma = np.asarray(trial.quadratic.sigma)
    return [log_slopes for problem in problems for log_slopes in _slopes(problem, places, sigma)]


def _slopes(problem: Problem, places: Sequence[int], sigma: np.ndarray) -> Iterator[Slopes]:
    """By finite differences of passes, for which nothing is compiled."""
    z, first, states = problem.start(), problem.shared, problem.each
    high = problem.limits()[1]
    now = passes(problem, z)
    by_place = []
    for at in [[i] for i in places] + [[*range(first + j, z.size, states)] for j in range(states)]:
        step = _STEP * (1 + float(np.abs(z[at]).max()))
        moved = z.copy()
        moved[at] += step if np.all(z[at] + step <= high[at]) else -step
        pairs = zip(passes(problem, moved), now, strict=True)
        by_place.append([(a.errors - b.errors) / (moved - z)[at[0]] for a, b in pairs])
    law = problem.layout.likelihood.law
    for k, log in enumerate(now):
        jacobian = np.stack([by_log[k] for by_log in by_place])
        yield _of_log(log, jacobian, len(places), sigma, law)


def _of_log(log: Pass, jacobian: np.ndarray, count: int, sigma: np.ndarray, law: Law) -> Slopes:
    """Slopes of one log from derivatives ``(P + states, C, T)`` of its errors."""
    residual = np.nan_to_num(log.errors / sigma[:, None])
    # a stiff run that diverges where a parameter is moved by a little says nothing of it
    jacobian = np.where(np.abs(jacobian) < _DIVERGED, jacobian, 0.0) / sigma[:, None]
    weight = np.asarray(law.weights(residual[None], np.ones(len(sigma))))[0]
    parameters, starts = jacobian[:count], jacobian[count:]
    flat = (starts * weight).reshape(len(starts), residual.size)
    inner = flat @ starts.reshape(len(starts), residual.size).T
    cross = flat @ parameters.reshape(count, residual.size).T
    parameters = parameters - np.tensordot(
        np.linalg.pinv(inner, hermitian=True) @ cross, starts, (0, 0)
    )
    product = parameters * weight * residual
    blocks = np.array_split(
        product.sum(axis=1), min(SETTINGS.outlier_logs.blocks, residual.shape[1]), axis=1
    )
    return Slopes(
        information=np.tensordot(parameters * weight, parameters, ((1, 2), (1, 2))) / law.excess,
        scores=np.stack([block.sum(axis=1) for block in blocks], axis=1),
        channels=product.sum(axis=2),
    )

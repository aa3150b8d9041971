"""What each log says of the parameters that all share, and which log wants one elsewhere.

A parameter is tested log by log: do the one-step errors of a log ask for another value than those
of all other logs? The slope of their likelihood is cleared of what the logs share and of each log's
own initial states (Neyman 1959). Its scatter over blocks of time tells how sure it is, and the
scatter of the other logs among each other how much logs differ anyway.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from diffthrust.diagnosis._innovations_fit import CandidateFitter, TrialFit
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.estimation._laws import Law
from diffthrust.estimation._one_step import Pass, passes, settled_start
from diffthrust.estimation._problem import Problem

_STEP = 1e-4
"""Numerics: share of a coordinate over which derivatives are differences."""
_BLIND = 1e-6
"""Numerics: a log tells nothing of a parameter of which it has less than this share of all
information."""


@dataclass(frozen=True)
class Slopes:
    """What one log says of the shared parameters, its own initial states cleared.

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
    """How far a parameter is off in one log, in coordinates of the fit.

    Args:
        log: place of the log.
        parameter: place of the parameter.
        size: the value that this log wants less that of the others.
        error: standard error of that.
        freedom: degrees of freedom of the error.
        channel: place of the channel that says so most.
        others: how far the optimum of the other logs is off the present values, ``(P,)``.
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
        """How far the optimum of this log is off the present values, ``(P,)``."""
        return self.others + self.size * np.eye(self.others.size)[self.parameter]

    @property
    def p_value(self) -> float:
        """Of this one test."""
        from scipy.special import stdtr  # slow to import

        return float(2 * stdtr(self.freedom, -abs(self.size) / self.error))


def deviations(logs: Sequence[Slopes]) -> list[Deviation]:
    """The logs that want a parameter elsewhere than all others, the surest first.

    Each log that is found is left out of the tests of the rest; fewer than half can be odd.
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
    joint = np.sum([logs[k].information for k in among], axis=0)
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
    """A deviation whose error contains how much the other logs differ among each other.

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
    """What each log says of the model's parameters, training logs first, then unseen ones."""
    problems = [trial.at_values]
    if trial.unseen is not None:
        problems.append(settled_start(trial.unseen))
    places = [i for i, n in enumerate(trial.names) if n not in fitter.nuisance]
    sigma = np.asarray(trial.quadratic.sigma)
    return [log_slopes for problem in problems for log_slopes in _slopes(problem, places, sigma)]


def _slopes(problem: Problem, places: Sequence[int], sigma: np.ndarray) -> Iterator[Slopes]:
    """By differences of passes: nothing is compiled for it."""
    z, first, states = problem.start(), problem.shared, len(problem.layout.starts)
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
    jacobian = np.nan_to_num(jacobian / sigma[:, None])
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

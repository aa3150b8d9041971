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
    found: list[Deviation] = []
    left = list(range(len(logs)))
    level = SETTINGS.outlier_logs.false_alarms / (len(logs) * max(1, len(logs[0].scores)))
    while 2 * (len(found) + 1) < len(logs):
        near = [one for one in tested(logs, left) if one.p_value < level]
        sure = [one for one in (widened(logs, left, one) for one in near) if one.p_value < level]
        if not sure:
            break
        found.append(max(sure, key=lambda one: abs(one.size) / one.error))
        left.remove(found[-1].log)
    return found


def tested(logs: Sequence[Slopes], among: Sequence[int]) -> Iterator[Deviation]:
    """Every parameter of every log against the other logs."""
    whole = np.sum([logs[k].information for k in among], axis=0)
    length = np.sqrt(np.maximum(np.diagonal(whole), 1e-300))
    scaled = whole / np.outer(length, length)
    inverse = np.linalg.pinv(scaled, rcond=1e-11, hermitian=True) / np.outer(length, length)
    slope = np.sum([logs[k].scores.sum(axis=1) for k in among], axis=0)
    for k in among:
        own = logs[k].information
        for j in range(len(length)):
            through = own[j] @ inverse
            left = own[j, j] - through @ own[:, j]
            if not left > _BLIND * whole[j, j]:
                continue
            blocks = [-through @ logs[m].scores for m in among]
            blocks[among.index(k)] = blocks[among.index(k)] + logs[k].scores[j]
            total = sum(float(block.sum()) for block in blocks)
            size = -total / left
            yield Deviation(
                log=k,
                parameter=j,
                size=size,
                error=max(sum(map(_scatter, blocks)), left) ** 0.5 / left,
                freedom=max(1, sum(block.size - 1 for block in blocks)),
                channel=int(np.argmax(logs[k].channels[j] * np.sign(total))),
                others=-inverse @ (slope + size * own[:, j]),
            )


def _scatter(block: np.ndarray) -> float:
    """Variance of the sum of some values, by how they scatter about their mean."""
    return float(np.var(block, ddof=1)) * block.size if block.size > 1 else 0.0


def widened(logs: Sequence[Slopes], among: Sequence[int], one: Deviation) -> Deviation:
    """A deviation whose error contains how much the other logs differ among each other.

    By the moments of DerSimonian and Laird (1986), with the degrees of freedom of Satterthwaite
    (1946).
    """
    others = [k for k in among if k != one.log]
    beside = [d for d in tested(logs, others) if d.parameter == one.parameter]
    if len(beside) < 2:
        return one
    sizes, weights = (
        np.array(x) for x in zip(*((d.size, d.error**-2) for d in beside), strict=True)
    )
    between = max(0.0, float(weights @ sizes**2) - len(beside)) / float(weights.sum())
    within = one.error**2
    share = within**2 / one.freedom + between**2 / (len(beside) - 1)
    return replace(one, error=(within + between) ** 0.5, freedom=(within + between) ** 2 / share)


def slopes(trials: CandidateFitter, trial: TrialFit) -> list[Slopes]:
    """What each log says of the model's parameters, training logs first, then unseen ones."""
    problems = [trial.at_values]
    unseen = trials.ready(trial.effects).unseen
    if unseen is not None:
        held = trial.limit.on(unseen.focus(trial.names, trial.values))
        problems.append(settled_start(held))
    known = [i for i, n in enumerate(trial.names) if n not in trials.nuisance]
    sigma = np.asarray(trial.quadratic.sigma)
    return [one for problem in problems for one in _slopes(problem, known, sigma)]


def _slopes(problem: Problem, known: Sequence[int], sigma: np.ndarray) -> Iterator[Slopes]:
    """By differences of passes: nothing is compiled for it."""
    z, first, states = problem.start(), problem.shared, len(problem.layout.starts)
    high = problem.limits()[1]
    now = passes(problem, z)
    by_place = []
    for at in [[i] for i in known] + [[*range(first + j, z.size, states)] for j in range(states)]:
        step = _STEP * (1 + float(np.abs(z[at]).max()))
        there = z.copy()
        there[at] += step if np.all(z[at] + step <= high[at]) else -step
        pairs = zip(passes(problem, there), now, strict=True)
        by_place.append([(a.errors - b.errors) / (there - z)[at[0]] for a, b in pairs])
    law = problem.layout.likelihood.law
    for k, one in enumerate(now):
        jacobian = np.stack([by_log[k] for by_log in by_place])
        yield _of_log(one, jacobian, len(known), sigma, law)


def _of_log(one: Pass, jacobian: np.ndarray, count: int, sigma: np.ndarray, law: Law) -> Slopes:
    """Slopes of one log from derivatives ``(P + states, C, T)`` of its errors."""
    rest = np.nan_to_num(one.errors / sigma[:, None])
    jacobian = np.nan_to_num(jacobian / sigma[:, None])
    weight = np.asarray(law.weights(rest[None], np.ones(len(sigma))))[0]
    own, starts = jacobian[:count], jacobian[count:]
    flat = (starts * weight).reshape(len(starts), rest.size)
    inner = flat @ starts.reshape(len(starts), rest.size).T
    cross = flat @ own.reshape(count, rest.size).T
    own = own - np.tensordot(np.linalg.pinv(inner, hermitian=True) @ cross, starts, (0, 0))
    product = own * weight * rest
    blocks = np.array_split(
        product.sum(axis=1), min(SETTINGS.outlier_logs.blocks, rest.shape[1]), axis=1
    )
    return Slopes(
        information=np.tensordot(own * weight, own, ((1, 2), (1, 2))) / law.excess,
        scores=np.stack([block.sum(axis=1) for block in blocks], axis=1),
        channels=product.sum(axis=2),
    )

"""Passes of an observer over logs: one-step errors and the path of the states."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Any

import jax
import numpy as np

from diffthrust._support._running.programs import program
from diffthrust.estimation._likelihood import named_values, tightness, values_of_log
from diffthrust.estimation._numbers import Batch, ProblemNumbers
from diffthrust.estimation._observer import CLIP, Limits, innovations
from diffthrust.estimation._problem import Layout, Problem
from diffthrust.estimation._residuals import Innovations
from diffthrust.simulation._starts import FIRST_PART

_ROUNDS = 2
"""Rounds of Gauss-Newton for initial states: the errors are nearly linear in them."""
_APART = 8
"""Numerics: so many logs at most are passed one by one, so that one program serves training and
unseen logs, and logs that are left out: of the example in the README three programs less. 200 logs
of 60 samples took 0.06 s one by one, and 0.01 s at once."""


@dataclass(frozen=True)
class Pass:
    """One log."""

    errors: np.ndarray  # measured minus predicted, ``(C, T)``; NaN where nothing was measured
    measured: np.ndarray  # ``(C, T)``
    path: dict[str, np.ndarray]  # inputs, states before each correction, and the observer's notes


def passes(problem: Problem, z: np.ndarray | None = None) -> list[Pass]:
    """A pass over each log of a problem in the innovations form, in the order of ``records``.

    At coordinates ``z``, initial states included; at the problem's own values where ``None``.
    """
    by_log: dict[int, Pass] = {}
    batches, by_batch = problem.numbers.batches, batch_passes(problem, z)
    for batch, indices, (errors, path) in zip(batches, problem.order, by_batch, strict=True):
        measured = np.asarray(batch.measured)
        errors = np.where(np.isnan(measured), np.nan, errors)
        series = {**batch.inputs, **path, "time": batch.time}
        series = {name: np.asarray(values) for name, values in series.items()}
        for row, index in enumerate(indices):
            size = len(problem.records[index])
            signals = {name: values[row, :size] for name, values in series.items()}
            by_log[index] = Pass(errors[row, :, :size], measured[row, :, :size], signals)
    return [by_log[index] for index in range(len(problem.records))]


def batch_passes(problem: Problem, z: np.ndarray | None = None) -> list[tuple[Any, dict[str, Any]]]:
    """Errors ``(B, C, T)``, zero where nothing was measured, and the path of each batch of logs."""
    z = problem.start() if z is None else np.asarray(z)
    layout, numbers = problem.layout, problem.numbers
    shared, starts = numbers.split(z, layout.shared)
    of_all = replace(numbers, batches=())
    out = []
    for grid, batch, start in zip(layout.grids, numbers.batches, starts, strict=True):
        static, logs = replace(layout, grids=(grid,)), replace(batch, start=start)
        parts = [_pass(static, of_all, shared, part) for part in _parts(logs)]
        out.append(jax.tree.map(lambda *series: np.concatenate(series), *parts))
    return out


def _parts(batch: Batch) -> list[Batch]:
    """The logs that are passed together: few of them one by one, many at once."""
    count = len(batch.time)
    if count > _APART:
        return [batch]
    return [jax.tree.map(lambda a, k=k: a[k : k + 1], batch) for k in range(count)]


def settled_start(problem: Problem) -> Problem:
    """The problem with the initial states that fit it best, its parameters unchanged.

    By differences: no other derivative of the passes is compiled. Errors beyond what the observer
    follows count as much as those at that limit.
    """
    return _settled(problem, problem.layout.local)


def with_own_values(problem: Problem) -> Problem:
    """Unseen logs with values of their own of what differs by log, from the first part of each.

    As in whole runs of a fit (`first_part`), so that the rest is predicted.
    """
    absent = {*problem.layout.free} - {*problem.free}
    differing = {name for name, _ in problem.layout.per_log} - absent
    if not differing:
        return problem
    batches = []
    for batch in problem.numbers.batches:
        begin, end = np.asarray(batch.time)[:, :1], np.asarray(batch.time)[:, -1:]
        first = np.asarray(batch.time) <= begin + FIRST_PART * (end - begin)
        batches.append(replace(batch, measured=np.where(first[:, None], batch.measured, np.nan)))
    early = replace(problem, numbers=replace(problem.numbers, batches=batches))
    z = _settled(early, differing).start()
    return problem.focus(problem.free, problem.values(z), z[problem.shared :])


@np.errstate(over="ignore", invalid="ignore")  # of values at which the model runs away
def _settled(problem: Problem, names: Collection[str]) -> Problem:
    """The problem with these of its logs' own coordinates where they fit it best."""
    first, states = problem.shared, problem.each
    sought = [j for j, name in enumerate(problem.layout.local) if name in names]
    if not sought:
        return problem
    z = problem.start()
    limit = (problem.numbers.reach * np.asarray(problem.numbers.clip))[:, None]
    errors = np.concatenate([log.errors for log in passes(problem, z)], axis=1)
    count = np.maximum(np.isfinite(errors).sum(axis=1, keepdims=True), 1)
    spread = np.sqrt(np.nansum(errors**2, axis=1, keepdims=True) / count)
    # without a clip, as of whole runs, errors count by their own spread
    size = np.where(np.isfinite(limit), limit, CLIP * np.maximum(spread, 1e-300))
    pull = np.sqrt(np.asarray(tightness(problem.layout, problem.numbers)))[sought] / CLIP

    def weighed(at: np.ndarray) -> list[np.ndarray]:
        rests = [np.clip(log.errors, -limit, limit) / size for log in passes(problem, at)]
        return [np.nan_to_num(residual).ravel() for residual in rests]

    logs = [index for indices in problem.order for index in indices]  # in the order of z
    for _ in range(_ROUNDS):
        now = weighed(z)
        own = z[first:].reshape(-1, states)
        moves = 1e-4 * (1.0 + np.abs(own)).max(axis=0)[sought]
        columns = []
        for j, move in zip(sought, moves, strict=True):
            moved = z.copy()
            moved[first + j :: states] += move
            columns.append([(a - b) / move for a, b in zip(weighed(moved), now, strict=True)])
        for place, index in enumerate(logs):
            slopes = np.stack([column[index] for column in columns], axis=1)
            slopes = np.concatenate([slopes, np.diag(pull)])
            residual = np.concatenate([now[index], pull * own[place, sought]])
            length = np.maximum(np.linalg.norm(slopes, axis=0), 1e-300)
            step = np.linalg.lstsq(slopes / length, -residual, rcond=1e-6)[0] / length
            z[first + place * states + np.array(sought)] += step
    return problem.focus(problem.free, problem.values(z), z[first:])


def cost(problem: Problem) -> float:
    """Negative log-likelihood at the problem's values."""
    errors = [errors for errors, _ in batch_passes(problem)]
    tight, own = np.asarray(tightness(problem.layout, problem.numbers)), problem.start()
    away = own[problem.shared :].reshape(len(problem.records), -1)
    likelihood, _ = cost_of_errors(problem.layout, problem.numbers, errors)
    return float(likelihood) + 0.5 * float(np.sum(tight * away**2))


@program(1)
def cost_of_errors(layout: Layout, numbers: ProblemNumbers, errors: Any) -> Any:
    """Negative log-likelihood of errors ``(B, C, T)`` by batch, and the noise of each channel."""
    return layout.cost(numbers, errors)


@np.errstate(over="ignore", invalid="ignore")  # infinite where the model runs away
def nrmse(problem: Problem) -> float:
    """Root mean over the channels of squared errors over variance of the measurement."""
    logs = passes(problem)
    ratios = []
    for i in range(len(problem.layout.channels)):
        errors = np.concatenate([log.errors[i] for log in logs])
        finite = np.isfinite(errors)
        if finite.any():
            measured = np.concatenate([log.measured[i] for log in logs])[finite]
            ratios.append(np.mean(errors[finite] ** 2) / np.var(measured))
    return float(np.sqrt(np.mean(ratios)))


def with_clip(problem: Problem, clip: Any, reach: Any = 1.0) -> Problem:
    """The problem in the innovations form with errors limited where they correct states.

    ``clip`` is the size of a large error, ``(C,)``; limited they are at ``reach`` times that.
    """
    clip, reach = np.asarray(clip, float), np.asarray(reach, float)
    return replace(problem, numbers=replace(problem.numbers, clip=clip, reach=reach))


@program(1, quick_compile=True)
def _pass(layout: Layout, numbers: ProblemNumbers, shared: Any, logs: Batch) -> Any:
    """Errors ``(B, C, T)`` and the paths of some logs of one batch."""
    assert isinstance(layout.likelihood, Innovations)
    observer, (grid,) = layout.likelihood.observer, layout.grids
    values, limits = named_values(layout, numbers, shared), Limits(numbers.clip, numbers.reach)

    def passed(log: Batch) -> Any:
        begin = {name: log.start[i] for i, name in enumerate(layout.starts)}
        states, own = {**log.held, **begin}, values_of_log(layout, numbers, values, log.start)
        return innovations(observer, layout.key.model.bind(own), grid, own, log, states, limits)

    return jax.lax.map(passed, logs)

"""What a fit may claim: named statuses, each earned by a check."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from diffthrust._support.correlation import lag_one
from diffthrust.estimation._insensitive import vanished
from diffthrust.estimation._likelihood import Quadratic, errors_at
from diffthrust.estimation._problem import Problem
from diffthrust.estimation._solver import NOTHING
from diffthrust.models._base.model import Model
from diffthrust.simulation._record import are_tables
from diffthrust.simulation._runs import Run
from diffthrust.simulation._trajectory import simulate_fixed

GRADIENT_LIMIT = 1e-5
"""A stationary point has max |J_j . r| / (|J_j| |r|) below this (true ones: below 1e-7)."""
RANK_LIMIT = 1e-13
"""Eigenvalues of the scaled information below this share of the largest count as zero: parameters
that only rounding tells apart (singular values of the Jacobian in the ratio 3e-7)."""


class Status(Enum):
    """The outcome of a fit; ``.value`` is the name used in JSON files.

    Example:
        >>> fit.status is dft.estimation.Status.CONVERGED, fit.status.value
        (True, 'converged')
    """

    CONVERGED = "converged"
    AT_BOUND = "converged_at_bound"
    NOT_IDENTIFIABLE = "not_identifiable"
    STARTS_DISAGREE = "starts_disagree"
    NOT_CONVERGED = "not_converged"
    SIMULATION_FAILED = "simulation_failed"

    def __str__(self) -> str:
        return self.value

    @property
    def ok(self) -> bool:
        """Whether the parameters and their errors can be used as they are.

        Example:
            >>> dft.estimation.Status.CONVERGED.ok, dft.estimation.Status.NOT_IDENTIFIABLE.ok
            (True, False)
        """
        return self in (Status.CONVERGED, Status.AT_BOUND)


@dataclass(frozen=True)
class Checks:
    """The figures behind a status.

    Args:
        gradient: max over free coordinates of |J_j . r| / (|J_j| |r|); zero at a stationary point.
        rank: rank of the scaled Jacobian.
        free_parameters: number of columns of that Jacobian (parameters not at a bound, and
            estimated initial states).
        condition: its condition number.
        starts: starts that were begun.
        starts_agreeing: starts that ended in the best optimum.

    Example:
        >>> fit.checks.rank, fit.checks.free_parameters, fit.checks.gradient < 1e-3
        (4, 4, True)
    """

    gradient: float
    rank: int
    free_parameters: int
    condition: float
    starts: int
    starts_agreeing: int


@dataclass(frozen=True)
class Local:
    """The neighbourhood of an optimum: what is known there and what is not."""

    gradient: float
    rank: int
    columns: int
    samples: int
    condition: float
    at_bound: tuple[str, ...]
    vanished: tuple[str, ...]
    covariance: np.ndarray
    spread: np.ndarray  # covariance of all coordinates, ``(n, n)``; NaN where there is none
    combinations: tuple[str, ...]
    rounding: float = 0.0  # the part of the gradient that floating-point numbers do not resolve


def examine(problem: Problem, z: np.ndarray, q: Quadratic) -> Local:
    """Stationarity, rank, condition, bound contact and covariance at some coordinates.

    Where the values of parameters that differ by log have bounds, they take the place of how far
    they are from the means.

    The covariance is that of the model's free parameters in their own units, ``(k, k)``; rows of
    parameters at a bound, or of those that cannot be told apart, are NaN. An observer's gains and
    memories are no claim of the fit: they follow to their best values, and where nothing depends
    on one (the memory of a force that is absent) nothing is lost.
    """
    low, high = problem.limits()
    if (turn := problem.turn) is not None:
        (low, high), z, q = turn.limited(low, high), turn.to(z), q.turned(turn.matrix)
    k, free = len(problem.own), len(problem.free)
    out, every = np.full((k, k), np.nan), np.full((z.size, z.size), np.nan)
    if not np.isfinite(q.cost):
        return Local(np.inf, 0, z.size, 0, np.inf, (), (), out, every, ())
    g, information = np.asarray(q.gradient), np.asarray(q.information)
    at_low = (z <= low + 1e-9) & (g >= 0)
    at_high = (z >= high - 1e-9) & (g <= 0)
    vanishing = vanished(problem, z)
    bound = at_low | at_high | vanishing
    # an initial state that nothing measured depends on is no unknown of the fit
    place, length = np.arange(z.size), np.sqrt(np.maximum(np.diagonal(information), 0.0))
    idle = length * np.maximum(1.0, np.abs(z)) < NOTHING  # a search holds these
    unseen = (place >= free) & idle
    nuisance = (place >= k) & (place < free)
    inside = np.flatnonzero(~bound & ~unseen & ~nuisance)
    beside = np.flatnonzero(~bound & nuisance)
    # in unit columns: otherwise the rank would depend on the parameters' units
    length = np.where(idle, 1.0, length)
    slope, scaled = marginal_spread(
        g / length, information / np.outer(length, length), inside, beside
    )
    length = length[inside]
    values, vectors = np.linalg.eigh(scaled)
    # A search converges on a redundant parameter as on any other. Inverting its eigenvalue, which
    # is rounding, would print a standard error of a number that the logs do not determine.
    null = values <= RANK_LIMIT * max(values.max(initial=0.0), 1e-300)
    samples = float(np.sum(problem.numbers.counts))
    energy = max(float(q.energy), 0.01 * samples)  # residuals at rounding have no direction
    # Checked here because a solver's word is not enough: at points that one reported as optima this
    # was 0.016 to 0.89, at true optima below 4e-8.
    gradient = np.max(np.abs(slope) / np.sqrt(energy), initial=0.0)
    inverse = _inverse(values, vectors, null) / np.outer(length, length)
    inverse *= inflation(problem, samples, inside.size + beside.size)
    every[np.ix_(inside, inside)] = inverse
    ours = inside[inside < k]
    slopes = problem.slopes(z)[ours]
    out[np.ix_(ours, ours)] = inverse[: ours.size, : ours.size] * np.outer(slopes, slopes)
    starts = np.array([_is_start(problem, int(i)) for i in inside], bool)
    redundant = _of_parameters(vectors[:, null], starts)
    combinations = tuple(_combination(problem, inside, vector / length) for vector in redundant.T)
    smallest = (values if combinations else values[~null]).min(initial=np.inf)
    condition = np.sqrt(values.max(initial=1.0) / smallest) if smallest > 0 else np.inf
    names = tuple(problem.free[i] for i in np.flatnonzero(bound[:k]))
    rank = int(np.sum(~null))
    return Local(
        gradient=float(gradient),
        rank=rank,
        columns=rank + len(combinations),
        samples=int(samples),
        condition=float(condition) if inside.size else 1.0,
        at_bound=names,
        vanished=tuple(problem.free[i] for i in np.flatnonzero(vanishing[:k])),
        covariance=out,
        spread=every,
        combinations=combinations,
    )


def _inverse(values: np.ndarray, vectors: np.ndarray, null: np.ndarray) -> np.ndarray:
    """The inverse of what has these eigenvalues, NaN for coordinates that ``null`` ones move."""
    kept = vectors[:, ~null]
    inverse = (kept / values[~null]) @ kept.T
    unknown = np.any(np.abs(vectors[:, null]) > 1e-3, axis=1)
    inverse[unknown, :] = np.nan
    inverse[:, unknown] = np.nan
    return inverse


def marginal_spread(
    slope: np.ndarray, information: np.ndarray, inside: np.ndarray, beside: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Scaled gradient and information of some coordinates, where others follow them."""
    if not beside.size:
        return slope[inside], information[np.ix_(inside, inside)]
    cross = information[np.ix_(inside, beside)]
    block = information[np.ix_(beside, beside)]
    through = cross @ np.linalg.pinv(block, rcond=1e-10, hermitian=True)
    schur = information[np.ix_(inside, inside)] - through @ cross.T
    return slope[inside] - through @ slope[beside], 0.5 * (schur + schur.T)


def inflation(problem: Problem, samples: float, columns: int) -> float:
    """What the inverse information lacks to be the covariance.

    An estimated noise level is too low by the samples that the parameters used up; and a law that
    forgives outliers has a weighted information above the Fisher information.
    """
    used = samples / (samples - columns) if samples > columns else np.inf
    return problem.layout.likelihood.law.excess * (1.0 if all(problem.layout.known_noise) else used)


def _of_parameters(null: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """The redundant directions, ``(n, r)``, less those in which initial states alone move.

    These are no unknowns of the fit: of two states that only a sum of both tells of, it does not
    matter where each began.
    """
    _, sizes, turned = np.linalg.svd(null[~starts])
    moved = np.zeros(null.shape[1], bool)
    moved[: sizes.size] = sizes > 1e-3
    return null if moved.all() else null @ turned[moved].T


def _own_name(problem: Problem, i: int) -> str:
    """The name of a coordinate that each log has of its own."""
    return problem.layout.local[(i - problem.shared) % problem.each]


def _is_start(problem: Problem, i: int) -> bool:
    return i >= len(problem.free) and _own_name(problem, i) in problem.layout.starts


def _combination(problem: Problem, inside: np.ndarray, direction: np.ndarray) -> str:
    """A direction that changes nothing that was measured, in words."""
    k, named = len(problem.free), problem.named
    size = np.max(np.abs(direction)) or 1.0
    parts = []
    for i, change in zip(inside, direction / size, strict=True):
        if abs(change) < 1e-3:
            continue
        if i >= k:
            start = _is_start(problem, i)
            parts.append("an initial state" if start else f"{_own_name(problem, i)} of a log")
            continue
        p = named[problem.free[i]]
        if p.transform == "log":
            parts.append(f"{problem.free[i]} by {change:+.2g} %")
        else:
            parts.append(f"{problem.free[i]} by {0.01 * change * p.scale:+.2g} {p.unit}".rstrip())
    parts = list(dict.fromkeys(parts))
    if len(parts) == 1:
        return f"{parts[0].split(' by ')[0]} changes nothing that was measured"
    return f"changing {' and '.join(parts)} together changes nothing that was measured"


def judge(
    local: Local,
    cost: float,
    starts: int,
    agreeing: int,
    rivals: Sequence[str] = (),
    alone: bool = False,
) -> tuple[Status, str]:
    """The status that the checks allow, with a sentence that says why.

    Where no start was drawn beside the caller's guesses, ``alone``, agreement is no claim.
    """
    if not np.isfinite(cost):
        return Status.SIMULATION_FAILED, (
            "No start could be simulated: every one diverged. "
            "Start from other values, narrow the bounds, or raise substeps."
        )
    allowed = max(GRADIENT_LIMIT, local.rounding)
    if local.gradient > allowed:
        return Status.NOT_CONVERGED, (
            f"The search stopped where the error still falls (gradient {local.gradient:.1e}, "
            f"allowed {allowed:.0e}). Start nearer, or try more starts."
        )
    if local.samples <= local.columns:
        return Status.NOT_IDENTIFIABLE, (
            f"{local.samples} samples cannot determine {local.columns} unknowns and the noise. "
            "Use more data, or fix parameters."
        )
    if local.rank < local.columns:
        return Status.NOT_IDENTIFIABLE, (
            "These logs cannot tell some parameters apart: "
            f"{'; '.join(local.combinations)}. Fix one of them, or use logs that separate them."
        )
    if rivals:
        return Status.NOT_IDENTIFIABLE, (
            f"Several sets of values fit equally well; they differ in {', '.join(rivals)}. "
            "Narrow the bounds, or use logs that separate them."
        )
    if not alone and agreeing < 2:
        return Status.STARTS_DISAGREE, (
            f"Of {starts} starts only one reached the lowest error: there may be a lower one. "
            "Raise starts, or start nearer."
        )
    if local.at_bound:
        return Status.AT_BOUND, _of_bounds(local)
    single = " A single start says nothing of other optima." if starts == 1 else ""
    return Status.CONVERGED, f"{agreeing} of {starts} starts agree.{single}"


def failed_over(failures: Sequence[str], message: str, begun: bool) -> tuple[Status, str]:
    """The status and the sentence of a fit whose model leaves the finite numbers over whole runs.

    It has ``begun`` where it found a start that can be simulated, by segments or corrected states.
    """
    where = " ".join(failures[:3])
    if begun:
        message = f"The model that was found cannot be simulated over whole runs. ({message})"
    return Status.SIMULATION_FAILED, f"{message} {where}"


def _of_bounds(local: Local) -> str:
    ends = [name for name in local.at_bound if name not in local.vanished]
    places = {"at a bound": ends, "at zero": local.vanished}
    at = [f"{', '.join(names)} {where}" for where, names in places.items() if names]
    return (
        f"Converged with {' and '.join(at)}, held there by the data: a parameter at a bound has no "
        "standard error."
    )


def correlation_notes(problem: Problem, z: np.ndarray, runs: Sequence[Run]) -> tuple[str, ...]:
    """A sentence where errors are correlated that the likelihood takes as white."""
    white = problem.layout.likelihood.whiteness(are_tables(run.record for run in runs))
    if white.whole_runs:
        errors = [{n: t.residual for n, t in run.channels.items()} for run in runs]
    else:
        errors = errors_at(problem, z)
    lags = _correlated(errors, white.limit)
    return (white.sentence.format(lags),) if lags else ()


def effect_notes(model: Model, runs: Sequence[Run]) -> tuple[str, ...]:
    """What the numbers of effects come to, and those that the spacing of held samples moves."""
    record = runs[0].record
    held = {n for n in model.inputs if record.hold.get(n) == "zero"}
    recorded = {*record.inputs, *record.measured}
    differing = {name.rpartition(".")[0] for name in model.per_log}
    shared = [e for e in model.effects if e.name not in differing]
    meant = [f"{e.name}: {words}." for e in shared if (words := e.consequence(model, recorded))]
    sampled = [e.of_sampling(record.step) for e in model.effects if held & {*e.ports}]
    return (*meant, *filter(None, sampled))


def _correlated(runs: Sequence[Mapping[str, np.ndarray]], limit: float) -> str:
    """Channels with a lag-one correlation beyond a limit and beyond chance, with its value."""
    lags = {}
    for name in dict.fromkeys(name for run in runs for name in run):
        lag = lag_one([run[name] for run in runs if name in run])
        if lag > limit:
            lags[name] = lag
    return ", ".join(f"{name} {lag:.2f}" for name, lag in lags.items())


_SMALL = 1e-8
"""What initial states are moved by, as a share of the range that the state has in the run."""
_LARGE = 1e4
"""Runs that part by more are those of an unstable model: one that only adds up (a position, a
heading) parts by as much as the run is long, and rounding of 1e-12 then stays unseen."""


def unstable_advice(status: Status, model: Model, runs: Sequence[Run], corrects: bool) -> str:
    """What to add to the message of a fit that may not be used, where the model is unstable.

    Simulated over whole runs such a model forgets nothing: the last digits of its initial states
    and parameters decide where a run ends, the likelihood has ridges that no search follows, and
    the rank that is left of it is that of rounding. Predictions from sample to sample do not have
    that; the fit does not go over to them by itself, for their standard errors claim other things.
    """
    measured = any(set(run.channels) & set(model.all_states) for run in runs)
    if status.ok or corrects or not measured:
        return ""
    parted = [(_parted(model, run), run.name) for run in runs if not run.failure]
    times, name = max(parted, default=(0.0, ""))
    if times < _LARGE:
        return ""
    return (
        f" The model is unstable: over {name} a small difference at the start grows {times:.0e} "
        "times as large, so that whole runs hardly tell its parameters. Predict each sample from "
        "the ones before it: likelihood='innovations'."
    )


def _parted(model: Model, run: Run) -> float:
    """How many times larger a small difference of the initial states becomes."""
    states = {n: run.signals[n] for n in model.all_states if n in run.signals}
    sizes = {n: float(np.ptp(x)) or 1.0 for n, x in states.items()}
    begin = {n: float(x[0]) + _SMALL * sizes[n] for n, x in states.items()}
    moved = simulate_fixed(model, run.record, begin, run.substeps)
    apart = [np.max(np.abs(moved[n] - x)) / (_SMALL * sizes[n]) for n, x in states.items()]
    return float(max(apart, default=0.0))

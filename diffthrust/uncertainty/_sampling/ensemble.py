"""Sampling by an ensemble of walkers (emcee), started by the fit's covariance."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import emcee
import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.progress import Progress, reporter
from diffthrust.uncertainty._sampling import chain_file
from diffthrust.uncertainty._sampling.chain_file import (
    BLOCK,
    Mark,
    Stored,
    packed,
    problem_identity,
)
from diffthrust.uncertainty._sampling.posterior import LANES, Posterior

_TAILS = 5.0
"""Degrees of freedom of independent proposals: heavier tails than most posteriors."""
_MOST_INDEPENDENT = 0.7
"""Share of independent proposals if enough are accepted."""
_ENOUGH = 0.3
"""Acceptance rate that is enough."""
_WIDER = 1.3
"""Walkers start wider than the posterior, so that R-hat can detect missing mixing."""
SAVE_EVERY = 5.0
"""Seconds between saves of the file, ..."""
SAVE_SHARE = 20.0
"""... and at least this multiple of the duration of a save."""


@dataclass(frozen=True)
class Chains:
    """The result of a sampler.

    Args:
        points: coordinates after the warmup, ``(chains, draws, d)``.
        log_prob: log densities, ``(chains, draws)``.
        levels: noise levels, ``(chains, draws, C)``.
        stats: further statistics of the sampler by name, ``(chains, draws)`` each.
        attrs: statistics of the run.
    """

    points: np.ndarray
    log_prob: np.ndarray
    levels: np.ndarray
    stats: Mapping[str, np.ndarray] = field(default_factory=dict)
    attrs: Mapping[str, Any] = field(default_factory=dict)


def default_walkers(dim: int) -> int:
    """At least twice as many walkers as coordinates, and enough to fill the vector registers.

    emcee evaluates half of the walkers at a time, hence two times `LANES`.
    """
    return max(2 * LANES, 2 * (dim + 1))


def lanes_of(walkers: int) -> int:
    """Points per evaluation, such that few lanes are empty.

    emcee calls the density with half of the walkers in most moves and with all of them in others.
    Both numbers are split into portions of one size: a program for each would be compiled twice.
    """
    half = walkers // 2
    return math.ceil(half / math.ceil(half / LANES))


def run_ensemble(
    posterior: Posterior,
    *,
    draws: int,
    warmup: int,
    walkers: int,
    seed: int,
    file: Path | None = None,
    progress: Progress | None = None,
) -> Chains:
    """Sample a posterior.

    With a ``file`` the run is saved every few seconds, and a killed run resumes from its last save:
    steps and final file are identical to those of an uninterrupted run.
    """
    report = reporter(progress)
    lanes, total = lanes_of(walkers), warmup + draws
    who = problem_identity(posterior, seed=seed, walkers=walkers, warmup=warmup)
    stored = chain_file.read(file, who) if file else None
    if stored is None:
        stored = _begin(posterior, walkers, seed)
    elif file and len(stored.chain):
        _same_density(file, posterior, stored, lanes)
    backend = _backend(stored, walkers)
    saving = _Saving(file, who, posterior.labels, stored, backend)

    def density(points: np.ndarray) -> np.ndarray:
        log_prob, levels = posterior.batch(points, lanes)
        return np.column_stack([log_prob, levels])

    try:
        # two legs: proposals are adapted once, half-way through the warmup, and are fixed for all
        # draws
        for until in (min(warmup // 2, total), total):
            if backend.iteration >= until:
                continue
            centre, root, share = stored.centre, stored.root, _MOST_INDEPENDENT
            if until == total and warmup >= 8:
                centre, root, share = _adapted(backend, density, stored, warmup, seed)
            sampler: Any = emcee.EnsembleSampler(
                walkers,
                posterior.dim,
                density,
                moves=_moves(centre, root, share),
                vectorize=True,
                backend=backend,
                blobs_dtype=float,
            )
            sampler.log_prob_fn = density  # emcee's wrapper would print a traceback on an interrupt
            if backend.iteration:
                start = backend.get_last_sample()
            else:
                first = _walkers(posterior, stored.root, walkers, seed)
                start = emcee.State(first, random_state=stored.random_state)
            # emcee's check rejects nearly coplanar walkers, which narrow posteriors produce
            for _ in sampler.sample(
                start, iterations=until - backend.iteration, skip_initial_state_check=True
            ):
                at = backend.iteration
                saving.mark()
                if at % 20 == 0:
                    report("warmup" if at < warmup else "drawing", at / total)
                saving.now_and_then()
    except KeyboardInterrupt:
        saving.finish()
        raise
    saving.finish()
    return _chains(backend, warmup, draws)


@dataclass
class _Saving:
    """Saves a growing chain every few seconds, and when the run ends; nothing without a file."""

    file: Path | None
    who: Mapping[str, Any]
    labels: tuple[str, ...]
    stored: Stored
    """The chain as it was when the run began."""
    backend: Any
    """emcee's record of the chain."""
    saved: float = field(default_factory=time.monotonic)
    took: float = 0.0
    marks: list[Mark] = field(init=False)

    def __post_init__(self) -> None:
        self.marks = [*self.stored.marks]

    def mark(self) -> None:
        """Record the generator's state at the end of a block, from which a run can resume."""
        if self.backend.iteration == (len(self.marks) + 1) * BLOCK:
            state = packed(self.backend.random_state)
            self.marks.append((self.backend.accepted.copy(), state))

    def now_and_then(self) -> None:
        """Save if the last save is long enough ago."""
        now = time.monotonic()
        if self.file and now - self.saved >= max(SAVE_EVERY, SAVE_SHARE * self.took):
            self._save(self.file)
            self.saved = time.monotonic()
            self.took = self.saved - now

    def finish(self) -> None:
        """Save what the run has added."""
        if self.file and self.backend.iteration > len(self.stored.chain):
            self._save(self.file)

    def _save(self, file: Path) -> None:
        backend, (_, walkers, channels) = self.backend, self.stored.levels.shape
        now = Stored(
            backend.chain[: backend.iteration],
            backend.log_prob[: backend.iteration],
            backend.blobs[: backend.iteration].reshape(-1, walkers, channels),
            backend.accepted,
            backend.random_state,
            self.stored.centre,
            self.stored.root,
            tuple(self.marks),
        )
        chain_file.write(file, chain_file.chain_bytes(now, self.who, self.labels))


def _adapted(
    backend: Any,
    density: Callable[[np.ndarray], np.ndarray],
    stored: Stored,
    warmup: int,
    seed: int,
) -> tuple[np.ndarray, np.ndarray, float]:
    """Adapt the independence proposals to the second quarter of the warmup."""
    quarter = slice(warmup // 4, warmup // 2)
    centre, root = learned(backend.chain[quarter], stored.centre, stored.root)
    late = slice(max(quarter.start, quarter.stop - 8), quarter.stop)
    points = backend.chain[late].reshape(-1, centre.size)
    log_prob = backend.log_prob[late].ravel()
    return centre, root, _suited(density, points, log_prob, centre, root, seed)


def _chains(backend: Any, warmup: int, draws: int) -> Chains:
    """The chain after the warmup, thinned."""
    kept = slice(warmup, warmup + draws)
    chain, walkers = backend.chain[kept], backend.chain.shape[1]
    levels = backend.blobs[kept].reshape(draws, walkers, -1)
    thin = _thinning(chain)
    return Chains(
        points=np.swapaxes(chain, 0, 1)[:, ::thin],
        log_prob=backend.log_prob[kept].T[:, ::thin],
        levels=np.swapaxes(levels, 0, 1)[:, ::thin],
        attrs={
            "acceptance_rate": float(np.mean(backend.accepted) / backend.iteration),
            "thin": thin,
            "walkers": walkers,
        },
    )


def _thinning(chain: np.ndarray) -> int:
    """Thinning: half the autocorrelation time, which loses almost no information."""
    if chain.shape[0] < 100:
        return 1
    memory = np.min(emcee.autocorr.integrated_time(chain, tol=0, quiet=True))
    return max(1, int(0.5 * memory)) if np.isfinite(memory) else 1


def _begin(posterior: Posterior, walkers: int, seed: int) -> Stored:
    """An empty chain."""
    channels = len(posterior.problem.layout.channels)
    state: Any = np.random.RandomState(seed).get_state()
    return Stored(
        np.empty((0, walkers, posterior.dim)),
        np.empty((0, walkers)),
        np.empty((0, walkers, channels)),
        np.zeros(walkers),
        state,
        posterior.centre,
        np.linalg.cholesky(posterior.covariance),
    )


def _walkers(posterior: Posterior, root: np.ndarray, walkers: int, seed: int) -> np.ndarray:
    """Start points: around the fit, within the bounds, with a finite density."""
    rng = np.random.default_rng(seed)
    low, high = posterior.low, posterior.high
    drawn = np.empty((0, posterior.dim))
    width = _WIDER
    for _ in range(20):
        x = posterior.centre + width * rng.standard_normal((walkers, posterior.dim)) @ root.T
        x = np.where(x < low, 2 * low - x, x)  # reflect at the bounds
        x = np.where(x > high, 2 * high - x, x)
        density, _ = posterior.batch(x, lanes_of(walkers))
        drawn = np.concatenate([drawn, x[np.isfinite(density)]])
        if len(drawn) >= walkers:
            return drawn[:walkers]
        # near the edge of where the simulation works a narrower cloud still finds points
        width *= 0.8
    raise InputError(
        f"Only {len(drawn)} of {20 * walkers} points drawn around the fit have a likelihood: the "
        "simulation fails beside it.",
        "Raise substeps, narrow the bounds, or give priors.",
    )


def _same_density(file: Path, posterior: Posterior, stored: Stored, lanes: int) -> None:
    """Raise `InputError` if the last walkers of a file have another density now.

    Equations may have changed under the same names, which the identity does not show.
    """
    now, _ = posterior.batch(stored.chain[-1], lanes)
    if not np.allclose(now, stored.log_prob[-1], rtol=1e-6, atol=1e-6):
        away = float(np.max(np.abs(now - stored.log_prob[-1])))
        raise InputError(
            f"{file}: the chain of another problem. Its last walkers have other densities now (by "
            f"up to {away:.3g}): an equation, an effect or the integrator has changed.",
            "Name another file, or sample with what this one was begun with. It was left as it is.",
        )


def _backend(stored: Stored, walkers: int) -> Any:
    backend = emcee.backends.Backend()
    backend.reset(walkers, stored.chain.shape[2])
    if len(stored.chain):
        backend.chain, backend.log_prob = stored.chain, stored.log_prob
        # emcee keeps a single number per walker without an axis of its own
        single = stored.levels.shape[-1] == 1
        backend.blobs = stored.levels[..., 0] if single else stored.levels
        backend.accepted, backend.random_state = stored.accepted, stored.random_state
        backend.iteration = len(stored.chain)
    return backend


def independent_proposals(
    centre: np.ndarray, root: np.ndarray
) -> Callable[[np.ndarray, Any], tuple[np.ndarray, np.ndarray]]:
    """Independence proposals: multivariate t about the fit.

    If the posterior is close to the fit's Gaussian, most are accepted, and each is an independent
    draw; the heavy tails bound the ratio of the densities, so that no walker gets stuck (Mengersen
    & Tweedie 1996). They come with the logarithm of q(old) / q(new), as `emcee.moves.MHMove` asks.
    """
    dim = centre.size
    # Invert once: a LAPACK call may wait for its threads longer than the work takes.
    inverse = np.linalg.inv(root)

    def log_q(x: np.ndarray) -> np.ndarray:
        away = (x - centre) @ inverse.T
        return -0.5 * (_TAILS + dim) * np.log1p(np.sum(away**2, axis=1) / _TAILS)

    def propose(x: np.ndarray, rng: Any) -> tuple[np.ndarray, np.ndarray]:
        normal = rng.standard_normal(x.shape)
        longer = np.sqrt(_TAILS / rng.chisquare(_TAILS, size=(x.shape[0], 1)))
        new = centre + (longer * normal) @ root.T
        return new, log_q(x) - log_q(new)

    return propose


def _moves(centre: np.ndarray, root: np.ndarray, share: float) -> list[tuple[Any, float]]:
    """Independence proposals, and moves by other walkers for non-Gaussian posteriors."""
    return [
        (emcee.moves.MHMove(independent_proposals(centre, root), ndim=centre.size), share),
        (emcee.moves.DEMove(), (1 - share) * 2 / 3),
        (emcee.moves.StretchMove(), (1 - share) / 3),
    ]


def _suited(
    density: Callable[[np.ndarray], np.ndarray],
    points: np.ndarray,
    log_prob: np.ndarray,
    centre: np.ndarray,
    root: np.ndarray,
    seed: int,
) -> float:
    """The share of independence proposals: lower if few would be accepted.

    Estimated by one proposal from each of the points, ``(n, d)``, with a separate generator.
    """
    propose = independent_proposals(centre, root)
    new, factors = propose(points, np.random.RandomState(seed))
    accepted = np.exp(np.minimum(density(new)[:, 0] - log_prob + factors, 0.0))
    # never none at all: they are the only moves that leave one mode for another at once
    return max(0.1, _MOST_INDEPENDENT * min(1.0, float(np.mean(accepted)) / _ENOUGH))


def learned(
    chain: np.ndarray, centre: np.ndarray, root: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Centre and covariance of the proposals from a segment of the warmup, ``(n, W, d)``.

    Near a bound, or for a curved posterior, they fit better than those of the fit, which are kept
    if the segment is short. The result depends only on the chain, so that a resumed run repeats it,
    and adaptation ends with the warmup: draws come from one fixed mixture of moves, which keeps the
    stationary distribution exact.
    """
    dim = centre.size
    points = chain.reshape(-1, dim)
    # twenty points for each entry of the covariance, or proposals follow the accidents of the
    # warmup
    if len(chain) < 50 or len(points) < 20 * dim**2:
        return centre, root
    try:
        return points.mean(axis=0), np.linalg.cholesky(np.atleast_2d(np.cov(points.T)))
    except np.linalg.LinAlgError:  # the walkers have not moved
        return centre, root

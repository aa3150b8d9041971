"""Sampling by an ensemble of walkers (emcee), started and steered by the fit's covariance."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import emcee
import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.progress import Progress
from diffthrust.uncertainty._sampling import chain_file
from diffthrust.uncertainty._sampling.chain_file import Stored
from diffthrust.uncertainty._sampling.density import LANES, Posterior
from diffthrust.uncertainty._sampling.moves import MOST, learned, moves, suited

WIDER = 1.3
"""Walkers begin wider than the posterior should be, so that R-hat can tell whether they mixed."""
EVERY = 5.0
"""Seconds between savings of the file."""
SHARE = 20.0
"""And at least so many times what a saving takes."""


@dataclass(frozen=True)
class Chains:
    """What a sampler returns.

    Args:
        points: coordinates after the warmup, ``(chains, draws, d)``.
        log_prob: log densities, ``(chains, draws)``.
        levels: noise levels, ``(chains, draws, C)``.
        stats: further figures of the sampler by name, ``(chains, draws)`` each.
        attrs: figures of the whole run.
    """

    points: np.ndarray
    log_prob: np.ndarray
    levels: np.ndarray
    stats: Mapping[str, np.ndarray] = field(default_factory=dict)
    attrs: Mapping[str, Any] = field(default_factory=dict)


def default_walkers(dim: int) -> int:
    """At least twice as many walkers as coordinates, and enough to fill the vector registers."""
    return max(2 * LANES, 2 * (dim + 1))


def lanes_of(walkers: int) -> int:
    """Points per evaluation such that half and all of the walkers leave few places empty."""
    half = walkers // 2
    return math.ceil(half / math.ceil(half / LANES))


def run(
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

    With a ``file`` the run is saved every few seconds, and one that was killed goes on from its
    last saving: the steps, and the file in the end, are those of a run that nothing stopped.

    Raises:
        InputError: a file of another problem or one that cannot be written, or a density that is
            not finite around the fit.
    """
    tell = progress or (lambda message, done: None)
    lanes, channels = lanes_of(walkers), len(posterior.problem.layout.channels)
    who = chain_file.identity(posterior, seed=seed, walkers=walkers, warmup=warmup)
    stored = chain_file.read(file, who) if file else None
    if stored is None:
        stored = _begin(posterior, walkers, seed)
    elif file and len(stored.chain):
        _same_density(file, posterior, stored, lanes)

    def density(points: np.ndarray) -> np.ndarray:
        log_prob, levels = posterior.batch(points, lanes)
        return np.column_stack([log_prob, levels])

    def advance(proposals: list[tuple[Any, float]]) -> Any:
        sampler = emcee.EnsembleSampler(
            walkers,
            posterior.dim,
            density,
            moves=proposals,
            vectorize=True,
            backend=backend,
            blobs_dtype=float,
        )
        begin = _last(backend)
        if begin is None:
            begin = emcee.State(
                _walkers(posterior, stored.root, walkers, seed), random_state=stored.random_state
            )
        # walkers near each other's plane are no mistake of the user's
        return sampler.sample(
            begin, iterations=until - backend.iteration, skip_initial_state_check=True
        )

    def save() -> None:
        if file:
            now = Stored(
                backend.chain[: backend.iteration],
                backend.log_prob[: backend.iteration],
                backend.blobs[: backend.iteration].reshape(-1, walkers, channels),
                backend.accepted,
                backend.random_state,
                stored.centre,
                stored.root,
            )
            chain_file.write(file, chain_file.image(now, who, posterior.labels))

    backend = _backend(stored, walkers)
    total, begun = warmup + draws, backend.iteration
    saved, took = time.monotonic(), 0.0
    try:
        for until in (min(warmup // 2, total), total):
            if backend.iteration >= until:
                continue
            centre, root, share = stored.centre, stored.root, MOST
            if until == total and warmup >= 8:
                part = slice(warmup // 4, warmup // 2)
                centre, root = learned(backend.chain[part], centre, root)
                late = slice(max(part.start, part.stop - 8), part.stop)
                points = backend.chain[late].reshape(-1, posterior.dim)
                log_prob = backend.log_prob[late].ravel()
                share = suited(density, points, log_prob, centre, root, seed)
            for _ in advance(moves(centre, root, share)):
                at = backend.iteration
                if at % 20 == 0:
                    tell("warmup" if at < warmup else "drawing", at / total)
                now = time.monotonic()
                if file and now - saved >= max(EVERY, SHARE * took):
                    save()
                    saved = time.monotonic()
                    took = saved - now
    except KeyboardInterrupt:
        if backend.iteration > begun:
            save()
        raise
    if backend.iteration > begun:
        save()
    kept = slice(warmup, total)
    levels = backend.blobs[kept].reshape(draws, walkers, channels)
    thin = _thinning(backend.chain[kept])
    return Chains(
        points=np.swapaxes(backend.chain[kept], 0, 1)[:, ::thin],
        log_prob=backend.log_prob[kept].T[:, ::thin],
        levels=np.swapaxes(levels, 0, 1)[:, ::thin],
        attrs={
            "acceptance_rate": float(np.mean(backend.accepted) / backend.iteration),
            "thin": thin,
            "walkers": walkers,
        },
    )


def _thinning(chain: np.ndarray) -> int:
    """Steps that are so alike that leaving them out loses next to nothing."""
    if chain.shape[0] < 100:
        return 1
    memory = np.min(emcee.autocorr.integrated_time(chain, tol=0, quiet=True))
    return max(1, int(0.5 * memory)) if np.isfinite(memory) else 1


def _begin(posterior: Posterior, walkers: int, seed: int) -> Stored:
    """A chain without a step."""
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
    """Where the walkers begin: around the fit, within the bounds, where the density is finite."""
    rng = np.random.default_rng(seed)
    low, high = posterior.low, posterior.high
    found = np.empty((0, posterior.dim))
    width = WIDER
    for _ in range(20):
        x = posterior.centre + width * rng.standard_normal((walkers, posterior.dim)) @ root.T
        x = np.where(x < low, 2 * low - x, x)  # a parameter at its bound keeps to the inside
        x = np.where(x > high, 2 * high - x, x)
        density, _ = posterior.batch(x, lanes_of(walkers))
        found = np.concatenate([found, x[np.isfinite(density)]])
        if len(found) >= walkers:
            return found[:walkers]
        width *= 0.8
    raise InputError(
        f"Only {len(found)} of {20 * walkers} points drawn around the fit have a likelihood: the "
        "simulation fails beside it.",
        "Raise substeps, narrow the bounds, or give priors.",
    )


def _same_density(file: Path, posterior: Posterior, stored: Stored, lanes: int) -> None:
    """Raise `InputError` where the last walkers of a file have another density now.

    Equations may have changed under the same names, which no description tells.
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
        backend.blobs = _squeezed(stored.levels)
        backend.accepted, backend.random_state = stored.accepted, stored.random_state
        backend.iteration = len(stored.chain)
    return backend


def _squeezed(levels: np.ndarray) -> np.ndarray:
    return levels[..., 0] if levels.shape[-1] == 1 else levels


def _last(backend: Any) -> Any:
    """Where a chain is, with the generator's state; ``None`` before the first step."""
    at = backend.iteration
    if not at:
        return None
    return emcee.State(
        backend.chain[at - 1],
        log_prob=backend.log_prob[at - 1],
        blobs=backend.blobs[at - 1],
        random_state=backend.random_state,
    )

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
from diffthrust._support.progress import Progress
from diffthrust.uncertainty._sampling import chain_file
from diffthrust.uncertainty._sampling.chain_file import Chain, problem_identity
from diffthrust.uncertainty._sampling.posterior import LANES, Posterior

Density = Callable[[np.ndarray], np.ndarray]
Proposal = Callable[[np.ndarray, Any], tuple[np.ndarray, np.ndarray]]
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
    """The result of a sampler, after the warmup.

    Coordinates ``(chains, draws, d)``, log densities ``(chains, draws)``, noise levels ``(chains,
    draws, C)``; further statistics by name ``(chains, draws)``, and those of the run.
    """

    points: np.ndarray
    log_prob: np.ndarray
    levels: np.ndarray
    stats: Mapping[str, np.ndarray] = field(default_factory=dict)
    attrs: Mapping[str, Any] = field(default_factory=dict)


def walkers_for(posterior: Posterior, wanted: int | None) -> int:
    """The number of walkers, even and enough for the coordinates.

    By default enough to fill the vector registers, too: emcee evaluates half of them at a time.
    """
    # with fewer walkers than twice the coordinates stretch moves stay in a subspace (Goodman &
    # Weare 2010)
    least = 2 * (posterior.dim + 1)
    if wanted is None:
        return max(2 * LANES, least)
    if wanted < least or wanted % 2:
        raise InputError(
            f"walkers: expected an even number of at least {least}, for {posterior.dim} "
            f"coordinates ({', '.join(posterior.labels)}), found {wanted}.",
            f"Give {max(least, wanted + wanted % 2)} or more.",
        )
    return wanted


def lanes_of(walkers: int) -> int:
    """Points per evaluation, such that few lanes are empty.

    emcee calls the density with half of the walkers in most moves and with all of them in others.
    Both numbers are split into portions of one size: a program for each would be compiled twice.
    """
    half = walkers // 2
    return math.ceil(half / math.ceil(half / LANES))


def run_ensemble(
    posterior: Posterior,
    report: Progress,
    file: Path | None,
    *,
    draws: int,
    warmup: int,
    walkers: int,
    seed: int,
) -> Chains:
    """Sample a posterior.

    With a ``file`` the run is saved every few seconds, and a killed run resumes from its last save:
    steps and final file are identical to those of an uninterrupted run.
    """
    lanes, total = lanes_of(walkers), warmup + draws
    who = problem_identity(posterior, seed=seed, walkers=walkers, warmup=warmup)
    chain = chain_file.read(file, who) if file else None
    if chain is None:
        state: Any = np.random.RandomState(seed).get_state()
        root = np.linalg.cholesky(posterior.covariance)
        chain = Chain(walkers, posterior.centre, root, state)
    elif file and chain.iteration:
        _same_density(file, posterior, chain, lanes)
    saving = _Saving(file, who, posterior.labels, chain)

    def density(points: np.ndarray) -> np.ndarray:
        log_prob, levels = posterior.batch(points, lanes)
        return np.column_stack([log_prob, levels])

    try:
        # two legs: proposals are adapted once, half-way through the warmup, and are fixed for all
        # draws
        for until in (min(warmup // 2, total), total):
            if chain.iteration >= until:
                continue
            centre, root, share = chain.centre, chain.root, _MOST_INDEPENDENT
            if until == total and warmup >= 8:
                centre, root, share = _adapted(chain, density, warmup, seed)
            sampler = _sampler(chain, density, centre, root, share)
            if chain.iteration:
                start = chain.get_last_sample()
            else:
                first = _walkers(posterior, chain.root, walkers, seed)
                start = emcee.State(first, random_state=chain.random_state)
            # emcee's check rejects nearly coplanar walkers, which narrow posteriors produce
            for _ in sampler.sample(
                start, iterations=until - chain.iteration, skip_initial_state_check=True
            ):
                at = chain.iteration
                if at % 20 == 0:
                    report("warmup" if at < warmup else "drawing", at / total)
                saving.now_and_then()
    except KeyboardInterrupt:  # after a failed save another would overwrite that of another run
        saving.finish()
        raise
    saving.finish()
    return _chains(chain, warmup, draws)


@dataclass
class _Saving:
    """Saves a growing chain every few seconds, and when the run ends; nothing without a file."""

    file: Path | None
    who: Mapping[str, Any]
    labels: tuple[str, ...]
    chain: Chain
    saved: float = field(default_factory=time.monotonic)
    took: float = 0.0

    def __post_init__(self) -> None:
        self.begun = self.chain.iteration

    def now_and_then(self) -> None:
        """Save if the last save is long enough ago."""
        now = time.monotonic()
        if now - self.saved >= max(SAVE_EVERY, SAVE_SHARE * self.took):
            self.finish()
            self.saved = time.monotonic()
            self.took = self.saved - now

    def finish(self) -> None:
        """Save what the run has added."""
        if self.file and self.chain.iteration > self.begun:
            chain_file.write(self.file, chain_file.chain_bytes(self.chain, self.who, self.labels))


def _adapted(
    chain: Chain, density: Density, warmup: int, seed: int
) -> tuple[np.ndarray, np.ndarray, float]:
    """Proposals adapted to the second quarter of the warmup, and their share of the moves.

    The share is lower if few would be accepted, estimated by one proposal, with a separate
    generator, from each of the quarter's last points.
    """
    quarter = slice(warmup // 4, warmup // 2)
    centre, root = learned(chain.chain[quarter], chain.centre, chain.root)
    late = slice(max(quarter.start, quarter.stop - 8), quarter.stop)
    points = chain.chain[late].reshape(-1, centre.size)
    proposed, factors = independent_proposals(centre, root)(points, np.random.RandomState(seed))
    gain = density(proposed)[:, 0] - chain.log_prob[late].ravel() + factors
    accepted = float(np.mean(np.exp(np.minimum(gain, 0.0))))
    # never none at all: they are the only moves that leave one mode for another at once
    return centre, root, max(0.1, _MOST_INDEPENDENT * min(1.0, accepted / _ENOUGH))


def _chains(chain: Chain, warmup: int, draws: int) -> Chains:
    """The chain after the warmup, thinned by half the autocorrelation time: next to no loss."""
    points, log_prob, levels = (steps[warmup : warmup + draws] for steps in chain.steps)
    thin = 1
    if draws >= 100:
        memory = np.min(emcee.autocorr.integrated_time(points, tol=0, quiet=True))
        thin = max(1, int(0.5 * memory)) if np.isfinite(memory) else 1
    return Chains(
        points=np.swapaxes(points, 0, 1)[:, ::thin],
        log_prob=log_prob.T[:, ::thin],
        levels=np.swapaxes(levels, 0, 1)[:, ::thin],
        attrs={
            "acceptance_rate": float(np.mean(chain.accepted) / chain.iteration),
            "thin": thin,
            "walkers": chain.nwalkers,
        },
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


def _same_density(file: Path, posterior: Posterior, chain: Chain, lanes: int) -> None:
    """Raise `InputError` if the last walkers of a file have another density now.

    Equations may have changed under the same names, which the identity does not show.
    """
    now, _ = posterior.batch(chain.chain[-1], lanes)
    if not np.allclose(now, chain.log_prob[-1], rtol=1e-6, atol=1e-6):
        away = float(np.max(np.abs(now - chain.log_prob[-1])))
        raise InputError(
            f"{file}: the chain of another problem. Its last walkers have other densities now (by "
            f"up to {away:.3g}): an equation, an effect or the integrator has changed.",
            "Name another file, or sample with what this one was begun with. It was left as it is.",
        )


def independent_proposals(centre: np.ndarray, root: np.ndarray) -> Proposal:
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


def _sampler(
    chain: Chain, density: Density, centre: np.ndarray, root: np.ndarray, share: float
) -> Any:
    """Independence proposals, and moves by other walkers for non-Gaussian posteriors."""
    independent = emcee.moves.MHMove(independent_proposals(centre, root), ndim=centre.size)
    moves = [
        (independent, share),
        (emcee.moves.DEMove(), (1 - share) * 2 / 3),
        (emcee.moves.StretchMove(), (1 - share) / 3),
    ]
    common = {"moves": moves, "vectorize": True, "backend": chain, "blobs_dtype": float}
    sampler: Any = emcee.EnsembleSampler(chain.nwalkers, chain.ndim, density, **common)
    sampler.log_prob_fn = density  # emcee's wrapper would print a traceback on an interrupt
    return sampler


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

"""emcee as most use it: one density at a time, its own moves; the density compiled by numba."""

from __future__ import annotations

from typing import Any

import emcee
import numpy as np

from . import _problem
from ._numba import log_density, peer_fit
from ._problem import DRAWS, NOISE, WALKERS, WARMUP


def posterior(samples: int) -> Any:
    given = _problem.record(samples)
    found = peer_fit(given)
    slopes = found.jac * [*found.x[:3], 1.0]
    root = np.linalg.cholesky(np.linalg.inv(slopes.T @ slopes))
    centre = np.array([*np.log(found.x[:3]), found.x[3]])
    told = (*given, NOISE["speed"], NOISE["thrust"])

    def density(x: np.ndarray) -> float:
        value = log_density(x, *told)
        return value if np.isfinite(value) else -np.inf

    def run(turn: int) -> np.ndarray:
        rng = np.random.default_rng(turn)
        begin = centre + rng.standard_normal((WALKERS, 4)) @ root.T
        sampler: Any = emcee.EnsembleSampler(WALKERS, 4, density)
        state = emcee.State(begin, random_state=np.random.RandomState(turn).get_state())
        sampler.run_mcmc(state, WARMUP + DRAWS)
        return np.exp(np.swapaxes(sampler.get_chain(discard=WARMUP), 0, 1)[..., :3])

    return run

"""Simulation-based calibration: of truths drawn from the prior, ranks in the posterior are uniform.

Talts et al. 2018. `SIMULATIONS` may be lowered by the environment for a first look.
"""

import os

import numpy as np
import pytest
from posterior_cases import thruster_log
from scipy.stats import chisquare

import diffthrust as dft
from diffthrust.uncertainty import sample

pytestmark = pytest.mark.slow

SIMULATIONS = int(os.environ.get("DIFFTHRUST_SIMULATIONS", "300"))
PRIORS = {
    "alpha": dft.models.Normal(0.037, 0.004),
    "beta": dft.models.Normal(42.0, 3.0),
    "ct": dft.models.Normal(0.02, 0.002),
}
RANKS = 100
"""A rank is one of 0 to 99: the truth among 99 draws that are next to independent."""
BINS = 10
SIZES = {
    "emcee": dict(draws=99, warmup=60),
    "nuts": dict(draws=150, warmup=150, chains=4),
}


def ranks(method: str) -> np.ndarray:
    """Ranks by simulation and parameter."""
    rng = np.random.default_rng(7)
    found = np.empty((SIMULATIONS, len(PRIORS)), int)
    model = dft.Thruster().replace({n: p.mean for n, p in PRIORS.items()})
    model = model.replace({n: {"prior": p} for n, p in PRIORS.items()})
    for row in range(SIMULATIONS):
        truth = {n: float(rng.normal(p.mean, p.std)) for n, p in PRIORS.items()}
        made = thruster_log(count=200, seed=1000 + row, values=truth, known=True)
        measured = {n: np.array(v) for n, v in made.measured.items()}
        # the first reading is exact and held, as a flat prior on the start could not be drawn from
        measured["speed"][0] = 0.0
        log = dft.Log(made.time, dict(made.inputs), measured, noise=made.noise)
        fit = dft.fit(model, log, starts=1, substeps=1, initial="measured")
        assert fit.status.ok, fit.message
        post = sample(fit, log, method=method, seed=row, **SIZES[method])
        for column, (name, true) in enumerate(truth.items()):
            draws = np.asarray(post.posterior[name]).T.ravel()  # by draw, then by chain
            spaced = draws[np.linspace(0, draws.size - 1, RANKS - 1).astype(int)]
            found[row, column] = np.sum(spaced < true)
    return found


@pytest.mark.parametrize("method", ["emcee", "nuts"])
def test_ranks_are_uniform(method):
    """Chi-square of ten bins for each of three parameters: a false alarm in 1000 runs.

    The parameters' ranks are tested at 3e-4 each.
    """
    found = ranks(method)
    for column, name in enumerate(PRIORS):
        counts = np.bincount(found[:, column] * BINS // RANKS, minlength=BINS)
        p_value = chisquare(counts).pvalue
        print(f"{method}, {name}: {counts.tolist()}, p = {p_value:.3f}")
        assert p_value > 3e-4

"""Effective samples per second of a posterior, against what a user of emcee would write.

``pytest -m benchmark -s tests/benchmarks/test_sampling_speed.py``. Nothing here asserts a time.
"""

from __future__ import annotations

import time

import emcee
import numpy as np
import pytest
from posterior_cases import posterior_of

import diffthrust as dft
from benchmarks.peers._jobs import fewest
from benchmarks.peers._numba import numba_rk4
from benchmarks.test_benchmarks import make_log, show
from diffthrust.uncertainty import sample

pytestmark = pytest.mark.benchmark

NAMES = ("alpha", "beta", "ct")
WALKERS = 32
WARMUP, DRAWS = 500, 1000
TURNS = 3
"""Runs of each, in turns, so that a busy machine hurts both alike."""


def test_effective_samples_per_second():
    log = make_log()
    fit = dft.fit(dft.Thruster(), log)
    t, c = log.time, log.inputs["command"]
    speed, thrust = log.measured["speed"], log.measured["thrust"]

    def density(x):  # the same posterior: logarithms, levels integrated out
        if np.any(np.abs(x[:3]) > 30):
            return -np.inf
        modelled = numba_rk4(t, c, *np.exp(x[:3]), x[3])
        rests = [np.mean((a - b) ** 2) for a, b in zip((speed, thrust), modelled, strict=True)]
        value = -0.5 * t.size * np.sum(np.log(rests))
        return value if np.isfinite(value) else -np.inf

    posterior = posterior_of(fit, log)
    root = np.linalg.cholesky(posterior.covariance)
    rng = np.random.default_rng(0)
    begin = posterior.centre + rng.standard_normal((WALKERS, 4)) @ root.T
    ours, _ = posterior.batch(begin)
    theirs = np.array([density(x) for x in begin])
    np.testing.assert_allclose(ours - ours[0], theirs - theirs[0], atol=1e-6)

    def peer(seed):
        sampler = emcee.EnsembleSampler(WALKERS, 4, density)
        state = emcee.State(begin, random_state=np.random.RandomState(seed).get_state())
        sampler.run_mcmc(state, WARMUP + DRAWS)
        return np.exp(np.swapaxes(sampler.get_chain(discard=WARMUP), 0, 1)[..., :3])

    def own(seed):
        post = sample(fit, log, draws=DRAWS, warmup=WARMUP, walkers=WALKERS, seed=seed)
        return np.stack([np.asarray(post.posterior[n]) for n in NAMES], axis=-1)

    def nuts(seed):
        post = sample(fit, log, method="nuts", draws=DRAWS, warmup=WARMUP, seed=seed)
        return np.stack([np.asarray(post.posterior[n]) for n in NAMES], axis=-1)

    jobs = {"numba, emcee's own moves": peer, "sample, emcee": own, "sample, nuts": nuts}
    own(0), nuts(0)  # compile
    figures = {name: [] for name in jobs}
    means = {}
    for seed in range(TURNS):
        for name, job in jobs.items():
            start = time.perf_counter()
            found = job(seed)
            took = time.perf_counter() - start
            figures[name].append((took, fewest(found)))
            means[name] = found.reshape(-1, 3).mean(axis=0)
    rows, reference = [], None
    for name, taken in figures.items():
        seconds, samples = np.median(taken, axis=0)
        rate = float(np.median([s / t for t, s in taken]))
        reference = reference or rate
        ratio = f"{rate / reference:.1f}"
        rows.append((name, f"{seconds:.2f} s", f"{samples:.0f}", f"{rate:.0f}", ratio))
    show(
        f"{WARMUP + DRAWS} steps of {WALKERS} walkers, 10 000 samples, warmup included",
        rows,
        ("what", "time", "effective samples", "per second", "ratio (target 5)"),
    )
    spread = np.array([fit.parameters[n].std_error for n in NAMES])
    for mean in means.values():
        assert np.all(np.abs(mean - means["sample, emcee"]) < 0.3 * spread)

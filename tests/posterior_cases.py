"""Fits whose posteriors the tests sample: a straight line with a known answer, and a thruster."""

from __future__ import annotations

import numpy as np
from reference import inputs, thruster

import diffthrust as dft
from diffthrust.uncertainty import (  # private: its limits
    _intervals as intervals_module,
)
from diffthrust.uncertainty import _profile as profile_module
from diffthrust.uncertainty import _scores as scores_module
from diffthrust.uncertainty._intervals import (  # private: the sentences alone
    Evidence,
    heading,
    sentences,
)
from diffthrust.uncertainty._prediction.band import mixed_quantile  # private: a closed form
from diffthrust.uncertainty._prediction.draws import draws_of  # private: no result keeps its draws
from diffthrust.uncertainty._prediction.tables import interval_text  # private: digits alone
from diffthrust.uncertainty._profile import (  # private: the threshold alone
    threshold_of,
)
from diffthrust.uncertainty._profile_walk import (  # private: walks and lines of a test
    DeeperError,
    ParameterLine,
    ProfilePoint,
    QuantityLine,
    root,
    spread,
    walk,
)
from diffthrust.uncertainty._results import (  # private: made by a call
    Better,
    Profiles,
)
from diffthrust.uncertainty._sampling import chain_file, nuts  # private: coordinates; marks
from diffthrust.uncertainty._sampling.arviz import arviz  # private: without its warning
from diffthrust.uncertainty._sampling.chain_file import problem_identity  # private: whose a file is
from diffthrust.uncertainty._sampling.ensemble import (  # private: proposals of a law not their own
    independent_proposals,
    learned,
)
from diffthrust.uncertainty._sampling.posterior import (
    Posterior,  # private: made to fail
    posterior_of,  # private: its density alone
)
from diffthrust.uncertainty._sampling.propriety import open_ends  # private: before any draw
from diffthrust.uncertainty._scores import (  # private: the parts alone
    sample_scores,
    summed,
)
from diffthrust.uncertainty._values import (  # private: rows that no logs give
    Interval,
    Profile,  # private: with arms that no logs give
    Row,
    scaled,
)

__all__ = [
    "NOISE",
    "PRIORS",
    "PROFILE",
    "TRUE",
    "Better",
    "DeeperError",
    "Evidence",
    "Interval",
    "ParameterLine",
    "Posterior",
    "ProfilePoint",
    "Profiles",
    "QuantityLine",
    "Row",
    "arviz",
    "chain_file",
    "draws_of",
    "exact_line",
    "heading",
    "independent_proposals",
    "interval_text",
    "intervals_module",
    "learned",
    "line",
    "mixed_quantile",
    "nuts",
    "open_ends",
    "posterior_of",
    "problem_identity",
    "profile_module",
    "root",
    "sample_scores",
    "scaled",
    "scores_module",
    "sentences",
    "spread",
    "summed",
    "threshold_of",
    "thruster_fit",
    "thruster_log",
    "walk",
]

NOISE = 0.2
PRIORS = {"slope": dft.Normal(0.25, 0.05), "offset": dft.Normal(-0.2, 0.1)}
TRUE = {"alpha": 0.037, "beta": 42.0, "ct": 0.02}


PROFILE = Profile(
    name="a",
    unit="V",
    value=2.0,
    low=1.5,
    high=2.6,
    open_low=None,
    open_high=None,
    level=0.9,
    threshold=2.7,
    grid=np.array([1.4, 2.0, 2.7]),
    drop=np.array([2.0, 0.0, 1.9]),
    std_error=0.3,
    bounds=(0.5, None),
    per=1000.0,
    shown_unit="mV",
)
"""A profile of one's own, in volts and told in millivolts."""


def line(known: bool = True, count: int = 40, seed: int = 0) -> tuple[dft.Fit, dft.Log]:
    """A sensor along a straight line; with known noise its posterior is Gaussian."""
    rng = np.random.default_rng(seed)
    depth = np.linspace(0.0, 4.0, count)
    reading = 0.2 * depth - 0.1 + NOISE * rng.normal(size=count)
    noise = {"reading": NOISE} if known else {}
    log = dft.Log(np.arange(count), {"depth": depth}, {"reading": reading}, noise=noise)
    model = dft.LinearSensor().replace({n: {"prior": p} for n, p in PRIORS.items()})
    return dft.fit(model, log, starts=4), log


def exact_line(log: dft.Log) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of slope and offset, by hand: precisions add up."""
    rows = np.column_stack([log.inputs["depth"], np.ones(len(log))])
    prior = np.diag([PRIORS[n].std ** -2 for n in ("slope", "offset")])
    mean = np.array([PRIORS[n].mean for n in ("slope", "offset")])
    covariance = np.linalg.inv(rows.T @ rows / NOISE**2 + prior)
    return covariance @ (rows.T @ log.measured["reading"] / NOISE**2 + prior @ mean), covariance


def thruster_log(
    count: int = 200, seed: int = 0, values: dict[str, float] | None = None, known: bool = False
) -> dft.Log:
    """A thruster driven by noise, with white sensor noise."""
    rng = np.random.default_rng(seed)
    time = 0.05 * np.arange(count)
    command = inputs.low_passed_random(time, 1.5, np.random.default_rng(1))
    made = thruster.simulate(time, command, **(values or TRUE), method="rk4")
    measured = {
        "speed": made.measured["speed"] + 0.3 * rng.normal(size=count),
        "thrust": made.measured["thrust"] + 0.5 * rng.normal(size=count),
    }
    noise = {"speed": 0.3, "thrust": 0.5} if known else {}
    return dft.Log(time, {"command": command}, measured, noise=noise, name=f"run {seed}")


def thruster_fit(**options: object) -> tuple[dft.Fit, dft.Log]:
    """A fit of the thruster's own model."""
    log = thruster_log()
    return dft.fit(dft.Thruster(**TRUE), log, starts=4, substeps=1, **options), log

"""Fits whose posteriors the tests sample: a straight line with a known answer, and a thruster."""

from __future__ import annotations

import numpy as np
from reference import inputs, thruster

import diffthrust as dft
from diffthrust.uncertainty import _intervals as intervals_module  # private: its limits
from diffthrust.uncertainty import _profile as profile_module  # private: its rounds and words
from diffthrust.uncertainty import _sandwich as sandwich_module  # private: the block alone
from diffthrust.uncertainty._prediction.band import mixed_quantile as mixed_quantile  # closed form
from diffthrust.uncertainty._prediction.draws import draws_of as draws_of  # no result keeps them
from diffthrust.uncertainty._profile import Better as Better  # made by a call
from diffthrust.uncertainty._profile import Profiles as Profiles
from diffthrust.uncertainty._profile import threshold_of as threshold_of  # the threshold alone
from diffthrust.uncertainty._profile_walk import DeeperError as DeeperError  # walks of a test
from diffthrust.uncertainty._profile_walk import ParameterLine as ParameterLine
from diffthrust.uncertainty._profile_walk import ProfilePoint as ProfilePoint
from diffthrust.uncertainty._profile_walk import QuantityLine as QuantityLine
from diffthrust.uncertainty._profile_walk import spread as spread
from diffthrust.uncertainty._profile_walk import walk as walk
from diffthrust.uncertainty._sampling import chain_file as chain_file  # private: marks of a file
from diffthrust.uncertainty._sampling import nuts as nuts  # private: its coordinates
from diffthrust.uncertainty._sampling.arviz import arviz as arviz  # without its warning
from diffthrust.uncertainty._sampling.chain_file import problem_identity as problem_identity
from diffthrust.uncertainty._sampling.ensemble import independent_proposals as independent_proposals
from diffthrust.uncertainty._sampling.ensemble import learned as learned  # of a law not their own
from diffthrust.uncertainty._sampling.posterior import Posterior as Posterior  # made to fail
from diffthrust.uncertainty._sampling.posterior import posterior_of as posterior_of
from diffthrust.uncertainty._sampling.sample import open_ends as open_ends  # before any draw
from diffthrust.uncertainty._sandwich import sample_scores as sample_scores  # the parts alone
from diffthrust.uncertainty._sandwich import summed as summed
from diffthrust.uncertainty._tables import Evidence as Evidence  # private: the sentences alone
from diffthrust.uncertainty._tables import heading as heading
from diffthrust.uncertainty._tables import interval_text as interval_text  # digits alone
from diffthrust.uncertainty._tables import sentences as sentences
from diffthrust.uncertainty._values import Interval as Interval  # rows that no logs give
from diffthrust.uncertainty._values import Profile
from diffthrust.uncertainty._values import Row as Row
from diffthrust.uncertainty._values import scaled as scaled

__all__ = ["intervals_module", "profile_module", "sandwich_module"]

NOISE = 0.2
PRIORS = {"slope": dft.models.Normal(0.25, 0.05), "offset": dft.models.Normal(-0.2, 0.1)}
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


def line(known: bool = True, count: int = 40, seed: int = 0) -> tuple[dft.estimation.Fit, dft.Log]:
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


def thruster_fit(**options: object) -> tuple[dft.estimation.Fit, dft.Log]:
    """A fit of the thruster's own model."""
    log = thruster_log()
    return dft.fit(dft.Thruster(**TRUE), log, starts=4, substeps=1, **options), log

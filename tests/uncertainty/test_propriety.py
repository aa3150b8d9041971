"""Posteriors that do not exist: one parameter whose density is known in closed form."""

import math
import re

import numpy as np
import pytest
from made_posterior import made_posterior
from posterior_cases import open_ends, posterior_of
from reference import axis
from scipy.integrate import quad

import diffthrust as dft

NOISE = 0.1
END = 35.0
"""So far from the guess the sampler lets a logarithm go."""


class Accelerometer(dft.Model):
    """A mass under a known force, whose acceleration is read: no states."""

    name = "accelerometer"
    inputs = {"force": "N"}
    outputs = {"acceleration": "m/s^2"}
    ports = {}

    mass: float = dft.parameter(1.0, "kg", bounds=(0, None))

    def equations(self, s, port):
        return {}, {"acceleration": s.force / self.mass}


def weighed(fall, count=50, bounds=(0, None)):
    """A fit whose log-likelihood is lower by ``fall`` for an infinite mass than for the best one.

    With y = u / m + e the logarithm of the likelihood is a parabola in 1 / m, at whose top
    (sum u y)^2 / (2 sigma^2 sum u^2) is gained over 1 / m = 0.
    """
    rng = np.random.default_rng(0)
    force, noise = rng.standard_normal(count), NOISE * rng.standard_normal(count)
    noise -= force * (force @ noise) / (force @ force)  # so that the fall is what was asked for
    best = NOISE * math.sqrt(2.0 * fall / (force @ force))
    measured, units = best * force + noise, {"force": "N", "acceleration": "m/s^2"}
    log = dft.Log(np.arange(count), {"force": force}, {"acceleration": measured}, units,
                  noise={"acceleration": NOISE})  # fmt: skip
    model = Accelerometer().replace(mass={"value": 1.5 / best, "bounds": bounds})
    fit = dft.fit(model, log)
    assert fit.status.ok
    assert fit.parameters["mass"].value == pytest.approx(1.0 / best, rel=1e-3)
    return fit, log, 1.0 / best


def share(fall, low, high, of=(-END, END), prior=lambda x: 1.0, of_x=lambda x: 1.0):
    """The integral of the closed form over x = log(mass / best), over that of the whole."""

    def density(x):
        return math.exp(-fall * min((1.0 - math.exp(-x)) ** 2, 700.0 / fall)) * prior(x)

    def area(a, b, of_x=lambda x: 1.0):
        cuts = [c for c in np.linspace(-3.0, 3.0, 13) if a < c < b]
        return sum(quad(lambda x: density(x) * of_x(x), p, q, limit=200)[0]
                   for p, q in zip([a, *cuts], [*cuts, b], strict=True))  # fmt: skip

    return area(low, high, of_x) / area(*of)


@pytest.mark.parametrize("fall", [1.7, 6.0])
def test_the_likelihood_falls_as_far_as_the_closed_form(fall):
    fit, log, _ = weighed(fall)
    (end,) = open_ends(posterior_of(fit, log), np.zeros((4, 1)))
    assert (end.name, end.upper) == ("mass", True)
    assert end.fall == pytest.approx(fall, rel=1e-6)


def test_what_draws_will_not_find_is_no_matter():
    """Open as well, strictly speaking; 1 in 10 000 of the density is where the line is drawn."""
    offset = math.log(1.5)  # of the guess, from which the end of the range is counted
    for fall, told in ((11.0, True), (14.0, False), (200.0, False)):
        span = END + offset
        assert (share(fall, 0.5 * span, span, (-END, span)) > 1e-4) == told
        fit, log, _ = weighed(fall)
        assert bool(open_ends(posterior_of(fit, log), np.zeros((4, 1)))) == told
    fit, log, _ = weighed(1.7, bounds=(0, 1e6))
    assert not open_ends(posterior_of(fit, log), np.zeros((4, 1)))


@pytest.mark.thorough
def test_chains_without_an_end_are_told_however_well_they_agree():
    fall = 1.7
    fit, log, best = weighed(fall)
    post = dft.sample(fit, log, draws=1500, warmup=500)
    told = dft.uncertainty.convergence(post)
    assert post.attrs["status"] == told.status.value == "improper"
    assert not told.status.ok
    mass = post.posterior["mass"].values
    assert mass.mean() > 1e6 * best  # what a user would have believed
    offset = math.log(1.5)
    expected = share(fall, 0.5 * (END + offset), END + offset, (-END, END + offset))
    beyond = np.mean(np.log(mass / best) > 0.5 * (END + offset), axis=1)
    error = np.std(beyond) / math.sqrt(beyond.size)  # walkers hardly meet: 4.5 errors
    assert abs(beyond.mean() - expected) < 4.5 * error
    assert f"{100 * beyond.mean():.0f} % of the draws lie beyond" in told.message


@pytest.mark.thorough
def test_the_line_that_is_offered_makes_a_posterior():
    fall = 1.7
    fit, log, best = weighed(fall)
    message = dft.uncertainty.convergence(dft.sample(fit, log, draws=50, warmup=50)).message
    (line,) = re.findall(r"^fit = (.*)$", message, re.MULTILINE)
    again = eval(line, {"dft": dft, "fit": fit, "logs": log})  # as a reader would paste it
    prior = again.model.parameters["mass"].prior
    assert prior == dft.models.Normal(float(f"{1.5 * best:.3g}"), float(f"{1.5 * best:.3g}"))
    assert f"mass = {{ prior = {{ mean = {prior.mean:.3g}, std = {prior.std:.3g} }} }}" in message
    post = dft.sample(again, log, draws=1500, warmup=500)
    assert post.attrs["status"] == "converged", post.attrs["message"]

    def density(x):  # of the prior, seen from the logarithm
        return math.exp(x - 0.5 * ((best * math.exp(x) - prior.mean) / prior.std) ** 2)

    mean = share(fall, -5.0, 5.0, (-5.0, 5.0), density, lambda x: best * math.exp(x))
    mass = post.posterior["mass"].values
    error = np.std(mass) / math.sqrt(dft.uncertainty.convergence(post).ess_bulk["mass"])
    assert abs(mass.mean() - mean) < 4.5 * error


@pytest.mark.thorough
def test_a_vehicle_whose_log_hardly_tells_its_mass():
    """583 +- 325 kg by the fit; the mean of its draws was 2e14 kg, and "converged"."""
    rng, time = np.random.default_rng(0), np.arange(0.0, 60.0, 0.5)
    thrust = 40.0 + 10.0 * np.sin(2.0 * np.pi * time / 50.0)
    run = axis.simulate(time, thrust, initial_velocity=math.sqrt(40.0 / 67.0))
    velocity = run.truth["velocity"] + 0.2 * rng.standard_normal(time.size)
    units = {"thrust": "N", "velocity": "m/s"}
    log = dft.Log(time, {"thrust": thrust}, {"velocity": velocity}, units)
    fit = dft.fit(dft.AxisVehicle(), log)
    assert fit.status.ok
    post = dft.sample(fit, log, draws=100, warmup=100)
    assert post.attrs["status"] == "improper"
    assert "'mass' has a flat prior without a bound above" in post.attrs["message"]


def test_a_posterior_that_was_read_again_tells_it():
    fit, _, _ = weighed(200.0)
    post = made_posterior(fit, improper="There is no posterior.")
    assert dft.uncertainty.convergence(post).message == "There is no posterior."

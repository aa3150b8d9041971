"""The posterior density: against formulas, its derivatives, its bounds, its compilations."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from compilations import compilations
from posterior_cases import (
    NOISE,
    PRIORS,
    TRUE,
    exact_line,
    line,
    nuts,
    posterior_of,
    thruster_fit,
    thruster_log,
)
from scipy.integrate import quad
from scipy.stats import norm
from scipy.stats import t as student
from short_logs import TwiceTheSame

import diffthrust as dft


def around(posterior, count=20, width=1.0, seed=0):
    root = np.linalg.cholesky(posterior.covariance)
    normal = np.random.default_rng(seed).normal(size=(count, posterior.dim))
    return posterior.centre + width * normal @ root.T


def test_a_line_with_known_noise_has_the_gaussian_posterior_of_the_formula():
    fit, log = line()
    posterior = posterior_of(fit, log)
    mean, covariance = exact_line(log)
    points = around(posterior)
    values = posterior.values(points)
    away = np.column_stack([values["slope"], values["offset"]]) - mean
    expected = -0.5 * np.einsum("ni,ij,nj->n", away, np.linalg.inv(covariance), away)
    density, level = posterior.batch(points)
    np.testing.assert_allclose(density - density[0], expected - expected[0], atol=1e-9)
    np.testing.assert_allclose(level, NOISE)
    scales = np.array([0.1, 1.0])  # of the coordinates
    ours = posterior.covariance * np.outer(scales, scales)
    np.testing.assert_allclose(ours, covariance, rtol=5e-3)


@pytest.mark.thorough
def test_an_unknown_gaussian_level_is_integrated_out():
    fit, log = line(known=False, count=12)
    posterior = posterior_of(fit, log)
    points = around(posterior, 4, width=2.0)
    density, _ = posterior.batch(points)
    expected = []
    for slope, offset in zip(*posterior.values(points).values(), strict=True):
        rest = log.measured["reading"] - slope * log.inputs["depth"] - offset
        peak = np.sqrt(np.mean(rest**2))

        def integrand(s, rest=rest, peak=peak):
            logs = norm.logpdf(rest, 0, peak * np.exp(s)).sum() - norm.logpdf(rest, 0, peak).sum()
            return np.exp(logs)  # flat in the logarithm of the level

        area = quad(integrand, -3, 6, epsabs=1e-12, limit=200)[0]
        prior = sum(
            p.std and norm.logpdf(v, p.mean, p.std)
            for p, v in zip(PRIORS.values(), (slope, offset), strict=True)
        )
        expected.append(np.log(area) + norm.logpdf(rest, 0, peak).sum() + prior)
    np.testing.assert_allclose(density - density[0], np.array(expected) - expected[0], atol=1e-6)


@pytest.mark.thorough
def test_a_student_level_is_sampled_with_the_density_of_the_law():
    fit, log = thruster_fit(loss="student_t")
    posterior = posterior_of(fit, log)
    assert posterior.labels[-2:] == ("sigma.speed", "sigma.thrust")
    points = around(posterior, 5)
    density, level = posterior.batch(points)
    np.testing.assert_allclose(level, np.exp(points[:, -2:]))
    expected = []
    for point, (speed, thrust) in zip(points, level, strict=True):
        values = {n: float(v) for n, v in posterior.values(point).items()}
        begin = {"speed": float(posterior.initial(point)["speed"][0])}
        out = dft.simulate(dft.Thruster(**values), log, initial=begin, substeps=1)
        expected.append(
            student.logpdf(log.measured["speed"] - out["speed"], 4, scale=speed).sum()
            + student.logpdf(log.measured["thrust"] - out["thrust"], 4, scale=thrust).sum()
        )
    np.testing.assert_allclose(density - density[0], np.array(expected) - expected[0], atol=1e-6)


def test_a_prior_is_a_density_in_the_value():
    log = thruster_log()
    prior = dft.models.Normal(0.04, 0.002)
    plain = dft.fit(dft.Thruster(**TRUE), log, starts=4, substeps=1)
    given = dft.fit(dft.Thruster(**TRUE).replace(alpha={"prior": prior}), log, starts=4, substeps=1)
    flat, bent = posterior_of(plain, log), posterior_of(given, log)
    points = around(flat)
    alpha = flat.values(points)["alpha"]
    found = bent.batch(points)[0] - flat.batch(points)[0]
    expected = norm.logpdf(alpha, prior.mean, prior.std) + np.log(alpha)  # seen from log(alpha)
    np.testing.assert_allclose(found - found[0], expected - expected[0], atol=1e-8)


def test_outside_of_the_bounds_and_where_the_simulation_fails_the_density_is_zero():
    log = thruster_log()
    model = dft.Thruster(**TRUE).replace(alpha={"bounds": (0.03, 0.045)})
    posterior = posterior_of(dft.fit(model, log, starts=4, substeps=1), log)
    points = np.repeat(posterior.centre[None], 4, axis=0)
    points[1, 0], points[2, 0] = np.log(0.0299), np.log(0.0451)
    points[3, 1] = 30.0  # a drive of 1e13 rad/(V s^2)
    density, _ = posterior.batch(points)
    assert np.isfinite(density[0])
    assert np.all(density[1:] == -np.inf)


def test_any_number_of_points_and_any_data_share_one_compilation():
    fit, log = thruster_fit()
    posterior = posterior_of(fit, log)
    posterior.batch(around(posterior, 32))
    before = compilations("log_densities")
    whole = around(posterior, 32)
    dense, _ = posterior.batch(whole)
    half, _ = posterior.batch(whole[:16])
    odd, _ = posterior.batch(whole[:7])
    np.testing.assert_array_equal(dense[:16], half)
    np.testing.assert_array_equal(dense[:7], odd)
    other = thruster_log(seed=5)
    theirs = posterior_of(dft.fit(dft.Thruster(**TRUE), other, starts=4, substeps=1), other)
    assert theirs.batch(around(theirs, 32))[0][0] != dense[0]
    assert compilations("log_densities") == before


@pytest.mark.thorough
@pytest.mark.parametrize("loss", ["gaussian", "student_t"])
def test_the_gradient_of_nuts_is_that_of_the_density(loss):
    fit, log = thruster_fit(loss=loss)
    posterior = posterior_of(fit, log)
    box, data = whitened(posterior)
    v = 0.3 * jnp.arange(1.0, posterior.dim + 1)
    smooth = jax.jit(nuts.smooth, static_argnums=(0, 1))
    gradient = jax.jit(jax.grad(nuts.smooth, argnums=3), static_argnums=(0, 1))(
        posterior.shape, box, data, v
    )
    step = 1e-4
    for i in range(posterior.dim):
        ends = [smooth(posterior.shape, box, data, v.at[i].add(s)) for s in (-step, step)]
        assert float(ends[1] - ends[0]) / (2 * step) == pytest.approx(
            float(gradient[i]), rel=1e-4, abs=1e-4
        )


def whitened(posterior):
    box = nuts.Box(
        tuple(map(bool, np.isfinite(posterior.low))), tuple(map(bool, np.isfinite(posterior.high)))
    )
    u, slope = nuts.from_coordinates(box, posterior.low, posterior.high, posterior.centre)
    root = np.linalg.cholesky(posterior.covariance / np.outer(slope, slope))
    return box, {**posterior.data, "origin": jnp.asarray(u), "root": jnp.asarray(root)}


@pytest.mark.thorough
def test_bounded_coordinates_and_their_jacobian():
    low, high = np.array([-np.inf, 1.0, -np.inf, -2.0]), np.array([np.inf, np.inf, 3.0, 5.0])
    box = nuts.Box(tuple(map(bool, np.isfinite(low))), tuple(map(bool, np.isfinite(high))))
    x = np.array([0.7, 1.2, 2.5, 4.0])
    u, slope = nuts.from_coordinates(box, low, high, x)
    data = {"low": jnp.asarray(low), "high": jnp.asarray(high), "origin": jnp.asarray(u)}
    data["root"] = jnp.eye(4)
    back, grown = nuts.to_coordinates(box, data, jnp.zeros(4))
    np.testing.assert_allclose(back, x, rtol=1e-12)
    jacobian = jax.jacfwd(lambda v: nuts.to_coordinates(box, data, v)[0])(jnp.zeros(4))
    np.testing.assert_allclose(np.abs(np.diagonal(jacobian)), slope, rtol=1e-12)
    assert float(grown) == pytest.approx(np.linalg.slogdet(jacobian)[1], rel=1e-12)


@pytest.mark.thorough
def test_a_fit_that_did_not_converge_is_refused():
    log = thruster_log()
    fit = dft.fit(dft.Thruster(**TRUE) + TwiceTheSame(), log, starts=4, substeps=1)
    with pytest.raises(dft.InputError, match=r"not_identifiable.*beta"):
        posterior_of(fit, log)


def test_a_prior_that_excludes_the_fit_is_named():
    log = thruster_log(known=True)
    given = {"bounds": (0, 0.05), "prior": dft.models.Normal(10.0, 1.0)}
    model = dft.Thruster(**TRUE).replace(alpha=given)
    fit = dft.fit(model, log, starts=4, substeps=1)
    with pytest.raises(
        dft.InputError, match=r"'alpha': its prior, 10 \+- 1 1/rad, excludes .*0.05"
    ):
        posterior_of(fit, log)


def test_the_initial_states_of_several_logs_stay_with_their_logs():
    logs = [thruster_log(count=300, seed=2), thruster_log(count=200, seed=3)]
    fit = dft.fit(dft.Thruster(**TRUE), logs, starts=4, substeps=1)
    posterior = posterior_of(fit, logs)
    assert posterior.dim == 5
    found = posterior.initial(posterior.centre)["speed"]
    np.testing.assert_allclose(found, [state["speed"] for state in fit.initial])


def test_states_that_the_fit_held_are_not_sampled():
    fit, log = thruster_fit(initial="measured")
    posterior = posterior_of(fit, log)
    assert posterior.labels == ("alpha", "beta", "ct")
    assert posterior.initial(posterior.centre[None]) == {}

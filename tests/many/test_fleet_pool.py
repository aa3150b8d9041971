"""Partial pooling against quadrature, against the joint density written out, and its edges."""

import sys
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
from scipy.stats import norm
from scipy.stats import t as student
from short_logs import MODEL, made_log

import diffthrust as dft
from diffthrust import InputError
from diffthrust.many._fleet.evidence import (  # private: the density alone
    Ruler,
    VehicleEvidence,
    gather_evidence,
)
from diffthrust.many._fleet.hierarchy import arrange  # private: the density alone

# Rubin 1981: effects of coaching in eight schools
EFFECT = np.array([28.0, 8.0, -3.0, 7.0, -1.0, 1.0, 18.0, 12.0])
ERROR = np.array([15.0, 10.0, 16.0, 11.0, 9.0, 11.0, 10.0, 18.0])
CLEAR = {"draws": 1000, "warmup": 500}


def schools(factor=1.0):
    frame = {"name": list("ABCDEFGH"), "effect": factor * EFFECT}
    return pd.DataFrame({**frame, "effect_std_error": factor * ERROR})


@pytest.fixture(scope="module")
def pooled():
    return dft.many.fleet(schools()).pool(**CLEAR)


def by_quadrature(typical):
    """Posterior means by the formulas of Gelman et al. 2013, section 5.4, over a grid."""
    tau = np.linspace(1e-3, 200.0, 20001)
    variance = ERROR[:, None] ** 2 + tau**2
    precision = np.sum(1 / variance, axis=0)
    mean = np.sum(EFFECT[:, None] / variance, axis=0) / precision
    log = norm.logpdf(EFFECT[:, None], mean, np.sqrt(variance)).sum(0) - 0.5 * np.log(precision)
    weight = np.exp(log - log.max()) * student.pdf(tau / typical, 4)
    weight /= weight.sum()
    own = (EFFECT[:, None] * tau**2 + mean * ERROR[:, None] ** 2) / variance
    return own @ weight, mean @ weight, tau @ weight


@pytest.mark.thorough
def test_eight_schools_are_those_of_quadrature(pooled):
    assert pooled.convergence.status.ok
    typical = pooled.ruler.typical[0]
    assert typical == 0.5 * np.median(np.abs(EFFECT))
    own, mean, tau = by_quadrature(typical)
    drawn = pooled.post.posterior
    wanted = {f"effect[{n}]": v for n, v in zip("ABCDEFGH", own, strict=True)}
    wanted |= {"effect.mean": mean, "effect.between": tau}
    found = {f"effect[{n}]": drawn["effect"].sel(vehicle=n) for n in "ABCDEFGH"}
    found |= {n: drawn[n] for n in ("effect.mean", "effect.between")}
    for name, value in wanted.items():
        error = float(found[name].std()) / np.sqrt(pooled.convergence.ess_bulk[name])
        assert float(found[name].mean()) == pytest.approx(value, abs=4 * error), name


@pytest.mark.thorough
def test_the_table_tells_vehicles_and_the_population(pooled):
    table = pooled.table.set_index("vehicle")
    assert list(table.index) == list("ABCDEFGH")
    assert table["separate"].tolist() == EFFECT.tolist()
    drawn = pooled.post.posterior["effect"].sel(vehicle="C").values
    row = table.loc["C"]
    assert row["low"] == pytest.approx(np.quantile(drawn, 0.025))
    assert row["median"] == pytest.approx(np.median(drawn))
    tau = pooled.post.posterior["effect.between"].values
    weight = np.mean(ERROR[2] ** 2 / (ERROR[2] ** 2 + tau**2))
    assert row["shrinkage"] == pytest.approx(weight, rel=1e-6)
    assert pooled.population["between_sd"].iloc[0] == pytest.approx(np.median(tau))
    assert "independent ones" in pooled.report()
    assert "A table has no covariances" in pooled.report()


def test_a_new_vehicle_is_drawn_from_the_fleet(pooled):
    prior = pooled.predict_new()["effect"]
    drawn = pooled.post.posterior
    exact = np.sqrt(drawn["effect.mean"].var() + (drawn["effect.between"] ** 2).mean())
    assert prior.mean == pytest.approx(float(drawn["effect.mean"].mean()), abs=1.0)
    assert 0.7 * exact < prior.std <= 1.05 * exact  # of a law with long tails, the middle alone
    model = dft.Thruster().replace(alpha={"prior": prior})
    assert model.parameters["alpha"].prior == prior


def test_units_do_not_change_what_pooling_gives(pooled):
    other = dft.many.fleet(schools(1000.0)).pool(**CLEAR)
    assert other.table["median"].to_numpy() == pytest.approx(
        1000 * pooled.table["median"].to_numpy(), rel=1e-6
    )


def test_equal_seeds_give_equal_draws(pooled):
    again, other = (dft.many.fleet(schools()).pool(**CLEAR, seed=seed) for seed in (0, 1))
    assert np.array_equal(again.post.posterior["effect"], pooled.post.posterior["effect"])
    assert not np.array_equal(other.post.posterior["effect"], pooled.post.posterior["effect"])


def test_the_figure_shows_both_estimates(pooled):
    axes = pooled.plot().axes[0]
    assert [t.get_text() for t in axes.get_yticklabels()] == list("ABCDEFGH")
    assert axes.get_xlabel() == "effect"
    labels = axes.get_legend_handles_labels()[1]
    assert labels[-2:] == ["by itself, 95 %", "pooled, 95 %"]


def joint(told, evidence, likelihood=None):
    """Log density of law and vehicles, written out; without constants."""
    spread, theta = np.asarray(told["spread"]), np.asarray(told["theta"])
    total = np.sum(student.logpdf(spread, 4)) + np.sum(norm.logpdf(theta, told["mean"], spread))
    for i, one in enumerate(evidence):
        if one.exact is None:
            away = theta[i] - one.values
            total -= 0.5 * away @ one.information @ away
        else:
            total += likelihood(one)
    return total


def agree(target, data, evidence, parts, likelihood=None):
    """The density is the joint one times the volume that the coordinates stand for."""

    @jax.jit
    def both(v):
        change = jax.jacfwd(lambda v: parts(target, data, v))(v)
        return target.density(data, v), target.kept(data, v), change

    rng = np.random.default_rng(5)
    rest = []
    for _ in range(4):
        v = jnp.asarray(0.7 * rng.standard_normal(target.dim))
        density, told, change = jax.tree.map(np.asarray, both(v))
        own = None if likelihood is None else (lambda one, v=v, t=told: likelihood(one, v, t))
        written = joint(told, evidence, own)
        rest.append(float(density) - written - np.linalg.slogdet(change)[1])
    assert np.ptp(rest) < 1e-8 * max(1.0, np.max(np.abs(rest)))


def law_and_vehicles(target, data, v):
    told = target.kept(data, v)
    return jnp.concatenate([told["mean"], told["spread"], told["theta"].ravel()])


def test_the_density_is_the_joint_one():
    rng = np.random.default_rng(1)
    evidence = []
    for i in range(4):
        root = rng.standard_normal((3, 3 - i % 3))  # some know nothing of a direction
        evidence.append(
            VehicleEvidence(f"v{i}", rng.standard_normal(3), root @ root.T, np.ones(3, bool))
        )
    agree(*arrange(evidence), evidence, law_and_vehicles)


@pytest.fixture(scope="module")
def dives():
    logs = [made_log(seed, name=f"auv{seed}") for seed in range(4)]
    return logs, dft.many.fit(MODEL, logs, starts=1)


@pytest.mark.thorough
def test_an_exact_likelihood_is_that_of_the_logs(dives):
    logs, fits = dives
    made = dft.many.fleet(fits)
    ruler = Ruler(tuple(made.axes[n] for n in ("alpha", "beta")), np.log([0.037, 42.0]))
    evidence, notes = gather_evidence(made, ruler, {"auv1": logs[1], "auv2": logs[2]})
    assert not notes
    target, data = arrange(evidence)
    assert target.kinds[0].vehicles == 2  # one compilation for both

    def whole(target, data, v):
        at = target.law + target.vehicles * target.parameters
        return jnp.concatenate([law_and_vehicles(target, data, v), v[at:]])

    def coordinates(one, v, told):
        e, row = one.exact, evidence.index(one)
        z = told["theta"][row]
        kind = target.kinds[0]
        at = target.law + target.vehicles * target.parameters + (row - 1) * kind.unpooled
        own = jax.tree.map(lambda a: a[row - 1], data["exact"][0])
        eta = np.asarray(v)[at : at + kind.unpooled]
        x = np.empty(e.posterior.dim)
        x[e.pooled] = e.shift + e.scale * z
        slope, root = np.asarray(own["rest_slope"]), np.asarray(own["rest_root"])
        x[e.unpooled] = own["rest_top"] + slope @ (z - own["top"]) + root @ eta
        return x

    def likelihood(one, v, told):
        return float(one.exact.posterior.batch(coordinates(one, v, told)[None])[0][0])

    agree(target, data, evidence, whole, likelihood)


def test_an_exact_likelihood_is_expanded_where_it_is_likely(dives):
    logs, fits = dives
    made = dft.many.fleet(fits)
    ruler = Ruler(tuple(made.axes[n] for n in ("alpha", "beta")), np.log([0.037, 42.0]))
    plain, _ = gather_evidence(made, ruler, {})
    whole, _ = gather_evidence(made, ruler, {"auv1": logs[1]})
    error = np.sqrt(np.diagonal(np.linalg.inv(plain[1].information)))
    assert whole[1].values == pytest.approx(plain[1].values, abs=0.2 * error.min())
    assert whole[1].information == pytest.approx(plain[1].information, rel=0.1)


def test_fits_of_one_vehicle_count_together(dives):
    logs, fits = dives
    own = list(fits)
    ruler_of = dft.many.fleet({"a": own[:1], "b": own[1:2], "c": own[2:]})
    ruler = Ruler(tuple(ruler_of.axes[n] for n in ("alpha", "beta")), np.log([0.037, 42.0]))
    evidence, _ = gather_evidence(ruler_of, ruler, {})
    parts, _ = gather_evidence(dft.many.fleet({"c": own[2], "d": own[3]}), ruler, {})
    total = sum(one.information for one in parts)
    mean = np.linalg.solve(total, sum(one.information @ one.values for one in parts))
    assert evidence[2].values == pytest.approx(mean)
    grown = np.sqrt(np.diagonal(total) / np.diagonal(evidence[2].information))
    assert (grown >= 1.0 - 1e-9).all()
    with pytest.raises(InputError, match="'c' has 2 fits, an exact likelihood needs one"):
        gather_evidence(ruler_of, ruler, {"c": logs[2]})


@pytest.mark.parametrize(
    ("frame", "options", "told"),
    [
        (schools()[:2], {}, "Pooling needs 3 vehicles with an estimate of effect"),
        (schools(), {"parameters": ["gain"]}, "no fit of the fleet estimated 'gain'"),
        (schools(), {"draws": 1}, "draws: expected a whole number of at least 10"),
        (schools(), {"level": 95}, r"level: expected a number in \(0, 1\), found 95"),
        (schools(), {"logs": {"Z": None}}, "there is no vehicle 'Z' in the fleet"),
        (schools(), {"logs": {"A": None}}, "'A' has 0 fits"),
    ],
)
def test_what_cannot_be_pooled_is_told(frame, options, told):
    with pytest.raises(InputError, match=told):
        dft.many.fleet(frame).pool(**options)


def test_a_prior_would_count_for_each_vehicle(dives):
    model = MODEL.replace(alpha={"prior": dft.models.Normal(0.037, 0.01)})
    made = dft.many.fleet({f"auv{i}": replace(fit, model=model) for i, fit in enumerate(dives[1])})
    with pytest.raises(InputError, match="the fit of 'alpha' has a prior"):
        made.pool()


def test_pooling_needs_blackjax(monkeypatch):
    monkeypatch.setitem(sys.modules, "blackjax", None)
    with pytest.raises(InputError, match="Pooling needs blackjax"):
        dft.many.fleet(schools()).pool()

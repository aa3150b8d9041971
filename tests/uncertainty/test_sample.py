"""Sampling: a posterior known by hand, two samplers against each other, ArviZ, words, errors."""

import sys
import warnings

import emcee
import matplotlib
import numpy as np
import pytest
from compilations import compilations
from posterior_cases import (
    TRUE,
    Posterior,
    arviz,
    exact_line,
    independent_proposals,
    learned,
    line,
    thruster_fit,
    thruster_log,
)

import diffthrust as dft
from diffthrust.uncertainty import convergence, sample

matplotlib.use("Agg")

SHORT = {"emcee": dict(draws=400, warmup=100), "nuts": dict(draws=600, warmup=200)}


@pytest.fixture(scope="module")
def posts():
    """The thruster's posterior by both samplers."""
    fit, log = thruster_fit()
    return {m: sample(fit, log, method=m, **SHORT[m]) for m in SHORT}


@pytest.mark.parametrize("method", ["emcee", pytest.param("nuts", marks=pytest.mark.slow)])
def test_the_posterior_of_a_line_is_the_one_worked_out_by_hand(method):
    """Five figures, each within 4.5 of its Monte Carlo errors: a false alarm in 3e4 runs."""
    fit, log = line()
    mean, covariance = exact_line(log)
    post = sample(fit, log, method=method, **SHORT[method])
    assert post.attrs["status"] == "converged", post.attrs["message"]
    draws = np.stack([np.asarray(post.posterior[n]) for n in ("slope", "offset")])
    away = draws - mean[:, None, None]
    sizes = np.sqrt(np.diagonal(covariance))
    for i, j in ((0, 0), (1, 1), (0, 1)):
        product = away[i] * away[j] / (sizes[i] * sizes[j])
        expected = covariance[i, j] / (sizes[i] * sizes[j])
        assert abs(product.mean() - expected) < 4.5 * error_of(product)
    for i in range(2):
        assert abs(away[i].mean()) < 4.5 * error_of(away[i])


def error_of(values):
    """Monte Carlo error of a mean over chains."""
    return float(arviz().mcse(made(np.asarray(values)))["beta"])


@pytest.mark.thorough
def test_emcee_and_nuts_agree_on_the_thruster(posts):
    """Six means and six variances within 4.5 Monte Carlo errors: a false alarm in 1e4 runs."""
    az = arviz()
    for name in ("alpha", "beta", "ct", "initial.speed", "sigma"):
        ours, theirs = (posts[m].posterior[name] for m in ("emcee", "nuts"))
        scale = float(ours.std(("chain", "draw")).mean())
        for power in (1, 2):
            centre = theirs.mean(("chain", "draw"))
            pair = [((x - centre) / scale) ** power for x in (ours, theirs)]
            gap = np.asarray(pair[0].mean(("chain", "draw")) - pair[1].mean(("chain", "draw")))
            error = np.sqrt(sum(np.asarray(az.mcse(x)[name]) ** 2 for x in pair))
            assert np.all(np.abs(gap) < 4.5 * error), (name, power)


def test_standard_errors_of_a_thruster_agree_with_the_fit(posts):
    fit, _ = thruster_fit()
    for name in TRUE:
        spread = float(posts["emcee"].posterior[name].std())
        assert spread == pytest.approx(fit.parameters[name].std_error, rel=0.1)


def test_names_units_and_attributes(posts):
    _, log = thruster_fit()
    post = posts["nuts"]
    own = post.posterior
    assert own["alpha"].dims == ("chain", "draw")
    assert own["alpha"].attrs["unit"] == "1/rad"
    assert own["initial.speed"].dims == ("chain", "draw", "log")
    assert list(own["log"].values) == ["run 0"]
    assert own["sigma"].dims == ("chain", "draw", "channel")
    assert list(own["channel"].values) == ["speed", "thrust"]
    np.testing.assert_allclose(post.observed_data["speed[run 0]"], log.measured["speed"])
    assert post.observed_data["speed[run 0]"].attrs["unit"] == "rad/s"
    assert set(post.sample_stats) >= {"lp", "diverging"}
    expected = {
        "method": "nuts",
        "seed": 0,
        "model": "thruster",
        "effects": "",
        "status": "converged",
    }
    assert {k: post.attrs[k] for k in expected} == expected
    assert own.attrs["message"] == post.attrs["message"]
    assert own.sizes == {"chain": 4, "draw": 600, "log": 1, "channel": 2}


def test_several_logs_have_an_initial_state_each_and_a_time_of_their_own():
    logs = [thruster_log(count=300, seed=2), thruster_log(count=200, seed=3)]
    fit = dft.fit(dft.Thruster(**TRUE), logs, starts=4, substeps=1, loss="student_t")
    post = sample(fit, logs, draws=50, warmup=50)
    found = post.posterior["initial.speed"]
    assert list(found["log"].values) == ["run 2", "run 3"]
    for name, state in zip(found["log"].values, fit.initial, strict=True):
        one = found.sel(log=name)
        assert abs(float(one.mean()) - state["speed"]) < 3 * float(one.std())
    assert float(post.posterior["sigma"].sel(channel="speed").mean()) == pytest.approx(
        fit.noise["speed"], rel=0.05
    )
    assert post.observed_data["speed[run 2]"].shape == (300,)
    assert post.observed_data["thrust[run 3]"].shape == (200,)


@pytest.mark.thorough
@pytest.mark.parametrize("method", ["emcee", "nuts"])
def test_the_plots_of_arviz_work(posts, method, tmp_path):
    from matplotlib import pyplot as plt

    az, post = arviz(), posts[method]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what ArviZ's plots warn of is not ours to mend
        az.plot_trace(post, var_names=["alpha", "sigma"])
        az.plot_pair(post, var_names=["alpha", "beta", "ct"], divergences=method == "nuts")
        az.plot_forest(post, combined=True)
        az.plot_posterior(post, var_names=["ct"])
        plt.close("all")
    table = az.summary(post)
    assert {"alpha", "initial.speed[run 0]", "sigma[thrust]"} <= set(table.index)
    post.to_netcdf(str(tmp_path / "post.nc"))
    assert az.from_netcdf(str(tmp_path / "post.nc")).attrs["status"] == "converged"


def test_equal_seeds_give_equal_draws():
    fit, log = line()
    one, two, other = (sample(fit, log, draws=20, warmup=10, seed=s) for s in (1, 1, 2))
    np.testing.assert_array_equal(one.posterior["slope"], two.posterior["slope"])
    assert not np.array_equal(one.posterior["slope"], other.posterior["slope"])


def test_nuts_compiles_once_for_any_log_of_the_same_length():
    fit, log = thruster_fit()
    sample(fit, log, method="nuts", **SHORT["nuts"])
    before = compilations("draw_block"), compilations("warm_up")
    other = thruster_log(seed=7)
    theirs = dft.fit(dft.Thruster(**TRUE), other, starts=4, substeps=1)
    sample(theirs, other, method="nuts", **SHORT["nuts"])
    assert min(before) > 0
    assert (compilations("draw_block"), compilations("warm_up")) == before


def test_the_independent_proposal_keeps_a_law_that_is_not_its_own():
    """A chi-square law of 4 degrees; mean and variance within 4.5 errors (1 in 1e5 runs)."""
    centre, root = np.array([3.0]), np.array([[2.0]])

    def density(x):
        inside = x[:, 0] > 0
        values = np.where(inside, x[:, 0], 1.0)
        return np.where(inside, np.log(values) - 0.5 * values, -np.inf)

    move = emcee.moves.MHMove(independent_proposals(centre, root))
    sampler = emcee.EnsembleSampler(32, 1, density, moves=move, vectorize=True)
    begin = np.random.default_rng(0).chisquare(4, size=(32, 1))
    generator = np.random.RandomState(0).get_state()
    sampler.run_mcmc(emcee.State(begin, random_state=generator), 2000)
    found = sampler.get_chain()[..., 0].T
    assert abs(found.mean() - 4.0) < 4.5 * error_of(found)
    assert abs(((found - 4.0) ** 2).mean() - 8.0) < 4.5 * error_of((found - 4.0) ** 2)


def test_proposals_are_learned_from_a_warmup_that_is_long_enough():
    centre, root = np.zeros(2), np.eye(2)
    rng = np.random.default_rng(0)
    lower = np.array([[2.0, 0.0], [1.0, 0.5]])
    chain = np.array([1.0, -1.0]) + rng.normal(size=(300, 32, 2)) @ lower.T
    ours = learned(chain, centre, root)
    np.testing.assert_allclose(ours[0], [1.0, -1.0], atol=0.1)
    np.testing.assert_allclose(ours[1], lower, atol=0.05)
    for short in (chain[:40], np.zeros((300, 32, 2))):
        assert learned(short, centre, root)[1] is root


def made(values, diverging=None):
    stats = None if diverging is None else {"diverging": diverging}
    return arviz().from_dict(posterior={"beta": values}, sample_stats=stats)


def test_convergence_in_words():
    rng = np.random.default_rng(0)
    white = rng.normal(size=(4, 1000))
    told = convergence(made(white))
    assert told.status.name == "CONVERGED"
    assert told.status.ok
    assert told.autocorrelation["beta"] == pytest.approx(1.0, abs=0.2)
    apart = convergence(made(white + np.array([[0.0], [0.0], [0.5], [0.5]])))
    assert apart.status.name == "NOT_MIXED"
    assert "R-hat of beta 1.0" in apart.message
    assert "times as many" in apart.message
    short = convergence(made(white[:, :60]))
    assert short.status.name == "TOO_SHORT"
    assert "240 draws of beta are worth only" in short.message
    lost = np.zeros((4, 1000), bool)
    lost[0, :30] = True
    bent = convergence(made(white, lost))
    assert bent.status.name == "DIVERGENT"
    assert bent.divergences == 30
    assert "30 of 4000 draws diverged" in bent.message
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        still = convergence(made(np.ones((4, 100))))
    assert not still.status.ok or still.r_hat["beta"] == 1.0
    with pytest.raises(dft.InputError, match="found dict"):
        convergence({})


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (dict(method="gibbs"), "method: expected one of emcee, nuts"),
        (dict(draws=0), r"draws: expected a whole number of at least 10(.|\n)*Correct draws\."),
        (dict(draws=2.5), "draws: expected a whole number"),
        (dict(warmup=-1), "warmup: expected a whole number of at least 0"),
        (dict(seed=-1), "seed: expected a whole number"),
        (dict(walkers=5), r"walkers: expected an even number of at least 6.*slope, offset"),
        (dict(walkers=4), "at least 6"),
        (dict(method="nuts", file="chain.h5"), "NUTS keeps no file"),
        (dict(method="nuts", walkers=32), "only emcee has walkers"),
        (dict(method="nuts", chains=0), "chains: expected"),
    ],
)
def test_arguments_that_cannot_be_meant(options, told):
    with pytest.raises(dft.InputError, match=told):
        sample(*line(), **options)


def test_what_is_no_fit_and_logs_of_another_fit():
    fit, log = line()
    with pytest.raises(dft.InputError, match="Expected a fit, found LinearSensor"):
        sample(fit.model, log)
    with pytest.raises(dft.InputError, match="not the training logs of the fit"):
        sample(fit, line(seed=3)[1])


def test_without_blackjax_the_command_to_install_it_is_told(monkeypatch):
    monkeypatch.setitem(sys.modules, "blackjax", None)
    with pytest.raises(dft.InputError, match=r"pip install 'diffthrust\[nuts\]'"):
        sample(*line(), method="nuts")


@pytest.mark.parametrize("method", ["emcee", pytest.param("nuts", marks=pytest.mark.slow)])
def test_a_parameter_at_its_bound_is_sampled_within_it(method):
    log = thruster_log()
    model = dft.Thruster(ct=0.019).replace(ct={"bounds": (0.0, 0.0199)})
    fit = dft.fit(model, log, starts=4, substeps=1)
    assert fit.status is dft.estimation.Status.AT_BOUND
    post = sample(fit, log, method=method, draws=1000, warmup=400)
    ct = post.posterior["ct"]
    assert float(ct.max()) <= 0.0199
    assert float(ct.min()) > 0.019
    assert post.attrs["status"] == "converged", post.attrs["message"]


@pytest.mark.slow
def test_noise_that_lasts_is_sampled_with_its_memory():
    log = thruster_log(count=600)
    fit = dft.fit(
        dft.Thruster(**TRUE), log, starts=4, substeps=1, noise_model="ar1", loss="student_t"
    )
    post = sample(fit, log, draws=200, warmup=200)
    assert {"noise.speed.lag_one", "noise.thrust.lag_one"} <= set(post.posterior.data_vars)
    for channel, level in fit.noise.items():
        found = post.posterior["sigma"].sel(channel=channel)
        assert abs(float(found.mean()) - level) < 2 * float(found.std())


def test_a_parameter_that_ran_to_zero_needs_a_prior():
    made = thruster_log()
    against = dict(made.measured, thrust=-made.measured["thrust"])
    log = dft.Log(made.time, dict(made.inputs), against)
    fit = dft.fit(dft.Thruster(), log, starts=4, substeps=1)
    assert fit.status is dft.estimation.Status.AT_BOUND
    with pytest.raises(dft.InputError, match="'ct' ran to zero"):
        sample(fit, log)


def test_likelihoods_that_are_no_numbers(monkeypatch):
    fit, log = line()
    whole = Posterior.batch

    def beside(self, points, *lanes):
        density, level = whole(self, points, *lanes)
        return np.where(np.all(points == self.centre, axis=1), density, -np.inf), level

    monkeypatch.setattr(Posterior, "batch", beside)
    with pytest.raises(dft.InputError, match="Only 0 of 640 points drawn around the fit"):
        sample(fit, log)
    monkeypatch.setattr(Posterior, "batch", lambda self, p: (np.array([-np.inf]), p))
    with pytest.raises(dft.InputError, match="likelihood at the fit is not a finite number"):
        sample(fit, log)


def test_progress_is_told():
    told = []

    def tell(message, share):
        told.append((message, share))

    sample(*line(), draws=60, warmup=30, progress=tell)
    assert {message for message, _ in told} == {"warmup", "drawing", "done"}
    shares = [share for _, share in told]
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_a_posterior_of_another_fit_is_refused():
    log = thruster_log(count=200)
    fits = [dft.fit(dft.Thruster(**TRUE).replace(ct=ct), log, starts=1) for ct in (0.02, 0.021)]
    post = sample(fits[0], log, draws=20, warmup=20)
    other = thruster_log(count=200, seed=9)
    away = dft.fit(dft.Thruster(**TRUE), other, starts=1)
    for call in (
        lambda: dft.intervals(away, other, post),
        lambda: dft.predict(post, away, other),
        lambda: dft.uncertainty.quantities(post, away, steps=[1.0]),
    ):
        with pytest.raises(dft.InputError, match="drawn from another fit"):
            call()


def test_one_chain_is_judged_by_its_halves():
    log = thruster_log(count=200)
    fit = dft.fit(dft.Thruster(**TRUE), log, starts=1)
    post = sample(fit, log, draws=100, warmup=20)
    lone = post.sel(chain=[0])
    told = dft.uncertainty.convergence(lone)
    assert all(np.isfinite(value) for value in told.r_hat.values())
    assert "never moved" not in told.message


def test_a_prior_that_drags_the_fit_along_is_found_out():
    log = thruster_log(count=200)
    model = dft.Thruster(**TRUE).replace(ct={"prior": dft.models.Normal(0.5, 1e-5)})
    fit = dft.fit(model, log, starts=4)
    assert fit.parameters["ct"].value == pytest.approx(0.5, rel=0.01)  # as told, and wrong
    with pytest.raises(dft.InputError, match=r"'ct': its prior.*excludes what the logs say"):
        sample(fit, log, draws=20, warmup=20)


@pytest.mark.thorough
def test_doubts_of_a_fit_are_told_with_all_that_is_drawn_of_it():
    rng = np.random.default_rng(3)
    log = thruster_log(count=400)
    lasting = np.convolve(rng.normal(size=420), np.full(20, 0.3), "valid")[:400]
    bent = dft.Log(
        log.time, dict(log.inputs), {**log.measured, "speed": log.measured["speed"] + lasting}
    )
    fit = dft.fit(dft.Thruster(**TRUE), bent, starts=1)
    post = sample(fit, bent, draws=20, warmup=20)
    for found in (
        dft.uncertainty.quantities(fit, steps=[1.0]),
        dft.uncertainty.quantities(post, fit, steps=[1.0]),
    ):
        assert any("too small" in note for note in found.notes)

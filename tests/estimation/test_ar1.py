"""Noise that lasts: the exact likelihood, honest errors, and the same noise in a diagnosis."""

import numpy as np
import pytest
from problems import NOISE_MODELS, SimulationError, build, linked, problem_of, restarts, solve
from scipy.stats import multivariate_normal

import diffthrust as dft

STEP = 0.05
LASTING = SimulationError(NOISE_MODELS["ar1"])
UNITS = {"command": "V", "speed": "rad/s", "thrust": "N"}


def lasting(rng, time, correlation, level):
    """Noise that lasts, drawn sample by sample."""
    out = np.empty(time.size)
    out[0] = rng.normal()
    for i, gap in enumerate(np.diff(time), start=1):
        kept = np.exp(-gap / correlation)
        out[i] = kept * out[i - 1] + np.sqrt(1 - kept**2) * rng.normal()
    return level * out


def log_of(time, measured):
    command = np.sin(0.4 * time) + 0.7 * np.sign(np.sin(1.3 * time))
    units = {n: UNITS[n] for n in ("command", *measured)}
    return dft.Log(time=time, inputs={"command": command}, measured=measured, units=units)


def thruster_log(rng, size=600, model=None, levels=(1.0, 0.5), kept=(0.8, 0.5), time=None):
    time = np.arange(size) * STEP if time is None else time
    blank = log_of(time, {"speed": np.zeros(time.size)})
    true = dft.simulate(model or dft.Thruster(), blank, initial={"speed": 0.0}, substeps=2)
    return log_of(
        time,
        {
            name: true[name] + lasting(rng, time, -STEP / np.log(phi), level)
            for name, level, phi in zip(("speed", "thrust"), levels, kept, strict=True)
        },
    )


def exact(times, rests, memory):
    """Negative log-likelihood of an Ornstein-Uhlenbeck process at its best level, by its matrix."""
    squares, logs, size = 0.0, 0.0, 0
    for time, rest in zip(times, rests, strict=True):
        seen = np.isfinite(rest)
        apart = np.abs(time[seen, None] - time[None, seen])
        law = multivariate_normal(cov=np.exp(-apart / memory))
        one = -2 * law.logpdf(rest[seen]) - seen.sum() * np.log(2 * np.pi)
        determinant = np.linalg.slogdet(np.exp(-apart / memory))[1]
        squares, logs, size = squares + one - determinant, logs + determinant, size + seen.sum()
    return 0.5 * size * np.log(squares / size) + 0.5 * logs


def costs(problem, kept):
    at = []
    for lag_one in kept:
        z = problem.start()
        name = "noise.speed.lag_one"
        z[problem.free.index(name)] = lag_one / problem.named[name].scale
        at.append(float(solve(problem, z, budget=1).quadratic.cost))
    return np.array(at)


def test_the_likelihood_is_that_of_the_whole_covariance_matrix():
    rng = np.random.default_rng(1)
    model = dft.Thruster()
    logs, rests = [], []
    for size in (90, 60):  # uneven steps, gaps, two runs of one batch and of different lengths
        time = np.cumsum(rng.uniform(0.02, 0.1, size))
        log = log_of(time, {"speed": np.zeros(size)})
        true = dft.simulate(model, log, initial={"speed": 0.0}, substeps=2)["speed"]
        noise = lasting(rng, time, 0.2, 1.0)
        noise[rng.random(size) < 0.15] = np.nan
        noise[0] = 0.0  # the measured start is that of the simulation
        logs.append(log_of(time, {"speed": true + noise}))
        rests.append(noise)
    problem = build(model, logs, substeps=2, likelihood=LASTING, initial="measured")
    kept = np.array([0.15, 0.7, 0.95])
    memories = -min(log.step for log in problem.records) / np.log(kept)
    expected = [exact([log.time for log in logs], rests, m) for m in memories]
    np.testing.assert_allclose(costs(problem, kept), expected, rtol=1e-8)


def test_gaps_of_one_ten_and_a_hundred_steps_are_told_apart():
    rng = np.random.default_rng(10)
    time = np.cumsum(np.r_[0.0, rng.choice([0.05, 0.5, 5.0], 79, p=[0.6, 0.3, 0.1])])
    log = log_of(time, {"speed": np.zeros(80)})
    true = dft.simulate(dft.Thruster(), log, initial={"speed": 0.0}, substeps=20)["speed"]
    noise = lasting(rng, time, 1.0, 1.0)
    noise[0] = 0.0
    measured = log_of(time, {"speed": true + noise})
    problem = build(dft.Thruster(), [measured], substeps=20, likelihood=LASTING, initial="measured")
    assert np.sum(np.asarray(problem.numbers.gaps.counts) > 0) == 3
    step = problem.records[0].step
    kept = np.array([0.3, 0.9])
    rests = [problem_rest(problem, noise)]
    expected = [exact([problem.records[0].time], rests, -step / np.log(k)) for k in kept]
    np.testing.assert_allclose(costs(problem, kept), expected, rtol=1e-8)


def problem_rest(problem, noise):
    """The noise on the problem's grid, on which wide gaps are bridged by samples without values."""
    log = problem.records[0]
    rest = np.full(log.time.size, np.nan)
    rest[np.isfinite(log.measured["speed"])] = noise
    return rest


def test_the_first_measured_sample_has_none_before_it():
    measured = np.array([[[np.nan, np.nan, 3.0, np.nan, 5.0]]])
    links = linked(np.arange(5.0)[None], measured, np.zeros((1, 5), bool), 0.5)
    assert np.isfinite(links.gap[0, 0]).all()
    assert links.gap[0, 0, 2] > 1e6  # so far that nothing of it is left
    assert (links.past[0, 0, 4], links.gap[0, 0, 4]) == (2, 4.0)


def test_noise_begins_anew_where_the_simulation_does():
    rng = np.random.default_rng(2)
    log = thruster_log(rng, size=200)
    problem = build(dft.Thruster(), [log], substeps=1, likelihood=LASTING, segmented=True)
    whole = np.asarray(problem.numbers.gaps.counts).sum()
    cut = restarts(problem, 2.0)
    assert whole - np.asarray(cut.numbers.gaps.counts).sum() == 2 * 4  # 2 channels, 4 restarts
    assert np.isfinite(costs(cut, [0.2])[0])


def test_correlation_level_and_parameters_are_found():
    rng = np.random.default_rng(3)
    log = thruster_log(rng, size=4000)
    fit = dft.fit(dft.Thruster(), log, starts=4, noise_model="ar1")
    assert fit.status is dft.estimation.Status.CONVERGED
    kept = {n: e.value for n, e in fit.disturbance.items()}
    # standard errors of phi: sqrt((1 - phi^2) / n) = 0.0095 and 0.0137; four of them
    assert kept["noise.speed.lag_one"] == pytest.approx(0.8, abs=0.04)
    assert kept["noise.thrust.lag_one"] == pytest.approx(0.5, abs=0.055)
    assert fit.noise["speed"] == pytest.approx(1.0, rel=0.14)
    assert fit.noise["thrust"] == pytest.approx(0.5, rel=0.08)
    for name, true in {"alpha": 0.037, "beta": 42.0, "ct": 0.019}.items():
        estimate = fit.parameters[name]
        assert abs(estimate.value - true) < 4 * estimate.std_error
    assert not any("correlated" in note for note in fit.notes)


def test_standard_errors_hold_where_those_of_white_noise_are_too_small():
    rng = np.random.default_rng(4)
    away = {"white": [], "ar1": []}
    for _ in range(30):
        log = thruster_log(rng, size=400)
        for noise_model, found in away.items():
            fit = dft.fit(dft.Thruster(), log, starts=1, noise_model=noise_model)
            found.append([(fit.parameters[n].value - true) / fit.parameters[n].std_error
                          for n, true in {"alpha": 0.037, "ct": 0.019}.items()])  # fmt: skip
    spread = {name: np.sqrt(np.mean(np.square(found))) for name, found in away.items()}
    # of 60 unit normals the root mean square is 1 +- 0.09; four of these are 0.37
    assert 0.63 < spread["ar1"] < 1.37
    assert spread["white"] > 1.6


@pytest.mark.slow
def test_white_noise_costs_next_to_nothing():
    rng = np.random.default_rng(5)
    log = thruster_log(rng, kept=(1e-9, 1e-9))
    white, ar1 = (dft.fit(dft.Thruster(), log, starts=2, noise_model=n) for n in ("white", "ar1"))
    # twice the gain of two parameters held at a bound half the time: below 12 but once in 1000
    assert 0 <= ar1.log_likelihood - white.log_likelihood < 6.0
    for name in ("alpha", "beta", "ct"):
        ratio = ar1.parameters[name].std_error / white.parameters[name].std_error
        assert ratio == pytest.approx(1.0, abs=0.15)


@pytest.mark.slow
def test_it_goes_with_spikes_and_with_segments_and_is_arranged_again():
    rng = np.random.default_rng(6)
    log = thruster_log(rng)
    for options in ({"loss": "student_t"}, {"horizon": 5.0}, {"initial": "measured"}):
        fit = dft.fit(dft.Thruster(), log, starts=2, noise_model="ar1", **options)
        assert fit.status.ok
        problem, z = problem_of(fit, log)
        again = dft.fit(fit.model, log, starts=1, **fit.options)
        assert again.log_likelihood == pytest.approx(fit.log_likelihood, abs=1e-4)
        gradient = solve(problem, z, budget=1).quadratic.gradient[: len(problem.free)]
        assert np.abs(gradient).max() < 1e-2


def test_the_problem_of_a_fit_wants_the_logs_of_the_fit():
    rng = np.random.default_rng(8)
    log, other = thruster_log(rng, size=200), thruster_log(rng, size=200)
    fit = dft.fit(dft.Thruster(), log, starts=1)
    with pytest.raises(dft.InputError, match="not the training logs of the fit"):
        problem_of(fit, other)
    with pytest.raises(dft.InputError, match="made of 1 training logs, given are 2"):
        problem_of(fit, [log, other])


@pytest.mark.slow
def test_a_diagnosis_of_such_a_fit_has_the_same_noise():
    rng = np.random.default_rng(9)
    hidden = dft.Thruster() + dft.effects.CommandDeadband(half_width=0.15)
    train, unseen = (thruster_log(rng, size=1000, model=hidden) for _ in range(2))
    fit = dft.fit(dft.Thruster(), train, holdout=unseen, starts=2, noise_model="ar1")
    wanted = ["command_deadband", "linear_damping"]
    found = dft.diagnose(fit, train, holdout=unseen, candidates=wanted, experiment=False)
    assert found.added == ("command_deadband",)
    assert {stage.fit.noise_model for stage in found.stages} == {"ar1"}

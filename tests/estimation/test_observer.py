"""The innovations form against a Kalman filter, finite differences and the reference simulators."""

import functools
import inspect
from dataclasses import replace
from typing import ClassVar

import jax
import numpy as np
import pytest
from observers import Limits, guesses, innovations, one_step, with_clip
from places import FITS
from problems import build, compiled, errors_at, evaluated, examine, innovations_of, solve
from reference import axis, inputs, noise, thruster
from scipy.stats import chi2

import diffthrust as dft
from diffthrust import InputError, Log
from diffthrust.effects import ActuatorLag, LinearDamping
from diffthrust.estimation import Status

GUESS = dft.Thruster(alpha=0.045, beta=38.0, ct=0.022)


def arranged(model, logs, *, initial="measured", **gains):
    """A problem in the innovations form, with some of the observer's values set."""
    problem = build(model, logs, initial=initial, likelihood=innovations_of(model, logs))
    named = {**problem.nuisance}
    for name, value in gains.items():
        key = f"noise.{name.replace('__', '.')}"
        named[key] = named[key].with_value(value)
    return replace(problem, nuisance=named)


def lag_one(rest):
    rest = rest[np.isfinite(rest)]
    return float(np.corrcoef(rest[:-1], rest[1:])[0, 1])


# A linear model, for which a Kalman filter is exact.


class FirstOrder(dft.Model):
    """dx/dt = -a x + b u."""

    name = "first_order"
    inputs: ClassVar = {"u": "V"}
    states: ClassVar = {"x": "rad/s"}
    outputs: ClassVar = {"x": "rad/s"}
    a: float = dft.parameter(4.0, "1/s", bounds=(0, None))
    b: float = dft.parameter(2.0, "rad/(V s^2)", bounds=(0, None))

    def equations(self, s, port):
        return {"x": -self.a * s.x + self.b * s.u}, {"x": s.x}


STEP, MEMORY, COLOUR = 0.02, 1.0, 0.05
FORCE, LASTING, WHITE = 5.0, 0.1, 0.1  # standard deviations


class Kalman:
    """The filter of x, an Ornstein-Uhlenbeck acceleration and an AR(1) sensor error.

    All as they are held over a sample; besides, the sensor has a white error.
    """

    def __init__(self, a=4.0, b=2.0):
        decay, kept, colour = np.exp([-a * STEP, -STEP / MEMORY, -STEP / COLOUR])
        moved = (1.0 - decay) / a
        self.transition = np.array([[decay, moved, 0.0], [0.0, kept, 0.0], [0.0, 0.0, colour]])
        self.drive = np.array([b * moved, 0.0, 0.0])
        self.spread = np.diag([0.0, FORCE**2 * (1 - kept**2), LASTING**2 * (1 - colour**2)])
        self.reads = np.array([1.0, 0.0, 1.0])
        p = np.diag([1.0, FORCE**2, LASTING**2])
        for _ in range(5000):
            p = self.ahead(p, self.gain(p))
        self.stationary = p

    def gain(self, p):
        return p @ self.reads / (self.reads @ p @ self.reads + WHITE**2)

    def ahead(self, p, k):
        kept = (np.eye(3) - np.outer(k, self.reads)) @ p
        return self.transition @ kept @ self.transition.T + self.spread

    def innovations(self, u, y, p):
        """Errors and their variances, begun at the first measurement with covariance ``p``."""
        x, errors, variances = np.array([y[0], 0.0, 0.0]), [], []
        for drive, measured in zip(u, y, strict=True):
            e = measured - self.reads @ x
            errors.append(e)
            variances.append(self.reads @ p @ self.reads + WHITE**2)
            k = self.gain(p)
            x, p = self.transition @ (x + k * e) + self.drive * drive, self.ahead(p, k)
        return np.array(errors), np.array(variances)

    def simulated(self, u, rng):
        x, y = np.array([0.0, *(rng.standard_normal(2) * [FORCE, LASTING])]), []
        for drive in u:
            y.append(self.reads @ x + WHITE * rng.standard_normal())
            shock = np.sqrt(np.diagonal(self.spread)) * rng.standard_normal(3)
            x = self.transition @ x + self.drive * drive + shock
        return np.array(y)

    def as_observer(self):
        """The stationary gains in the observer's terms."""
        x, force, lasting = self.gain(self.stationary)
        return {
            "x__gain__x": x,
            "x__drift__x": force * STEP / self.transition[1, 1],
            "x__memory": MEMORY,
            "x__colour": lasting,
            "x__correlation": COLOUR,
        }


STILL = Log([0.0, 1.0, 2.0], {"u": np.zeros(3)}, {"x": np.zeros(3)})
LIKELIHOOD = innovations_of(FirstOrder(), [STILL])


@functools.cache
def linear_log(count=6000):
    rng = np.random.default_rng(7)
    time = STEP * np.arange(count)
    u = np.where(np.sin(0.7 * time) + np.sin(2.9 * time) > 0, 2.0, -1.0)
    return Log(time, {"u": u}, {"x": Kalman().simulated(u, rng)}, name="linear")


def test_stationary_gains_give_the_innovations_of_the_kalman_filter():
    log, kalman = linear_log(), Kalman()
    problem = arranged(FirstOrder(), [log], **kalman.as_observer())
    found = errors_at(problem, problem.start())[0]["x"]
    u, y = log.inputs["u"], log.measured["x"]
    same, _ = kalman.innovations(u, y, kalman.stationary)
    np.testing.assert_allclose(found, same, rtol=0, atol=1e-6)
    # one that begins with other certainty agrees once that is forgotten
    other, _ = kalman.innovations(u, y, np.diag([WHITE**2, FORCE**2, LASTING**2]))
    assert np.max(np.abs(found - other)[:20]) > 1e-3
    np.testing.assert_allclose(found[1000:], other[1000:], rtol=0, atol=1e-6)
    assert np.std(found) > WHITE


@pytest.mark.thorough
def test_maximum_likelihood_finds_the_gains_of_the_kalman_filter():
    log, kalman = linear_log(), Kalman()
    truth = arranged(FirstOrder(), [log], **kalman.as_observer())
    z = truth.start()
    at_truth = evaluated(truth, z)
    begin = arranged(FirstOrder(a=2.0, b=1.0), [log])
    best = solve(begin, begin.start())
    assert best.done
    # the filter's own likelihood, its noise levels scaled as they fit best
    errors, variances = kalman.innovations(log.inputs["u"], log.measured["x"], kalman.stationary)
    scale = np.mean(errors**2 / variances)
    exact = 0.5 * errors.size * np.log(scale) + 0.5 * np.sum(np.log(variances))
    assert float(at_truth.cost) == pytest.approx(exact, abs=1e-4)
    # the truth is no further below the optimum, nor away from it, than chance allows
    assert 0.0 < exact - float(best.quadratic.cost) < 0.5 * chi2.ppf(0.999, z.size)
    away = best.z - z
    assert away @ best.quadratic.information @ away < chi2.ppf(0.999, z.size)
    slopes = begin.slopes(best.z)
    covariance = np.linalg.inv(best.quadratic.information) * np.outer(slopes, slopes)
    found, given = begin.values(best.z), truth.values(z)
    jump = ("noise.x.gain.x", "noise.x.colour")  # only their sum is seen at once
    for names, limit in ((jump, 0.05), (("noise.x.drift.x",), 0.05), (("a",), 0.6), (("b",), 0.2)):
        pick = np.array([n in names for n in begin.free], float)
        width = np.sqrt(pick @ covariance @ pick)
        assert width < limit
        assert abs(sum(found[n] - given[n] for n in names)) < 3.5 * width


def plain_observer(log, values, model, clip=np.inf):
    """The constant-gain observer of the linear model, written out; errors of its predictions."""
    unsigned = "x" in log.unsigned
    decay = np.exp(-model.a * STEP)
    kept, colour = np.exp(-STEP / values["x__memory"]), np.exp(-STEP / values["x__correlation"])
    x, force, lasting, errors = log.measured["x"][0], 0.0, 0.0, []
    for drive, measured in zip(log.inputs["u"], log.measured["x"], strict=True):
        e = 0.0 if np.isnan(measured) else measured - (abs(x) if unsigned else x) - lasting
        errors.append(np.nan if np.isnan(measured) else e)
        e = e / (1.0 + (e / clip) ** 8) ** 0.125
        pull = -e if unsigned and x < 0 else e
        x += values["x__gain__x"] * pull
        force = kept * (force + values["x__drift__x"] / STEP * pull)
        lasting = colour * (lasting + values["x__colour"] * e)
        x = decay * x + (1 - decay) / model.a * (model.b * drive + force)
    return np.array(errors)


@pytest.mark.parametrize("case", ["plain", "missing", "unsigned", "spikes"])
def test_what_sensors_do(case):
    full = linear_log()
    rng = np.random.default_rng(3)
    u, y = full.inputs["u"][:800], full.measured["x"][:800].copy()
    clip = 0.3 if case == "spikes" else np.inf
    if case == "missing":
        y[1:][rng.random(799) < 0.3] = np.nan
        y[300:360] = np.nan
    if case == "spikes":
        y[1:] += noise.spikes(rng, 799, 0.05, 20.0)
    if case == "unsigned":
        assert np.min(y) < -0.3
        y = np.abs(y)
    unsigned = ("x",) if case == "unsigned" else ()
    log = Log(full.time[:800], {"u": u}, {"x": y}, unsigned=unsigned)
    gains = Kalman().as_observer()
    problem = arranged(FirstOrder(), [log], **gains)
    problem = with_clip(problem, [clip])
    found = errors_at(problem, problem.start())[0]["x"]
    expected = plain_observer(log, gains, FirstOrder(), clip)
    np.testing.assert_array_equal(np.isnan(found), np.isnan(y))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6)


def test_a_whole_turn_is_no_error():
    class Pointer(FirstOrder):
        angles: ClassVar = ("x",)

    full = linear_log()
    turns = 2 * np.pi * np.random.default_rng(5).integers(-3, 4, 500)
    turns[0] = 0.0
    found = []
    for y in (full.measured["x"][:500], full.measured["x"][:500] + turns):
        log = Log(full.time[:500], {"u": full.inputs["u"][:500]}, {"x": y})
        problem = arranged(Pointer(), [log], **Kalman().as_observer())
        found.append(errors_at(problem, problem.start())[0]["x"])
    assert np.max(np.abs(found[0])) < np.pi
    np.testing.assert_allclose(found[1], found[0], rtol=0, atol=1e-9)


def test_substeps_change_nothing_at_a_fine_step():
    log = linear_log().slice(0.0, 8.0)
    found = []
    for substeps in (1, 3):
        problem = build(FirstOrder(), [log], substeps=substeps, likelihood=LIKELIHOOD)
        found.append(errors_at(problem, problem.start())[0]["x"])
    np.testing.assert_allclose(found[1], found[0], rtol=0, atol=1e-6)


def test_a_batch_of_unequal_logs_is_its_logs():
    logs = [linear_log().slice(10.0, 15.5), linear_log().slice(0.0, 6.0)]
    both = arranged(FirstOrder(), logs)
    assert both.order == ((1, 0),)
    together = errors_at(both, both.start())
    for log, ours in zip(logs, together, strict=True):
        alone = arranged(FirstOrder(), [log])
        theirs = errors_at(alone, both.start())[0]["x"]
        assert ours["x"].shape == log.time.shape
        np.testing.assert_allclose(ours["x"], theirs, rtol=0, atol=1e-12)


@pytest.mark.thorough
@pytest.mark.parametrize("loss", ["gaussian", "student_t"])
def test_the_gradient_is_that_of_the_cost(loss):
    log = field_log(0, spikes=0.02, dropout=0.1)
    likelihood = innovations_of(GUESS, [log], loss)
    problem = build(GUESS, [log], likelihood=likelihood)
    assert evaluated(problem, problem.start()).scores.size == 0  # wanted of trials alone
    problem = build(GUESS, [log], likelihood=likelihood, width=len(problem.free))
    problem = problem.focus(problem.free, problem.values(problem.start()))
    problem = with_clip(problem, [3.0, 3.0])
    z = problem.start()
    q = evaluated(problem, z)
    ahead = 1e-5 * np.eye(z.size)
    steps = [(evaluated(problem, z + d).cost, evaluated(problem, z - d).cost) for d in ahead]
    differences = np.array([float(a - b) / 2e-5 for a, b in steps])
    np.testing.assert_allclose(q.gradient, differences, rtol=2e-5, atol=2e-4)
    assert np.all(np.abs(q.gradient[: len(problem.free)]) > 1e-2)
    np.testing.assert_allclose(q.scores.sum(axis=1), q.gradient[: len(problem.free)], rtol=1e-9)


@pytest.mark.thorough
def test_many_selections_of_parameters_share_one_compilation():
    model = GUESS + LinearDamping().at_null() + ActuatorLag().at_null()
    log = field_log(0)
    problem = build(model, [log], likelihood=innovations_of(model, [log]), width=6)
    values = {name: p.value for name, p in problem.named.items()}
    names = list(problem.free)
    before, costs = compiled._cache_size(), []
    for chosen in (names[:3], names[1:6], [*names[2:4], "linear_damping.rate"], names[-6:]):
        part = problem.focus(chosen, {**values, "beta": 40.0})
        q = evaluated(part, part.start())
        costs.append(float(q.cost))
        slope = np.asarray(q.gradient)
        assert np.count_nonzero(slope[: len(chosen)]) > 0
        assert np.all(slope[len(chosen) : 6] == 0.0)
    assert compiled._cache_size() == before + 1
    np.testing.assert_allclose(costs, costs[0], rtol=1e-12)


# The reference thruster under turbulent torque and lasting sensor errors.


@functools.cache
def field_log(seed, count=601, force=6.0, colour=0.9, spikes=0.0, dropout=0.0, unsigned=False):
    rng = np.random.default_rng(seed)
    time = 0.05 * np.arange(count)
    command = inputs.low_passed_random(time, 1.5, rng)
    torque = noise.ornstein_uhlenbeck(rng, time, force, 0.5)
    record = thruster.simulate(
        time, command, disturbance=torque, initial_speed=5.0, method="rk4", substeps=2
    )
    kept = {"correlation": colour, "dropout_share": dropout}
    record = noise.measure(
        record,
        rng,
        speed=noise.Sensor(0.3, spike_share=spikes, spike_size=20.0, unsigned=unsigned, **kept),
        thrust=noise.Sensor(0.5, **kept),
    )
    name = f"log{seed}"
    return Log(
        record.time, record.inputs, record.measured, name=name, unsigned=("speed",)[:unsigned]
    )


def scores_of(fit):
    """Estimated minus true, in standard errors."""
    found = {name: fit.parameters[name] for name in thruster.JASON}
    return [(e.value - thruster.JASON[n]) / e.std_error for n, e in found.items()]


def both_scores(seeds):
    kinds = ("innovations", "simulation")
    found = {kind: [] for kind in kinds}
    for seed in seeds:
        for kind in kinds:
            fit = dft.fit(GUESS, field_log(seed), likelihood=kind, starts=2)
            assert fit.status is Status.CONVERGED
            found[kind].append(scores_of(fit))
    return (np.array(found[kind]) for kind in kinds)


@pytest.mark.slow
def test_intervals_hold_under_random_forces_where_those_of_the_simulation_do_not():
    ours, theirs = both_scores(range(8))
    assert np.mean(np.abs(ours) < 1.96) > 0.8
    assert np.max(np.abs(ours)) < 4.0
    assert np.mean(np.abs(theirs) < 1.96) < 0.6


@pytest.mark.slow
def test_intervals_cover_what_they_say():
    ours, theirs = both_scores(range(100, 140))
    assert 0.85 <= np.mean(np.abs(ours) < 1.96) <= 0.99
    assert np.mean(np.abs(theirs) < 1.96) < 0.6
    bias = np.mean(ours, axis=0) * np.sqrt(len(ours))  # a standard normal each, without bias
    assert np.all(np.abs(bias) < 3.0)


@pytest.mark.slow
def test_one_step_errors_are_white_where_residuals_of_the_simulation_are_not():
    for log in (field_log(20), field_log(21)):
        fit = dft.fit(GUESS, log, likelihood="innovations", starts=2)
        assert fit.status is Status.CONVERGED
        assert not [note for note in fit.notes if "correlated" in note]
        run = dft.compare(fit, log).runs[0]
        for name, rest in one_step(fit, [log])[0].items():
            assert abs(lag_one(rest)) < 3 / np.sqrt(len(log))
            assert lag_one(run.channels[name].residual) > 0.9


@pytest.mark.thorough
def test_without_random_forces_the_gains_vanish():
    for seed in range(3):
        log = field_log(seed, force=0.0, colour=0.0)
        ours = dft.fit(GUESS, log, likelihood="innovations", starts=3)
        plain = dft.fit(GUESS, log, starts=3)
        assert ours.status is Status.CONVERGED
        for name, e in plain.parameters.items():
            assert abs(ours.parameters[name].value - e.value) < 0.5 * e.std_error
            assert ours.parameters[name].std_error == pytest.approx(e.std_error, rel=0.5)
        value = {n.removeprefix("noise."): e.value for n, e in ours.disturbance.items()}
        assert value["speed.gain.speed"] < 0.1
        assert value["speed.drift.speed"] < 0.1
        for name in ("speed", "thrust"):  # what of an error is left at the next sample
            kept = np.exp(-log.step / value[f"{name}.correlation"])
            assert value[f"{name}.colour"] * kept < 4 / np.sqrt(len(log))
        gained = ours.log_likelihood - plain.log_likelihood
        assert -1e-6 < gained < 0.5 * chi2.ppf(0.999, len(ours.disturbance))


@pytest.mark.thorough
def test_spikes_do_not_move_the_states_under_student_t():
    log = field_log(30, spikes=0.02)
    fit = dft.fit(GUESS, log, likelihood="innovations", loss="student_t", starts=2)
    assert fit.status.ok
    assert np.max(np.abs(scores_of(fit))) < 3.5
    assert fit.noise["speed"] < 0.5  # that of the samples without a spike


# A state that is not measured.


@pytest.mark.slow
def test_a_driving_state_that_is_not_measured_follows_the_gusts():
    rng = np.random.default_rng(11)
    time = 0.2 * np.arange(1001)
    thrust = 80.0 * np.sin(0.35 * time) + 60.0 * np.sign(np.sin(0.11 * time))
    gusts = noise.ornstein_uhlenbeck(rng, time, 25.0, 4.0)
    record = axis.simulate(time, thrust, disturbance=gusts, method="rk4", substeps=2)
    truth = record.truth["velocity"]
    read = noise.measure(record, rng, position=noise.Sensor(0.05))
    log = Log(time, read.inputs, read.measured)
    model = dft.AxisVehicle(mass=300.0, drag=80.0)
    fit = dft.fit(model, log, likelihood="innovations", starts=3)
    assert fit.status is Status.CONVERGED
    for name, e in fit.parameters.items():
        assert abs(e.value - axis.JASON_JR[name]) < 3.5 * e.std_error
    assert {"noise.velocity.gain.position", "noise.velocity.memory"} <= set(fit.disturbance)
    values = {name: e.value for name, e in fit.disturbance.items()}
    problem = build(fit.model, [log], initial="measured", likelihood=innovations_of(model, [log]))
    batch = jax.tree.map(lambda a: a[0], problem.numbers.batches[0])
    limits = Limits(problem.numbers.clip, 1.0)
    layout = problem.layout
    _, path = innovations(
        layout.likelihood.observer, fit.model, layout.grids[0], values, batch, batch.held, limits
    )
    estimated = np.asarray(path["velocity"])[: time.size]  # rows are padded to few lengths
    ours = np.sqrt(np.mean((estimated - truth) ** 2))
    known = dft.simulate(dft.AxisVehicle(), log)["velocity"]
    plain = np.sqrt(np.mean((known - truth) ** 2))
    assert ours < 0.5 * plain


# What a fit tells of it.


def test_the_fit_says_which_likelihood_it_is_of():
    log = field_log(0)
    fit = dft.fit(GUESS, log, holdout=field_log(1), likelihood="innovations", starts=2)
    assert (fit.likelihood, fit.horizon) == ("innovations", None)
    assert fit.free == ("alpha", "beta", "ct")
    assert fit.covariance.shape == (3, 3)
    assert fit.disturbance["noise.speed.memory"].unit == "s"
    assert not set(fit.disturbance) & set(fit.parameters)
    assert set(fit.to_json()["parameters"]) == {"alpha", "beta", "ct"}
    ahead = dft.compare(fit, [log, field_log(1)])
    assert ahead.one_step is not None
    assert ahead.one_step.channels["speed"].rmse == pytest.approx(fit.noise["speed"], rel=0.1)
    assert ahead.one_step.nrmse < 0.5 * fit.holdout.nrmse
    plain = dft.fit(GUESS, log, starts=1)
    assert (plain.likelihood, plain.disturbance) == ("simulation", None)
    assert dft.compare(plain, log).one_step is None
    assert dft.compare(plain.model, log).one_step is None


def test_the_covariance_is_that_with_the_observers_part_left_free():
    log = field_log(2)
    problem = arranged(GUESS, [log], initial="estimate")
    best = solve(problem, problem.start())
    low, high = problem.limits()
    inside = (best.z > low + 1e-9) & (best.z < high - 1e-9)
    assert np.all(inside[:3])
    assert np.sum(inside) >= 8
    kept = np.ix_(inside, inside)
    whole = np.linalg.inv(best.quadratic.information[kept])[:3, :3]
    slopes = problem.slopes(best.z)[:3]
    local = examine(problem, best.z, best.quadratic)
    samples = 2 * len(log)
    used = samples / (samples - np.sum(inside))
    np.testing.assert_allclose(local.covariance, used * whole * np.outer(slopes, slopes), rtol=1e-5)


def test_gaps_in_time_are_crossed():
    log = field_log(3)
    kept = np.r_[0:200, 230:601]
    series = {n: v[kept] for n, v in log.measured.items()}
    holed = Log(log.time[kept], {"command": log.inputs["command"][kept]}, series)
    fit = dft.fit(GUESS, holed, likelihood="innovations", starts=1)
    rests = one_step(fit, [holed])[0]["speed"]
    assert rests.shape == kept.shape
    assert np.std(rests) == pytest.approx(fit.noise["speed"], rel=0.2)


def test_a_spec_file_may_ask_for_it():
    words = type(dft.load_spec(FITS / "depth_sensor").file.fit)
    part = words(likelihood="innovations")
    assert part.model_dump(exclude_unset=True) == {"likelihood": "innovations"}
    assert set(words.model_fields) <= set(inspect.signature(dft.fit).parameters)


def test_without_a_measured_state_there_is_nothing_to_correct():
    log = field_log(0)
    blind = Log(log.time, log.inputs, {"thrust": log.measured["thrust"]})
    with pytest.raises(InputError, match="expected one of 'speed', found 'thrust'") as caught:
        dft.fit(GUESS, blind, likelihood="innovations")
    assert "likelihood='simulation'" in caught.value.mend
    driven = Log(log.time, {"speed": log.measured["speed"]}, {"thrust": log.measured["thrust"]})
    with pytest.raises(InputError, match="drive the model alike"):
        dft.fit(GUESS, [log, driven], likelihood="innovations")


def test_gains_are_begun_as_given_small_and_as_the_sensors_own():
    names = ["noise.speed.gain.speed", "noise.speed.memory", "noise.thrust.colour"]
    small = {"noise.speed.gain.speed": 0.02, "noise.thrust.colour": 0.02}
    assert guesses(names) == ({}, small, {**small, "noise.thrust.colour": 0.9})
    assert guesses(["noise.speed.memory"]) == ({},)

"""The simulation-error likelihood against finite differences and a plain NumPy version of it."""

import functools
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from error_laws import TAIL
from problems import (
    LOSSES,
    SimulationError,
    build,
    compiled,
    evaluated,
    gram,
    likelihood_module,
    restarts,
)
from reference import inputs, noise, thruster, vessel
from scipy.optimize import minimize_scalar

import diffthrust as dft
from diffthrust import Log, simulate
from diffthrust.effects import ActuatorLag, ReverseThrustAsymmetry


@functools.cache
def record(seed, count=161, unsigned=False, dropout=0.0, spikes=0.0):
    rng = np.random.default_rng(seed)
    time = 0.05 * np.arange(count)
    command = inputs.low_passed_random(time, 1.5, rng)
    clean = thruster.simulate(time, command, initial_speed=5.0, method="rk4")
    kept = {"unsigned": unsigned, "spike_share": spikes, "spike_size": 20.0}
    speed = noise.Sensor(0.3, dropout_share=dropout, **kept)
    return noise.measure(clean, rng, speed=speed, thrust=noise.Sensor(0.5, dropout_share=dropout))


def log_of(seed, count=161, *, known=(), unsigned=False, dropout=0.0, spikes=0.0, channels=None):
    r = record(seed, count, unsigned, dropout, spikes)
    measured = {k: v for k, v in r.measured.items() if channels is None or k in channels}
    return Log(
        r.time,
        r.inputs,
        measured,
        noise={name: {"speed": 0.3, "thrust": 0.5}[name] for name in known},
        unsigned=("speed",) if unsigned else (),
        name=f"log{seed}",
    )


GUESS = dft.Thruster(alpha=0.045, beta=38.0, ct=0.022)
FORGIVING = SimulationError(law=LOSSES["student_t"])


# A second version, by way of `simulate` on each log.


def plain_residuals(problem, z):
    """For each channel the differences of all logs, missing samples left out."""
    model = problem.model.replace(problem.values(z))
    out = {name: [] for name in problem.layout.channels}
    for record, start in zip(problem.records, problem.numbers_by_log(z), strict=True):
        log = record.counted
        found = simulate(model, log, initial=start, substeps=problem.substeps)
        for name in out:
            if name in log.measured:
                modelled = np.abs(found[name]) if name in log.unsigned else found[name]
                rest = log.values(name, model.outputs[name]) - modelled
                if name in model.angles:
                    rest = np.angle(np.exp(1j * rest))
                out[name].append(rest[np.isfinite(rest)])
    return {name: np.concatenate(parts) for name, parts in out.items()}


def plain_cost(problem, z):
    cost = 0.0
    for i, (_name, rest) in enumerate(plain_residuals(problem, z).items()):
        known = problem.layout.known_noise[i]
        sigma = float(problem.numbers.noise[i])

        def gaussian(s, rest=rest):
            return 0.5 * np.sum(rest**2) / s**2 + rest.size * np.log(s)

        def student(s, rest=rest):
            tails = np.log1p(rest**2 / (TAIL * s**2))
            return 0.5 * (TAIL + 1.0) * np.sum(tails) + rest.size * np.log(s)

        normal = problem.layout.likelihood.law.word == "gaussian"
        law = gaussian if normal else student
        if not known:
            root = np.sqrt(np.mean(rest**2))
            inside = (np.log(0.01 * root), np.log(10.0 * root))
            best = minimize_scalar(
                lambda v, law=law: law(np.exp(v)),
                bounds=inside,
                method="bounded",
                options={"xatol": 1e-10},
            )
            sigma = float(np.exp(best.x))
        cost += law(sigma)
        if normal:  # constants that the package leaves out
            cost -= rest.size * np.log(sigma) if known else 0.5 * rest.size
    for name, (mean, std) in problem.numbers.prior.items():
        cost += 0.5 * ((problem.values(z)[name] - float(mean)) / float(std)) ** 2
    return cost


def lagged():
    model = GUESS + ActuatorLag(time_constant=0.06) + ReverseThrustAsymmetry(change=-0.15)
    return build(model, [log_of(1)])


CASES = {
    "gaussian": lambda: build(GUESS, [log_of(1)]),
    "known_noise": lambda: build(GUESS, [log_of(1, known=("speed", "thrust"))]),
    "one_known": lambda: build(GUESS, [log_of(1, known=("thrust",))]),
    "student_t": lambda: build(GUESS, [log_of(2, spikes=0.05)], likelihood=FORGIVING),
    "student_t_known": lambda: build(
        GUESS, [log_of(2, spikes=0.05, known=("speed", "thrust"))], likelihood=FORGIVING
    ),
    "unsigned": lambda: build(GUESS, [log_of(3, unsigned=True)]),
    "missing": lambda: build(GUESS, [log_of(4, dropout=0.3)]),
    "several_logs": lambda: build(GUESS, [log_of(1), log_of(5, 150), log_of(6, 60)]),
    "channels_differ": lambda: build(GUESS, [log_of(1), log_of(5, channels=("speed",))]),
    "measured_start": lambda: build(GUESS, [log_of(1), log_of(5)], initial="measured"),
    "substeps": lambda: build(GUESS, [log_of(1)], substeps=3),
    "effects": lagged,
    "prior": lambda: build(
        GUESS.replace(
            alpha={"prior": dft.models.Normal(0.037, 0.001)},
            beta={"prior": dft.models.Normal(42.0, 0.1)},
        ),
        [log_of(1)],
    ),
    "fixed": lambda: build(GUESS.fix("beta"), [log_of(1)]),
    "vessel": lambda: build(
        dft.Vessel(**{**vessel.SIRAMDASU, "d33": 1.5}).fix("exponent"), [vessel_log()]
    ),
}


@functools.cache
def vessel_log():
    time = 0.2 * np.arange(120)
    given = {
        "propeller_speed": np.full(120, 98.0),
        "rudder_angle": inputs.zigzag(time, 0.35, 6.0, 2.0) - 0.1,
    }
    start = {"surge": 0.3, "heading": 3.0}
    clean = vessel.simulate(time, given, parameters=vessel.SIRAMDASU, initial=start, method="rk4")
    rng = np.random.default_rng(9)
    levels = {"surge": 0.02, "yaw_rate": 0.01, "heading": 0.02}
    read = noise.measure(clean, rng, **{n: noise.Sensor(std) for n, std in levels.items()})
    read.measured["heading"][:] = np.angle(np.exp(1j * read.measured["heading"]))
    assert np.ptp(np.diff(read.measured["heading"])) > 6.0  # it does wrap
    return Log(time, given, read.measured)


@functools.cache
def case(name):
    """A problem, and a point away from both the guess and the optimum."""
    problem = CASES[name]()
    rng = np.random.default_rng(7)
    return problem, problem.start() + 0.05 * rng.standard_normal(problem.start().size)


@pytest.mark.parametrize("name", CASES)
def test_the_cost_is_that_of_the_plain_version(name):
    problem, z = case(name)
    assert float(evaluated(problem, z).cost) == pytest.approx(plain_cost(problem, z), rel=1e-9)


@pytest.mark.parametrize("name", CASES)
def test_the_gradient_agrees_with_differences_of_the_cost(name):
    problem, z = case(name)
    found = evaluated(problem, z)
    size = np.sqrt(np.diagonal(found.information) * float(found.energy))
    for i in range(z.size):
        ends = []
        for step in (2e-5, 1e-5):
            away = np.zeros(z.size)
            away[i] = step
            ahead, behind = evaluated(problem, z + away), evaluated(problem, z - away)
            ends.append((float(ahead.cost) - float(behind.cost)) / (2.0 * step))
        exact = (4.0 * ends[1] - ends[0]) / 3.0  # Richardson: the error of the differences falls
        assert float(found.gradient[i]) == pytest.approx(exact, rel=1e-6, abs=1e-6 * size[i]), i


@pytest.mark.parametrize("name", [n for n in CASES if not n.startswith("student")])
def test_the_information_is_that_of_the_differenced_residuals(name):
    problem, z = case(name)
    found = evaluated(problem, z)

    def whitened(at):
        parts = plain_residuals(problem, at)
        return np.concatenate([r / s for r, s in zip(parts.values(), found.sigma, strict=True)])

    columns = []
    for i in range(z.size):
        away = np.zeros(z.size)
        away[i] = 1e-5
        columns.append((whitened(z + away) - whitened(z - away)) / 2e-5)
    jacobian = np.stack(columns, axis=1)
    information = jacobian.T @ jacobian
    for prior, (_, std) in problem.numbers.prior.items():
        i = problem.free.index(prior)
        information[i, i] += (problem.slopes(z)[i] / float(std)) ** 2
    length = np.sqrt(np.diagonal(information))
    length[length == 0] = 1.0  # an initial state that nothing measured depends on
    difference = (found.information - information) / np.outer(length, length)
    assert np.max(np.abs(difference)) < 1e-6
    rest = whitened(z)
    assert float(found.energy) == pytest.approx(np.sum(rest**2), rel=1e-9)


def test_the_estimated_noise_is_the_root_mean_square_of_what_was_seen():
    problem, z = case("missing")
    found = evaluated(problem, z)
    for sigma, rest in zip(found.sigma, plain_residuals(problem, z).values(), strict=True):
        assert float(sigma) == pytest.approx(np.sqrt(np.mean(rest**2)), rel=1e-9)


def test_an_outlier_weighs_little_under_student_t():
    clean = log_of(2)
    spoilt = {name: np.array(values) for name, values in clean.measured.items()}
    spoilt["speed"][40] += 300.0
    z = build(GUESS, [clean]).start()

    def gradients(loss):
        out = []
        likelihood = SimulationError(law=LOSSES[loss])
        for measured in (clean.measured, spoilt):
            log = Log(clean.time, clean.inputs, measured, noise={"speed": 0.3, "thrust": 0.5})
            out.append(evaluated(build(GUESS, [log], likelihood=likelihood), z).gradient[:3])
        return np.linalg.norm(out[1] - out[0]) / np.linalg.norm(out[0])

    assert gradients("student_t") < 0.02
    assert gradients("gaussian") > 0.1


# Failure.


@pytest.mark.parametrize("loss", ["gaussian", "student_t"])
@pytest.mark.parametrize("known", [(), ("speed", "thrust")])
def test_a_simulation_that_fails_costs_infinity(loss, known):
    problem = build(
        GUESS,
        [log_of(1, known=known), log_of(6, 60, known=known)],
        likelihood=SimulationError(law=LOSSES[loss]),
    )
    for alpha in (1e3, 1e9, 1e200):
        z = problem.start()
        z[problem.free.index("alpha")] = np.log(alpha)
        found = evaluated(problem, z)
        assert float(found.cost) == np.inf, alpha
    z = problem.start()
    z[0] = np.nan
    assert float(evaluated(problem, z).cost) == np.inf


def test_one_log_that_fails_is_not_hidden_by_the_others():
    steady = log_of(1)
    wild = Log(steady.time, {"command": 1e6 * steady.inputs["command"]}, steady.measured)
    problem = build(GUESS, [steady, wild])
    assert float(evaluated(problem, problem.start()).cost) == np.inf


# Several logs and padding.


@pytest.mark.parametrize("counts", [(161, 150, 140), (161, 60), (30, 161, 33)])
def test_logs_of_different_lengths_add_up(counts):
    logs = [log_of(20 + i, n, known=("speed", "thrust")) for i, n in enumerate(counts)]
    joint = build(GUESS, logs)
    z = joint.start()
    z[:3] += [0.1, -0.05, 0.07]
    whole = evaluated(joint, z)
    starts = joint.numbers_by_log(z)
    cost, gradient, information = 0.0, np.zeros(3), np.zeros((3, 3))
    for log, start in zip(logs, starts, strict=True):
        alone = build(GUESS, [log])
        part = evaluated(alone, np.concatenate([z[:3], [start["speed"]]]))
        cost += float(part.cost)
        gradient += part.gradient[:3]
        information += part.information[:3, :3]
    assert float(whole.cost) == pytest.approx(cost, rel=1e-10)
    np.testing.assert_allclose(whole.gradient[:3], gradient, rtol=1e-10)
    np.testing.assert_allclose(whole.information[:3, :3], information, rtol=1e-10)


def test_the_order_of_the_logs_changes_nothing():
    logs = [log_of(20, 161), log_of(21, 40), log_of(22, 150), log_of(23, 45)]
    forward, backward = build(GUESS, logs), build(GUESS, logs[::-1])
    one = evaluated(forward, forward.start())
    other = evaluated(backward, backward.start())
    assert float(one.cost) == pytest.approx(float(other.cost), rel=1e-12)
    assert (
        forward.numbers_by_log(forward.start()) == backward.numbers_by_log(backward.start())[::-1]
    )
    for problem in (forward, backward):  # each log gets its own first measurement
        starts = problem.numbers_by_log(problem.start())
        for record, start in zip(problem.records, starts, strict=True):
            assert start["speed"] == record.measured["speed"][0]


def test_starts_of_one_log_do_not_touch_another():
    problem = build(GUESS, [log_of(20, 161), log_of(21, 150), log_of(22, 50)])
    information = evaluated(problem, problem.start()).information
    own = information[3:, 3:]
    np.testing.assert_array_equal(own - np.diag(np.diagonal(own)), 0.0)
    assert np.all(np.diagonal(own) > 0.0)
    np.testing.assert_array_equal(information, information.T)


def test_values_of_the_same_structure_are_not_traced_again():
    log, other = log_of(20), log_of(24)
    before = compiled._cache_size()
    problem = build(GUESS, [log])
    evaluated(problem, problem.start())
    grown = compiled._cache_size()
    assert grown <= before + 1
    for guess in (GUESS.replace(alpha=0.1), GUESS.replace(ct={"bounds": (0.0, 1.0)})):
        again = build(guess, [other])
        evaluated(again, again.start())
    assert compiled._cache_size() == grown


# Segments.


def test_segments_are_separate_runs_from_the_measured_state():
    rng = np.random.default_rng(30)
    time = 0.05 * np.arange(201)
    clean = thruster.simulate(time, inputs.low_passed_random(time, 1.5, rng), initial_speed=5.0)
    log = Log(time, clean.inputs, clean.truth, noise={"speed": 0.3, "thrust": 0.5})
    whole = build(GUESS, [log], segmented=True)
    horizon = 2.5
    problem = restarts(whole, horizon)
    z = problem.start()
    cuts = [0, 50, 100, 150, 200]
    cost = 0.0
    for k, (begin, end) in enumerate(itertools.pairwise(cuts)):
        part = log.slice(time[begin], time[end])
        start = float(log.measured["speed"][begin])
        found = simulate(GUESS, part, initial={"speed": start}, substeps=1)
        own = slice(0 if k == 0 else 1, None)  # a cut belongs to the segment that it ends
        for name, sigma in (("speed", 0.3), ("thrust", 0.5)):
            cost += 0.5 * np.sum(((part.measured[name] - found[name])[own] / sigma) ** 2)
    assert float(evaluated(problem, z).cost) == pytest.approx(cost, rel=1e-10)
    # Whole runs are what they are without segments, and nothing is traced for another horizon.
    plain = build(GUESS, [log])
    run = evaluated(restarts(whole, None), z)
    assert float(run.cost) == pytest.approx(float(evaluated(plain, z).cost), rel=1e-12)
    size = compiled._cache_size()
    assert float(evaluated(restarts(whole, 1.0), z).cost) < float(run.cost)
    assert compiled._cache_size() == size


def test_gradients_of_segments_agree_with_differences():
    problem = restarts(build(GUESS, [log_of(1), log_of(5, 150)], segmented=True), 2.0)
    z = problem.start() + 0.02
    found = evaluated(problem, z)
    for i in range(z.size):
        away = np.zeros(z.size)
        away[i] = 1e-5
        ahead, behind = evaluated(problem, z + away), evaluated(problem, z - away)
        exact = (float(ahead.cost) - float(behind.cost)) / 2e-5
        assert float(found.gradient[i]) == pytest.approx(exact, rel=1e-6, abs=1e-4), i


def test_a_restart_waits_for_a_measurement():
    r = record(1)
    seen = {name: np.array(values) for name, values in r.measured.items()}
    seen["speed"][35:60] = np.nan
    log = Log(r.time, r.inputs, seen)
    problem = restarts(build(GUESS, [log], segmented=True), 2.0)
    anew = np.asarray(problem.numbers.batches[0].restarts["speed"].value)[0]
    assert np.flatnonzero(np.isfinite(anew)).tolist() == [60, 80, 120]


@pytest.mark.parametrize("count", [1, 3, 6, 7])  # of few and of many series
def test_inner_products_of_series_are_those_of_numpy(count):
    series = np.random.default_rng(count).normal(size=(count, 3, 2, 500))
    found = jax.jit(gram)(list(jnp.asarray(series)))
    np.testing.assert_allclose(found, np.einsum("ibct,jbct->bij", series, series), atol=1e-10)


def test_inner_products_tell_that_series_are_parallel():
    # a fit calls parameters indistinguishable where an eigenvalue is below 1e-13 of the largest
    one, other = np.random.default_rng(0).normal(size=(2, 1, 1, 200_000))
    found = np.asarray(gram([jnp.asarray(a) for a in (one, 0.3141 * one, other)]))[0]
    length = np.sqrt(np.diagonal(found))
    values = np.linalg.eigvalsh(found / np.outer(length, length))
    assert abs(values[0]) < 2e-14 * values[-1]


@pytest.mark.parametrize("count", [30, 48, 50, 1000])
def test_products_are_summed_over_equal_blocks_of_time(count):
    products = np.random.default_rng(0).normal(size=(2, 3, 2, count))
    blocks = likelihood_module._BLOCKS
    found = np.asarray(likelihood_module.by_blocks(jnp.asarray(products), blocks, jnp))
    size = int(np.ceil(count / blocks))
    parts = [products[..., k * size : (k + 1) * size].sum(axis=(2, 3)) for k in range(blocks)]
    np.testing.assert_allclose(found, np.stack(parts, axis=-1), atol=1e-12)

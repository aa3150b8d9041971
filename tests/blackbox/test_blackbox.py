"""Black-box models against closed forms, known systems and python-control."""

import sys

import control
import numpy as np
import pytest
from scipy.linalg import solve_triangular, toeplitz
from scipy.optimize import minimize
from scipy.signal import cont2discrete, lfilter
from scipy.stats import binom

import diffthrust as dft
from diffthrust import InputError
from diffthrust import blackbox as bb
from diffthrust.blackbox._prediction_error import Shape, stretches  # private: the gradient alone
from diffthrust.blackbox._sampled import (
    System,  # private: what the gradient takes
    sampled_channels,  # private: what the gradient takes
)
from diffthrust.blackbox._search import joint  # private: the gradient alone
from diffthrust.blackbox._simulation_error import (  # private: the gradient alone
    linearized,
    output_sizes,
    squared_error,
    stepped,
)
from diffthrust.estimation import Status

A, B, C = [1.0, -1.5, 0.7], [0.0, 1.0, 0.5], [1.0, 0.5, 0.2]
UY = {"input": "u", "output": "y"}


def log_of(u, y, step=0.1, **more):
    inputs = {"u": u} if np.ndim(u) == 1 else {f"u{j + 1}": u[:, j] for j in range(u.shape[1])}
    measured = {"y": y} if np.ndim(y) == 1 else {f"y{j + 1}": y[:, j] for j in range(y.shape[1])}
    return dft.Log(time=step * np.arange(len(u)), inputs=inputs, measured=measured, **more)


def made(kind="output_error", n=400, seed=0, noise=0.5, a=A, b=B, c=C, **more):
    rng = np.random.default_rng(seed)
    u, e = rng.standard_normal(n), noise * rng.standard_normal(n)
    coloured = {"arx": ([1.0], a), "armax": (c, a), "output_error": ([1.0], [1.0])}[kind]
    return log_of(u, lfilter(b, a, u) + lfilter(*coloured, e), **more)


def log_matrix(log):
    return np.stack(list(log.measured.values()), axis=1)


def values(model):
    return np.array([e.value for e in model.parameters.values()])


def spreads(model):
    return np.array([e.std_error for e in model.parameters.values()])


# -- estimates -------------------------------------------------------------------------------------


def test_arx_is_least_squares_without_equations_across_logs_or_gaps():
    logs = [made("arx", 60, seed) for seed in (1, 2)]
    y = logs[1].measured["y"].copy()
    y[[20, 21, 40]] = np.nan
    logs[1] = log_of(logs[1].inputs["u"], y)
    rows, target = [], []
    for log in logs:
        u, y = log.inputs["u"], log.measured["y"]
        for t in range(2, 60):
            row = [-y[t - 1], -y[t - 2], u[t - 1], u[t - 2]]
            if np.isfinite([*row, y[t]]).all():
                rows.append(row)
                target.append(y[t])
    rows, target = np.array(rows), np.array(target)
    expected = np.linalg.solve(rows.T @ rows, rows.T @ target)
    variance = np.sum((target - rows @ expected) ** 2) / (len(target) - 4)
    model = bb.arx(logs, **UY, orders=(2, 2, 1))
    np.testing.assert_allclose(values(model), expected, rtol=1e-9)
    np.testing.assert_allclose(model.covariance, variance * np.linalg.inv(rows.T @ rows), rtol=1e-8)
    assert list(model.parameters) == ["a1", "a2", "b1", "b2"]
    assert model.samples == 117


@pytest.mark.parametrize("tied", [False, True])
def test_gradients_are_those_of_the_residuals(tied):
    log = made("armax", 80)
    gap = np.array(log.measured["y"])
    gap[30:34] = np.nan
    _, records = sampled_channels([log, log_of(log.inputs["u"], gap)], "u", "y", offset=True)
    shape = Shape(2, (2, 1), 0 if tied else 2, (1, 0), tied)
    theta = np.array([-1.4, 0.6, 0.9, 0.4, 0.3, *([] if tied else [0.3, 0.1])])

    def cost(point):
        residuals, _ = joint(stretches(records, shape, point))
        return 0.5 * float(residuals @ residuals)

    residuals, gradient = joint(stretches(records, shape, theta))
    slope = gradient.T @ residuals
    for i, step in enumerate(1e-6 * np.eye(theta.size)):
        numeric = (cost(theta + step) - cost(theta - step)) / 2e-6
        assert slope[i] == pytest.approx(numeric, rel=1e-5, abs=1e-5)


def printed_plant(step, seed, n=1500):
    """G(s) of Aras et al. 2013, in steps of 6 V, with 20 mV of white noise on its output."""
    rng = np.random.default_rng(seed)
    num, den, _ = cont2discrete(([-28.77, 16.28], [1.0, 45.09, 16.33]), step)
    u = 6.0 * np.repeat(rng.choice([-1.0, 1.0], n // 20), 20)
    y = lfilter(np.ravel(num), den, u) + 0.02 * rng.standard_normal(n)
    return log_of(u, y, step), np.concatenate([den[1:], np.ravel(num)[1:]])


@pytest.mark.thorough
@pytest.mark.parametrize(("step", "seed"), [(0.1, 0), (0.1, 2), (0.01, 3)])
def test_noise_on_the_output_alone_converges(step, seed):
    """C is A there, with a zero near or on the unit circle, and residuals know little of it."""
    log, truth = printed_plant(step, seed)
    model = bb.armax(log, **UY)
    assert model.status is Status.CONVERGED
    np.testing.assert_allclose(values(model)[:4], truth, rtol=0, atol=2e-3)
    assert np.abs(np.roots(model.polynomials["c"])).max() <= 1.0 + 1e-9
    on_circle = any("on the unit circle" in note for note in model.notes)
    assert on_circle == (step == 0.01)
    assert bb.state_space(log, **UY).status is Status.CONVERGED


def test_armax_is_the_largest_likelihood_of_dense_covariances():
    """The likelihood of A y - B u as a moving average, by its covariance matrix, for SciPy."""
    log, _ = printed_plant(0.1, 1, n=300)
    u, y = log.inputs["u"], log.measured["y"]

    def unlikely(theta):
        a1, a2, b1, b2, c1, c2 = theta
        w = y[2:] + a1 * y[1:-1] + a2 * y[:-2] - b1 * u[1:-1] - b2 * u[:-2]
        shares = np.zeros(w.size)
        shares[:3] = 1.0 + c1**2 + c2**2, c1 * (1.0 + c2), c2
        lower = np.linalg.cholesky(toeplitz(shares))
        white = solve_triangular(lower, w, lower=True)
        return 0.5 * w.size * np.log(white @ white) + np.sum(np.log(np.diag(lower)))

    model = bb.armax(log, **UY)
    best, size = values(model), spreads(model)
    least = unlikely(best)
    found = minimize(lambda z: unlikely(best + size * z), 0.05 * np.ones(6), method="BFGS")
    assert least <= found.fun + 1e-6
    np.testing.assert_allclose(found.x, 0.0, atol=2e-3)  # in standard errors


@pytest.mark.slow
def test_standard_errors_cover_the_truth_in_95_of_100_cases():
    """200 repeats each; with right errors a parameter fails here once in 10 000 cases."""
    truth = {
        "arx": (bb.arx, (2, 2, 1), [*A[1:], *B[1:]]),
        "armax": (bb.armax, (2, 2, 2, 1), [*A[1:], *B[1:], *C[1:]]),
        "output_error": (bb.output_error, (2, 2, 1), [*A[1:], *B[1:]]),
    }
    least, most = binom.ppf([5e-5, 1 - 5e-5], 200, 0.95)
    for kind, (model_of, orders, right) in truth.items():
        inside = np.zeros(len(right))
        for seed in range(200):
            model = model_of(made(kind, 300, seed), **UY, orders=orders)
            assert model.status is Status.CONVERGED
            inside += np.abs(values(model) - right) < 1.96 * spreads(model)
        assert np.all((least <= inside) & (inside <= most)), (kind, inside)


def test_noise_of_the_output_biases_arx_and_not_output_error():
    logs = [made(seed=seed, n=300, noise=1.0) for seed in range(40)]
    found = {
        kind: np.array([values(model_of(log, **UY, orders=(2, 2, 1)))[0] for log in logs])
        for kind, model_of in (("arx", bb.arx), ("oe", bb.output_error))
    }
    away = {
        kind: (a.mean() - A[1]) / (a.std(ddof=1) / np.sqrt(a.size)) for kind, a in found.items()
    }
    assert away["arx"] > 30.0  # a1 is drawn towards zero
    assert abs(away["oe"]) < 3.5  # once in 2000 cases by chance
    assert found["arx"].mean() > -1.3


def test_errors_of_an_output_error_allow_for_noise_that_lasts():
    right, inside, believed = np.array([-0.8, 1.0]), 0, 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        u = lfilter([1.0], [1.0, -0.9], rng.standard_normal(600))
        noise = lfilter([1.0], [1.0, -0.95], rng.standard_normal(600))
        log = log_of(u, lfilter([0.0, 1.0], [1.0, -0.8], u) + noise)
        model = bb.output_error(log, **UY, orders=(1, 1, 1))
        inside += np.abs(values(model) - right) < 1.96 * spreads(model)
        believed += "standard errors allow for that" in " ".join(model.notes)
    assert believed == 60
    assert np.all(inside >= binom.ppf(1e-4, 60, 0.9))  # of 95 %, less what a finite record costs


def test_an_offset_is_told_from_the_input():
    log = made(noise=0.1)
    raised = log_of(log.inputs["u"] + 3.0, log.measured["y"] + 20.0)
    for model in (
        bb.output_error(raised, **UY, orders=(2, 2, 1), offset=True),
        bb.armax(raised, **UY, orders=(2, 2, 2, 1), offset=True),
        bb.state_space(raised, **UY, offset=True, refine=False),
    ):
        np.testing.assert_allclose(np.sort(model.poles), np.sort(np.roots(A)), atol=0.02)
        assert model.errors(raised).nrmse < 0.1
        assert model.to_control().dcgain() == pytest.approx(sum(B) / sum(A), rel=0.02)
    assert bb.arx(raised, **UY, offset=True).parameters["offset"].std_error < 0.2


# -- systems ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("delay", [0, 1, 4])
def test_simulation_is_that_of_python_control(delay):
    u = np.random.default_rng(3).standard_normal(150)
    num = np.concatenate([np.zeros(delay), [1.0, -1.6]])  # a zero outside the unit circle
    log = log_of(u, lfilter(num, A, u))
    for model in (
        bb.arx(log, **UY, orders=(2, 2, delay)),
        bb.output_error(log, **UY, orders=(2, 2, delay)),
        bb.state_space(log, **UY, order=2, delay=delay, refine=False),
    ):
        assert model.errors(log).nrmse < 1e-6
        assert np.max(np.abs(model.zeros() - 1.6)) < 1e-5 or delay == 0
        found = model.simulate(log, start="rest")["y"]
        for form in ("transfer", "states"):
            system = model.to_control(form)
            expected = control.forced_response(system, log.time, u).outputs
            np.testing.assert_allclose(found, np.ravel(expected), atol=1e-8)


def test_two_inputs_and_two_outputs():
    rng = np.random.default_rng(5)
    a = np.array([[0.8, 0.3, 0.0], [-0.3, 0.8, 0.1], [0.0, 0.0, 0.5]])
    b, c = rng.standard_normal((3, 2)), rng.standard_normal((2, 3))
    true = control.StateSpace(a, b, c, np.zeros((2, 2)), 0.1)
    u = rng.standard_normal((1500, 2))
    y = control.forced_response(true, 0.1 * np.arange(1500), u.T).outputs.T
    log = log_of(u, y + 0.05 * rng.standard_normal(y.shape))
    model = bb.state_space(log, input=["u1", "u2"], output=["y1", "y2"], order=3)
    assert model.parameters == {}
    assert model.singular_values[2] > 5.0 * model.singular_values[3]
    np.testing.assert_allclose(
        np.sort_complex(model.poles), np.sort_complex(np.linalg.eigvals(a)), atol=0.02
    )
    z = np.exp(1j * np.array([0.1, 0.5, 2.0]))
    expected, found = true(z), model.to_control("states")(z)
    assert np.max(np.abs(found - expected)) < 0.05 * np.max(np.abs(expected))
    assert model.errors(log).nrmse < 0.06
    small = log_of(u * [1.0, 1e3], log_matrix(log) * [1e-4, 1.0])  # other units
    again = bb.state_space(small, input=["u1", "u2"], output=["y1", "y2"], order=3)
    np.testing.assert_allclose(np.sort_complex(again.poles), np.sort_complex(model.poles))
    miso = bb.arx(log, input=["u1", "u2"], output="y1", orders=(3, (3, 2), (1, 2)))
    assert list(miso.parameters)[3:] == ["b1_u1", "b2_u1", "b3_u1", "b2_u2", "b3_u2"]
    with pytest.raises(InputError, match=r"input: expected one of 'u1', 'u2'"):
        miso.transfer()


def two_by_two(seed, n=1200, noise=0.0):
    """Two inputs and two outputs, with noise that lasts as long as what the inputs move."""
    a = np.array([[0.9, 0.2, 0.0], [-0.2, 0.9, 0.1], [0.0, 0.0, 0.7]])
    b, c = np.array([[0.3, 0.0], [0.0, 0.2], [0.5, -0.4]]), np.array([[1.0, 0, 0.3], [0, 1.0, 0]])
    true = control.StateSpace(a, b, c, np.zeros((2, 2)), 0.1)
    rng = np.random.default_rng(seed)
    u = rng.standard_normal((n, 2))
    y = control.forced_response(true, 0.1 * np.arange(n), u.T).outputs.T
    lasting = lfilter([1.0], [1.0, -1.9, 0.905], rng.standard_normal((n, 2)), axis=0)
    return true, log_of(u, y + noise * lasting)


def test_the_gradient_of_a_simulated_state_space():
    _, log = two_by_two(1, 60, 0.05)
    y = log_matrix(log).copy()
    y[20:24, 0] = np.nan
    log = log_of(np.stack(list(log.inputs.values()), axis=1), y * [1.0, 1e3])
    _, records = sampled_channels(log, ["u1", "u2"], ["y1", "y2"], offset=True)
    rng = np.random.default_rng(2)
    start = System(0.6 * np.eye(2) + 0.1 * rng.standard_normal((2, 2)),
                   rng.standard_normal((2, 3)), rng.standard_normal((2, 2)),
                   np.zeros((2, 3)), np.zeros((2, 2)), (1, 0, 0))  # fmt: skip
    free = np.array([[False, True, True], [False, False, True]])
    size = output_sizes(records)
    error, r, j = linearized(start, records, size, free)
    assert error == pytest.approx(squared_error(start, records, size))
    slope = 2.0 * j.T @ r
    assert slope.size == 4 + 6 + 4 + 3
    for i, step in enumerate(1e-6 * np.eye(slope.size)):
        ends = [squared_error(stepped(start, sign * step, free), records, size) for sign in (1, -1)]
        assert slope[i] == pytest.approx((ends[0] - ends[1]) / 2e-6, rel=1e-4, abs=1e-4)


def test_a_focus_on_simulation_finds_what_lasting_noise_hides_from_prediction():
    inout = {"input": ["u1", "u2"], "output": ["y1", "y2"], "order": 3}
    z, away = np.exp(1j * np.array([0.05, 0.2, 0.8])), {"prediction": [], "simulation": []}
    for seed in range(2):
        true, log = two_by_two(seed, noise=0.01)  # half of the size of what the inputs move
        for focus, found in away.items():
            model = bb.state_space(log, **inout, focus=focus)
            assert model.status is Status.CONVERGED
            found.append(np.max(np.abs(model.to_control("states")(z) - true(z))))
            found[-1] /= np.max(np.abs(true(z)))
    assert np.max(away["simulation"]) < 0.1
    assert np.min(np.array(away["prediction"]) / away["simulation"]) > 5.0
    _, clean = two_by_two(5, 300)
    model = bb.state_space(clean, **inout, focus="simulation")
    assert model.errors(clean).nrmse < 1e-6
    del inout["order"]
    chosen = bb.select(clean, **inout, orders=(2, 3), by="unseen", holdout=two_by_two(6, 300)[1])
    assert chosen.chosen.order == 3
    assert "free simulation" in " ".join(chosen.best.notes)


def test_starting_states_do_not_depend_on_the_units_of_outputs():
    _, log = two_by_two(3, 200, 0.3)
    inout = {"input": ["u1", "u2"], "output": ["y1", "y2"]}
    u, y = np.stack(list(log.inputs.values()), axis=1), log_matrix(log)
    first, other = (bb.state_space(g, **inout, order=3).simulate(g)
                    for g in (log, log_of(u, y * [1.0, 1e4])))  # fmt: skip
    np.testing.assert_allclose(other["y1"], first["y1"], atol=1e-6)
    np.testing.assert_allclose(other["y2"], 1e4 * first["y2"], atol=1e-2)


def test_several_inputs_with_delays_of_their_own_as_states():
    rng = np.random.default_rng(6)
    u = rng.standard_normal((300, 2))
    y = lfilter([0, 1.0], A, u[:, 0]) + lfilter([0, 0, 0, 0.5, 0.2], A, u[:, 1])
    log = log_of(u, y)
    model = bb.arx(log, input=["u1", "u2"], output="y", orders=(2, (1, 2), (1, 3)))
    np.testing.assert_allclose(values(model), [-1.5, 0.7, 1.0, 0.5, 0.2], atol=1e-9)
    found = control.forced_response(model.to_control("states"), log.time, u.T).outputs
    np.testing.assert_allclose(np.ravel(found), y, atol=1e-8)
    assert model.transfer("u2").delay == pytest.approx(0.2)


def test_an_unstable_system_is_found_by_its_predictions():
    log = made("armax", 120, noise=0.2, a=[1.0, -1.9, 0.85], c=[1.0, 0.3, 0.1])  # pole at 1.18
    right = np.sort(np.roots([1.0, -1.9, 0.85]))
    assert right[-1] > 1.1
    for model in (
        bb.armax(log, **UY, orders=(2, 2, 2, 1)),
        bb.arx(log, **UY, orders=(2, 2, 1)),
        bb.state_space(log, **UY, order=2),
    ):
        np.testing.assert_allclose(np.sort(model.poles), right, atol=0.02)
        assert not model.stable
        assert model.errors(log, "prediction").nrmse < 1e-3
    short = made("output_error", 40, noise=0.1, a=[1.0, -1.9, 0.85])
    found = bb.output_error(short, **UY, orders=(2, 2, 1))
    assert not found.stable
    np.testing.assert_allclose(np.sort(found.poles), right, atol=0.01)
    assert np.isinf(bb.armax(log, **UY).errors(made("arx", 9000)).nrmse)


def test_a_closed_loop_does_not_mislead_the_state_space():
    rng = np.random.default_rng(8)
    n, e = 4000, 0.5 * rng.standard_normal(4000)
    u, y, r = np.zeros(n), np.zeros(n), rng.standard_normal(n)
    for t in range(n):
        if t > 1:
            y[t] = 1.5 * y[t - 1] - 0.7 * y[t - 2] + u[t - 1] + 0.5 * u[t - 2]
            y[t] += e[t] - 0.9 * e[t - 1] + 0.2 * e[t - 2]
        u[t] = r[t] - 0.3 * y[t]
    model = bb.state_space(log_of(u, y), **UY, refine=False)
    np.testing.assert_allclose(np.sort(model.poles), np.sort(np.roots(A)), atol=0.02)


def test_too_many_coefficients_are_told():
    model = bb.arx(made(noise=0.0), **UY, orders=(4, 4, 1))
    assert model.status is Status.NOT_IDENTIFIABLE
    assert model.parameters["a1"].std_error is None
    assert "6 of 8 coefficients" in " ".join(model.notes)
    assert "not determined by these logs" in model.report()


def test_logs_shorter_than_a_delay_do_no_harm():
    logs = [made(b=[0] * 6 + B, noise=0.1), made(n=4)]
    for model in (
        bb.output_error(logs, **UY, orders=(2, 2, 7)),
        bb.armax(logs, **UY, orders=(2, 2, 2, 7)),
        bb.state_space(logs, **UY, delay=7, refine=False),
    ):
        np.testing.assert_allclose(np.sort(model.poles), np.sort(np.roots(A)), atol=0.02)
        assert model.errors(logs).channels["y"].samples == 394


def test_a_pole_at_the_limit_is_not_forced_inside():
    log = made("output_error", 300, noise=0.1, a=[1.0, -1.0], b=[0.0, 1.0])  # an integrator
    model = bb.output_error(log, **UY, orders=(1, 1, 1))
    assert model.status is Status.CONVERGED
    assert values(model)[0] == pytest.approx(-1.0, abs=4 * spreads(model)[0])
    many = bb.output_error(made(noise=0.1), **UY, orders=(4, 4, 1))
    assert many.errors(made(seed=5, noise=0.1)).nrmse < 0.05


# -- continuous time -------------------------------------------------------------------------------


@pytest.mark.parametrize(("hold", "method"), [("zero", "zoh"), ("linear", "foh")])
def test_continuous_time_undoes_the_step(hold, method):
    true = ([-28.77, 16.28], [1.0, 45.09, 16.33])
    num, den, _ = cont2discrete(true, 0.02, method)
    u = np.random.default_rng(1).standard_normal(300)
    log = log_of(u, lfilter(num[0], den, u), step=0.02, hold=hold)
    late = bb.arx(log, **UY, orders=(2, 2, 1) if hold == "zero" else (2, 3, 0))
    found = late.transfer()
    np.testing.assert_allclose(found.num, true[0], rtol=1e-6)
    np.testing.assert_allclose(found.den, true[1], rtol=1e-6)
    s = 1j * np.array([0.1, 1.0, 10.0])
    exact = control.TransferFunction(*true)(s)
    np.testing.assert_allclose(late.transfer(method="tustin")(s), exact, rtol=0.3)


def test_a_delay_becomes_dead_time_and_lost_poles_are_named():
    u = np.random.default_rng(1).standard_normal(200)
    model = bb.arx(log_of(u, lfilter([0, 0, 0, 1.0], [1.0, -0.8], u)), **UY, orders=(1, 1, 3))
    found = model.transfer()
    assert found.delay == pytest.approx(0.2)
    assert found.poles == pytest.approx([np.log(0.8) / 0.1])
    assert abs(found(0.0)) == pytest.approx(5.0)
    wild = bb.arx(log_of(u, lfilter([0, 1.0], [1.0, 0.5], u)), **UY, orders=(1, 1, 1))
    with pytest.raises(InputError, match=r"poles at -0\.5.*\n.*tustin"):
        wild.transfer()
    assert abs(wild.transfer(method="tustin")(0.0)) == pytest.approx(2 / 3)
    with pytest.raises(InputError, match="'zero', 'linear' or 'tustin'"):
        wild.transfer(method="euler")


# -- use -------------------------------------------------------------------------------------------


def test_errors_are_those_of_the_library_and_missing_samples_are_left_out():
    log = made(noise=0.3)
    y = np.array(log.measured["y"])
    y[100:130] = np.nan
    holed = log_of(log.inputs["u"], y)
    model = bb.output_error(holed, **UY)
    wrong = (y - model.simulate(holed)["y"])[np.isfinite(y)]
    found = model.errors(holed).channels["y"]
    assert found.samples == 370
    assert found.nrmse == pytest.approx(np.sqrt(np.mean(wrong**2)) / np.nanstd(y))
    assert found.fit_percent == pytest.approx(100 * (1 - found.nrmse))
    assert np.isfinite(model.predict(holed)["y"]).all()
    whole = bb.armax(log, **UY)
    gone = bb.armax(holed, **UY)
    np.testing.assert_allclose(values(gone), values(whole), atol=0.15)
    kept = whole.predict(holed)["y"][:100]
    np.testing.assert_allclose(kept[10:], whole.predict(log)["y"][10:100], atol=0.02)


def test_orders_are_selected_by_bic_and_by_unseen_logs():
    train, test = [made(seed=s) for s in (1, 2)], made(seed=3)
    by_bic = bb.select(train, **UY, orders=(1, 2, 3))
    assert (by_bic.chosen.kind, by_bic.chosen.order) == ("output_error", 2)
    unseen = bb.select(train, **UY, orders=(1, 2), by="unseen", holdout=test)
    assert unseen.chosen.order == 2
    assert unseen.chosen.kind != "arx"
    assert unseen.chosen.unseen == pytest.approx(unseen.best.errors(test).nrmse)
    text = unseen.report()
    assert text.count("\n* ") == 1
    assert "NRMSE of unseen logs" in text
    few = bb.select(test.slice(0.0, 4.0), **UY, kinds=["arx"], orders=(2, 12))
    assert few.candidates[1].model is None
    assert "expected more than twice as many" in few.candidates[1].remark


def test_report_and_figure_name_what_they_show():
    log = made(noise=0.3, units={"u": "V", "y": "rad/s"})
    model = bb.armax(log, **UY)
    text = model.report()
    assert "armax (na 2, nb 2, nc 2, delay 1), from u to y, a sample every 0.1 s" in text
    assert "rad/s/V" in text
    assert "(stable)" in text
    figure = model.plot(log)
    assert figure.axes[0].get_ylabel() == "y [rad/s]"
    assert "fit" in figure.axes[0].get_title(loc="left")


def test_an_output_at_half_the_rate_of_its_log_is_drawn():
    log = made(noise=0.3)
    model = bb.arx(log, **UY)
    half = np.where(np.arange(len(log)) % 2, np.nan, log.measured["y"])
    top, below = model.plot(log.replaced(measured={"y": half})).axes
    # no two samples are neighbours, so that a line alone would be invisible
    for axes, label in ((top, "measured"), (below, None)):
        lines = [x for x in axes.get_lines() if label in (None, x.get_label())]
        sparse = [x for x in lines if np.isnan(np.asarray(x.get_ydata(), float)).any()]
        assert sparse
        assert all(x.get_marker() == "o" for x in sparse)


def test_python_control_is_asked_for_where_it_is_absent(monkeypatch):
    model = bb.arx(made(), **UY)
    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(InputError, match="python -m pip install control"):
        model.to_control()
    assert model.transfer().order == 2


def uneven():
    return dft.Log(time=[0, 0.1, 0.3, 0.4], inputs={"u": np.ones(4)}, measured={"y": np.ones(4)})


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: bb.arx([], **UY), "No log was given"),
        (
            lambda: bb.arx(uneven(), **UY),
            "evenly spaced samples, found 4 samples with steps of 0.1",
        ),
        (lambda: bb.arx(made(), input="v", output="y"), "expected the input 'v', found 'u'"),
        (lambda: bb.arx(made(), input="u", output="z"), "expected the measured channel 'z'"),
        (lambda: bb.arx(made(), input="u", output="z"), "Name a measured channel of the log"),
        (lambda: bb.arx(made(), input=[], output="y"), "input: expected one or more"),
        (lambda: bb.arx(made(), input="u", output=["y", "z"]), "expected the measured channel"),
        (lambda: bb.arx([made(), made(step=0.2)], **UY), r"a sample every 0\.1 s.*every 0\.2 s"),
        (lambda: bb.arx(made(unsigned=("y",)), **UY), "gives no sign"),
        (lambda: bb.arx(made(), **UY, orders=(2, 2)), r"expected \(na, nb, delay\)"),
        (lambda: bb.arx(made(), **UY, orders=(2, 0, 1)), r"nb: .* whole number of at least 1"),
        (lambda: bb.arx(made(), **UY, orders=(2, (1, 1), 1)), "nb once or for each of 1 inputs"),
        (lambda: bb.armax(made(), **UY, orders=(2, 2, 1.5, 1)), "nc: expected a whole number"),
        (lambda: bb.arx(made(n=12), **UY, orders=(4, 4, 1)), "8 equations"),
        (lambda: bb.state_space(made(n=20), **UY), "stretches of 6 samples without a gap"),
        (lambda: bb.state_space(made(), **UY, horizon=2), "more than the order 2"),
        (lambda: bb.state_space(made(), **UY, order=0), r"order: .* whole number of at least 1"),
        (lambda: bb.state_space(made(), **UY, focus="both"), "'prediction' or 'simulation'"),
        (lambda: bb.select(made(), **UY, by="aic"), "expected 'bic' or 'unseen', found 'aic'"),
        (lambda: bb.select(made(), **UY, by="unseen"), "no unseen logs"),
        (lambda: bb.select(made(), **UY, kinds=["oe"]), "kinds: expected some of"),
        (lambda: bb.select(made(), **UY, kinds=[["arx"]]), "kinds: expected some of"),
        (lambda: bb.select(made(), **UY, orders=()), "orders: none was given"),
        (lambda: bb.arx(made(), **UY).simulate(made(), start="zero"), "'estimated' or 'rest'"),
        (lambda: bb.arx(made(), **UY).errors(made(), "free"), "'simulation' or 'prediction'"),
        (lambda: bb.arx(made(), **UY).to_control("zpk"), "'transfer' or 'states'"),
    ],
)
def test_what_cannot_be_meant_is_refused(call, words):
    with pytest.raises(InputError, match=words):
        call()

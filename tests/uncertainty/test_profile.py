"""Profile likelihood against closed forms and brute force; bounds, open ends, other optima."""

from dataclasses import replace

import numpy as np
import pytest
from compilations import compilations
from scipy import stats
from scipy.optimize import brentq, minimize
from short_logs import fitted, made_log

import diffthrust as dft
from diffthrust.uncertainty import profile


def line_log(count=12, seed=0, noise=0.02):
    rng = np.random.default_rng(seed)
    depth = np.linspace(0.0, 3.0, count)
    volts = 0.19 * depth - 0.097 + 0.02 * rng.standard_normal(count)
    measured = {"reading": volts}
    return dft.Log(
        time=np.arange(float(count)),
        inputs={"depth": depth},
        measured=measured,
        noise={} if noise is None else {"reading": noise},
    )


def test_a_linear_model_with_known_noise_has_the_quadratic_of_its_covariance():
    log = line_log()
    fit = dft.fit(dft.LinearSensor(), log, starts=1)
    found = profile(fit, log)
    for name in fit.free:
        one, error = found[name], fit.parameters[name].std_error
        np.testing.assert_allclose(one.drop, 0.5 * ((one.grid - one.value) / error) ** 2, rtol=1e-4)
        half = stats.norm.ppf(0.975) * error
        assert one.low == pytest.approx(one.value - half, abs=1e-3 * half)
        assert one.high == pytest.approx(one.value + half, abs=1e-3 * half)
        assert one.lopsided == pytest.approx(1.0, abs=2e-3)


def test_with_unknown_noise_a_line_has_the_interval_of_students_t():
    log = line_log(noise=None)
    fit = dft.fit(dft.LinearSensor(), log, starts=1)
    depth, volts = log.inputs["depth"], log.measured["reading"]
    plain = stats.linregress(depth, volts)
    half = stats.t.ppf(0.95, depth.size - 2) * plain.stderr
    one = profile(fit, log, "slope", level=0.9)["slope"]
    assert one.low == pytest.approx(plain.slope - half, abs=1e-3 * half)
    assert one.high == pytest.approx(plain.slope + half, abs=1e-3 * half)


class Saturating(dft.Model):
    """Michaelis and Menten's curve: a static model, far from linear in its constant."""

    name = "saturating"
    inputs = {"depth": "m"}
    outputs = {"reading": "V"}

    most: float = dft.parameter(2.0, "V", bounds=(0.0, None))
    half: float = dft.parameter(1.0, "m", bounds=(0.0, None))

    def equations(self, s, port):
        """The curve."""
        return {}, {"reading": self.most * s.depth / (self.half + s.depth)}


DEPTH = np.array([0.1, 0.2, 0.35, 0.5, 0.8, 1.1, 1.5, 2.0])
LEVEL = 0.06


def curve_log(depth=DEPTH, seed=1, noise=LEVEL):
    rng = np.random.default_rng(seed)
    volts = 2.0 * depth / (1.0 + depth) + noise * rng.standard_normal(depth.size)
    return dft.Log(
        time=np.arange(float(depth.size)),
        inputs={"depth": depth},
        measured={"reading": volts},
        noise={"reading": noise},
    )


def cost(log, most, half):
    depth, volts = log.inputs["depth"], log.measured["reading"]
    return 0.5 * np.sum((volts - most * depth / (half + depth)) ** 2) / LEVEL**2


def brute(of, start, scale):
    """Ends of the interval of a function of one number that has its other numbers at their best."""
    best = minimize(lambda x: of(x[0]), [start], method="Nelder-Mead", tol=1e-10)

    def above(x):
        return 2 * (of(x) - best.fun) - stats.chi2.ppf(0.95, 1)

    ends = []
    for sign in (-1, 1):
        far = scale
        while above(best.x[0] + sign * far) < 0:
            far *= 1.3
        ends.append(brentq(above, *sorted([best.x[0], best.x[0] + sign * far]), xtol=1e-10))
    return ends


def least(of, start):
    """The least over one more number, on a logarithm."""
    result = minimize(
        lambda v: of(np.exp(v[0])), [np.log(start)], method="Nelder-Mead",
        options={"xatol": 1e-11, "fatol": 1e-12, "maxiter": 2000},
    )  # fmt: skip
    return result.fun


def test_a_nonlinear_model_agrees_with_brute_force():
    log = curve_log()
    fit = dft.fit(Saturating(), log, starts=4)
    found = profile(fit, log)
    for name, of in {
        "half": lambda x: least(lambda most: cost(log, most, x), 2.0),
        "most": lambda x: least(lambda half: cost(log, x, half), 1.0),
    }.items():
        one = found[name]
        low, high = brute(of, one.value, one.std_error)
        assert one.low == pytest.approx(low, rel=1e-4)
        assert one.high == pytest.approx(high, rel=1e-4)
        assert one.lopsided > 1.2  # the covariance knows nothing of this
        assert "times as far up" in one.sentence


def test_a_derived_quantity_agrees_with_the_reparametrised_brute_force():
    log = curve_log()
    fit = dft.fit(Saturating(), log, starts=4)
    found = profile(
        fit,
        log,
        (),
        quantities=lambda p: {"slope": p["most"] / p["half"], "product": p["most"] * p["half"]},
        units={"slope": "V/m"},
    )
    assert list(found) == ["slope", "product"]
    for name, most in {"slope": lambda q, h: q * h, "product": lambda q, h: q / h}.items():

        def of(q, most=most):
            return least(lambda half: cost(log, most(q, half), half), 1.0)

        one = found[name]
        low, high = brute(of, one.value, one.std_error)
        assert one.low == pytest.approx(low, rel=1e-4)
        assert one.high == pytest.approx(high, rel=1e-4)
        assert one.quantity
    assert found["slope"].unit == "V/m"


def test_profiles_of_all_parameters_compile_nothing():
    log = made_log(seed=1)
    fit = fitted(log)
    before = compilations()
    found = profile(fit, log)
    assert compilations() == before
    for name in ("alpha", "beta", "ct"):  # 800 samples: the covariance is right
        e, one = fit.parameters[name], found[name]
        np.testing.assert_allclose(
            [one.low, one.high],
            [e.value - 1.96 * e.std_error, e.value + 1.96 * e.std_error],
            atol=0.1 * e.std_error,
        )
    gain = profile(
        fit, log, (), quantities=lambda p: {"gain": p["beta"] / p["alpha"]}, units={}
    )["gain"]  # fmt: skip
    np.testing.assert_allclose(
        [gain.low, gain.high],
        [gain.value - 1.96 * gain.std_error, gain.value + 1.96 * gain.std_error],
        atol=0.1 * gain.std_error,
    )


def test_a_bound_within_the_interval_is_an_open_end():
    log = line_log(seed=3)
    free = dft.fit(dft.LinearSensor(), log, starts=1)
    value, error = free.parameters["offset"].value, free.parameters["offset"].std_error
    model = dft.LinearSensor().replace(offset={"value": value, "bounds": (value - error, 1.0)})
    one = profile(dft.fit(model, log, starts=1), log)["offset"]
    assert one.low is None
    assert one.open_low == f"reaches the bound {value - error:g}"
    assert one.grid[0] == pytest.approx(value - error)
    assert one.high == pytest.approx(value + 1.96 * error, rel=1e-3)
    assert "is at most" in one.sentence


def test_an_estimate_at_its_bound_has_the_other_end():
    log = line_log(seed=3)
    free = dft.fit(dft.LinearSensor(), log, starts=1)
    value, error = free.parameters["offset"].value, free.parameters["offset"].std_error
    model = dft.LinearSensor().replace(
        offset={"value": value + 2 * error, "bounds": (value + error, 9)}
    )
    fit = dft.fit(model, log, starts=1)
    assert fit.parameters["offset"].at_bound
    one = profile(fit, log)["offset"]
    assert one.low is None
    assert "bound" in one.open_low
    # twice the drop from one deviation to x deviations: x^2 - 1
    reach = np.sqrt(1 + stats.chi2.ppf(0.95, 1))
    assert one.high == pytest.approx(value + reach * error, rel=1e-3)
    # what another parameter may do is not changed by it
    assert profile(fit, log, "slope")["slope"].low is not None


def test_a_likelihood_that_never_falls_far_enough_is_an_open_end():
    """Below its bend the curve is a line: the constant may be as large as one likes."""
    log = curve_log(depth=0.1 * DEPTH, seed=2)
    fit = dft.fit(Saturating(), log, starts=4)
    one = profile(fit, log)["half"]
    assert one.high is None
    assert one.open_high == "the likelihood never falls far enough"
    slope = profile(fit, log, (), quantities=lambda p: {"slope": p["most"] / p["half"]})["slope"]
    assert slope.low is not None
    assert slope.low < 2.0 < slope.high


def test_a_quantity_that_the_bounds_hold_back_is_told():
    log = curve_log()
    model = Saturating().replace(
        half={"value": 1.0, "bounds": (0.95, 1.05)}, most={"value": 2.0, "bounds": (1.95, 2.05)}
    )
    fit = dft.fit(model, log, starts=1)
    one = profile(fit, log, (), quantities=lambda p: {"sum": p["most"] + p["half"]})["sum"]
    assert one.low is None
    assert one.high is None
    assert "bounds of the parameters allow no less" in one.open_low
    assert one.grid[0] == pytest.approx(2.90, abs=0.01)
    assert one.grid[-1] == pytest.approx(3.10, abs=0.01)


class Wave(dft.Model):
    """A sine of the depth: its wave number has many optima."""

    name = "wave"
    inputs = {"depth": "m"}
    outputs = {"reading": "V"}

    number: float = dft.parameter(1.0, "rad/m", bounds=(0.1, 12.0))

    def equations(self, s, port):
        """The sine."""
        import jax.numpy as jnp

        return {}, {"reading": jnp.sin(self.number * s.depth)}


def test_a_better_optimum_on_the_way_is_reported():
    depth = np.linspace(0.0, 2.0, 30)
    log = dft.Log(
        time=np.arange(30.0),
        inputs={"depth": depth},
        measured={"reading": np.sin(5.0 * depth)},
        noise={"reading": 1.7},
    )
    # with residuals this large a Gauss-Newton step is poor: the last digits of the fit are missing
    poor = replace(dft.fit(Wave(number=9.0), log, starts=1), status=dft.estimation.Status.CONVERGED)
    assert abs(poor.parameters["number"].value - 5.0) > 1.0
    found = profile(poor, log)
    assert found.better is not None
    assert found.better.values["number"] == pytest.approx(5.0, abs=1e-3)
    assert found["number"].value == pytest.approx(5.0, abs=1e-3)
    assert "better optimum" in found.report()
    assert found.to_json()["better"]["gain"] > 0


@pytest.mark.parametrize("level", [0.0, 1.0, 1, 0, 95, -0.1, "0.95", None])
def test_a_level_that_is_none_is_refused(level):
    log = line_log()
    with pytest.raises(dft.InputError, match="profile, level: expected a number between 0 and 1"):
        profile(dft.fit(dft.LinearSensor(), log, starts=1), log, level=level)


def test_other_logs_and_fits_that_did_not_converge_are_refused():
    log = line_log()
    fit = dft.fit(dft.LinearSensor(), log, starts=1)
    with pytest.raises(dft.InputError, match="not the training logs"):
        profile(fit, line_log(seed=5))
    with pytest.raises(dft.InputError, match="not_converged"):
        profile(replace(fit, status=dft.estimation.Status.NOT_CONVERGED), log)


def test_report_figure_and_plain_data():
    log = curve_log()
    found = profile(dft.fit(Saturating(), log, starts=4), log)
    assert "half" in found.report()
    assert len(found.sentences) == len(found) == 2
    told = found.to_json()["profiles"]["half"]
    assert told["low"] < told["value"] < told["high"]
    assert len(told["grid"]) == len(told["drop"]) > 6
    figure = found.plot()
    assert len(figure.axes) == 2
    assert "half [m]" in figure.axes[1].get_xlabel()

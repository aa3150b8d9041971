"""Derived quantities by draws, against closed forms."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import written_fits
from compilations import compilations
from made_posterior import made_posterior
from posterior_cases import draws_of

import diffthrust as dft
from diffthrust import InputError
from diffthrust.uncertainty import quantities

SIZES = [-3.0, 0.5, 1.0, 2.0, 4.0]
STEP = 1 - math.exp(-1)


def log(model: dft.Model, seed: int = 0, samples: int = 300) -> dft.Log:
    rng = np.random.default_rng(seed)
    time = 0.05 * np.arange(samples)
    command = np.repeat(rng.uniform(-4, 4, samples // 20), 20)
    bare = dft.Log(time=time, inputs={"command": command}, measured={})
    clean = dft.simulate(model, bare, substeps=1)
    return dft.Log(
        time=time,
        inputs={"command": command},
        measured={
            "speed": clean["speed"] + 0.5 * rng.standard_normal(samples),
            "thrust": clean["thrust"] + 0.5 * rng.standard_normal(samples),
        },
    )


@pytest.fixture(scope="module")
def fit() -> dft.estimation.Fit:
    return dft.fit(dft.Thruster(), log(dft.Thruster()), starts=2)


@pytest.mark.thorough
def test_steady_thrust_is_proportional_to_the_command(fit):
    found = quantities(fit, commands=[*SIZES, 0.0], draws=30)["steady_thrust"]
    drawn = draws_of(fit, None, count=30, seed=0).values
    slope = drawn["ct"] * drawn["beta"] / drawn["alpha"]
    np.testing.assert_allclose(found.draws, slope[:, None] * [*SIZES, 0.0], rtol=1e-6, atol=1e-12)
    assert found.unit == "N"
    assert (found.grid_name, found.grid_unit) == ("command", "V")
    np.testing.assert_allclose(found.median, np.median(found.draws, axis=0))
    np.testing.assert_allclose(found.high, np.quantile(found.draws, 0.975, axis=0))


@pytest.mark.parametrize(("response", "reached"), [("speed", STEP), (None, math.sqrt(STEP))])
def test_step_times_follow_the_riccati_solution(fit, response, reached):
    """Out of rest the speed is tanh(t sqrt(alpha beta |c|)) of its end; the thrust its square."""
    found = quantities(fit, steps=SIZES, response=response, draws=30)["step_time"]
    drawn = draws_of(fit, None, count=30, seed=0).values
    pace = np.sqrt(drawn["alpha"] * drawn["beta"])[:, None] * np.sqrt(np.abs(SIZES))
    np.testing.assert_allclose(found.draws, math.atanh(reached) / pace, rtol=1e-4)
    assert found.unit == "s"


def test_efficiency_and_volume_agree_with_errors_to_first_order(fit):
    found = quantities(fit, pitch=0.101, area=0.0527, draws=4000)
    for name, one in dft.uncertainty.physical(fit, pitch=0.101, area=0.0527).items():
        assert one.std_error is not None
        assert found[name].unit == one.unit
        assert found[name].median == pytest.approx(one.value, abs=0.1 * one.std_error)
        half = 0.5 * (found[name].high - found[name].low)
        # the ends of 4000 draws are off by 2.5 % of the half width (one standard deviation)
        assert half == pytest.approx(1.96 * one.std_error, rel=0.1)


def test_break_frequency_and_functions(fit):
    found = quantities(
        fit,
        amplitudes=[5.0, 10.0],
        functions={
            "gain": lambda p: p["beta"] / p["alpha"],
            "powers": lambda p: [p["ct"], p["ct"] ** 2],
        },
        units={"gain": "1/(V s^2)"},
        draws=50,
    )
    drawn = draws_of(fit, None, count=50, seed=0).values
    pace = 8 * drawn["alpha"][:, None] / (3 * np.pi) * [5.0, 10.0]
    np.testing.assert_allclose(found["break_frequency"].draws, pace)
    np.testing.assert_allclose(found["gain"].draws, drawn["beta"] / drawn["alpha"])
    assert found["powers"].draws.shape == (50, 2)
    assert set(found) == {"break_frequency", "gain", "powers"}
    text = found.report()
    for word in ("gain", "1/(V s^2)", "break_frequency [rad/s]", "speed amplitude [rad/s]"):
        assert word in text
    assert len(found.plot().axes) == 2
    with pytest.raises(InputError, match="None of the quantities is a curve"):
        quantities(fit, functions={"a": lambda p: p["ct"]}, draws=5).plot()


def test_effects_count_and_sensors_do_not(fit):
    drawn = {"level": 0.95, "draws": 5}
    damped = dft.Thruster() + dft.effects.LinearDamping(rate=1.5)
    plain = damped + dft.effects.ThrustSensorOffset(offset=5.0)
    post = made_posterior(fit, chains=1, draws=10)
    added = {
        "linear_damping.rate": 1.5,
        "thrust_sensor_offset.offset": 5.0,
        "command_deadband.half_width": 0.6,
        "command_delay.delay": 0.3,
    }
    for name, value in added.items():
        values = np.full((1, 10), value)
        post.posterior[name] = (("chain", "draw"), values, {"unit": ""})

    def of(model: dft.Model, **asked):
        extra = [n for n in added if n not in model.parameters]
        own = SimpleNamespace(posterior=post.posterior.drop_vars(extra), attrs={})
        return quantities(own, model, **asked, **drawn)

    found = of(plain, commands=[1.0, 3.0])["steady_thrust"]
    picked = draws_of(post_of(post, damped), damped, count=5, seed=0).values
    a, b, d = (picked[n][:, None] for n in ("alpha", "beta", "linear_damping.rate"))
    speed = (-d + np.sqrt(d**2 + 4 * a * b * np.array([1.0, 3.0]))) / (2 * a)
    np.testing.assert_allclose(found.draws, picked["ct"][:, None] * speed**2, rtol=1e-6)

    dead = of(dft.Thruster() + dft.effects.CommandDeadband(half_width=0.6), steps=[0.3, 2.0])
    assert np.isinf(dead["step_time"].median[0])
    assert np.isfinite(dead["step_time"].high[1])
    assert any("inf" in note for note in dead.notes)
    assert json.loads(json.dumps(dead.to_json()))["quantities"]["step_time"]["median"][0] is None
    late = of(dft.Thruster() + dft.effects.CommandDelay(delay=0.3), steps=[2.0])["step_time"]
    soon = of(dft.Thruster(), steps=[2.0])["step_time"]
    np.testing.assert_allclose(late.draws - soon.draws, 0.3, atol=0.02)


def post_of(post, model):
    keep = [n for n in post.posterior.data_vars if n in model.parameters or n == "sigma"]
    return SimpleNamespace(posterior=post.posterior[keep], attrs={})


def test_a_vehicle_and_a_motor_settle_too():
    vehicle = dft.AxisVehicle()
    post = SimpleNamespace(posterior=draws_around(vehicle), attrs={})
    found = quantities(post, vehicle, commands=[10.0, 60.0], response="velocity", draws=4)
    drag = found_draws(post, vehicle, 4)["drag"]
    expected = np.sqrt(np.array([10.0, 60.0]) / drag[:, None])
    np.testing.assert_allclose(found["steady_velocity"].draws, expected, rtol=1e-5)
    with pytest.raises(InputError, match="does not settle"):
        quantities(post, vehicle, commands=[10.0], response="position", draws=4)
    motor = dft.DCMotorThruster()
    post = SimpleNamespace(posterior=draws_around(motor), attrs={})
    found = quantities(post, motor, commands=[6.0, 12.0], steps=[12.0], draws=4)
    assert np.all(found["steady_thrust"].low > 0)
    assert np.all(found["step_time"].low > 0)


def draws_around(model: dft.Model):
    import xarray as xr

    rng = np.random.default_rng(0)
    values = {
        n: (("chain", "draw"), p.value * (1 + 0.03 * rng.standard_normal((2, 10))))
        for n, p in model.parameters.items()
        if not p.fixed
    }
    return xr.Dataset(values)


def found_draws(post, model, count):
    return draws_of(post, model, count=count, seed=0).values


def test_one_compilation_serves_all_draws_and_sizes(fit):
    quantities(fit, commands=[1.0, 2.0], steps=[3.0], draws=5)
    before = compilations()
    quantities(fit, commands=[0.2, 2.5], steps=[9.0], draws=40, seed=3)
    assert compilations() == before


def test_draws_of_a_fit_are_those_of_its_covariance_within_bounds(fit):
    drawn = draws_of(fit, None, count=4000, seed=1).values
    seen = np.cov(np.stack([drawn[n] for n in fit.free]))
    scale = np.sqrt(np.diagonal(fit.covariance))
    np.testing.assert_allclose(
        seen / np.outer(scale, scale), fit.covariance / np.outer(scale, scale), atol=0.1
    )
    tight = fit.model.replace(
        ct={"bounds": (fit.parameters["ct"].value - scale[2], None), "value": fit.model.ct}
    )
    held = draws_of(replace(fit, model=tight), None, count=500, seed=0).values["ct"]
    assert held.min() >= tight.parameters["ct"].limits[0]
    assert len(np.unique(held)) == 500  # drawn anew, not put on the bound


def test_parameters_without_an_error_are_held_and_named(fit):
    covariance = fit.covariance.copy()
    covariance[2, :] = covariance[:, 2] = np.nan
    partly = replace(fit, covariance=covariance, status=dft.estimation.Status.STARTS_DISAGREE)
    found = quantities(partly, commands=[1.0], draws=5)
    assert any("'ct' has no standard error" in note for note in found.notes)
    assert any("to be doubted" in note for note in found.notes)
    assert "Note: 'ct' has no" in found.report()
    with pytest.raises(InputError, match="No parameter of the fit has a standard error"):
        quantities(replace(fit, covariance=np.full((3, 3), np.nan)), commands=[1.0])


def test_wrong_input_is_told(fit):
    post = made_posterior(fit, draws=20)

    def refused(words: str, *given, **asked):
        with pytest.raises(InputError, match=words):
            quantities(*given, **asked)

    refused("no quantity is requested", post, fit)
    refused("both pitch and area", post, fit, pitch=0.1)
    refused("positive area", post, fit, pitch=0.1, area=-1.0)
    refused("Give the model or the fit", post, commands=[1.0])
    refused("is of another model", post, dft.AxisVehicle(), commands=[1.0])
    refused("no draws of 'linear_damping.rate'", post,
            dft.Thruster() + dft.effects.LinearDamping(), commands=[1.0])  # fmt: skip
    refused("is of another model", fit, dft.DCMotorThruster(), commands=[1.0])
    refused("finite numbers as steps", post, fit, steps=["a"])
    refused("finite numbers as commands", post, fit, commands=[])
    refused("puts out no 'trust'", post, fit, commands=[1.0], response="trust")
    refused("reads the parameter 'gamma'", post, fit, functions={"f": lambda p: p["gamma"]})
    refused("arrays of the shapes", post, fit, functions={"f": lambda p: np.eye(2)})
    refused("two of the name", post, fit, pitch=0.1, area=0.05, functions={"volume": len})
    refused("draws: expected", post, fit, commands=[1.0], draws=1)
    refused("level: expected", post, fit, commands=[1.0], level=95)
    refused("seed: expected", post, fit, commands=[1.0], seed=-1)
    refused("Expected a fit or a posterior", [1, 2], fit, commands=[1.0])
    refused("has no input 'depth'", post, fit, commands=[1.0], inputs={"depth": 1.0})
    empty = SimpleNamespace(posterior=post.posterior.isel(draw=[]), attrs={})
    refused("The posterior is empty", empty, fit, commands=[1.0])
    broken = post.posterior.copy(deep=True)
    broken["ct"][0, 3] = np.nan
    refused("'ct' are not all finite", SimpleNamespace(posterior=broken, attrs={}), fit,
            commands=[1.0], draws=1000)  # fmt: skip
    sag = dft.Thruster() + dft.effects.SupplyVoltageSag()
    values = {n: p.value for n, p in sag.parameters.items() if not p.fixed}
    extra = {n: ("draw", [v] * 4) for n, v in values.items()}
    whole = post.posterior.isel(draw=slice(0, 4), chain=[0]).assign(
        {n: (("chain", "draw"), [v[1]]) for n, v in extra.items() if n not in post.posterior}
    )
    refused("which has no value", SimpleNamespace(posterior=whole, attrs={}), sag, commands=[1.0])


def test_a_derived_ratio_has_the_error_of_its_closed_form(fit):
    ratio = dft.uncertainty.derived(
        fit, lambda p: {"ratio": p["beta"] / p["alpha"]}, {"ratio": "1/(V s^2)"}
    )["ratio"]
    alpha, beta = (fit.parameters[name].value for name in ("alpha", "beta"))
    slope = np.array(
        [{"alpha": -beta / alpha**2, "beta": 1 / alpha, "ct": 0.0}[n] for n in fit.free]
    )
    assert ratio.value == pytest.approx(beta / alpha, rel=1e-12)
    assert ratio.std_error == pytest.approx(math.sqrt(slope @ fit.covariance @ slope), rel=1e-9)
    assert ratio.unit == "1/(V s^2)"


@pytest.mark.thorough
def test_quantities_are_told_and_drawn_in_the_units_of_the_logs():
    commands, steps = np.array([-0.5, 0.25, 0.5]), np.array([0.25, 0.5])
    found = quantities(written_fits.fit(), commands=commands, steps=steps, draws=20)
    thrust, time = found["steady_thrust"], found["step_time"]
    assert (thrust.unit, thrust.grid_unit, time.grid_unit) == ("N", "effort", "effort")
    np.testing.assert_array_equal(thrust.grid, commands)
    shown = thrust.shown
    np.testing.assert_allclose(shown.median, written_fits.KGF * thrust.median, rtol=1e-12)
    np.testing.assert_allclose(shown.grid, [1300.0, 1600.0, 1700.0])
    np.testing.assert_allclose(time.shown.grid, [100.0, 200.0])  # from the stop, not a width
    np.testing.assert_array_equal(time.shown.median, time.median)
    table = found.report()
    assert "command [us]" in table
    assert "steady_thrust [kgf]" in table
    assert "step of command [us]" in table
    assert "effort" not in table
    labels = [(axes.get_xlabel(), axes.get_ylabel()) for axes in found.plot().axes]
    assert labels[0] == ("command [us]", "steady thrust [kgf]")
    data = json.loads(json.dumps(found.to_json()))["quantities"]["steady_thrust"]
    assert (data["unit"], data["grid"]["unit"]) == ("N", "effort")
    assert data["median"] == thrust.median.tolist()
    assert data["written"]["grid"] == {
        "name": "command",
        "unit": "us",
        "values": [1300, 1600, 1700],
    }
    assert data["written"]["median"] == shown.median.tolist()


@pytest.mark.parametrize(("command", "unit"), [("V", "N m/V"), ("effort", "N m per full effort")])
def test_the_torque_constant_is_by_what_the_thruster_is_commanded_in(command, unit):
    model = dft.Thruster(command=command)
    plain = log(dft.Thruster())
    share = {"command": plain.inputs["command"] / 4}
    made = plain.replaced(inputs=share, units={**plain.units, "command": command})
    thruster = dft.fit(model, made, starts=1)
    sizes = {"pitch": 0.1, "area": 0.05}
    assert dft.uncertainty.physical(thruster, **sizes)["torque_constant"].unit == unit
    assert quantities(thruster, **sizes, draws=10)["torque_constant"].unit == unit

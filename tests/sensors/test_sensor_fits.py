"""Crafts recovered from what their sensors read; sensors in saved fits, lines and exports."""

import numpy as np
import pytest
from lines_to_copy import python_lines

import diffthrust as dft
from diffthrust.actuators import StaticThruster
from diffthrust.bodies import Heave, Planar
from diffthrust.sensors import DVL, GNSS, IMU, Attitude, Pressure

LAW = StaticThruster(gain=30.0, exponent=1.5)
NOISE = {
    "gps.north": 0.02,
    "gps.east": 0.02,
    "gps.speed": 0.02,
    "imu.yaw_rate": 0.005,
    "imu.x_force": 0.05,
    **dict.fromkeys(("att.qw", "att.qx", "att.qy", "att.qz"), 0.003),
    "dvl.surge": 0.01,
    "dvl.sway": 0.01,
}


def boat(**numbers: float) -> dft.Craft:
    """A boat of two thrusters and all its sensors off the centre."""
    made = dft.Craft(
        Planar(),
        port=LAW.at((-0.4, -0.285, 0)),
        starboard=LAW.at((-0.4, 0.285, 0)),
        share=[("port", "starboard")],
        gps=GNSS().at((0.5, 0.2, -1.0)),
        imu=IMU().at((0.1, 0.0, 0.0)),
        att=Attitude(frame="ENU"),
        dvl=DVL(frame="FLU").at((-0.3, 0.0, 0.1)),
    )
    return made.fix("port.gain", "port.exponent").replace(numbers)


def recorded(truth: dft.Craft, seed: int, names: tuple[str, ...], count: int = 300) -> dft.Log:
    rng = np.random.default_rng(seed)
    time = 0.1 * np.arange(count)
    steps = np.repeat(rng.uniform(-0.3, 1.0, (2, count // 15)), 15, axis=1)
    inputs = dict(zip(truth.inputs, steps, strict=True))
    units = dict.fromkeys(inputs, "effort")
    start = {"heading": rng.uniform(-3, 3), "surge": 0.3}
    out = dft.simulate(truth, dft.Log(time, inputs, units=units), initial=start, substeps=8)
    measured = {n: out[n] + rng.normal(0, NOISE[n], count) for n in names}
    if "att.qw" in measured:  # as an autopilot that keeps the first above zero
        sign = np.where(measured["att.qw"] < 0, -1.0, 1.0)
        measured |= {f"att.q{k}": sign * measured[f"att.q{k}"] for k in "wxyz"}
    return dft.Log(time, inputs, measured, units=units, name=f"run{seed}")


def distances(fit: dft.estimation.Fit, truth: dft.Craft) -> dict[str, float]:
    """Errors of the free parameters in standard errors."""
    free = {n: e for n, e in fit.parameters.items() if not e.fixed}
    assert all(e.std_error for e in free.values()), fit.report()
    true = truth.parameters
    return {n: abs(e.value - true[n].value) / e.std_error for n, e in free.items()}


@pytest.fixture(scope="module")
def found() -> tuple[dft.Craft, dft.estimation.Fit, dft.Log]:
    """A boat fitted to positions, quaternions and a yaw rate; the antenna is said elsewhere."""
    truth = boat(m11=36.0, d11=18.0, **{"gps.x": 0.62, "gps.y": 0.05})
    names = ("gps.north", "gps.east", "imu.yaw_rate", "att.qw", "att.qx", "att.qy", "att.qz")
    logs = [recorded(truth, seed, names) for seed in (1, 2)]
    begin = boat().free("gps.x", "gps.y").fix("m22", "d22", "i33")
    return truth, dft.fit(begin, logs, starts=1), recorded(truth, 3, names)


def test_the_place_of_an_antenna_is_recovered(found):
    truth, fit, unseen = found
    assert fit.status is dft.estimation.Status.CONVERGED
    assert max(distances(fit, truth).values()) < 4
    assert fit.parameters["gps.x"].std_error < 0.05
    errors = dft.compare(fit, unseen).errors.channels
    assert errors["gps.north"].rmse < 0.1
    assert errors["att.qz"].rmse < 0.02


def test_a_craft_is_recovered_from_velocities_at_their_places_and_a_speed_over_ground():
    truth = boat(m11=36.0, m22=58.0, i33=5.0, d11=18.0, d22=70.0, d33=10.0)
    names = ("dvl.surge", "dvl.sway", "gps.speed", "imu.yaw_rate", "imu.x_force")
    fit = dft.fit(boat(), [recorded(truth, seed, names) for seed in (4, 5)], starts=1)
    assert fit.status is dft.estimation.Status.CONVERGED
    assert max(distances(fit, truth).values()) < 4


def test_density_and_tare_of_a_gauge_are_recovered_beside_a_measured_depth():
    lift = StaticThruster(gain=30.0, exponent=1.5).at((0, 0, 0), (0, 0, 1))
    model = dft.Craft(Heave(), lift=lift, bar=Pressure().at((0, 0, 0.2))).fix("m33", "lift.gain")
    model = model.fix("lift.exponent", "lift.reverse", "d33")
    truth = model.replace({"bar.density": 1027.0, "bar.tare": 100_400.0})
    rng = np.random.default_rng(7)
    time = 0.1 * np.arange(300)
    command = {"lift.command": np.repeat(rng.uniform(-0.2, 0.8, 15), 20)}
    units = {"lift.command": "effort", "depth": "m", "bar.pressure": "mbar"}
    out = dft.simulate(truth, dft.Log(time, command, units={"lift.command": "effort"}), substeps=4)
    measured = {
        "depth": out["depth"] + rng.normal(0, 0.02, 300),
        "bar.pressure": 0.01 * (out["bar.pressure"] + rng.normal(0, 30.0, 300)),
    }
    log = dft.Log(time, command, measured, units=units)
    fit = dft.fit(model.free("bar.density", "bar.tare"), log, starts=1)
    assert fit.status is dft.estimation.Status.CONVERGED
    assert max(distances(fit, truth).values()) < 4
    assert "mbar" in str(fit.report())


def test_a_saved_fit_and_its_lines_have_the_sensors(found, tmp_path):
    _, fit, unseen = found
    fit.save(tmp_path / "fit.json")
    again = dft.load(tmp_path / "fit.json")
    assert repr(again.model) == repr(fit.model)
    expected = dft.simulate(fit.model, unseen)
    for name, series in dft.simulate(again.model, unseen).items():
        np.testing.assert_array_equal(series, expected[name], err_msg=name)
    names = {"dft": dft}
    exec(python_lines(fit.model), names)
    for name, series in dft.simulate(names["model"], unseen).items():
        np.testing.assert_allclose(series, expected[name], rtol=1e-6, atol=1e-6, err_msg=name)


def test_a_craft_with_more_sensors_keeps_its_numbers_and_effects():
    model = boat(m11=40.0, **{"gps.x": 0.7}).free("gps.x") + ("port", "command_delay")
    more = model.with_sensors(dvl=DVL().at((1.0, 0, 0)), second=GNSS())
    assert (more.m11, more.parameters["gps.x"]) == (40.0, model.parameters["gps.x"])
    assert more.parameters["dvl.x"].value == 1.0
    assert str(more) == str(model)
    assert set(more.outputs) - set(model.outputs) == {f"second.{n}" for n in GNSS.outputs}
    with pytest.raises(dft.InputError, match="'port' has the name of an actuator"):
        model.with_sensors(port=GNSS())


def test_an_error_of_a_sensor_is_an_effect_on_its_channel():
    bias = {"unit": "rad/s", "value": 0.1}
    effect = dft.effects.Formula("imu.yaw_rate", "bias", name="gyro", bias=bias)
    log = recorded(boat(), 6, ("imu.yaw_rate",), 30)
    plain = dft.simulate(boat(), log, substeps=2)
    biased = dft.simulate(boat() + effect, log, substeps=2)
    np.testing.assert_allclose(biased["imu.yaw_rate"], plain["imu.yaw_rate"] + 0.1, atol=1e-15)
    np.testing.assert_array_equal(biased["heading"], plain["heading"])

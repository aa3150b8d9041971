"""Each effect's law against the formula of its docstring, written in NumPy.

Points and parameters are generic, in both directions and on both sides of every edge. What reads
other samples (delays, rate limits, lags) is held against loops over the samples.
"""

import numpy as np
import pytest

from diffthrust.effects import EFFECTS
from diffthrust.models import Signals

COUNT = 60
RNG = np.random.default_rng(8)
VALUE = RNG.normal(scale=2.0, size=COUNT)
S = {
    name: RNG.normal(scale=1.6, size=COUNT)
    for name in (
        "speed", "inflow", "flow", "supply_voltage", "surge", "sway", "yaw_rate", "heading",
        "surge_through_water", "sway_through_water", "sway_alone", "yaw_alone", "propulsion",
        "left_force", "right_force", "response",
    )
} | {"time": np.linspace(3.0, 9.0, COUNT), "m22": 5.3, "i33": 1.7}  # fmt: skip


def quotient_power(size, reference, exponent):
    return np.maximum(np.abs(size) / reference, 0.02) ** exponent


def deadband(x, width, restored):
    size = np.abs(x)
    back = np.interp(size, [0.95 * width, 1.05 * width], [0.0, 1.0])
    return np.sign(x) * (np.where(size > width, size - width, 0.0) + restored * width * back)


def dry(speed, level, settling):
    return np.clip(speed / settling, -level, level)


def stuck(x, speed, level, settling, spread):
    slow = np.clip(1.0 - (speed / (level * settling)) ** 4, 0.0, None)
    low, high = level * (1.0 - spread / 2), level * (1.0 + spread / 2)
    borne = slow * np.interp(np.abs(x), [low, high], [1.0, 0.0])
    return (1.0 - borne) * x - borne * speed / settling


def reverse(x, by, change):
    return np.where(by < 0, (1.0 + change) * x, x)


def ahead_aside(north, east):
    cos, sin = np.cos(S["heading"]), np.sin(S["heading"])
    return north * cos + east * sin, east * cos - north * sin


def blown(speed, origin):
    a, b = ahead_aside(-speed * np.cos(origin), -speed * np.sin(origin))
    a, b = a - S["surge"], b - S["sway"]
    return a, b, np.hypot(a, b)


def coupled(mass):
    """Accelerations of sway and yaw by the two coupled equations, solved as such."""
    m22, i33 = S["m22"], S["i33"]
    forces = np.array([m22 * S["sway_alone"], i33 * S["yaw_alone"]])
    return np.linalg.solve([[m22, mass], [mass, i33]], forces)


AHEAD, ASIDE = ahead_aside(0.7, -0.4)
A, B, V = blown(6.3, 0.9)
U, R = S["surge_through_water"], S["yaw_rate"]
DRIFT = S["sway_through_water"]
ALONE = {"sway": S["sway_alone"], "yaw": S["yaw_alone"]}
SWAY, YAW = coupled(0.8)

LAWS = [  # effect, its parameters, its port, what leaves it where `VALUE` arrives
    ("command_deadband", {"half_width": 0.9, "restored": 0.0}, "command",
     deadband(VALUE, 0.9, 0.0)),
    ("command_deadband", {"half_width": 0.9, "restored": 0.7}, "command",
     deadband(VALUE, 0.9, 0.7)),
    ("command_saturation", {"limit": 1.3}, "command", np.clip(VALUE, -1.3, 1.3)),
    ("command_offset", {"offset": -0.37}, "command", VALUE - 0.37),
    ("slew_limit", {"rate": 1.1}, "loop", np.clip(VALUE, -1.1, 1.1)),
    ("reverse_drive_asymmetry", {"change": 0.4}, "drive", reverse(VALUE, VALUE, 0.4)),
    ("supply_voltage_sag", {"share": 0.6, "nominal": 13.0}, "drive",
     VALUE * (0.4 + 0.6 * S["supply_voltage"] / 13.0)),
    ("reverse_load_asymmetry", {"change": -0.3}, "load", reverse(VALUE, S["speed"], -0.3)),
    ("inflow_load_relief", {"relief": 0.45}, "load",
     VALUE - 0.45 * np.abs(S["speed"]) * S["inflow"]),
    ("linear_damping", {"rate": 0.35}, "shaft", VALUE - 0.35 * S["speed"]),
    ("coulomb_friction", {"level": 2.2, "settling": 0.7}, "shaft",
     VALUE - dry(S["speed"], 2.2, 0.7)),
    ("static_friction", {"level": 2.5, "settling": 0.9, "spread": 0.6}, "shaft",
     stuck(VALUE, S["speed"], 2.5, 0.9, 0.6)),
    ("thrust_exponent", {"exponent": 2.7, "reference": 1.9}, "propeller",
     VALUE * quotient_power(S["speed"], 1.9, 0.7)),
    ("load_exponent", {"exponent": 1.6, "reference": 60.0}, "load",
     VALUE * quotient_power(S["speed"], 60.0, -0.4)),
    ("force_exponent", {"exponent": 1.6, "reference": 60.0}, "left_force",
     VALUE * quotient_power(VALUE, 60.0, 0.6)),
    ("force_exponent", {"exponent": 0.6, "reference": 3.0}, "right_force",
     VALUE * quotient_power(VALUE, 3.0, -0.4)),
    ("reverse_thrust_asymmetry", {"change": 0.3}, "propeller", reverse(VALUE, S["speed"], 0.3)),
    ("inflow_thrust_loss", {"loss": 0.15}, "propeller",
     VALUE - 0.15 * np.abs(S["speed"]) * S["inflow"]),
    ("axial_flow", {"loss": 0.15}, "propeller", VALUE - 0.15 * np.abs(S["speed"]) * S["flow"]),
    ("cavitation", {"shortfall": 0.4, "onset": 1.4}, "propeller",
     VALUE * np.where(np.abs(S["speed"]) > 1.4, 0.6 + 0.4 * (1.4 / S["speed"]) ** 2, 1.0)),
    ("thrust_degradation", {"fraction": 0.4, "instant": 6.1, "transition": 1.7}, "propeller",
     VALUE * (1.0 - np.interp(S["time"], [5.25, 6.95], [0.0, 0.4]))),
    ("speed_sensor_scale", {"change": 0.12}, "speed", 1.12 * VALUE),
    ("thrust_sensor_scale", {"change": -0.12}, "thrust", 0.88 * VALUE),
    ("speed_sensor_offset", {"offset": 0.6}, "speed", VALUE + 0.6),
    ("thrust_sensor_offset", {"offset": -0.6}, "thrust", VALUE - 0.6),
    ("rudder_offset", {"offset": 0.21}, "rudder", VALUE + 0.21),
    ("rudder_inflow", {"gain": 0.7}, "steering", VALUE * (1.0 + 0.7 * U)),
    ("propeller_inflow", {"loss": 0.4}, "propulsion", VALUE - 0.4 * np.abs(VALUE) * U),
    ("propeller_walk", {"fraction": 0.3}, "steering", VALUE + 0.3 * S["propulsion"]),
    ("reverse_propeller_asymmetry", {"change": 0.3}, "propulsion", reverse(VALUE, VALUE, 0.3)),
    ("differential_gain", {"gain": 0.3}, "left_force", 1.3 * VALUE),
    ("differential_gain", {"gain": 0.3}, "right_force", 0.7 * VALUE),
    ("swapped_thrusters", {"share": 0.3}, "left_force", 0.7 * VALUE + 0.3 * S["right_force"]),
    ("swapped_thrusters", {"share": 0.3}, "right_force", 0.7 * VALUE + 0.3 * S["left_force"]),
    ("buoyancy", {"excess": -2.3}, "force", VALUE - 2.3),
    ("quadratic_surge_drag", {"drag": 1.7}, "surge_force", VALUE - 1.7 * np.sign(U) * U**2),
    ("quadratic_sway_drag", {"drag": 1.7}, "sway_force",
     VALUE - 1.7 * np.sign(DRIFT) * DRIFT**2),
    ("quadratic_yaw_drag", {"drag": 1.7}, "yaw_moment", VALUE - 1.7 * np.sign(R) * R**2),
    ("sway_yaw_coupling", {"mass": 0.8, "damping": 0.6}, "surge_force", VALUE + 0.8 * R**2),
    ("sway_yaw_coupling", {"mass": 0.8, "damping": 0.6}, "sway_force", VALUE - 0.6 * R),
    ("sway_yaw_coupling", {"mass": 0.8, "damping": 0.6}, "yaw_moment",
     VALUE - 0.6 * DRIFT - 0.8 * U * R),
    ("sway_yaw_coupling", {"mass": 0.8, "damping": 0.6}, "sway_acceleration",
     VALUE + SWAY - ALONE["sway"]),
    ("sway_yaw_coupling", {"mass": 0.8, "damping": 0.6}, "yaw_acceleration",
     VALUE + YAW - ALONE["yaw"]),
    ("water_current", {"to_north": 0.7, "to_east": -0.4}, "surge_through_water", VALUE - AHEAD),
    ("water_current", {"to_north": 0.7, "to_east": -0.4}, "sway_through_water", VALUE - ASIDE),
    ("water_current", {"to_north": 0.7, "to_east": -0.4}, "surge_acceleration", VALUE + R * ASIDE),
    ("water_current", {"to_north": 0.7, "to_east": -0.4}, "sway_acceleration", VALUE - R * AHEAD),
    ("wind", {"along": 0.3, "direction": 0.9, "speed": 6.3}, "surge_force", VALUE + 0.3 * A * V),
    ("wind", {"across": 0.4, "direction": 0.9, "speed": 6.3}, "sway_force", VALUE + 0.4 * B * V),
    ("wind", {"turning": 0.2, "direction": 0.9, "speed": 6.3}, "yaw_moment", VALUE + 0.2 * B * V),
]  # fmt: skip
STATEFUL = {"actuator_lag", "propeller_lag", "rudder_lag"}
OF_THE_SERIES = {name for name, cls in EFFECTS.items() if cls.memory}


def test_each_effect_has_its_law_here():
    assert {row[0] for row in LAWS} | STATEFUL | OF_THE_SERIES == set(EFFECTS)
    for name, cls in EFFECTS.items():
        at = {row[2] for row in LAWS if row[0] == name}
        assert name in STATEFUL | OF_THE_SERIES or at == set(cls.ports)


@pytest.mark.parametrize(
    ("name", "values", "port", "leaving"), LAWS, ids=[f"{r[0]}-{r[2]}" for r in LAWS]
)
def test_what_leaves_a_port(name, values, port, leaving):
    effect = EFFECTS[name](**values)
    np.testing.assert_allclose(effect.at(port, VALUE, Signals(S)), leaving, rtol=1e-6, atol=1e-9)


def test_a_wind_that_the_log_measures():
    measured = {"wind_speed": np.abs(S["flow"]), "wind_direction": S["response"]}
    wind = EFFECTS["wind"](along=0.3, across=0.4, direction=0.25, speed=99.0)
    a, b, v = blown(measured["wind_speed"], 0.25 + measured["wind_direction"])
    s = Signals({**S, **measured})
    np.testing.assert_allclose(wind.at("surge_force", VALUE, s), VALUE + 0.3 * a * v, rtol=1e-9)
    np.testing.assert_allclose(wind.at("sway_force", VALUE, s), VALUE + 0.4 * b * v, rtol=1e-9)


@pytest.mark.parametrize("name", sorted(STATEFUL))
def test_a_lag(name):
    lag = EFFECTS[name](time_constant=0.37)
    np.testing.assert_array_equal(lag.at(lag.port, VALUE, Signals(S)), S["response"])
    (rate,) = lag.rates(VALUE, Signals(S)).values()
    np.testing.assert_allclose(rate.rate, (VALUE - S["response"]) / 0.37, rtol=1e-7)
    assert rate.decay == pytest.approx(1.0 / 0.37, rel=1e-7)
    assert lag.initial(VALUE, Signals(S))["response"] is VALUE
    np.testing.assert_array_equal(lag.at_null().at(lag.port, VALUE, Signals(S)), VALUE)
    decay = lag.at_null().rates(VALUE, Signals(S))["response"].decay
    assert decay == pytest.approx(1e9)


def test_the_water_in_a_duct():
    flow = EFFECTS["axial_flow"](loss=0.15, mass=7.0, linear_drag=1.4, quadratic_drag=6.0)
    left = VALUE - 0.15 * np.abs(S["speed"]) * S["flow"]
    drag = 1.4 * S["flow"] + 6.0 * S["flow"] * np.abs(S["flow"])
    rate = flow.rates(VALUE, Signals(S))["flow"]
    np.testing.assert_allclose(rate, (left - drag) / 7.0, rtol=1e-12)
    settled = flow.initial(VALUE, Signals(S))["flow"]
    still = flow.rates(VALUE, Signals({**S, "flow": settled}))["flow"]
    np.testing.assert_allclose(still, 0.0, atol=1e-8)
    assert np.all(np.sign(settled) == np.sign(VALUE))

"""The reference simulator held against closed forms and against the figures of the papers."""

import csv
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from reference import axis, dc_motor, inputs, make_fits, noise, thruster, vessel
from reference.hidden import THRUSTER, Effect
from reference.records import Column, Record, write_csv
from reference.vessel_hidden import VESSEL

DEGREES = 180.0 / np.pi
HERE = Path(__file__).parent

# Thruster: closed forms.


@pytest.mark.parametrize("method", ["dop853", "rk4"])
@pytest.mark.parametrize(
    ("command", "initial"), [(2.0, 0.0), (2.0, 30.0), (1.0, 80.0), (2.0, -50.0), (-3.0, 60.0)]
)
def test_constant_command_agrees_with_the_riccati_solution(command, initial, method):
    time = inputs.grid(3.0, 0.05)
    record = thruster.simulate(
        time, np.full(len(time), command), initial_speed=initial, method=method, substeps=40
    )
    exact, turned = thruster.exact_spin(time, command, initial, 0.037, 42.0)
    assert turned[-1]
    np.testing.assert_allclose(record.truth["speed"], exact, atol=1e-8, rtol=1e-9)


def test_the_riccati_solution_solves_its_equation():
    time = np.linspace(0.0, 2.0, 200_001)
    w, turned = thruster.exact_spin(time, -1.5, 40.0, 0.037, 42.0)
    slope = np.gradient(w, time, edge_order=2)
    assert 0 < np.argmax(turned) < len(time) - 1
    np.testing.assert_allclose(slope[1:-1], -63.0 - 0.037 * (w * np.abs(w))[1:-1], atol=1e-6)
    assert w[0] == pytest.approx(40.0, rel=1e-12)


def test_quick_method_is_of_fourth_order_and_accurate_in_random_runs():
    rng = np.random.default_rng(5)
    time = inputs.grid(20.0, 0.05)
    command = inputs.low_passed_random(time, 1.5, rng)
    exact = thruster.simulate(time, command).truth["speed"]
    errors = [
        np.max(
            np.abs(
                thruster.simulate(time, command, method="rk4", substeps=k).truth["speed"] - exact
            )
        )
        for k in (2, 4, 8)
    ]
    assert np.sum(np.diff(np.sign(exact)) != 0) > 10
    assert errors[2] < 1e-6
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.3)
    assert errors[1] / errors[2] == pytest.approx(16.0, rel=0.3)


def test_linear_hold_is_the_limit_of_finer_zero_order_holds():
    time = inputs.grid(4.0, 0.05)
    command = inputs.chirp(time, 2.0, 0.3, 1.0)
    linear = thruster.simulate(time, command, hold="linear").truth["speed"]
    errors = []
    for finer in (10, 20):
        fine = inputs.grid(4.0, 0.05 / finer)
        half = 0.5 * 0.05 / finer
        steps = thruster.simulate(fine, np.interp(fine + half, time, command)).truth["speed"]
        errors.append(np.max(np.abs(steps[::finer] - linear)))
    assert errors[0] < 5e-3
    assert errors[1] < 0.4 * errors[0]


@pytest.mark.parametrize("command", [0.5, -2.0, 3.0])
def test_steady_thrust_is_proportional_to_command(command):
    time = inputs.grid(20.0, 0.1)
    record = thruster.simulate(time, np.full(len(time), command))
    expected = 0.020 * (42.0 / 0.037) * command
    assert record.truth["thrust"][-1] == pytest.approx(expected, rel=1e-9)


def test_without_command_the_speed_decays_and_never_turns():
    time = inputs.grid(5.0, 0.05)
    speed = thruster.simulate(time, np.zeros(len(time)), initial_speed=-70.0).truth["speed"]
    np.testing.assert_allclose(speed, -70.0 / (1.0 + 0.037 * 70.0 * time), rtol=1e-9)


def test_responses_are_slower_for_smaller_steps():
    time = inputs.grid(4.0, 0.01)
    rises = []
    for level in (0.3, 1.0, 3.0):
        speed = thruster.simulate(time, np.full(len(time), level)).truth["speed"]
        rises.append(time[np.argmax(speed > 0.9 * np.sqrt(42.0 * level / 0.037))])
    assert rises[0] > 1.5 * rises[1] > 2.0 * rises[2]


# Thruster: hidden effects.

CASES = {
    "command_rate_limit": 3.0,
    "command_delay": 0.13,
    "command_offset": 0.1,
    "command_deadband": 0.2,
    "command_saturation": 1.5,
    "reverse_drive_asymmetry": -0.2,
    "supply_voltage_sag": 0.8,
    "actuator_lag": 0.1,
    "reverse_load_asymmetry": 0.3,
    "inflow_load_relief": 0.05,
    "linear_damping": 0.5,
    "coulomb_friction": 8.0,
    "static_friction": 40.0,
    "reverse_thrust_asymmetry": -0.3,
    "inflow_thrust_loss": 0.2,
    "axial_flow": 0.3,
    "cavitation": {"shortfall": 0.4, "onset": 35.0},
    "thrust_degradation": {"fraction": 0.3, "instant": 5.02},
    "thrust_exponent": 1.7,
    "load_exponent": 1.6,
    "speed_sensor_scale": 0.05,
    "speed_sensor_offset": 0.4,
    "speed_sensor_lag": 0.2,
    "speed_sensor_delay": 0.07,
    "thrust_sensor_scale": 0.05,
    "thrust_sensor_offset": 1.0,
    "thrust_sensor_lag": 0.2,
    "thrust_sensor_delay": 0.07,
}
SENSOR_EFFECTS = ("speed_sensor", "thrust_sensor")


def busy_run(method="dop853", **hidden):
    time = inputs.grid(12.0, 0.05)
    return thruster.simulate(
        time,
        inputs.staircase(time, [0, 0.3, 2, 3, 0, -0.3, -1, -3, 1], 1.3),
        inflow=0.5 + 0.3 * np.sin(time),
        supply_voltage=24.0 - 0.2 * time,
        method=method,
        **hidden,
    )


def assert_same(one, other):
    for name in ("speed", "thrust"):
        np.testing.assert_array_equal(one.measured[name], other.measured[name])
        np.testing.assert_array_equal(one.truth[name], other.truth[name])


def test_every_thruster_effect_has_a_case():
    assert set(CASES) == set(THRUSTER)


@pytest.mark.parametrize("name", CASES)
def test_thruster_effect_is_exactly_nothing_at_null_and_something_otherwise(name):
    plain = busy_run("rk4")
    assert_same(plain, busy_run("rk4", **{name: {}}))
    changed = busy_run("rk4", **{name: CASES[name]})
    moved = {c: np.max(np.abs(changed.measured[c] - plain.measured[c])) for c in plain.measured}
    assert max(moved.values()) > 1e-2
    if name.startswith(SENSOR_EFFECTS):
        np.testing.assert_allclose(changed.truth["speed"], plain.truth["speed"], atol=1e-6)
    if THRUSTER[name].place == "thrust":
        assert moved["speed"] == 0.0


def test_null_effects_are_exact_under_the_adaptive_method_too():
    assert_same(busy_run(), busy_run(**{name: {} for name in CASES}))


@pytest.mark.parametrize("name", CASES)
def test_both_methods_agree_with_each_effect(name):
    one, other = busy_run(**{name: CASES[name]}), busy_run("rk4", **{name: CASES[name]})
    for channel in one.measured:
        # Kinks within a sample (axial flow, the onset of cavitation or of the fault) cost more.
        np.testing.assert_allclose(
            one.measured[channel], other.measured[channel], atol=2e-4, err_msg=channel
        )


def test_unknown_effects_and_parameters_are_refused():
    with pytest.raises(TypeError, match="no such hidden effect"):
        busy_run(couloumb_friction=1.0)
    with pytest.raises(TypeError, match="expected \\['friction'\\]"):
        busy_run(coulomb_friction={"level": 1.0})


def test_numpy_numbers_do_as_well_as_plain_ones():
    time = inputs.grid(2.0, 0.1)
    command = np.full(len(time), 1.0)
    one, other = (
        thruster.simulate(time, command, alpha=kind(0.05), coulomb_friction=kind(5.0))
        for kind in (float, np.float64)
    )
    assert_same(one, other)


def test_a_new_effect_is_a_function_in_a_table():
    def fouling(load, s, *, growth=0.0):
        return load * (1.0 + growth * s.time)

    catalogue = {**THRUSTER, "fouling": Effect("load", fouling)}
    time = inputs.grid(20.0, 0.05)
    record = thruster.simulate(time, np.full(len(time), 2.0), catalogue=catalogue, fouling=0.05)
    assert record.parameters["fouling"] == {"growth": 0.05}
    assert record.truth["speed"][-1] == pytest.approx(np.sqrt(84.0 / 0.037 / 2.0), rel=0.01)


def test_coulomb_friction_stops_the_shaft_in_finite_time_and_holds_it():
    """W' = -k - alpha W^2 is solved by a tangent that reaches zero, and rest follows."""
    friction, start = 8.0, 60.0
    time = inputs.grid(5.0, 0.05)
    # A push of 0.18 V * 42 = 7.56 rad/s^2 cannot break the shaft away, 0.2 V can.
    command = inputs.staircase(time, [0.0, 0.18, 0.2], 4.0)
    for method in ("dop853", "rk4"):
        speed = thruster.simulate(
            time,
            command,
            initial_speed=start,
            coulomb_friction=friction,
            method=method,
            substeps=40,
        ).truth["speed"]
        q = np.sqrt(friction / 0.037)
        exact = q * np.tan(np.maximum(np.arctan(start / q) - 0.037 * q * time, 0.0))
        np.testing.assert_allclose(speed, exact, atol=1e-7)
        assert np.any(exact == 0.0)
        assert np.all(speed[exact == 0.0] == 0.0)


def test_coulomb_friction_takes_its_part_of_the_drive():
    time = inputs.grid(2.0, 0.05)
    command = np.full(len(time), -2.0)
    speed = thruster.simulate(time, command, coulomb_friction=8.0).truth["speed"]
    exact, _ = thruster.exact_spin(time, -2.0 + 8.0 / 42.0, 0.0, 0.037, 42.0)
    np.testing.assert_allclose(speed, exact, atol=1e-9)


def test_stiction_holds_until_the_push_exceeds_it_then_lets_go():
    time = inputs.grid(4.0, 0.05)
    ramp = 0.5 * time
    speed = thruster.simulate(
        time, ramp, hold="linear", static_friction=42.0, coulomb_friction=10.0
    ).truth["speed"]
    away = time > 2.0 + 1e-9
    assert np.all(speed[~away] == 0.0)
    # Just after 2 s the friction left is 10 of 42: the first step is fast.
    assert speed[away][0] == pytest.approx(32.0 * 0.05, rel=0.05)


def test_a_ramp_from_rest_without_friction_sets_off_at_once():
    time = inputs.grid(0.1, 0.001)
    speed = thruster.simulate(time, -time, hold="linear").truth["speed"]
    np.testing.assert_allclose(speed, -21.0 * time**2, rtol=1e-3, atol=1e-12)


def test_actuator_lag_has_a_first_order_step_response():
    """With the load vanishing, W = beta c (t - tau (1 - exp(-t/tau)))."""
    time = inputs.grid(1.0, 0.02)
    record = thruster.simulate(time, np.ones(len(time)), alpha=0.0, actuator_lag=0.15)
    exact = 42.0 * (time - 0.15 * (1.0 - np.exp(-time / 0.15)))
    np.testing.assert_allclose(record.truth["speed"], exact, atol=1e-9)


def test_sensor_lag_has_a_first_order_step_response():
    """At a steady speed the reading rises from zero as 1 - exp(-t/tau)."""
    time = inputs.grid(1.0, 0.02)
    steady = np.sqrt(42.0 / 0.037)
    record = thruster.simulate(
        time, np.ones(len(time)), initial_speed=steady, speed_sensor_lag=0.2, thrust_sensor_lag=0.1
    )
    np.testing.assert_allclose(
        record.measured["speed"], steady * (1.0 - np.exp(-time / 0.2)), atol=1e-8
    )
    np.testing.assert_allclose(
        record.measured["thrust"], 0.02 * steady**2 * (1.0 - np.exp(-time / 0.1)), atol=1e-8
    )


@pytest.mark.parametrize("delay", [0.05, 0.1, 0.0321])
def test_delays_shift_the_solution(delay):
    time = inputs.grid(1.5, 0.05)
    command = np.full(len(time), 2.0)
    exact, _ = thruster.exact_spin(np.maximum(time - delay, 0.0), 2.0, 0.0, 0.037, 42.0)
    sensor = thruster.simulate(time, command, speed_sensor_delay=delay)
    np.testing.assert_allclose(sensor.measured["speed"], exact, atol=1e-8)
    command[0] = 0.0
    exact, _ = thruster.exact_spin(np.maximum(time - delay - 0.05, 0.0), 2.0, 0.0, 0.037, 42.0)
    link = thruster.simulate(time, command, command_delay=delay)
    np.testing.assert_allclose(link.truth["speed"], exact, atol=1e-8)


def test_a_delayed_linear_command_keeps_its_first_value_meanwhile():
    """Without load W = beta times the integral of the delayed command."""
    time = inputs.grid(1.0, 0.05)
    record = thruster.simulate(time, 1.0 + time, hold="linear", alpha=0.0, command_delay=0.23)
    late = np.maximum(time - 0.23, 0.0)
    np.testing.assert_allclose(record.truth["speed"], 42.0 * (time + 0.5 * late**2), atol=1e-9)


SYMMETRIC = [n for n in CASES if not n.startswith("reverse_") and not n.endswith("_offset")]


@pytest.mark.parametrize("name", SYMMETRIC)
def test_effects_that_know_no_direction_mirror(name):
    time = inputs.grid(8.0, 0.05)
    command = inputs.staircase(time, [0.3, 2.0, 3.0, -0.5], 2.0)
    inflow = 0.2 + 0.1 * np.sin(time)
    supply = 22.0 + 0.0 * time
    one, other = (
        thruster.simulate(
            time,
            side * command,
            inflow=side * inflow,
            supply_voltage=supply,
            method="rk4",
            **{name: CASES[name]},
        )
        for side in (1.0, -1.0)
    )
    for channel in one.measured:
        np.testing.assert_allclose(one.measured[channel], -other.measured[channel], atol=1e-9)


STEADY = [
    ("command_deadband", 0.2, 2.0, "speed", np.sqrt(42 * 1.8 / 0.037)),
    ("command_saturation", 1.5, -2.0, "speed", -np.sqrt(42 * 1.5 / 0.037)),
    ("command_offset", 0.3, -2.0, "speed", -np.sqrt(42 * 1.7 / 0.037)),
    ("reverse_drive_asymmetry", -0.2, -2.0, "speed", -np.sqrt(42 * 1.6 / 0.037)),
    ("reverse_load_asymmetry", 0.25, -2.0, "speed", -np.sqrt(84 / 0.037 / 1.25)),
    ("reverse_thrust_asymmetry", -0.3, -2.0, "thrust", -0.7 * 0.02 * 84 / 0.037),
    ("supply_voltage_sag", 1.0, 2.0, "speed", np.sqrt(84 * 20.0 / 24.0 / 0.037)),
    ("inflow_thrust_loss", 0.1, 2.0, "thrust", 0.02 * 84 / 0.037 - 0.05 * np.sqrt(84 / 0.037)),
    ("thrust_degradation", {"fraction": 0.3, "instant": 2.0}, 2.0, "thrust", 0.7 * 1.68 / 0.037),
    ("cavitation", {"shortfall": 0.5, "onset": 30.0}, 2.0, "thrust", 9.0 + 0.5 * (1.68 / 0.037)),
    ("thrust_exponent", 1.5, 2.0, "thrust", 32.0 * ((84 / 0.037) ** 0.5 / 40.0) ** 1.5),
    ("load_exponent", 2.5, 2.0, "speed", 40.0 * (84 / 0.037 / 1600.0) ** 0.4),
    ("speed_sensor_scale", 0.05, 2.0, "speed", 1.05 * np.sqrt(84 / 0.037)),
    ("speed_sensor_offset", -0.7, 2.0, "speed", np.sqrt(84 / 0.037) - 0.7),
    ("thrust_sensor_scale", 0.05, 2.0, "thrust", 1.05 * 1.68 / 0.037),
    ("thrust_sensor_offset", -0.7, 2.0, "thrust", 1.68 / 0.037 - 0.7),
]


@pytest.mark.parametrize(("name", "size", "command", "channel", "expected"), STEADY)
def test_steady_values_with_an_effect(name, size, command, channel, expected):
    time = inputs.grid(8.0, 0.1)
    one = np.ones(len(time))
    record = thruster.simulate(
        time, command * one, inflow=0.5 * one, supply_voltage=20.0 * one, **{name: size}
    )
    assert record.measured[channel][-1] == pytest.approx(expected, rel=1e-9)


def test_steady_speeds_that_solve_a_quadratic():
    time = inputs.grid(15.0, 0.1)
    one = np.ones(len(time))
    damped = thruster.simulate(time, 2.0 * one, linear_damping=0.8).truth["speed"][-1]
    assert 84.0 - 0.037 * damped**2 - 0.8 * damped == pytest.approx(0.0, abs=1e-6)
    relieved = thruster.simulate(time, 2.0 * one, inflow=0.4 * one, inflow_load_relief=0.5)
    w = relieved.truth["speed"][-1]
    assert 84.0 - 0.037 * w**2 + 0.2 * w == pytest.approx(0.0, abs=1e-6)


def test_axial_flow_overshoots_then_settles_on_its_balance():
    time = inputs.grid(20.0, 0.05)
    thrust = thruster.simulate(time, np.full(len(time), 2.0), axial_flow=0.2).truth["thrust"]
    assert np.max(thrust) > 1.05 * thrust[-1]
    w = np.sqrt(84.0 / 0.037)
    up = (0.02 * w**2 - thrust[-1]) / (0.2 * w)
    assert thrust[-1] == pytest.approx(up + 10.0 * up**2, rel=1e-6)


def test_rate_limit_ramps_the_command():
    time = inputs.grid(1.0, 0.1)
    _, limited = THRUSTER["command_rate_limit"].function(
        time, inputs.step(time, 2.0, 0.1), rate=4.0
    )
    np.testing.assert_allclose(limited[:8], [0.0, 0.4, 0.8, 1.2, 1.6, 2.0, 2.0, 2.0])


# Vessel.


def run_vessel(n=98.0, angle=0.0, duration=30.0, step=0.1, **options):
    time = inputs.grid(duration, step)
    one = np.ones(len(time))
    channels = {"propeller_speed": n * one, "rudder_angle": angle * one}
    return vessel.simulate(time, channels, **options)


def test_the_paper_s_propeller_speed_gives_the_paper_s_vessel_speed():
    """Section 6: 76.4 rev/s for 0.8 m/s."""
    record = run_vessel(76.4)
    assert record.truth["surge"][-1] == pytest.approx(0.8, rel=2e-3)
    t = record.time
    exact = 76.4**0.27 / 4.03 * (1.0 - np.exp(-4.03 / 5.23 * t))
    np.testing.assert_allclose(record.truth["surge"], exact, atol=1e-9)
    np.testing.assert_allclose(record.truth["north"][-1], np.trapezoid(exact, t), atol=1e-2)
    for name in ("sway", "yaw_rate", "east", "heading"):
        np.testing.assert_array_equal(record.truth[name], 0.0)


def test_stern_pushed_to_starboard_turns_the_bow_to_port():
    first = run_vessel(angle=10.0 / DEGREES, duration=0.3, step=0.01).truth
    assert np.all(first["sway"][1:] > 0.0)
    assert np.all(first["yaw_rate"][1:] < 0.0)
    assert first["yaw_rate"][1] == pytest.approx(
        -0.5 * 98**0.27 * np.sin(10 / DEGREES) / 1.25 * 0.01, rel=0.01
    )
    later = run_vessel(angle=10.0 / DEGREES, duration=5.0).truth
    assert later["heading"][-1] < 0.0
    assert later["east"][-1] < 0.0


def test_steady_circle_satisfies_equations_13_to_15():
    a = -24.0 / DEGREES
    truth = run_vessel(angle=a, duration=60.0).truth
    u, v, r = (truth[k][-1] for k in ("surge", "sway", "yaw_rate"))
    force = 98.0**0.27
    assert 4.03 * u == pytest.approx(5.93 * v * r + force * np.cos(a), rel=1e-6)
    assert 5.23 * u * r == pytest.approx(-5.48 * v + force * np.sin(a), rel=1e-6)
    assert (5.23 - 5.93) * u * v == pytest.approx(1.13 * r + 0.5 * force * np.sin(a), rel=1e-6)


def test_port_and_starboard_mirror_each_other():
    one, other = (run_vessel(angle=s * 16.0 / DEGREES).truth for s in (1.0, -1.0))
    for name in vessel.STATES:
        sign = 1.0 if name in ("surge", "north") else -1.0
        np.testing.assert_allclose(one[name], sign * other[name], atol=1e-9)


def test_without_propeller_the_kinetic_energy_falls():
    start = {"surge": 0.8, "sway": -0.4, "yaw_rate": 0.6}
    truth = run_vessel(0.0, initial=start).truth
    energy = 5.23 * truth["surge"] ** 2 + 5.93 * truth["sway"] ** 2 + 1.25 * truth["yaw_rate"] ** 2
    assert np.all(np.diff(energy) < 0.0)
    assert energy[-1] < 1e-6 * energy[0]


def test_twin_thrusters_turn_towards_the_weaker_side():
    time = inputs.grid(5.0, 0.1)
    one = np.ones(len(time))
    channels = {"left_force": 2.0 * one, "right_force": 1.0 * one}
    truth = vessel.simulate(time, channels).truth
    assert truth["heading"][-1] > 0.0
    start = vessel.simulate(inputs.grid(1e-3, 1e-4), {k: v[:11] for k, v in channels.items()}).truth
    assert start["surge"][-1] == pytest.approx(3.0 / 5.23 * 1e-3, rel=1e-3)
    assert start["yaw_rate"][-1] == pytest.approx(0.5 / 1.25 * 1e-3, rel=1e-3)
    swapped = vessel.simulate(time, channels, swapped_thrusters=1.0).truth
    np.testing.assert_allclose(swapped["heading"], -truth["heading"], atol=1e-9)
    even = vessel.simulate(time, channels, differential_gain=-1.0 / 3.0).truth
    np.testing.assert_allclose(even["heading"], 0.0, atol=1e-12)


VESSEL_CASES = {
    "swapped_thrusters": 1.0,
    "differential_gain": 0.1,
    "force_exponent": 1.3,
    "rudder_rate_limit": 0.2,
    "propeller_lag": 0.5,
    "rudder_lag": 0.5,
    "rudder_offset": 0.05,
    "reverse_propeller_asymmetry": -0.3,
    "propeller_inflow": 0.2,
    "rudder_inflow": 0.5,
    "propeller_walk": 0.05,
    "quadratic_surge_drag": 0.5,
    "quadratic_sway_drag": 2.0,
    "quadratic_yaw_drag": 0.5,
    "wind": {"along": 0.02, "across": 0.05, "turning": 0.01},
    "water_current": {"to_north": 0.1, "to_east": -0.2},
    "sway_yaw_coupling": {"mass": 0.3, "damping": 0.2},
}


TWIN_EFFECTS = ("swapped_thrusters", "differential_gain", "force_exponent")


def busy_vessel(twin, **options):
    time = inputs.grid(30.0, 0.1)
    if twin:
        channels = {
            "left_force": inputs.zigzag(time, 1.0, 5.0) + 2.0,
            "right_force": np.full(len(time), 2.0),
        }
    else:
        channels = {
            "propeller_speed": inputs.staircase(time, [98, 80, -60], 10.0),
            "rudder_angle": inputs.zigzag(time, 20.0 / DEGREES, 6.0, 3.0),
        }
    channels["wind_speed"] = 4.0 + np.sin(time)
    channels["wind_direction"] = 0.1 * time
    return vessel.simulate(time, channels, **options)


def test_every_vessel_effect_has_a_case():
    assert set(VESSEL_CASES) == set(VESSEL)


@pytest.mark.parametrize("name", VESSEL_CASES)
def test_vessel_effect_is_exactly_nothing_at_null_and_something_otherwise(name):
    twin = name in TWIN_EFFECTS
    plain, null = busy_vessel(twin), busy_vessel(twin, **{name: {}})
    changed = busy_vessel(twin, **{name: VESSEL_CASES[name]})
    quick = busy_vessel(twin, method="rk4", **{name: VESSEL_CASES[name]})
    moved = 0.0
    for channel in vessel.STATES:
        np.testing.assert_array_equal(plain.measured[channel], null.measured[channel])
        moved = max(moved, np.max(np.abs(changed.measured[channel] - plain.measured[channel])))
        # A propeller whose lag passes zero speed has an infinite slope there.
        close = 2e-3 if name == "propeller_lag" else 1e-6
        np.testing.assert_allclose(
            quick.measured[channel], changed.measured[channel], atol=close, err_msg=channel
        )
    assert moved > 1e-2


STATE = {"surge": 0.7, "sway": -0.2, "yaw_rate": -0.4, "heading": 0.8}
GUST = np.array([0.3, -0.2, 0.1])


def forces_in_words(n, angle):
    """What each effect adds to X, Y, N in ``STATE``, written down a second time."""
    u, v, r, psi = STATE.values()
    force = np.sign(n) * abs(n) ** 0.27
    turn = np.array([[np.cos(psi), np.sin(psi)], [-np.sin(psi), np.cos(psi)]])
    # 5 m/s from 0.5 rad blow towards 0.5 + pi.
    a, b = turn @ (5.0 * np.array([np.cos(0.5 + np.pi), np.sin(0.5 + np.pi)])) - [u, v]
    blow = np.hypot(a, b) * np.array([0.02 * a, 0.05 * b, 0.01 * b])
    return {
        "propeller_inflow": -0.2
        * u
        * abs(force)
        * np.array([np.cos(angle), *stern(np.sin(angle))]),
        "rudder_inflow": 0.5 * u * force * np.array([0.0, *stern(np.sin(angle))]),
        "propeller_walk": 0.05 * force * np.array([0.0, *stern(1.0)]),
        "reverse_propeller_asymmetry": (-0.3 if n < 0 else 0.0)
        * force
        * np.array([np.cos(angle), *stern(np.sin(angle))]),
        "quadratic_surge_drag": np.array([-0.5 * u * abs(u), 0.0, 0.0]),
        "quadratic_sway_drag": np.array([0.0, -2.0 * v * abs(v), 0.0]),
        "quadratic_yaw_drag": np.array([0.0, 0.0, -0.5 * r * abs(r)]),
        "wind": blow,
        "sway_yaw_coupling": np.array([0.0, -0.2 * r, -0.2 * v]),
    }


def stern(side):
    """Side force at the stern and its moment, bow to port for a push to starboard."""
    return side, -0.5 * side


@pytest.mark.parametrize("n", [98.0, -60.0])
@pytest.mark.parametrize("name", [None, *forces_in_words(1.0, 0.0)])
def test_accelerations_agree_with_the_matrix_form(name, n):
    """M nu' = tau - C(nu) nu - D nu (Fossen 2011, section 7.1), at one state."""
    angle = 0.3
    u, v, r = (STATE[k] for k in ("surge", "sway", "yaw_rate"))
    m23 = 0.3 if name == "sway_yaw_coupling" else 0.0
    mass = np.array([[5.23, 0.0, 0.0], [0.0, 5.93, m23], [0.0, m23, 1.25]])
    c = 5.93 * v + m23 * r
    coriolis = np.array([[0.0, 0.0, -c], [0.0, 0.0, 5.23 * u], [c, -5.23 * u, 0.0]])
    force = np.sign(n) * abs(n) ** 0.27
    tau = force * np.array([np.cos(angle), *stern(np.sin(angle))]) + GUST
    tau = tau + (forces_in_words(n, angle)[name] if name else 0.0)
    nu = np.array([u, v, r])
    expected = np.linalg.solve(mass, tau - coriolis @ nu - np.diag([4.03, 5.48, 1.13]) @ nu)

    h = 1e-4
    time = h * np.arange(3)
    one = np.ones(3)
    channels = {
        "propeller_speed": n * one,
        "rudder_angle": angle * one,
        "wind_speed": 5.0 * one,
        "wind_direction": 0.5 * one,
    }
    hidden = {name: VESSEL_CASES[name]} if name else {}
    truth = vessel.simulate(
        time, channels, initial=STATE, disturbance=np.outer(one, GUST), **hidden
    ).truth
    found = [
        (4.0 * truth[k][1] - 3.0 * truth[k][0] - truth[k][2]) / (2.0 * h)
        for k in ("surge", "sway", "yaw_rate")
    ]
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_a_current_carries_the_vessel_and_only_shifts_its_path():
    current = {"to_north": 0.1, "to_east": -0.2}
    still = run_vessel(angle=0.2).truth
    drifting = run_vessel(angle=0.2, water_current=current).truth
    time = inputs.grid(30.0, 0.1)
    np.testing.assert_allclose(drifting["north"], still["north"] + 0.1 * time, atol=1e-8)
    np.testing.assert_allclose(drifting["east"], still["east"] - 0.2 * time, atol=1e-8)
    np.testing.assert_allclose(drifting["yaw_rate"], still["yaw_rate"], atol=1e-9)
    # Velocities are over ground: they are the path's derivative, in body axes.
    north = np.gradient(drifting["north"], time)
    east = np.gradient(drifting["east"], time)
    c, s = np.cos(drifting["heading"]), np.sin(drifting["heading"])
    np.testing.assert_allclose((north * c + east * s)[5:-1], drifting["surge"][5:-1], atol=5e-3)
    np.testing.assert_allclose((east * c - north * s)[5:-1], drifting["sway"][5:-1], atol=5e-3)


def test_rudder_lag_and_offset_have_their_closed_forms():
    settled = run_vessel(angle=0.2, duration=60.0).truth
    trimmed = run_vessel(angle=0.15, duration=60.0, rudder_offset=0.05).truth
    lagged = run_vessel(angle=0.2, duration=60.0, rudder_lag=0.7).truth
    for name in ("surge", "sway", "yaw_rate"):
        np.testing.assert_allclose(trimmed[name], settled[name], atol=1e-9)
        assert lagged[name][-1] == pytest.approx(settled[name][-1], rel=1e-6)
    time = inputs.grid(0.02, 1e-3)
    one = np.ones(len(time))
    first = vessel.simulate(
        time, {"propeller_speed": 98.0 * one, "rudder_angle": 0.2 * one}, rudder_lag=0.7
    ).truth
    # r' = -L n^C sin(a) / i33 with a = 0.2 (1 - exp(-t/0.7)), damping still small.
    slope = 0.5 * 98**0.27 * 0.2 / 1.25 / 0.7
    assert first["yaw_rate"][-1] == pytest.approx(-0.5 * slope * 0.02**2, rel=0.03)


def test_quadratic_drag_and_wind_settle_on_their_balance():
    u = run_vessel(duration=60.0, quadratic_surge_drag=2.0).truth["surge"][-1]
    assert 4.03 * u + 2.0 * u**2 == pytest.approx(98**0.27, rel=1e-9)
    wind = {"along": 0.03, "speed": 5.0, "direction": 0.0}
    u = run_vessel(duration=60.0, wind=wind).truth["surge"][-1]
    assert 4.03 * u + 0.03 * (5.0 + u) ** 2 == pytest.approx(98**0.27, rel=1e-9)
    # From starboard (east) the wind pushes to port.
    beam = {"across": 0.05, "speed": 5.0, "direction": np.pi / 2}
    assert run_vessel(duration=2.0, wind=beam).truth["sway"][-1] < 0.0


# One axis, and the motor.


def test_axis_settles_and_coasts_as_in_closed_form():
    time = inputs.grid(120.0, 0.5)
    pushed = axis.simulate(time, np.full(len(time), -20.0)).truth["velocity"]
    v = np.sqrt(20.0 / 67.0)
    np.testing.assert_allclose(pushed, -v * np.tanh(67.0 * v / 340.0 * time), atol=1e-9)
    coast = axis.simulate(time, np.zeros(len(time)), initial_velocity=0.5).truth
    np.testing.assert_allclose(
        coast["position"], 340.0 / 67.0 * np.log(1.0 + 67.0 * 0.5 / 340.0 * time), atol=1e-8
    )


def test_axis_with_dry_friction_stops():
    time = inputs.grid(60.0, 0.5)
    truth = axis.simulate(
        time, np.zeros(len(time)), drag=0.0, friction=17.0, initial_velocity=1.0
    ).truth
    np.testing.assert_allclose(truth["velocity"], np.maximum(1.0 - 0.05 * time, 0.0), atol=1e-9)
    assert truth["position"][-1] == pytest.approx(10.0, rel=1e-9)


@pytest.mark.parametrize("voltage", [13.0, -6.0])
def test_motor_settles_on_its_balance(voltage):
    time = inputs.grid(10.0, 0.05)
    truth = dc_motor.simulate(time, np.full(len(time), voltage)).truth
    p = dc_motor.ARAS
    current, w = truth["current"][-1], truth["speed"][-1]
    assert voltage == pytest.approx(p["resistance"] * current + p["ke"] * w, rel=1e-9)
    load = p["viscous"] * w + np.sign(w) * p["friction"] + p["kq"] * w * abs(w)
    assert p["km"] * current == pytest.approx(load, rel=1e-9)
    assert truth["thrust"][-1] == pytest.approx(p["kt"] * w * abs(w), rel=1e-12)


def test_disturbances_add_to_the_drive():
    time = inputs.grid(20.0, 0.5)
    one = np.ones(len(time))
    pushed = axis.simulate(time, 15.0 * one).truth["velocity"]
    shared = axis.simulate(time, 5.0 * one, disturbance=10.0 * one).truth["velocity"]
    np.testing.assert_allclose(shared, pushed, atol=1e-9)
    driven = dc_motor.simulate(time, 0.0 * one, disturbance=1e-3 * one).truth
    w = driven["speed"][-1]
    p = dc_motor.ARAS
    assert driven["current"][-1] == pytest.approx(-p["ke"] / p["resistance"] * w, rel=1e-6)
    assert w > 0.0


def test_motor_held_by_friction_is_a_coil():
    time = inputs.grid(0.02, 1e-3)
    truth = dc_motor.simulate(time, np.ones(len(time)), parameters={"friction": 1.0}).truth
    p = dc_motor.ARAS
    coil = (1.0 - np.exp(-time * p["resistance"] / p["inductance"])) / p["resistance"]
    np.testing.assert_allclose(truth["current"], coil, atol=1e-10)
    np.testing.assert_array_equal(truth["speed"], 0.0)


def test_motor_without_loads_is_the_linear_machine():
    free = {"viscous": 0.0, "friction": 0.0, "kq": 0.0}
    time = inputs.grid(0.5, 0.01)
    truth = dc_motor.simulate(time, np.full(len(time), 5.0), parameters=free).truth
    p = dc_motor.ARAS
    poles = np.roots([p["inductance"] * p["inertia"], p["resistance"] * p["inertia"], p["ke"] ** 2])
    a, b = poles
    step = 1.0 + (b * np.exp(a * time) - a * np.exp(b * time)) / (a - b)
    np.testing.assert_allclose(truth["speed"], 5.0 / p["ke"] * step.real, rtol=1e-8, atol=1e-8)


# Noise, commands, files.


@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.9])
def test_ar1_has_the_spread_and_correlation_asked_for(correlation):
    e = noise.ar1(np.random.default_rng(3), 100_000, 0.7, correlation)
    assert np.std(e) == pytest.approx(0.7, rel=0.03)
    assert np.corrcoef(e[1:], e[:-1])[0, 1] == pytest.approx(correlation, abs=0.01)
    starts = [noise.ar1(np.random.default_rng(k), 2, 0.7, correlation)[0] for k in range(2000)]
    assert np.std(starts) == pytest.approx(0.7, rel=0.06)


@pytest.mark.parametrize("step", [0.01, 0.1])
def test_ornstein_uhlenbeck_forgets_at_its_time_constant(step):
    time = inputs.grid(50_000 * step, step)
    x = noise.ornstein_uhlenbeck(np.random.default_rng(4), time, 2.0, 0.2)
    lag = round(0.2 / step)
    assert np.std(x) == pytest.approx(2.0, rel=0.06)
    assert np.corrcoef(x[lag:], x[:-lag])[0, 1] == pytest.approx(np.exp(-1.0), abs=0.05)


def test_spikes_dropouts_and_quantisation():
    rng = np.random.default_rng(6)
    s = noise.spikes(rng, 50_000, 0.02, 5.0)
    hit = s[s != 0.0]
    assert len(hit) == pytest.approx(1000, rel=0.15)
    assert np.min(np.abs(hit)) >= 2.5
    assert np.max(np.abs(hit)) <= 5.0
    assert abs(np.mean(np.sign(hit))) < 0.15
    lost = noise.dropouts(rng, np.ones(50_000), 0.1)
    assert np.mean(np.isnan(lost)) == pytest.approx(0.1, rel=0.05)
    np.testing.assert_allclose(noise.quantise(np.array([0.24, -0.26, 0.0]), 0.1), [0.2, -0.3, 0.0])
    np.testing.assert_array_equal(noise.quantise(np.array([0.24]), 0.0), [0.24])


def test_sensors_leave_the_truth_alone_and_repeat():
    record = busy_run("rk4", speed_sensor_offset=1.0)
    sensors = {"speed": noise.Sensor(0.3, 0.8, 0.01, 9.0, 0.05, 0.02, unsigned=True)}
    one, other = (noise.measure(record, np.random.default_rng(9), **sensors) for _ in range(2))
    np.testing.assert_array_equal(one.measured["speed"], other.measured["speed"])
    assert list(one.measured) == ["speed"]
    assert one.truth is record.truth
    assert np.nanmin(one.measured["speed"]) >= 0.0
    perfect = noise.measure(record, np.random.default_rng(9), speed=noise.Sensor())
    np.testing.assert_array_equal(perfect.measured["speed"], record.measured["speed"])


def test_process_noise_moves_the_plant():
    time = inputs.grid(20.0, 0.05)
    torque = noise.ornstein_uhlenbeck(np.random.default_rng(1), time, 3.0, 0.3)
    command = np.full(len(time), 1.0)
    calm = thruster.simulate(time, command).truth["speed"]
    rough = thruster.simulate(time, command, disturbance=torque).truth["speed"]
    assert 0.2 < np.std((rough - calm)[100:]) < 3.0
    constant = thruster.simulate(time, command, disturbance=0.0 * time + 4.2).truth["speed"]
    assert constant[-1] == pytest.approx(np.sqrt(42.0 * 1.1 / 0.037), rel=1e-9)


def test_commands():
    time = inputs.grid(10.0, 0.1)
    assert time[-1] == pytest.approx(10.0)
    assert len(time) == 101
    stairs = inputs.staircase(time, [1.0, -1.0, 2.0], 2.0)
    assert [stairs[k] for k in (0, 19, 20, 39, 40, 100)] == [1.0, 1.0, -1.0, -1.0, 2.0, 2.0]
    z = inputs.zigzag(time, 5.0, 2.0, 1.0)
    assert [z[k] for k in (0, 9, 10, 19, 20, 39, 40)] == [0.0, 0.0, 5.0, 5.0, -5.0, -5.0, 5.0]
    circle = inputs.turning_circle(time, 0.4)
    assert (circle[49], circle[50]) == (0.0, 0.4)
    m = inputs.multisine(time, 1.5, [0.1, 0.3], np.random.default_rng(0))
    assert np.max(np.abs(m)) == pytest.approx(1.5)
    fine = inputs.grid(10.0, 0.001)
    turns = fine[1:-1][np.diff(np.sign(inputs.chirp(fine, 1.0, 0.5, 2.0)[1:])) != 0]
    halves = 0.5 / np.diff(turns)
    middle = 0.5 * (turns[1:] + turns[:-1])
    np.testing.assert_allclose(halves, 0.5 + 0.15 * middle, rtol=0.02)


def test_low_passed_random_has_its_bandwidth():
    time = inputs.grid(4000.0, 0.05)
    c = inputs.low_passed_random(time, 2.0, np.random.default_rng(8))
    assert np.std(c) == pytest.approx(2.0, rel=0.03)
    lag = np.corrcoef(c[1:], c[:-1])[0, 1]
    assert lag == pytest.approx(np.exp(-2.0 * np.pi * 0.05), abs=0.01)


def test_csv_has_fixed_text(tmp_path):
    record = Record(
        time=np.array([0.0, 0.1]),
        inputs={"command": np.array([-0.0001, 1.0])},
        measured={"speed": np.array([np.pi, np.nan])},
        truth={},
    )
    columns = {"t": Column("time", 1e3, 0), "u": Column("command", 1.0, 2), "w": Column("speed")}
    write_csv(record, tmp_path / "deep" / "run.csv", columns)
    assert (tmp_path / "deep" / "run.csv").read_bytes() == b"t,u,w\n0,0.00,3.1416\n100,1.00,\n"
    assert [p.name for p in (tmp_path / "deep").iterdir()] == ["run.csv"]


# Shipped logs.


def test_shipped_logs_are_what_the_simulator_makes(tmp_path):
    make_fits.make(tmp_path)
    made = sorted(p.relative_to(tmp_path) for p in tmp_path.rglob("*.csv"))
    assert len(made) == 8
    for name in made:
        shipped = (make_fits.FITS / name).read_bytes()
        assert shipped == (tmp_path / name).read_bytes(), f"{name}: run reference.make_fits"
        assert len(shipped) < 300_000


def test_a_plain_fixed_step_on_the_shipped_grid_is_far_below_the_noise():
    """One RK4 step a sample, kinks unheeded: the error is below a hundredth of the noise."""
    for record in make_fits.jason_thruster().values():
        c, w, h = record.inputs["command"], 0.0, 0.05
        worst = 0.0
        for k in range(len(c) - 1):

            def f(x, c=c[k]):
                return 42.0 * c - 0.037 * x * abs(x)

            k1 = f(w)
            k2 = f(w + 0.5 * h * k1)
            k3 = f(w + 0.5 * h * k2)
            w += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + f(w + h * k3))
            worst = max(worst, abs(w - record.truth["speed"][k + 1]))
        assert worst < 0.01 * make_fits.THRUSTER_SENSORS["speed"].std


def test_shipped_thruster_log_is_the_jason_thruster():
    with (make_fits.FITS / "jason_thruster" / "holdout.csv").open() as file:
        rows = list(csv.DictReader(file))
    at = next(r for r in rows if r["t"] == "19.90")
    assert float(at["rpm"]) == pytest.approx(np.sqrt(42 * 3 / 0.037) * 30 / np.pi, abs=8.0)
    assert float(at["thrust"]) == pytest.approx(0.02 * 42 / 0.037 * 3, abs=2.0)


def test_the_simulator_does_not_use_the_package():
    code = (
        "import sys, json, reference.make_fits, reference.axis, reference.dc_motor;"
        "print(json.dumps([m for m in sys.modules if m.split('.')[0] in ('jax', 'diffthrust')]))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=HERE, capture_output=True, text=True, check=True
    )
    assert json.loads(done.stdout) == []

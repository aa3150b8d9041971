"""What names, units and numbers of columns say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from diffthrust.logs._contents import Contents, Field  # private: what files hold, made up here
from diffthrust.survey import Look
from diffthrust.survey._guess import meanings  # private: the guesses themselves
from diffthrust.survey._rows import rows_of  # private: the rows that a table shows
from diffthrust.survey._suited import choice_of  # private: which model suits them

WAVE = np.sin(np.linspace(0, 20, 400))
PULSES = np.round(1500 + 300 * WAVE)


def meant(name, values=WAVE, unit="", **more):
    (one,) = meanings([Field(name, np.asarray(values, float), unit=unit, **more)])
    return one.quantity, one.unit


NAMES = [
    ("rpm", 900 * WAVE, ("speed", "rpm")),
    ("ESC[0].RPM", 900 * WAVE, ("speed", "rpm")),
    ("esc_status.esc[0].esc_rpm", 900 * WAVE, ("speed", "rpm")),
    ("tach_rad_s", WAVE, ("speed", "rad/s")),
    ("n_prop [rps]", WAVE, ("speed", "rps")),
    ("thrust_kgf", WAVE, ("thrust", "kgf")),
    ("Force (Kg f)", WAVE, ("thrust", "kgf")),
    ("load cell (g)", WAVE, ("thrust", "gf")),
    ("Fx", WAVE, ("thrust", "N")),
    ("pwm_1", PULSES, ("command", "us")),
    ("RCOU.C1", PULSES, ("command", "us")),
    ("SERVO_OUTPUT_RAW.servo3_raw", PULSES, ("command", "us")),
    ("actuator_outputs.output[0]", PULSES, ("command", "us")),
    ("actuator_motors.control[0]", WAVE, ("command", "effort")),
    ("u1", 10 * WAVE, ("command", "V")),
    ("motor volts", 10 * WAVE, ("command", "V")),
    ("throttle", 90 * WAVE, ("command", "percent")),
    ("BAT.Volt", 15 + WAVE, ("supply_voltage", "V")),
    ("battery_status.voltage_v", 15 + WAVE, ("supply_voltage", "V")),
    ("tau", WAVE, ("torque", "N m")),
    ("current (A)", WAVE, ("current", "A")),
    ("water current (m/s)", WAVE, ("inflow", "m/s")),
    ("yaw", 170 * WAVE, ("heading", "deg")),
    ("psi", 3 * WAVE, ("heading", "rad")),
    ("yaw_rate", WAVE, ("yaw_rate", "rad/s")),
    ("gyro_z", 40 * WAVE, ("yaw_rate", "deg/s")),
    ("vehicle_angular_velocity.xyz[2]", WAVE, ("yaw_rate", "rad/s")),
    ("/imu.angular_velocity.z", WAVE, ("yaw_rate", "rad/s")),
    ("/odom.twist.twist.linear.x", WAVE, ("surge", "m/s")),
    ("/odom.twist.twist.linear.y", WAVE, ("sway", "m/s")),
    ("/odom.pose.pose.position.x", WAVE, ("east", "m")),
    ("GPS[0].Spd", WAVE, ("surge", "m/s")),
    ("delta_rudder [rad]", WAVE, ("rudder_angle", "rad")),
    ("lat", 63 + WAVE, ("latitude", "deg")),
    ("wind_dir_true [rad]", WAVE, ("wind_direction", "rad")),
    # what is recorded and is not what a model puts out
    ("/cmd_vel.linear.x", WAVE, ("set_point", "")),
    ("thrust_demand_N", WAVE, ("set_point", "N")),
    ("ATT.DesYaw", WAVE, ("set_point", "")),
    ("surge_dot", WAVE, ("derived", "")),
    ("yaw_rate_bias", WAVE, ("derived", "")),
    ("XKF1.GZ", WAVE, ("", "")),
    ("foo", WAVE, ("", "")),
]


@pytest.mark.parametrize(("name", "values", "expected"), NAMES, ids=[n[0] for n in NAMES])
def test_names_of_the_field_are_known(name, values, expected):
    quantity, unit = meant(name, values)
    assert quantity == expected[0]
    if quantity not in ("set_point", "derived"):
        assert unit == expected[1]


@pytest.mark.parametrize(
    ("values", "unit"),
    [
        (0.02 * np.arange(400), "s"),
        (20.0 * np.arange(400), "ms"),
        (20_000.0 * np.arange(400), "us"),
        (2e7 * np.arange(400), "ns"),
        (1.7e9 + np.arange(400), "s"),
        (1.7e12 + 20 * np.arange(400), "ms"),
        (1.7e15 + np.arange(400), "us"),
        (np.repeat(1.7e9 + np.arange(40), 10), "s"),
    ],
)
def test_stamps_tell_their_unit(values, unit):
    assert meant("timestamp", values) == ("time", unit)
    assert meant("time_exp", -values)[0] != "time"


def test_the_unit_that_the_file_gives_is_believed_before_the_numbers():
    assert meant("rpm", WAVE, "rad/s") == ("speed", "rad/s")
    assert meant("yaw", 170 * WAVE, "rad") == ("heading", "rad")
    assert meant("speed", WAVE, "m/s") == ("velocity", "m/s")
    assert meant("speed", WAVE, "rpm") == ("speed", "rpm")
    assert meant("channel 7", WAVE, "kgf") == ("thrust", "kgf")


def test_the_stop_of_pulses_is_where_they_begin():
    for stop, expected in ((1500, 1500.0), (1511, 1511.0), (1300, 1500.0)):
        rest = np.full(200, float(stop))
        field = Field("pwm", np.concatenate([rest, PULSES]))
        (one,) = meanings([field])
        assert one.pwm is not None
        assert (one.pwm.stop, one.pwm.full, one.pwm.astern) == (expected, 1900, 1100)


VESSELS = [
    ("u_mps", "v_mps", "r_dps", ("m/s", "m/s", "deg/s")),
    ("u_kn", "v_kn", "r_degps", ("knot", "knot", "deg/s")),
    ("u_m_s", "v_m_s", "r_radps", ("m/s", "m/s", "rad/s")),
    ("u [m/s]", "v [m/s]", "r [deg/s]", ("m/s", "m/s", "deg/s")),
    ("u_mps", "v_mps", "yaw_rate_dps", ("m/s", "m/s", "deg/s")),
]


@pytest.mark.parametrize(("u", "v", "r", "units"), VESSELS, ids=[v[2] + v[0] for v in VESSELS])
def test_letters_with_their_units_are_the_motion_of_a_vessel(u, v, r, units):
    found = meanings([Field(name, WAVE) for name in (u, v, r)])
    assert [one.quantity for one in found] == ["surge", "sway", "yaw_rate"]
    assert tuple(one.unit for one in found) == units


def test_letters_alone_keep_what_their_unit_says():
    names = ("v [m/s]", "u_V", "r_rpm", "x_m", "y_m", "l_rpm")
    found = meanings([Field(name, 9 * WAVE) for name in names])
    quantities = ["velocity", "command", "speed", "north", "east", "speed"]
    assert [one.quantity for one in found] == quantities


def clocked(name, values, rate=10.0):
    return Field(name, np.asarray(values, float), np.arange(len(values)) / rate)


def test_of_many_outputs_the_one_that_the_shaft_follows_is_the_command():
    rng = np.random.default_rng(5)
    outputs = [
        clocked(f"RCOU.C{k}", 1500 + 300 * np.repeat(rng.uniform(-1, 1, 40), 10))
        for k in range(1, 9)
    ]
    driven = np.abs(np.roll(outputs[5].values - 1500, 2)) * 3 + rng.normal(0, 10, 400)
    fields = (*outputs, clocked("ESC.RPM", driven), clocked("ATT.Yaw", 90 + WAVE))
    found = choice_of(Contents(Path("x.bin"), "ArduPilot DataFlash log", True, fields))
    assert found.model == "speed_loop_thruster"
    assert found.channels["command"].field.name == "RCOU.C6"
    assert found.channels["speed"].unsigned
    assert found.channels["command"].alternatives[:2] == ("RCOU.C1", "RCOU.C2")


def test_in_ros_sway_and_yaw_rate_are_turned_round():
    fields = [
        clocked("/left_thruster/cmd.data", WAVE),
        clocked("/right_thruster/cmd.data", WAVE[::-1]),
        clocked("/odom.twist.twist.linear.x", WAVE),
        clocked("/odom.twist.twist.linear.y", WAVE**2),
        clocked("/odom.twist.twist.angular.z", WAVE[::-1] - WAVE),
    ]
    found = choice_of(Contents(Path("bag"), "ROS 2 bag", True, tuple(fields)))
    scales = {name: pick.meaning.scale for name, pick in found.channels.items()}
    assert scales == {
        "left_force": 1, "right_force": 1, "surge": 1, "sway": -1, "yaw_rate": -1,
    }  # fmt: skip


def test_a_log_of_hundreds_of_fields_shows_first_what_a_model_may_use(tmp_path, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    rng = np.random.default_rng(0)
    many = [clocked(f"MSG{k // 20}.F{k}", rng.normal(size=400)) for k in range(300)]
    effort = np.repeat(rng.uniform(-1, 1, 40), 10)
    used = [clocked("RCOU.C1", 1500 + 400 * effort), clocked("ESC.RPM", 2000 * effort)]
    contents = Contents(tmp_path / "x.bin", "ArduPilot DataFlash log", True, (*many, *used))
    choice = choice_of(contents)

    look = Look(contents.path, choice, rows_of(choice), (contents.path,))
    short = look.report()
    assert "RCOU.C1" in short
    assert "300 more fields" in short
    assert "MSG3 (20)" in short
    assert "MSG3.F61" not in short
    assert len(short.splitlines()) < 30
    long = look.report(all=True)
    assert all(field.name in long for field in contents.fields)

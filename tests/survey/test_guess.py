"""What names, units and numbers of columns say."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from robot_files import number, plain_twist, write_bag, write_dataflash

import diffthrust as dft

WAVE = np.sin(np.linspace(0, 20, 400))
PULSES = np.round(1500 + 300 * WAVE)


@pytest.fixture
def looked(tmp_path):
    """What is seen of columns, beside one whose name says nothing."""

    def look(columns):
        path = tmp_path / "run.csv"
        pd.DataFrame(
            {"beside": 1 + 0.37 * WAVE[: len(next(iter(columns.values())))], **columns}
        ).to_csv(path, index=False)
        return dft.look(path)

    return look


@pytest.fixture
def meant(looked):
    def quantity_and_unit(name, values):
        row = looked({name: np.resize(values, 400)}).columns[1]
        return row.quantity, row.unit

    return quantity_and_unit


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
    ("current_time", np.arange(400.0), ("time", "s")),
    ("current_R [A]", WAVE, ("current", "A")),
    ("current_speed [m/s]", WAVE, ("inflow", "m/s")),
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
    ("previous_heading", WAVE, ("derived", "")),
    ("surge_dot", WAVE, ("derived", "")),
    ("yaw_rate_bias", WAVE, ("derived", "")),
    ("XKF1.GZ", WAVE, ("", "")),
    ("foo", WAVE, ("", "")),
]


@pytest.mark.parametrize(("name", "values", "expected"), NAMES, ids=[n[0] for n in NAMES])
def test_names_of_the_field_are_known(meant, name, values, expected):
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
def test_stamps_tell_their_unit(meant, values, unit):
    assert meant("timestamp", values) == ("time", unit)
    assert meant("time_exp", -values)[0] != "time"


@pytest.mark.parametrize(
    ("name", "values", "unit", "quantity"),
    [
        ("rpm", WAVE, "rad/s", "speed"),
        ("yaw", 170 * WAVE, "rad", "heading"),
        ("speed", WAVE, "m/s", "velocity"),
        ("speed", WAVE, "rpm", "speed"),
        ("channel 7", WAVE, "kgf", "thrust"),
    ],
)
def test_the_unit_that_the_file_gives_is_believed_before_the_numbers(
    tmp_path, name, values, unit, quantity
):
    rows = [f"{number},{beside}" for number, beside in zip(values, 1 + WAVE, strict=True)]
    path = tmp_path / "run.csv"
    path.write_text("\n".join([f"{name},beside", f"{unit},-", *rows, ""]))
    row = dft.look(path).columns[0]
    assert (row.quantity, row.unit) == (quantity, unit)


def test_the_stop_of_pulses_is_where_they_begin(looked):
    for stop, expected in ((1500, 1500.0), (1511, 1511.0), (1300, 1500.0)):
        pulses = np.concatenate([np.full(200, float(stop)), PULSES[:200]])
        pwm = looked({"pwm": pulses, "rpm": 900 * WAVE}).choice.channels["command"].meaning.pwm
        assert (pwm.stop, pwm.full, pwm.astern) == (expected, 1900, 1100)


VESSELS = [
    ("u_mps", "v_mps", "r_dps", ("m/s", "m/s", "deg/s")),
    ("u_kn", "v_kn", "r_degps", ("knot", "knot", "deg/s")),
    ("u_m_s", "v_m_s", "r_radps", ("m/s", "m/s", "rad/s")),
    ("u [m/s]", "v [m/s]", "r [deg/s]", ("m/s", "m/s", "deg/s")),
    ("u_mps", "v_mps", "yaw_rate_dps", ("m/s", "m/s", "deg/s")),
]


@pytest.mark.parametrize(("u", "v", "r", "units"), VESSELS, ids=[v[2] + v[0] for v in VESSELS])
def test_letters_with_their_units_are_the_motion_of_a_vessel(looked, u, v, r, units):
    found = looked(dict.fromkeys((u, v, r), WAVE)).columns[1:]
    assert [one.quantity for one in found] == ["surge", "sway", "yaw_rate"]
    assert tuple(one.unit for one in found) == units


def test_letters_alone_keep_what_their_unit_says(looked):
    names = ("v [m/s]", "u_V", "r_rpm", "x_m", "y_m", "l_rpm")
    found = looked(dict.fromkeys(names, 9 * WAVE)).columns[1:]
    quantities = ["velocity", "command", "speed", "north", "east", "speed"]
    assert [one.quantity for one in found] == quantities


def in_dataflash(path, messages):
    """A log of messages, each with its fields, all at 10 Hz."""
    formats = {name: ("Q" + "f" * len(f), ["TimeUS", *f]) for name, f in messages.items()}
    rows = [
        (name, [1_000_000 + 100_000 * k, *(float(series[k]) for series in fields.values())])
        for k in range(400)
        for name, fields in messages.items()
    ]
    return write_dataflash(path, formats, rows)


def test_of_many_outputs_the_one_that_the_shaft_follows_is_the_command(tmp_path):
    rng = np.random.default_rng(5)
    outputs = {f"C{k}": 1500 + 300 * np.repeat(rng.uniform(-1, 1, 40), 10) for k in range(1, 9)}
    driven = np.abs(np.roll(outputs["C6"] - 1500, 2)) * 3 + rng.normal(0, 10, 400)
    messages = {"RCOU": outputs, "ESC": {"RPM": driven}, "ATT": {"Yaw": 90 + WAVE}}
    seen = dft.look(in_dataflash(tmp_path / "x.bin", messages))
    assert seen.model == "speed_loop_thruster"
    command = seen.choice.channels["command"]
    assert command.field.name == "RCOU.C6"
    assert seen.choice.channels["speed"].unsigned
    assert command.alternatives[:2] == ("RCOU.C1", "RCOU.C2")


def test_in_ros_sway_and_yaw_rate_are_turned_round(tmp_path):
    stamps, back = 0.1 * np.arange(400), WAVE[::-1]
    motion = zip(stamps, WAVE, WAVE**2, back - WAVE, strict=True)
    topics = {
        "/left_thruster/cmd": (
            "std_msgs/msg/Float64",
            [(t, number(v)) for t, v in zip(stamps, WAVE, strict=True)],
        ),
        "/right_thruster/cmd": (
            "std_msgs/msg/Float64",
            [(t, number(v)) for t, v in zip(stamps, back, strict=True)],
        ),
        "/odom": ("geometry_msgs/msg/Twist", [(t, plain_twist(*values)) for t, *values in motion]),
    }
    channels = dft.look(write_bag(tmp_path, topics)).choice.channels
    assert {name: pick.meaning.scale for name, pick in channels.items()} == {
        "left_force": 1, "right_force": 1, "surge": 1, "sway": -1, "yaw_rate": -1,
    }  # fmt: skip


def test_a_log_of_hundreds_of_fields_shows_first_what_a_model_may_use(tmp_path, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    rng = np.random.default_rng(0)
    messages = {f"MS{k:02}": {f"F{j}": rng.normal(size=400) for j in range(10)} for k in range(30)}
    effort = np.repeat(rng.uniform(-1, 1, 40), 10)
    messages |= {"RCOU": {"C1": 1500 + 400 * effort}, "ESC": {"RPM": 2000 * effort}}
    seen = dft.look(in_dataflash(tmp_path / "x.bin", messages))
    short = seen.report()
    assert "RCOU.C1" in short
    assert "300 more fields" in short
    assert "MS03 (10)" in short
    assert "MS03.F1" not in short
    assert len(short.splitlines()) < 30
    long = seen.report(all=True)
    assert all(f"{name}.{field}" in long for name, fields in messages.items() for field in fields)

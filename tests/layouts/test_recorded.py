"""Layouts by the settings of autopilots, against mechanics written anew."""

import csv
import tomllib

import numpy as np
import pytest

import diffthrust as dft
from diffthrust import InputError
from diffthrust.layouts import (
    ARDUSUB_FRAMES,
    Mixer,
    ardupilot_layout,
    ardusub_mixer,
    layout_in,
    px4_layout,
)
from diffthrust.logs import PWM
from tests.reference.allocation import px4_allocation, wrench


@pytest.mark.parametrize("frame", ARDUSUB_FRAMES)
def test_thrusters_of_ardusub_do_what_their_factors_say(frame):
    layout = ardupilot_layout({"FRAME_CONFIG": float(ARDUSUB_FRAMES.index(frame))})
    factors = ardusub_mixer(frame).factors
    assert list(layout.thrusters) == list(factors)
    for name, thruster in layout.thrusters.items():
        acting = wrench(thruster.place, thruster.pointing)
        wanted = np.array(factors[name])
        forces = wanted[:3] / np.linalg.norm(wanted[:3])
        np.testing.assert_allclose(acting[:3], forces, atol=1e-6)
        moved = wanted[3:] != 0
        assert np.all(np.sign(acting[3:][moved]) == np.sign(wanted[3:][moved])), name
    (acted, _), off = _coupling(layout)
    assert np.all(acted > 0)
    # the vertical thrusters of the vectored frame are on the axis; forces of BlueROV1 are its own
    if frame.startswith(("vectored", "simplerov")):
        assert off < 1e-9


def _coupling(layout):
    """Forces along each commanded axis, and the largest unwanted beside it, but for pitch."""
    acting = np.array([wrench(t.place, t.pointing) for t in layout.thrusters.values()]).T
    mixed = acting @ layout.mixer.matrix
    used = [k for k in range(6) if np.any(layout.mixer.matrix[:, k])]
    inside = mixed[np.ix_(used, used)]
    # what horizontal thrusters below the origin do to roll and pitch is no matter of the factors
    flat = [used.index(k) for k in used if k in (0, 1, 5)]
    plane = inside[np.ix_(flat, flat)]
    off = np.abs(plane - np.diag(np.diag(plane))).max()
    return (np.diag(inside), used), off


def test_directions_and_outputs_follow_the_parameters():
    parameters = {
        "FRAME_CONFIG": 2.0,
        "MOT_3_DIRECTION": -1.0,
        **{f"SERVO{k}_FUNCTION": 33.0 + (8 - k) for k in range(1, 9)},
    }
    layout = ardupilot_layout(parameters)
    plain = ardupilot_layout({"FRAME_CONFIG": 2.0})
    assert layout.thrusters["m3"].pointing == tuple(
        -v for v in plain.thrusters["m3"].pointing[:2]
    ) + (0.0,)
    assert layout.thrusters["m1"].columns[0] == ("RCOU.C8", PWM(1500.0, 1900.0, 1100.0))
    # what is sent is turned as well: a surge command still pushes ahead
    (acted, _), _ = _coupling(layout)
    assert np.all(acted > 0)
    assert ardupilot_layout({"FRAME_CLASS": 1.0, "SERVO1_FUNCTION": 73.0}) is None


def test_a_boat_of_ardupilot(tmp_path):
    (tmp_path / "boat.param").write_text(
        "FRAME_CLASS,2\nSERVO1_FUNCTION,74\nSERVO1_REVERSED,1\nSERVO1_MIN,1000\nSERVO1_MAX,2000\n"
        "SERVO1_TRIM,1490\nSERVO3_FUNCTION,73\n"
    )
    layout = layout_in(tmp_path / "boat.param")
    starboard, port = layout.thrusters["starboard"], layout.thrusters["port"]
    assert starboard.place[1] > 0 > port.place[1]
    assert starboard.columns[0] == ("RCOU.C1", PWM(1490.0, 1000.0, 2000.0))
    assert port.columns[0] == ("RCOU.C3", PWM(1500.0, 1900.0, 1100.0))
    craft = layout.craft()
    time = 0.1 * np.arange(30)
    push = {"port.command": np.full(30, 0.5), "starboard.command": np.zeros(30)}
    out = dft.simulate(craft, dft.Log(time, push, units=dict(craft.inputs)))
    assert out["yaw_rate"][-1] > 0.01


def test_pulses_that_are_none_are_refused(tmp_path):
    boat = {"FRAME_CLASS": 2.0, "SERVO1_FUNCTION": 73.0, "SERVO3_FUNCTION": 74.0}
    told = r"SERVO1_MIN 1100, SERVO1_TRIM 1900, SERVO1_MAX 1900: expected the stop \(1900\) between"
    with pytest.raises(InputError, match=told):
        ardupilot_layout({**boat, "SERVO1_TRIM": 1900.0})
    # a motor that does not turn back
    ahead = ardupilot_layout({**boat, "SERVO3_MIN": 1500.0})
    assert ahead.thrusters["starboard"].columns[0].pwm == PWM(1500.0, 1900.0)
    with pytest.raises(InputError, match="PWM_MAIN_MIN3 1900, PWM_MAIN_MAX3 1900: expected"):
        px4_layout({**ROTORS, "PWM_MAIN_MIN3": 1900.0})


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"FRAME_CONFIG": 7.0}, "FRAME_CONFIG: .* found 7, a frame of your own code"),
        ({"FRAME_CONFIG": 1.5}, "FRAME_CONFIG: expected a whole number from 0 to 6, found 1.5"),
        ({"FRAME_CONFIG": 1.0, "MOT_1_DIRECTION": 0.0}, "MOT_1_DIRECTION: expected 1 or -1"),
        ({"FRAME_CONFIG": 1.0, "MOT_2_DIRECTION": -2.0}, "MOT_2_DIRECTION: .* found -2.0"),
    ],
)
def test_settings_that_ardusub_does_not_have_are_refused(settings, told):
    with pytest.raises(InputError, match=told):
        ardupilot_layout(settings)


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"CA_ROTOR_COUNT": 2.7}, "CA_ROTOR_COUNT: expected a whole number up to 12, found 2.7"),
        ({"CA_ROTOR_COUNT": 20.0}, "CA_ROTOR_COUNT: .* found 20"),
        ({"CA_ROTOR3_CT": -6.5}, r"CA_ROTOR3_CT: [\s\S]*Set it to 6.5 and turn its axis round"),
    ],
)
def test_settings_that_px4_does_not_have_are_refused(settings, told):
    with pytest.raises(InputError, match=told):
        px4_layout({**ROTORS, **settings})


ROTORS = {
    "CA_AIRFRAME": 7.0,
    "CA_ROTOR_COUNT": 8.0,
    **{f"CA_ROTOR{k}_PX": v for k, v in enumerate([0.14, 0.14, -0.14, -0.14])},
    **{f"CA_ROTOR{k}_PX": v for k, v in enumerate([0.12, 0.12, -0.12, -0.12], 4)},
    **{f"CA_ROTOR{k}_PY": 0.1 if k % 2 == 0 else -0.1 for k in range(4)},
    **{f"CA_ROTOR{k}_PY": 0.22 if k % 2 == 0 else -0.22 for k in range(4, 8)},
    **{f"CA_ROTOR{k}_PZ": 0.06 for k in range(4)},
    **{f"CA_ROTOR{k}_AX": v for k, v in enumerate([1.0, 1.0, 1.0, 1.0])},
    **{f"CA_ROTOR{k}_AY": v for k, v in enumerate([-1.0, 1.0, 1.0, -1.0])},
    **{f"CA_ROTOR{k}_AZ": 0.0 for k in range(4)},
    **{f"CA_ROTOR{k}_KM": 0.0 for k in range(4)},
    "CA_ROTOR6_CT": 3.25,
    "CA_R_REV": 255.0,
    "PWM_MAIN_FUNC3": 101.0,
    "PWM_MAIN_MIN3": 1100.0,
    "PWM_MAIN_MAX3": 1900.0,
}  # fmt: skip


def test_px4_geometry_and_what_px4_makes_of_it():
    layout = px4_layout(ROTORS)
    thrusters = layout.thrusters
    assert thrusters["m1"].pointing == pytest.approx((np.sqrt(0.5), -np.sqrt(0.5), 0.0), abs=1e-6)
    assert thrusters["m1"].reaction is None
    # left out: up, and the default torque, against the axis
    assert (thrusters["m5"].pointing, thrusters["m5"].reaction) == ((0.0, 0.0, -1.0), -0.05)
    assert thrusters["m7"].strength == 0.5
    assert thrusters["m1"].columns == (
        ("actuator_motors.control[0]", None),
        ("actuator_outputs.output[2]", PWM(1500.0, 1900.0, 1100.0)),
    )
    assert layout.craft().parameters["m7.strength"].value == 0.5
    np.testing.assert_allclose(layout.mixer.matrix, px4_allocation(ROTORS, 8), atol=2e-4)
    assert layout.mixer.commands == ("surge", "sway", "heave", "roll", "pitch", "yaw")
    assert px4_layout({**ROTORS, "CA_AIRFRAME": 0.0}) is None


def rotors(*rows):
    """PX4's parameters of motors: place and axis of each, without a torque of its own."""
    settings = {"CA_AIRFRAME": 7.0, "CA_ROTOR_COUNT": float(len(rows))}
    keys = ("PX", "PY", "PZ", "AX", "AY", "AZ", "KM", "CT")
    for k, row in enumerate(rows):
        values = dict(zip(keys, (*row, 0.0, 6.5), strict=True))
        settings |= {f"CA_ROTOR{k}_{key}": float(value) for key, value in values.items()}
    return settings


def test_px4_does_not_divide_a_yaw_that_sends_nothing_ahead():
    # surge turns the craft to port, so yaw sends the one motor astern, and is left as it is
    one = px4_layout(rotors((0, 0.3, 0, 1, 0, 0))).mixer
    yaw = -0.3 * 6.5 / (6.5**2 + (0.3 * 6.5) ** 2)
    np.testing.assert_allclose(one.matrix, [[1.0, yaw]], rtol=1e-9)
    stern = px4_layout(rotors((0, 0, 0, 1, 0, 0), (-0.5, 0, 0, 0, 1, 0))).mixer
    turn = -0.5 * 6.5 / (6.5**2 + (0.5 * 6.5) ** 2)
    assert stern.commands == ("surge", "sway", "yaw")
    np.testing.assert_allclose(stern.matrix, [[1, 0, 0], [0, 1, turn]], rtol=1e-9)


def test_px4_defaults_are_not_told_as_settings_of_the_log():
    bare = {"CA_AIRFRAME": 7.0, "CA_ROTOR_COUNT": 2.0}
    marks = {fact.mark for fact in px4_layout(bare).facts}
    assert marks == {"unknown"}
    sources = [fact.source for fact in px4_layout(bare).facts]
    assert sources[0] == (
        "PX4's default, the log has no CA_ROTOR0_PX, CA_ROTOR0_PY, CA_ROTOR0_PZ and 3 more"
    )
    assert sources[-1].startswith("no thruster turns the craft by its place")
    told = rotors((0, 0.3, 0, 1, 0, 0), (0, -0.3, 0, 1, 0, 0))
    facts = px4_layout(told).facts
    assert [fact.mark for fact in facts] == ["published"] * 3 + ["unknown"]
    told.pop("CA_ROTOR1_PY")
    facts = [f.source for f in px4_layout(told).facts if "places" in f.values]
    assert facts == ["the log's parameters", "PX4's default, the log has no CA_ROTOR1_PY"]


def test_px4_leaves_out_rotors_without_a_direction():
    layout = px4_layout({**ROTORS, "CA_ROTOR7_AZ": 0.0, "CA_ROTOR4_CT": 0.0})
    assert list(layout.thrusters) == ["m1", "m2", "m3", "m4", "m6", "m7"]


def test_a_file_without_a_craft_says_what_it_has(tmp_path):
    (tmp_path / "copter.param").write_text("FRAME_CLASS,1\nFRAME_TYPE,1\n")
    with pytest.raises(InputError, match=r"found FRAME_CLASS 1 among 2 parameters"):
        layout_in(tmp_path / "copter.param")


def test_mixers_that_are_none_are_refused():
    with pytest.raises(InputError, match="expected axes of 'surge', 'sway'"):
        Mixer(("forward",), {"port": (1.0,)})
    with pytest.raises(InputError, match="port: expected 2 factors"):
        Mixer(("surge", "yaw"), {"port": (1.0,)})
    with pytest.raises(InputError, match="expected thrusters, found none"):
        Mixer(("surge",), {})
    with pytest.raises(InputError, match=r"'vektored' is not known.*'vectored'"):
        ardusub_mixer("vektored")
    with pytest.raises(InputError, match="expected 3 names, found 1"):
        ardusub_mixer("simplerov_3").named(["a"])


@pytest.mark.parametrize(
    ("factors", "told"),
    [
        ([(1,)], r"Mixer: expected thrusters, found \[\(1,\)\]"),
        ({"a": ("x",)}, r"Mixer, a: expected 1 factors, for 'surge', found \('x',\)"),
        ({"a": 1}, "Mixer, a: expected 1 factors, for 'surge', found 1"),
    ],
)
def test_factors_that_are_none_are_refused(factors, told):
    with pytest.raises(InputError, match=told):
        Mixer(("surge",), factors)


@pytest.mark.parametrize(
    ("effectiveness", "told"),
    [
        ({}, "Mixer.inverse: expected thrusters, found none"),
        ({"a": (1, 0, 0)}, r"Mixer.inverse, a: expected 6 numbers.*found \(1, 0, 0\)"),
        ({"a": (0,) * 6}, "Mixer.inverse: expected forces or moments of 'a', found zeros"),
    ],
)
def test_thrusters_that_have_no_inverse_are_refused(effectiveness, told):
    with pytest.raises(InputError, match=told):
        Mixer.inverse(effectiveness)


def test_odd_names_are_read_back():
    mixer = Mixer(("surge", "yaw"), {"bow, left": (1, 0.5), 'a "b"': (1, -1)}, "mine\n[other]")
    rows = list(csv.reader(mixer.csv().splitlines()))
    assert rows[0] == ["thruster", "surge", "yaw"]
    assert {name: tuple(map(float, row)) for name, *row in rows[1:]} == mixer.factors
    tables = tomllib.loads(mixer.toml())
    assert {n: tuple(row) for n, row in tables["thrusters"].items()} == mixer.factors
    assert list(tables) == ["commands", "thrusters"]


def test_one_thruster_is_no_plural():
    assert px4_layout(rotors((0, 0, 0, 1, 0, 0))).title == "PX4, CA_AIRFRAME 7, one thruster"


def test_errors_of_settings_name_the_file(tmp_path):
    (tmp_path / "own.param").write_text("FRAME_CONFIG,7\n")
    with pytest.raises(InputError, match=r"own\.param: FRAME_CONFIG: expected"):
        layout_in(tmp_path / "own.param")
    with pytest.raises(InputError, match=r"expected the path of a log .* found 3"):
        layout_in(3)


def test_ardusub_lines_count_a_throttle_up():
    lines = ardusub_mixer("vectored").ardusub().splitlines()
    assert lines[5] == (
        "add_motor_raw_6dof(AP_MOTORS_MOT_5, 1.0f, 0.0f, 0.0f, -1.0f, 0.0f, 0.0f, 5);"
    )

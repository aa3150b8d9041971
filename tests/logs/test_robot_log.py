"""Logs of robots: read back what was written, on one time base, and say what was done."""

import builtins
from dataclasses import replace
from decimal import Decimal

import numpy as np
import pytest
from file_contents import contents
from hypothesis import given, settings
from hypothesis import strategies as st

from diffthrust import Column, InputError, Log, Thruster, read_log, read_robot_log, simulate
from diffthrust.logs._robots.fields import Series, series_of  # private: series without a file
from diffthrust.logs._robots.read import resample  # private: likewise
from diffthrust.specs import load_spec
from tests.robot_files import (
    attitude,
    number,
    numbers,
    orientation,
    servos,
    twist,
    write_bag,
    write_dataflash,
    write_telemetry,
)

FLOAT, ARRAY = "std_msgs/msg/Float64", "std_msgs/msg/Float64MultiArray"
TWIST = "geometry_msgs/msg/TwistStamped"
COMMANDS = [(0.0, 1.0), (0.31, 2.0), (0.7, -1.0)]
SPEEDS = [(k / 10, 3.0 * k / 10) for k in range(11)]  # 3 m/s^2


@pytest.fixture(params=["sqlite3", "mcap", "mcap file"])
def bag(request, tmp_path):
    pytest.importorskip("rosbags")
    path = write_bag(
        tmp_path,
        {
            "/cmd": (FLOAT, [(t, number(u)) for t, u in COMMANDS]),
            "/velocity": (TWIST, [(t, twist(v, t - 0.02)) for t, v in SPEEDS]),
            "/rpm": (ARRAY, [(t + 0.05, numbers([60 * t, -60 * t])) for t, _ in SPEEDS]),
        },
        storage=request.param.split()[0],
    )
    return next(path.glob("*.mcap")) if request.param == "mcap file" else path


def read(path, **more):
    given = dict(
        base="surge",
        inputs={"command": Column("/cmd.data", unit="V")},
        measured={"surge": Column("/velocity.twist.linear.x", unit="m/s")},
    )
    return read_robot_log(path, **{**given, **more})


def assert_told(words, reading, *arguments, **options):
    """A call that is refused tells so many words, and a mend."""
    with pytest.raises(InputError) as caught:
        reading(*arguments, **options)
    for word in words:
        assert word in str(caught.value)
    assert caught.value.mend


def test_without_a_time_base_the_choice_is_told():
    with pytest.raises(InputError, match="expected a time base, found none") as caught:
        read("run.bin", base=None)
    assert 'base="messages"' in caught.value.mend


def test_a_bag_is_read_back(bag):
    log = read(bag)
    np.testing.assert_allclose(log.time, np.arange(11) / 10, atol=1e-9)
    np.testing.assert_allclose(log.measured["surge"], 3 * log.time, atol=1e-9)
    np.testing.assert_array_equal(log.inputs["command"], [1] * 4 + [2] * 3 + [-1] * 4)
    assert log.units["surge"] == "m/s"
    assert log.name == bag.name
    base, command, surge = log.notes
    assert "the stamps of 'surge', 10 Hz, 11 samples" in base
    assert "largest gap 0.39 s at 0.31 s" in command
    assert "a change appears up to 0.1 s late" in command
    assert "held for 0.3 s after its last message" in command
    assert "jitter 0 ms; 0% of the samples are interpolated" in surge


def test_limits_may_be_any_kind_of_number(bag):
    limits = {"gap": 0.5, "faster": 2.5, "start": 0.25, "stop": 0.75}
    log = read(bag, **limits)
    same = read(bag, **{word: Decimal(value) for word, value in limits.items()})
    np.testing.assert_array_equal(same.time, log.time)
    assert same.notes == log.notes


def test_channels_of_other_rates_are_interpolated_and_it_is_said(bag):
    speed = Column("/rpm.data[1]", unit="rpm", scale=-1.0)
    log = read(bag, measured={"surge": "/velocity.twist.linear.x", "speed": speed}, base=0.05)
    np.testing.assert_allclose(np.diff(log.time), 0.05)
    assert log.time[0] == 0
    assert log.time[-1] == pytest.approx(1.05)
    expected = np.where(log.time > 1.0 + 1e-9, np.nan, 3 * log.time)
    np.testing.assert_allclose(log.measured["surge"], expected, atol=1e-9)
    rpm = np.where(log.time < 0.05 - 1e-9, np.nan, 60 * (log.time - 0.05))
    np.testing.assert_allclose(log.values("speed", "rpm"), rpm, atol=1e-6)
    assert any("a step of 0.05 s, 22 samples" in note for note in log.notes)
    assert any("'surge'" in note and "45% of the samples are interp" in note for note in log.notes)


def test_stamps_of_headers(bag):
    late = read(bag, base=0.1, measured={"surge": "/velocity.twist.linear.x"}, stamps="header")
    # the message that says v = 3 t was sent 0.02 s before it was recorded; zero is the first stamp
    np.testing.assert_allclose(late.measured["surge"], 3 * (late.time), atol=1e-6)
    assert late.time[0] == pytest.approx(0.02)
    assert "no header, so the recorder's stamps are taken" in late.notes[1]
    with pytest.raises(InputError, match="expected a header with a time stamp"):
        read(bag, base=0.5, measured={"speed": "/rpm.data[0]"}, inputs={}, stamps="header")


def test_the_heading_of_an_orientation(tmp_path):
    """To the north there is a yaw of a quarter turn; turning to starboard lowers it."""
    pytest.importorskip("rosbags")
    time = np.arange(0.0, 10.0, 0.5)
    turns = [(t, orientation(np.pi / 2 - t, 0.0 if t == 2.0 else 1.0)) for t in time]
    path = write_bag(tmp_path, {"/q": ("geometry_msgs/msg/Quaternion", turns)})
    log = read(path, base="messages", inputs={}, measured={"heading": "/q.heading", "y": "/q.yaw"})
    seen = time[time != 2.0]
    np.testing.assert_allclose(log.time, seen, atol=1e-9)
    np.testing.assert_allclose(log.measured["heading"], seen, atol=1e-9)
    np.testing.assert_allclose(np.sin(log.measured["y"]), np.cos(seen), atol=1e-9)
    assert any("1 of 20 messages held no number" in note for note in log.notes)
    with pytest.raises(InputError, match="expected the field 'roll', found 'yaw', 'heading', 'x'"):
        read(path, base="messages", inputs={}, measured={"heading": "/q.roll"})


@pytest.mark.parametrize(
    ("column", "words"),
    [
        ("/velocty.twist.linear.x", ["topic '/velocty'", "nearest is '/velocity'"]),
        ("/velocity.twist.linaer.x", ["field 'twist.linaer.x'", "nearest is 'twist.linear.x'"]),
        ("/velocity.twist.linear", ["expected a number, found a message", "such as 'x'"]),
        ("/velocity.header.frame_id", ["expected a number, found str 'base'"]),
        ("/velocity.__class__", ["expected the field '__class__'"]),
        ("/velocity.twist.linear.x[0]", ["expected the field 'twist.linear.x[0]'"]),
        ("/rpm.data", ["found an array of 2", "such as [0]"]),
        ("/rpm.data[2]", ["an element [2], found 2 elements"]),
        ("/rpm.data[-1]", ["found '['"]),
        ("/velocity", ["expected a message and its field"]),
    ],
)
def test_defects_of_columns_in_a_bag(bag, column, words):
    assert_told((bag.name, f"column {column!r}", *words), read, bag, measured={"surge": column})


def test_a_second_type_of_messages_on_a_topic_must_have_the_field(tmp_path):
    def text(types):
        return types["std_msgs/msg/String"](data="7")

    sound = "/x", (FLOAT, [(t, number(t)) for t in (0.0, 0.1)])
    bag = write_bag(tmp_path, [sound, ("/x", ("std_msgs/msg/String", [(0.2, text)]))])
    with pytest.raises(InputError, match=r"column '/x\.data': expected a number, found str '7'"):
        read_robot_log(bag, base=0.1, measured={"x": "/x.data"})


ESC = {"RCOU": ("QHH", ["TimeUS", "C1", "C2"]), "ESC": ("QBfc", ["TimeUS", "Instance", "RPM", "V"])}


def dataflash_rows(restart=False):
    rows = []
    for k in range(21):
        late = 40_000 if k == 10 else 0
        rows.append(("RCOU", (1_000_000 + 50_000 * k + late, 1500 + 10 * k, 1500)))
        for which in (0, 1):
            rows.append(("ESC", (1_010_000 + 50_000 * k, which, (1 + which) * 100.0 * k, 1234)))
    if restart:
        rows.append(("ESC", (0, 0, 0.0, 0)))
    return rows


@pytest.fixture
def dataflash(tmp_path):
    pytest.importorskip("pymavlink")
    return write_dataflash(
        tmp_path / "00000042.BIN", ESC, dataflash_rows(), instances={"ESC": "Instance"}
    )


def test_a_dataflash_log_is_read_back(dataflash):
    log = read_robot_log(
        dataflash,
        base="speed",
        inputs={"command": Column("RCOU.C1", unit="us")},
        measured={
            "speed": Column("ESC[1].RPM", unit="rpm", unsigned=True),
            "supply_voltage": Column("ESC[1].V", unit="V"),
        },
    )
    k = np.arange(21)
    np.testing.assert_allclose(log.time, 0.01 + 0.05 * k, atol=1e-9)
    np.testing.assert_allclose(log.values("speed", "rpm"), 200.0 * k)
    held = 1500 + 10 * np.where(k == 10, 9, k)  # the tenth came 40 ms late
    np.testing.assert_allclose(log.values("command", "us"), held, atol=1e-9)
    np.testing.assert_allclose(log.measured["supply_voltage"], 12.34)  # hundredths in the file
    assert log.unsigned == {"speed"}
    assert any("largest gap 0.09 s at " in note for note in log.notes)


@pytest.mark.parametrize(
    ("column", "words"),
    [
        ("ESC.RPM", ["several 'ESC': '0', '1'", "such as 'ESC[0].RPM'"]),
        ("ESC[7].RPM", ["found the instances '0', '1'"]),
        ("ESD[0].RPM", ["expected the message 'ESD'", "nearest is 'ESC'"]),
        ("ESC[0].RPMs", ["field 'RPMs'", "nearest is 'RPM'"]),
        ("ESC[0].RPM[1]", ["expected an element [1], found '0.0'"]),
        ("ESC[0].a.b", ["expected the field 'a.b', found 'RPM', 'V'"]),
        ("FMT.Name", ["no time stamp"]),
    ],
)
def test_defects_of_columns_in_a_dataflash_log(dataflash, column, words):
    asked = {"base": 0.05, "measured": {"speed": column}}
    assert_told((dataflash.name, *words), read_robot_log, dataflash, **asked)


def test_damage_in_a_dataflash_log_is_told(tmp_path):
    pytest.importorskip("pymavlink")
    path = write_dataflash(tmp_path / "a.bin", ESC, dataflash_rows())
    whole = path.read_bytes()
    path.write_bytes(whole[:-918] + b"\0\0\0" + whole[-918:])  # between two messages
    log = read_robot_log(path, base="command", inputs={}, measured={"command": "RCOU.C2"})
    at = len(whole) - 918
    assert any(f"damaged in 1 place (at byte {at}: 3 bytes are no" in note for note in log.notes)


def test_a_clock_that_was_restarted(tmp_path):
    pytest.importorskip("pymavlink")
    path = write_dataflash(tmp_path / "a.bin", ESC, dataflash_rows(restart=True))
    with pytest.raises(InputError, match=r"message 43: the clock steps back by 2\.01 s"):
        read_robot_log(path, base=0.05, measured={"speed": "ESC.RPM"})


@pytest.fixture
def telemetry(tmp_path):
    pytest.importorskip("pymavlink")
    messages = []
    for k in range(21):
        yaw = (3.0 + 0.05 * k + np.pi) % (2 * np.pi) - np.pi  # over pi, to -pi
        messages.append((0.1 * k, 1, attitude(yaw)))
        messages.append((0.1 * k + 0.03, 255, attitude(0.5)))
        if k % 2 == 0:
            messages.append((0.1 * k + 0.05, 1, servos(1500 + k if k < 20 else 65535)))
    return write_telemetry(tmp_path / "run.tlog", messages)


def read_yaw(path, column="1/ATTITUDE.yaw", **more):
    inputs = {"command": Column("SERVO_OUTPUT_RAW.servo1_raw", unit="us")}
    heading = {"heading": Column(column, unit="rad")}
    return read_robot_log(path, base="heading", inputs=inputs, measured=heading, **more)


def test_a_telemetry_log_is_read_back(telemetry):
    log = read_yaw(telemetry, missing_values=[65535])
    np.testing.assert_allclose(log.time, 0.1 * np.arange(1, 21), atol=1e-6)
    # an angle runs on across its jump
    np.testing.assert_allclose(log.measured["heading"], 3.0 + 0.5 * log.time, atol=1e-6)
    sent = 1500 + 2 * np.minimum(np.floor((log.time - 0.05) / 0.2 + 1e-6), 9)
    np.testing.assert_allclose(log.values("command", "us"), sent, atol=1e-9)
    assert any("1 of 11 messages held no number" in note for note in log.notes)
    assert any("1 jumps of a full turn" in note for note in log.notes)


def test_damaged_telemetry_is_read_as_far_as_it_goes(telemetry):
    whole = telemetry.read_bytes()
    telemetry.write_bytes(b"no message" + whole[:-7])
    log = read_yaw(telemetry)
    assert len(log) == 20
    np.testing.assert_allclose(log.measured["heading"], 3.0 + 0.5 * log.time, atol=1e-6)
    assert any("damaged in 2 places (at byte 0: 10 bytes are no" in note for note in log.notes)
    telemetry.write_bytes(b"no telemetry at all, but text")
    with pytest.raises(InputError, match="expected a telemetry file"):
        read_yaw(telemetry)


@pytest.mark.parametrize(
    ("column", "words"),
    [
        ("ATTITUDE.yaw", ["sent by several", "'1/1', '255/1'", "such as '1/1/ATTITUDE.yaw'"]),
        ("7/ATTITUDE.yaw", ["found none from that sender"]),
        ("1/ATTITUDES.yaw", ["expected the message 'ATTITUDES'", "nearest is 'ATTITUDE'"]),
        ("1/ATTITUDE.jaw", ["field 'jaw'", "nearest is 'yaw'"]),
    ],
)
def test_defects_of_columns_in_a_telemetry_log(telemetry, column, words):
    assert_told(words, read_yaw, telemetry, column)


def one(time, values, place="a.bin, column 'M.x'"):
    return Series(place, np.asarray(time, float), np.asarray(values, float))


def even(series, base, held=(), gap=None, faster=2.0, inputs=()):
    channels = {
        name: replace(each, held=name in held, driving=name in (*held, *inputs))
        for name, each in series.items()
    }
    return resample("a.bin", channels, base, gap, faster)


def test_nothing_is_interpolated_across_long_gaps():
    time = np.array([0.0, 0.1, 0.2, 0.3, 0.9, 1.0, 1.1])
    out = even({"x": one(time, 2 * time)}, 0.05)
    inside = (out.time < 0.3 + 1e-9) | (out.time > 0.9 - 1e-9)
    np.testing.assert_allclose(out.values["x"], np.where(inside, 2 * out.time, np.nan), atol=1e-12)
    assert "11 are missing (gaps above 0.3 s)" in out.notes[-1]
    full = even({"x": one(time, 2 * time)}, 0.05, gap=0.6)
    np.testing.assert_allclose(full.values["x"], 2 * full.time, atol=1e-12)


@given(
    steps=st.lists(st.floats(0.001, 1.0), min_size=2, max_size=40),
    step=st.floats(0.01, 0.5),
    gap=st.floats(0.0, 1.0),
)
@settings(max_examples=100, deadline=None)
def test_a_straight_line_stays_one_up_to_the_gap(steps, step, gap):
    time = np.cumsum(steps)
    try:
        out = even({"x": one(time, 3 * time - 1)}, step, gap=gap, faster=1e9)
    except InputError:
        return
    np.testing.assert_allclose(np.diff(out.time), step)
    assert out.time[0] == time[0]
    assert out.time[-1] <= time[-1] + 1e-8
    known = np.isfinite(out.values["x"])
    np.testing.assert_allclose(out.values["x"][known], 3 * out.time[known] - 1, atol=1e-6)
    after = np.clip(np.searchsorted(time, out.time - 1e-9), 1, time.size - 1)
    width = time[after] - time[after - 1]
    exact = np.min(np.abs(out.time[:, None] - time[None, :]), axis=1) <= 1e-9
    assert known[(width < gap - 1e-8) | exact].all()
    assert not known[(width > gap + 1e-8) & ~exact].any()


def test_a_base_that_is_too_fast_is_refused_unless_asked_for():
    series = {"x": one(np.arange(10.0), np.arange(10.0))}
    with pytest.raises(InputError) as caught:
        even(series, 0.25)
    assert "4 samples of each message, expected at most 2" in caught.value.problem
    assert "faster = 4" in caught.value.mend
    assert even(series, 0.25, faster=4).time.size == 37
    assert even(series, 0.5).time.size == 19


def test_a_faster_channel_is_read_between_and_it_is_said():
    time = np.arange(0, 1, 0.01)
    out = even({"x": one(time, time), "y": one([0.0, 0.5, 0.9], [0, 1, 2])}, "y")
    assert "content above half the base's rate is aliased" in out.notes[1]


def test_on_all_messages_nothing_is_made_up():
    series = {
        "u": one([0.0, 0.1, 0.25, 0.3], [1, 1, 2, 3]),  # what comes again unchanged is no change
        "w": one([0.05, 0.35], [0.5, 3.5]),
        "x": one([0.02, 0.12, 0.25, 0.32, 0.42], [1, 2, 3, 4, 5]),
    }
    out = even(series, "messages", held=["u"], inputs=["w"])
    np.testing.assert_allclose(out.time, [0.05, 0.12, 0.25, 0.3, 0.32, 0.35])
    np.testing.assert_array_equal(out.values["u"], [1, 1, 2, 3, 3, 3])
    np.testing.assert_allclose(out.values["w"], 10 * out.time)
    np.testing.assert_array_equal(out.values["x"], [np.nan, 2, 3, np.nan, 4, np.nan])
    assert "the stamps of all messages" in out.notes[0]
    assert "3 samples, each at its own stamp" in out.notes[3]
    assert "late" not in out.notes[1]


def test_a_step_loses_no_change_to_rounding():
    commands = one(np.arange(1000) / 10, np.arange(1000))
    out = even({"u": commands, "x": one([0.0, 99.9], [0, 1])}, 0.1, held=["u"], gap=100, faster=1e4)
    np.testing.assert_array_equal(out.values["u"], np.arange(1000))


def test_inputs_are_known_at_every_sample():
    series = {
        "u": one([0.3], [7.0]),
        "w": one([0.1, 0.5, 0.8], [1, 5, 8]),
        "x": one(np.arange(11) / 10, np.zeros(11)),
    }
    out = even(series, "x", held=["u"], inputs=["w"], faster=4)
    np.testing.assert_allclose(out.time, [0.3, 0.4, 0.5, 0.6, 0.7, 0.8])
    np.testing.assert_allclose(out.values["w"], 10 * out.time)
    np.testing.assert_array_equal(out.values["u"], 7)
    assert "5 were cut, where an input is not known" in out.notes[0]
    assert "input 'u': one message" in out.notes[1]
    with pytest.raises(InputError, match="no time in common"):
        even({**series, "u": one([2.0], [7.0])}, "x", held=["u"], faster=4)


@pytest.mark.parametrize("base", ["sped", 0, -1.0, float("nan"), True, None, 1e-9])
def test_bases_that_are_none(base):
    with pytest.raises(InputError):
        even({"speed": one([0, 1, 2], [0, 1, 2])}, base, faster=1e12)


def test_samples_are_put_in_order_and_doubles_taken_out():
    stamps, values = [0, 20, 10, 30, 30, 40], [0.0, 2, 1, 9, 3, np.nan]
    got = series_of("a.bin", "M.x", [s * 10**6 for s in stamps], values, 0)
    np.testing.assert_allclose(got.time, [0, 0.01, 0.02, 0.03])
    np.testing.assert_array_equal(got.values, [0, 1, 2, 3])
    assert len(got.notes) == 3
    with pytest.raises(InputError, match="message 2: expected a finite number"):
        series_of("a.bin", "M.x", [0, 1], [0, np.inf], 0)
    with pytest.raises(InputError, match="found none in 2 messages"):
        series_of("a.bin", "M.x", [0, 1], [np.nan, 5], 0, missing=[5.0])


@pytest.mark.parametrize(
    ("name", "library", "extra"),
    [
        ("a.db3", "rosbags", "ros"),
        ("a.tlog", "pymavlink", "ardupilot"),
        ("a.ulg", "pyulog", "px4"),
    ],
)
def test_a_library_that_is_not_installed(tmp_path, monkeypatch, name, library, extra):
    (tmp_path / name).write_bytes(b"\0" * 100)
    real = builtins.__import__

    def without(wanted, *rest):
        if wanted.startswith(library):
            raise ImportError(f"no {wanted}", name=wanted)
        return real(wanted, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(InputError, match=f"needs {library}") as caught:
        read_robot_log(tmp_path / name, base=0.1, measured={"speed": "A.b"})
    assert caught.value.mend.endswith(f"pip install 'diffthrust[{extra}]'.")
    with pytest.raises(InputError, match=f"needs {library}"):
        contents(tmp_path / name)


def test_a_recording_that_was_cut_off_names_what_saves_it(tmp_path):
    pytest.importorskip("rosbags")
    topics = {"/cmd": ("std_msgs/msg/Float64", [(0.1 * k, number(k)) for k in range(50)])}
    whole = next(write_bag(tmp_path, topics, "mcap").glob("*.mcap")).read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match=r"cut\.mcap.*cut off[\s\S]*mcap recover"):
        read_robot_log(tmp_path / "cut.mcap", base=0.1, inputs={"command": "/cmd.data"})


@pytest.mark.parametrize("content", [b"", b"x" * 1000, b"\xa3\x95\x80" * 50])
@pytest.mark.parametrize("name", ["a.mcap", "a.db3", "a.bin", "a.tlog"])
def test_damaged_files(tmp_path, name, content):
    pytest.importorskip("rosbags")
    pytest.importorskip("pymavlink")
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=name.replace(".", r"\.")):
        read_robot_log(tmp_path / name, base=0.1, measured={"speed": "/A.b"})


def test_arguments_that_cannot_be_used(tmp_path):
    (tmp_path / "a.bin").write_bytes(b"\xa3\x95\x80")
    (tmp_path / "empty.bin").write_bytes(b"")
    (tmp_path / "a.csv").write_text("t,u\n0,1\n")
    for more, words in [
        ({"path": tmp_path / "b.bin"}, "expected a file, found none"),
        ({"path": tmp_path / "a.csv"}, "read by read_log"),
        ({"path": tmp_path / "empty.bin"}, "found an empty file"),
        ({"path": tmp_path}, "found a folder"),
        ({"gap": -1}, "expected gap"),
        ({"faster": 0.5}, "expected faster as a number of at least 1"),
        ({"stamps": "message"}, "stamps 'recorder' or 'header'"),
        ({"stamps": "header"}, "only ROS bags"),
        ({"missing_values": ["n/a"]}, "expected numbers as missing_values"),
        ({"measured": {}}, "none named"),
        ({"stop": "1"}, "expected stop"),
    ]:
        arguments = {"path": tmp_path / "a.bin", "base": 0.1, "measured": {"x": "A.b"}, **more}
        with pytest.raises(InputError, match=words):
            read_robot_log(**arguments)
    with pytest.raises(InputError, match="found an ArduPilot DataFlash log") as caught:
        read_log(tmp_path / "a.bin", measured={"x": "A.b"})
    assert "read_robot_log" in caught.value.mend


SPEC = """
model = "thruster"
[logs]
train = ["{bag}"]
base = "speed"
stop = 2.0
[channels.command]
column = "/cmd.data"
unit = "V"
[channels.speed]
column = "/rpm.data[0]"
unit = "rad/s"
"""


@pytest.fixture
def spec(tmp_path):
    pytest.importorskip("rosbags")
    steps = [(0.5 * k, number(2.0 if k % 2 else -1.0)) for k in range(6)]
    time = np.arange(0.0, 3.0, 0.02)
    write_bag(
        tmp_path,
        {"/cmd": (FLOAT, steps), "/rpm": (ARRAY, [(t, numbers([20 * np.sin(t)])) for t in time])},
        storage="mcap",
        name="run",
    )
    (tmp_path / "fit.toml").write_text(SPEC.format(bag="run"))
    return tmp_path / "fit.toml"


def test_a_spec_file_reads_a_bag(spec):
    (log,) = load_spec(spec).train_logs()
    assert log.duration == pytest.approx(2.0)
    np.testing.assert_allclose(log.measured["speed"], 20 * np.sin(log.time), atol=1e-9)
    spec.write_text(SPEC.format(bag="run/*.mcap"))
    assert len(load_spec(spec).train_logs()) == 1


def test_a_fit_on_all_messages_is_not_biased_by_late_inputs(spec):
    """On the stamps of the speed the same fit is wrong by 6 and 3 %, twenty standard errors."""
    true = Thruster().replace(alpha=0.03, beta=50.0)
    time = np.arange(0.0, 6.0, 0.001)
    command = np.repeat(np.random.default_rng(1).uniform(-5, 5, 12), 500)
    speed = simulate(true, Log(time, {"command": command}, {"speed": 0 * time}))["speed"]
    steps = [(time[k], number(command[k])) for k in range(0, time.size, 100)]
    turns = [(time[k], numbers([speed[k]])) for k in range(19, time.size, 20)]
    write_bag(spec.parent, {"/cmd": (FLOAT, steps), "/rpm": (ARRAY, turns)}, name="made")
    text = SPEC.format(bag="made").replace("stop = 2.0\n", "")
    text = text.replace('base = "speed"', 'base = "messages"')
    spec.write_text(text + "[fit]\nstarts = 1\n")
    fit = load_spec(spec).fit()
    assert fit.parameters["alpha"].value == pytest.approx(0.03, rel=2e-3)
    assert fit.parameters["beta"].value == pytest.approx(50.0, rel=2e-3)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('base = "speed"', "", ["line 3, logs.base", "no time base is chosen"]),
        ('base = "speed"', 'time = "t"', ["line 5, logs.time", "a log of messages"]),
        ('base = "speed"', "base = -1", ["expected a channel or a step above zero"]),
        ("stop = 2.0", 'stamps = "sent"', ["line 6, logs.stamps"]),
        ("/rpm.data[0]", "/rpn.data[0]", ["nearest is '/rpm'", "line 11"]),
        ('"run"', '"runn"', ["expected the file 'runn'"]),
    ],
)
def test_defects_of_a_spec_file_for_a_bag(spec, old, new, words):
    spec.write_text(spec.read_text().replace(old, new))
    assert_told(words, lambda: load_spec(spec).train_logs())


def test_a_time_base_is_refused_for_a_table(spec):
    (spec.parent / "run.csv").write_text("time,/cmd.data,/rpm.data[0]\n0,1,0\n1,1,1\n")
    spec.write_text(spec.read_text().replace('"run"', '"run.csv"'))
    with pytest.raises(InputError, match=r"run\.csv is a table, for which 'base' has no meaning"):
        load_spec(spec).train_logs()

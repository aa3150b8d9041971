"""Everything in a file is listed by the names that the readers take, whatever is broken in it."""

import io
import sqlite3
import struct
from contextlib import suppress

import numpy as np
import pandas as pd
import pytest
from file_contents import contents

from diffthrust import Column, InputError, read_log, read_robot_log
from tests.damaged_files import outcomes
from tests.robot_files import (
    START,
    attitude,
    number,
    numbers,
    orientation,
    servos,
    twist,
    twist_1,
    write_bag,
    write_bag_1,
    write_dataflash,
    write_telemetry,
)

FLOAT, ARRAY = "std_msgs/msg/Float64", "std_msgs/msg/Float64MultiArray"
TWIST, QUATERNION = "geometry_msgs/msg/TwistStamped", "geometry_msgs/msg/Quaternion"
T = np.arange(12) / 10


def fields(path, **more):
    return {field.name: field for field in contents(path, **more).fields}


def test_columns_of_text_with_words_units_dates_and_remarks(tmp_path):
    rows = [f"2025-01-02 10:00:{k:02},{k % 3},{60 + k},MANUAL,{k}" for k in range(12)]
    rows[4] = rows[4].replace(",64,", ",n/a,")
    path = tmp_path / "run.csv"
    path.write_text("\n".join(["stamp,u [V],rpm,mode,rpm", "-,-,1/min,-,-", *rows, ""]))
    found = contents(path)
    assert (found.kind, found.messages, found.path) == ("CSV table", False, path)
    by_name = {field.name: field for field in found.fields}
    assert by_name["stamp"].dates
    np.testing.assert_allclose(by_name["stamp"].values, range(12))
    assert by_name["u [V]"].unit == "V"
    assert by_name["rpm"].unit == "rpm"
    assert by_name["rpm"].text == "n/a"
    assert np.flatnonzero(np.isnan(by_name["rpm"].values)).tolist() == [4]
    assert by_name["mode"].text == "MANUAL"
    assert np.isnan(by_name["mode"].values).all()
    assert "several columns are named 'rpm': only the first is listed." in found.notes
    assert all(field.time is None for field in found.fields)


def test_rows_that_do_not_fit_are_cut_and_filled(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text('t,u\n0,1\n0.1\n0.2,1,5\n0.3,"2\n0.4,2\n')
    np.testing.assert_array_equal(fields(path)["t"].values, [0, 0.1, 0.2, 0.3, 0.4])


@pytest.mark.parametrize("delimiter", [",", ";", "\t", " "])
@pytest.mark.parametrize("comma", [True, False])
def test_the_delimiter_is_found_without_names(tmp_path, delimiter, comma):
    if comma and delimiter == ",":
        pytest.skip("such a file is no table")
    path = tmp_path / "run.txt"
    text = "".join(f"{t}|{k % 3}.5|{60 + k}\n" for k, t in enumerate(T))
    text = text.replace(".", ",") if comma else text
    path.write_text(("t|u|rpm\n" + text).replace("|", delimiter))
    np.testing.assert_allclose(fields(path)["u"].values, [k % 3 + 0.5 for k in range(12)])


def test_parquet_lists_what_it_cannot_read(tmp_path):
    frame = pd.DataFrame(
        {"t": T, "list": [[1]] * 12, "when": pd.Timestamp(0) + T * pd.Timedelta("1s")}
    )
    frame.to_parquet(tmp_path / "run.parquet")
    found = contents(tmp_path / "run.parquet")
    assert [f.name for f in found.fields] == ["t", "when"]
    assert found.fields[1].dates
    assert "'list' (values of type list<" in found.notes[0]


@pytest.fixture(params=["sqlite3", "mcap", "ros1"])
def bag(request, tmp_path):
    pytest.importorskip("rosbags")
    stamped = twist_1 if request.param == "ros1" else twist
    topics = {
        "/cmd": (FLOAT, [(t, number(t)) for t in T]),
        "/velocity": (TWIST, [(t + 0.01, stamped(2 * t, t)) for t in T]),
        "/rpm": (ARRAY, [(t + 0.02, numbers([60 * t, -60 * t])) for t in T]),
        "/image": (ARRAY, [(t + 0.03, numbers(range(500))) for t in T]),
        "/attitude": (QUATERNION, [(t + 0.04, orientation(0.5 * t)) for t in T]),
    }
    if request.param == "ros1":
        return write_bag_1(tmp_path / "run.bag", topics)
    return write_bag(tmp_path, topics, storage=request.param)


def test_topics_of_a_bag(bag):
    found = contents(bag)
    assert found.messages
    assert found.kind == ("ROS 1 bag" if bag.suffix == ".bag" else "ROS 2 bag")
    by_name = {field.name: field for field in found.fields}
    assert {f"/velocity.twist.{a}.{b}" for a in ("linear", "angular") for b in "xyz"} <= set(
        by_name
    )
    assert {"/cmd.data", "/rpm.data[0]", "/rpm.data[1]", "/attitude.heading"} <= set(by_name)
    assert not any(name.startswith("/image") or "header" in name for name in by_name)
    assert any("'/image'" in note for note in found.notes)
    assert by_name["/velocity.twist.linear.x"].unit == "m/s"
    assert by_name["/velocity.twist.angular.z"].unit == "rad/s"
    assert by_name["/attitude.heading"].unit == "rad"
    np.testing.assert_allclose(by_name["/velocity.twist.linear.x"].time, T + 0.01, atol=1e-9)
    for name, field in by_name.items():  # what is listed can be read by its name
        log = read_robot_log(bag, base="q", measured={"q": name})
        np.testing.assert_allclose(log.measured["q"], field.values)


def test_a_bag_of_ros_1_becomes_a_log(tmp_path):
    pytest.importorskip("rosbags")
    topics = {
        "/cmd": (FLOAT, [(t, number(t)) for t in T]),
        "/velocity": (TWIST, [(t + 0.05, twist_1(2 * t, t)) for t in T]),
    }
    path = write_bag_1(tmp_path / "run.bag", topics)
    channels = dict(inputs={"command": "/cmd.data"}, measured={"v": "/velocity.twist.linear.x"})
    log = read_robot_log(path, base="v", stamps="header", **channels)
    np.testing.assert_allclose(log.time, T, atol=1e-9)
    np.testing.assert_allclose(log.measured["v"], 2 * T)
    other = path.rename(tmp_path / "run.dat")
    with pytest.raises(InputError, match="found a ROS 1 bag") as caught:
        read_robot_log(other, base="v", **channels)
    assert caught.value.mend == "rename it to 'run.bag'."


def test_messages_of_a_dataflash_log(tmp_path):
    pytest.importorskip("pymavlink")
    rows = []
    for k in range(12):
        rows.append(("RCOU", [100_000 * k, 1500 + k]))
        for which in (0, 1):
            rows.append(("ESC", [100_000 * k + 1_000, which, 600.0 * k * (1 - 2 * which)]))
        rows.append(("BAT", [100_000 * k + 2_000, 1_600 + k, "idle"]))
    path = write_dataflash(
        tmp_path / "run.bin",
        {
            "RCOU": ("QH", ["TimeUS", "C1"]),
            "ESC": ("QBf", ["TimeUS", "Instance", "RPM"]),
            "BAT": ("Qcn", ["TimeUS", "Volt", "Mode"]),
            "PARM": ("QNf", ["TimeUS", "Name", "Value"]),
        },
        [("PARM", [0, "X", 1.0]), *rows],
        instances={"ESC": "Instance"},
    )
    by_name = fields(path)
    assert set(by_name) == {"RCOU.C1", "ESC[0].RPM", "ESC[1].RPM", "BAT.Volt"}
    np.testing.assert_allclose(by_name["BAT.Volt"].values, [16 + k / 100 for k in range(12)])
    np.testing.assert_allclose(by_name["ESC[1].RPM"].time, T + 0.001, atol=1e-9)
    for name, field in by_name.items():
        log = read_robot_log(path, base="q", measured={"q": name})
        np.testing.assert_allclose(log.measured["q"], field.values)


def test_a_dataflash_log_reads_as_by_ardupilots_own_library(tmp_path):
    DFReader = pytest.importorskip("pymavlink.DFReader")
    rng = np.random.default_rng(0)
    letters = {"ONE": "bBhHiIqQ", "TWO": "gfdcCeELM"}
    limits = {"b": 100, "B": 200, "h": 30_000, "H": 60_000, "q": 2**40, "Q": 2**40, "g": 100}
    limits |= {"c": 30_000, "C": 60_000, "M": 30}

    def values(codes):
        whole = [int(rng.integers(limits.get(c, 2**30))) for c in codes]
        return [v + 0.5 if c in "gfd" else v for c, v in zip(codes, whole, strict=True)]

    formats = {
        "UNIT": ("QbZ", ["TimeUS", "Id", "Label"]),
        "MULT": ("Qbd", ["TimeUS", "Id", "Mult"]),
        "FMTU": ("QBNN", ["TimeUS", "FmtType", "UnitIds", "MultIds"]),
        **{name: ("Q" + codes, ["TimeUS", *codes]) for name, codes in letters.items()},
        "MIX": ("QNahf", ["TimeUS", "Who", "Spectrum", "Volt", "Turn"]),
    }
    units = {"v": "V", "q": "rpm", "h": "degheading", "z": "furlongs/UNKNOWN"}
    rows = [("UNIT", [0, ord(key), text]) for key, text in units.items()]
    rows += [("MULT", [0, ord(key), v]) for key, v in {"C": 1e-3, "0": 1.0, "E": 1e-2}.items()]
    rows.append(("FMTU", [0, 134, "-#-vh", "--" + "-CE"]))
    rows.append(("FMTU", [0, 132, "-qz", "-00"]))
    for k in range(40):
        rows += [(name, [1000 * k, *values(codes)]) for name, codes in letters.items()]
        rows.append(("MIX", [1000 * k + 7, "AB"[k % 2], "\x01\x02" * 32, k, k / 4]))
    path = write_dataflash(tmp_path / "run.bin", formats, rows)

    by_name = fields(path)
    plain = {f"{name}.{code}" for name, codes in letters.items() for code in codes}
    mixed = {f"MIX[{which}].{c}" for which in "AB" for c in ("Volt", "Turn")}
    assert set(by_name) == plain | mixed
    given = {name: field.unit for name, field in by_name.items() if field.unit}
    assert given == {
        "ONE.b": "rpm",
        **{f"MIX[{which}].{c}": u for which in "AB" for c, u in (("Volt", "mV"), ("Turn", "cdeg"))},
    }
    theirs = DFReader.DFReader_binary(str(path))
    try:
        expected = {name: [] for name in by_name}
        while (message := theirs.recv_match(type=["ONE", "TWO", "MIX"])) is not None:
            head = message.get_type()
            head += f"[{message.Who}]" if head == "MIX" else ""
            for name, held in expected.items():
                if name.startswith(f"{head}."):
                    held.append(getattr(message, name.split(".")[1]))
    finally:
        theirs.filehandle.close()
    for name, field in by_name.items():
        np.testing.assert_array_equal(field.values, expected[name])


def test_messages_of_a_telemetry_log(tmp_path):
    pytest.importorskip("pymavlink")
    messages = []
    for k, t in enumerate(T):
        messages += [(t, 1, attitude(0.1 * k, k)), (t, 2, attitude(-0.1 * k, k))]
        messages.append((t + 0.01, 1, servos(1500 + k)))
    path = write_telemetry(tmp_path / "run.tlog", messages)
    by_name = fields(path)
    assert {"1/1/ATTITUDE.yaw", "2/1/ATTITUDE.yaw", "SERVO_OUTPUT_RAW.servo1_raw"} <= set(by_name)
    assert by_name["1/1/ATTITUDE.yaw"].unit == "rad"
    assert by_name["SERVO_OUTPUT_RAW.servo1_raw"].unit == "us"
    for name in ("2/1/ATTITUDE.yaw", "SERVO_OUTPUT_RAW.servo1_raw"):
        log = read_robot_log(path, base="q", measured={"q": name})
        np.testing.assert_allclose(log.measured["q"], by_name[name].values)


def test_a_cut_bag_is_read_as_far_as_it_goes(tmp_path):
    pytest.importorskip("rosbags")
    topics = {"/cmd": (FLOAT, [(k / 10, number(k)) for k in range(500)])}
    bag = write_bag(tmp_path, topics)
    with sqlite3.connect(next(bag.glob("*.db3"))) as base:
        base.execute("UPDATE messages SET data = x'00' WHERE id = 400")
    base.close()
    found = contents(bag)
    assert any("cannot be read" in note or "damaged" in note for note in found.notes)
    assert found.fields[0].values.size == 399


def test_a_stamp_that_no_clock_gives_ends_a_bag(tmp_path):
    pytest.importorskip("rosbags")
    bag = write_bag(tmp_path, {"/x": (FLOAT, [(t, number(t)) for t in T])}, "mcap")
    path = next(bag.glob("*.mcap"))
    last = struct.pack("<Q", START + round(T[-1] * 1e9))
    path.write_bytes(path.read_bytes().replace(last, struct.pack("<Q", 2**63 + 5)))
    found = contents(path)
    (field,) = found.fields
    assert field.values.size == field.time.size == T.size - 1
    assert "damaged" in found.notes[0]


@pytest.mark.parametrize("kind", ["mcap", "db3", "bag", "bin", "tlog"])
def test_no_change_of_a_byte_ends_in_a_traceback(tmp_path, capfd, kind):
    pytest.importorskip("rosbags")
    pytest.importorskip("pymavlink")
    topics, column = {"/x": (ARRAY, [(t, numbers([t])) for t in T])}, "/x.data[0]"
    if kind in ("mcap", "db3"):
        storage = "mcap" if kind == "mcap" else "sqlite3"
        path = next(write_bag(tmp_path, topics, storage).glob(f"*.{kind}"))
    elif kind == "bag":
        path = write_bag_1(tmp_path / "run.bag", topics)
    elif kind == "tlog":
        path, column = tmp_path / "run.tlog", "ATTITUDE.yaw"
        write_telemetry(path, [(t, 1, attitude(t)) for t in T])
    else:
        path, column = tmp_path / "run.bin", "RCOU.C1"
        rows = [("RCOU", [round(1e6 * t), 1500]) for t in T]
        write_dataflash(path, {"RCOU": ("QH", ["TimeUS", "C1"])}, rows)

    def read(path):
        return read_robot_log(path, base=0.1, measured={"x": column}, faster=100.0)

    sound = path.read_bytes()
    for reader, least in ((contents, 3), (read, 18)):
        path.write_bytes(sound)
        ended = outcomes(path, (reader,), rounds=150)
        assert ended["read"] > least
        # of telemetry all sound messages are listed
        assert ended["told"] > least or (kind == "tlog" and reader is contents)
        assert not ended["unnamed"]
    assert capfd.readouterr().err == ""


def test_files_of_no_kind(tmp_path):
    for content, words in [
        (b"\xff\xd8\xff\xe0\0\x10JFIF\0", "binary data of an unknown format"),
        (b'{"t": [0, 1]}', "JSON"),
        (b"<html><body>404</body></html>", "HTML"),
        (b"\x1f\x8b" + bytes(60), "gzip"),
        (b"\xd0\xcf\x11\xe0" + bytes(600), "old Excel"),
        (b"Dear all,\nthe boat sank.\n", "numbers"),
        (b"", "empty"),
    ]:
        path = tmp_path / "run.dat"
        path.write_bytes(content)
        with pytest.raises(InputError, match=words) as caught:
            contents(path)
        assert caught.value.mend
    with pytest.raises(InputError, match="found none"):
        contents(tmp_path / "absent.csv")
    with pytest.raises(InputError, match="found a folder"):
        contents(tmp_path)


@pytest.mark.thorough
def test_random_changes_of_text_end_in_contents_or_a_message(tmp_path):
    rng = np.random.default_rng(0)
    buffer = io.StringIO()
    pd.DataFrame({"time": T, "u [V]": T, "rpm": 60 * T}).to_csv(buffer, index=False)
    good = buffer.getvalue().encode()
    pieces = [b",", b"\n", b";", b'"', b"#", b"nan", b"03/04/2025", b"\xff", b"1e400", b"\t", b" "]
    for _ in range(150):
        data = bytearray(good)
        for _ in range(int(rng.integers(1, 8))):
            at = int(rng.integers(len(data)))
            data[at : at + int(rng.integers(3))] = pieces[int(rng.integers(len(pieces)))]
        (tmp_path / "run.csv").write_bytes(data)
        with suppress(InputError):
            found = contents(tmp_path / "run.csv")
            assert len({field.values.shape for field in found.fields}) == 1


def test_what_the_header_says_must_not_be_passed_over(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("t (ms),n [rpm]\n" + "".join(f"{100 * k},{60 * k}\n" for k in range(5)))
    with pytest.raises(InputError) as caught:
        read_log(path, time="t (ms)", measured={"speed": Column("n [rpm]", unit="rpm")})
    assert "the file says 'ms'" in caught.value.problem
    assert "Column('t (ms)', unit='ms')" in caught.value.mend
    time = Column("t (ms)", unit="ms")
    with pytest.raises(InputError, match="the file says 'rpm'"):
        read_log(path, time=time, measured={"speed": "n [rpm]"})
    log = read_log(path, time=time, measured={"speed": Column("n [rpm]", unit="rad/s")})
    assert log.notes == ("'speed': the file says 'rpm' of 'n [rpm]', read in 'rad/s'.",)


def test_text_of_a_second_type_on_a_topic_is_no_number(tmp_path):
    """The text "7" between numbers was listed as the number 7."""

    def text(types):
        return types["std_msgs/msg/String"](data="7")

    first = "/x", (FLOAT, [(t, number(t)) for t in (0.0, 0.1)])
    bag = write_bag(tmp_path, [first, ("/x", ("std_msgs/msg/String", [(0.2, text)]))])
    np.testing.assert_array_equal(fields(bag)["/x.data"].values, [0.0, 0.1, np.nan])

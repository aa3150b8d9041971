import errno
import io
import os
import struct
import time as clock
from fractions import Fraction
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import scipy.sparse
from scipy.io import savemat
from text_readers import in_blocks

from diffthrust import Column, InputError, look, read_log
from tests.shared_data import data_folder

NAN = float("nan")
GOOD = "t,u,rpm\n0,0,0\n0.1,1,60\n0.2,2,90\n0.4,2,120\n"


def write(tmp_path, content, name="run3.csv"):
    path = tmp_path / name
    if isinstance(content, str):
        content = content.encode()
    path.write_bytes(content)
    return path


def read(path, **more):
    given = dict(time="t", inputs={"command": "u"}, measured={"speed": Column("rpm", unit="rpm")})
    return read_log(path, **{**given, **more})


def check_good(log):
    np.testing.assert_array_equal(log.time, [0, 0.1, 0.2, 0.4])
    np.testing.assert_array_equal(log.inputs["command"], [0, 1, 2, 2])
    np.testing.assert_allclose(log.values("speed", "rev/s"), [0, 1, 1.5, 2])


@pytest.mark.parametrize(
    "content",
    [
        GOOD,
        GOOD.rstrip("\n"),
        GOOD.replace(",", ";"),
        GOOD.replace(",", "\t"),
        GOOD.replace(",", "   "),
        GOOD.replace(",", " , "),
        GOOD.replace("\n", "\r\n"),
        GOOD.replace("\n", "\r"),
        GOOD.replace("t,u,rpm", '"t","u","rpm"'),
        GOOD.replace("0.1,1,60", '"0.1","1","60"'),
        GOOD.replace(",", ";").replace(".", ","),
        GOOD.replace(",", "\t").replace(".", ","),
        "# a comment\n\n" + GOOD,
        "# " + GOOD,
        GOOD.replace("0.2,2,90", "# in between, with commas\n0.2,2,90"),
        GOOD.replace("t,u,rpm", "t,u,rpm,note").replace("0\n", "0,hello\n"),
    ],
)
def test_one_table_in_many_hands(tmp_path, content):
    check_good(read(write(tmp_path, content)))


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "latin-1", "utf-8"])
def test_encodings(tmp_path, encoding):
    content = GOOD.replace("rpm", "Größe [°/s]").encode(encoding)
    log = read(write(tmp_path, content), measured={"yaw_rate": Column("Größe [°/s]", unit="deg/s")})
    np.testing.assert_allclose(log.measured["yaw_rate"], np.deg2rad([0, 60, 90, 120]))


def test_units_scale_noise_hold_and_name(tmp_path):
    log = read(
        write(tmp_path, GOOD),
        time=Column("t", unit="ms"),
        inputs={"command": Column("u", hold="linear", scale=-2.0)},
        measured={"speed": Column("rpm", unit="rpm", unsigned=True, noise=3.0)},
    )
    np.testing.assert_allclose(log.time, [0, 1e-4, 2e-4, 4e-4])
    np.testing.assert_array_equal(log.inputs["command"], [0, -2, -4, -4])
    assert log.hold["command"] == "linear"
    assert log.unsigned == {"speed"}
    assert log.noise_in("speed", "rpm") == pytest.approx(3.0)
    assert log.name == "run3.csv"
    assert log.notes == ()


@pytest.mark.parametrize("blocks", [False, True])
def test_numbers_are_exact_either_way(tmp_path, monkeypatch, blocks):
    if blocks:
        in_blocks(monkeypatch, never_whole=True)
    rng = np.random.default_rng(1)
    numbers = rng.normal(size=2000) * 10.0 ** rng.integers(-30, 30, 2000)
    rows = "".join(f"{k},{float(x)!r},1\n" for k, x in enumerate(numbers))
    log = read(write(tmp_path, "t,u,rpm\n" + rows))
    np.testing.assert_array_equal(log.inputs["command"], numbers)


def test_missing_samples_are_kept_and_counted(tmp_path):
    content = GOOD.replace(",60", ",").replace(",90", ",NaN").replace(",120", ",n/a")
    log = read(write(tmp_path, content), missing_values=["n/a"])
    np.testing.assert_array_equal(np.isnan(log.measured["speed"]), [False, True, True, True])
    assert log.notes == ("measured 'speed': 3 of 4 samples are missing and carry no weight.",)
    content = GOOD.replace(",60", ",-999").replace(",90", ",-999.0")
    for words in (["-999"], "-999"):
        log = read(write(tmp_path, content), missing_values=words)
        assert np.isnan(log.measured["speed"]).sum() == 2


def test_missing_inputs(tmp_path):
    path = write(tmp_path, GOOD.replace("0.2,2", "0.2,"))
    with pytest.raises(InputError) as caught:
        read(path)
    assert "run3.csv, line 4, column 'u'" in caught.value.problem
    assert "interpolate_inputs" in caught.value.mend
    log = read(path, interpolate_inputs=True)
    np.testing.assert_allclose(log.inputs["command"], [0, 1, 1 + 1 / 3, 2])
    assert "1 of 4" in log.notes[0]


def test_blank_rows_are_counted(tmp_path):
    content = GOOD.replace("0.2,2", "\n,,\n0.2,2") + "\n,,\n  \n , ,\n"
    log = read(write(tmp_path, content))
    check_good(log)
    assert log.notes == (
        "4 trailing blank rows were trimmed.",
        "2 blank rows were skipped.",
    )
    with pytest.raises(InputError, match="line 7, column 't'"):
        read(write(tmp_path, content.replace("0.4,2", "0.1,2")))


def test_start_and_stop_are_told(tmp_path):
    path = write(tmp_path, "t,u,rpm\n" + "".join(f"{100 + k / 10},1,2\n" for k in range(50)))
    log = read(path, start=1.0, stop=2.5)
    assert log.time[0] == 101.0
    assert log.time[-1] == 102.5
    assert log.notes == ("34 of 50 samples were cut, those outside 1 s to 2.5 s.",)
    same = read(path, start=Fraction(1), stop=Fraction(5, 2))
    assert (same.notes, same.time.tolist()) == (log.notes, log.time.tolist())
    with pytest.raises(InputError, match=r"lasts 4\.9 s"):
        read(path, start=10.0)
    with pytest.raises(InputError, match="start in seconds"):
        read(path, start=NAN)


def test_what_was_cut_away_may_be_defective(tmp_path):
    content = GOOD.replace("0.4,2", "0.4,")
    assert len(read(write(tmp_path, content), stop=0.2)) == 3


def test_static_table_without_time(tmp_path):
    path = write(tmp_path, "depth_m,reading_V\n0,1.6\n0.3,1.7\n")
    log = read_log(path, time=None, inputs={"position": "depth_m"}, measured={"v": "reading_V"})
    np.testing.assert_array_equal(log.time, [0, 1])


def test_one_column_for_two_channels(tmp_path):
    log = read(write(tmp_path, GOOD), measured={"speed": "rpm", "other": "rpm"})
    np.testing.assert_array_equal(log.measured["speed"], log.measured["other"])


def test_dates_become_seconds(tmp_path):
    content = GOOD
    for second in ("0.1", "0.2", "0.4"):
        content = content.replace(f"\n{second},", f"\n2024-05-01T10:00:0{second}00,")
    content = content.replace("\n0,", "\n2024-05-01 09:59:59.9,")
    log = read(write(tmp_path, content))
    np.testing.assert_allclose(log.time, [0, 0.2, 0.3, 0.5])
    assert "dates" in log.notes[0]
    with pytest.raises(InputError, match="line 4, column 't': expected an ISO date"):
        read(write(tmp_path, content.replace("10:00:00.2", "10:77:00.2")))


@pytest.mark.parametrize(
    ("content", "more", "words"),
    [
        ("", {}, ["empty file"]),
        ("\n \n\n", {}, ["empty file"]),
        ("# only a comment\n", {}, ["empty file"]),
        ("t,u,rpm\n", {}, ["expected samples below the header in line 1"]),
        ("t,u,rpm\n\n,,\n", {}, ["expected samples, found none in 2 rows"]),
        (GOOD.replace("90", "n/a"), {}, ["line 4, column 'rpm'", "a number, found 'n/a'."]),
        ("# c\n" + GOOD.replace("90", "9 0"), {}, ["line 5, column 'rpm'", "'9 0'"]),
        (GOOD.replace("90", "1_000"), {}, ["line 4, column 'rpm'", "'1_000'"]),
        (GOOD.replace("90", "0x1F"), {}, ["line 4, column 'rpm'", "'0x1F'"]),
        (GOOD.replace("90", "True"), {}, ["line 4, column 'rpm'", "'True'"]),
        (GOOD.replace("90", "inf"), {}, ["line 4, column 'rpm'", "found inf"]),
        (GOOD.replace("90", "1e999"), {}, ["line 4, column 'rpm'", "found inf"]),
        (GOOD.replace("0.2,", "0.1,"), {}, ["line 4, column 't'", "the same again"]),
        (GOOD.replace("0.2,", "-3,"), {}, ["line 4, column 't'", "backward"]),
        (GOOD.replace("0.2,", ","), {}, ["line 4, column 't'", "a time stamp, found none"]),
        (GOOD.replace("0.2,", "inf,"), {}, ["line 4, column 't'", "inf"]),
        (GOOD.replace("0.2,2,90", "0.2,2"), {}, ["line 4", "expected 3 cells", "found 2"]),
        (GOOD.replace("0.2,2,90", "0,2,2,90"), {}, ["line 4", "found 4", "semicolons"]),
        (GOOD.replace("90", '"90'), {}, ["line 4", "quotes"]),
        (GOOD.replace("t,u,rpm\n", ""), {}, ["line 1", "names of columns, found numbers"]),
        (GOOD.replace("t,u,rpm", "t,u,u"), {}, ["one column 'u'", "several"]),
        (GOOD.replace("rpm", "RPM"), {}, ["column 'rpm'", "'t', 'u', 'RPM'", "nearest is 'RPM'"]),
        (GOOD, {"time": "time"}, ["column 'time'", "'t', 'u', 'rpm'"]),
        (GOOD, {"time": Column("t", unit="m")}, ["column 't'", "'m'", "'s'"]),
        (GOOD, {"inputs": {"speed": "u"}}, ["'speed'", "twice"]),
        (GOOD, {"inputs": {"time": "u"}}, ["'time'", "twice"]),
        (GOOD, {"inputs": {}, "measured": {}}, ["none named"]),
        (GOOD, {"inputs": {"command": 3}}, ["'command'", "found 3"]),
        (GOOD, {"inputs": {"command": Column("u", scale=0)}}, ["'command'", "scale"]),
        (GOOD, {"inputs": {"command": Column("u", hold="x")}}, ["'command'", "hold"]),
        (GOOD, {"measured": {"speed": Column("rpm", noise=-1)}}, ["column 'rpm'", "-1"]),
        (GOOD, {"measured": {"speed": Column("rpm", unit="Hz")}}, ["column 'rpm'", "ambiguous"]),
        (GOOD, {"measured": {"speed": Column("rpm", unit="rmp")}}, ["column 'rpm'", "'rmp'"]),
        (b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR", {}, ["binary"]),
        (b"\xff\xfet\x00,\x00u\x00", {}, ["column"]),
        (b"\xff\xfe\x00\xd8", {}, ["binary"]),
        (GOOD.replace(",", ";").replace("0.1", "0,1"), {}, ["line 4, column 't'", "'0.2'"]),
    ],
)  # fmt: skip
def test_defects_of_text_files(tmp_path, content, more, words):
    path = write(tmp_path, content)
    with pytest.raises(InputError) as caught:
        read(path, **more)
    message = str(caught.value)
    assert "run3.csv" in message
    for word in words:
        assert word in message
    assert caught.value.mend


def test_message_reads_as_designed(tmp_path):
    with pytest.raises(InputError) as caught:
        read(write(tmp_path, GOOD.replace("90", "n/a")))
    assert str(caught.value) == (
        "run3.csv, line 4, column 'rpm': expected a number, found 'n/a'.\n"
        "Mend: list 'n/a' under [logs] missing_values, or remove the line."
    )


def test_files_that_are_none(tmp_path):
    (tmp_path / "folder.csv").mkdir()
    for name, words in [
        ("absent.csv", "absent.csv: expected a file, found none"),
        ("folder.csv", "found a folder"),
        ("run", "found none"),
        ("null\0.csv", "cannot be opened"),
        ("x" * 5000 + ".csv", "cannot be opened"),
    ]:
        with pytest.raises(InputError, match=words):
            read(tmp_path / name)


def test_a_file_that_its_disk_does_not_give_is_refused(tmp_path, monkeypatch):
    path = write(tmp_path, GOOD)

    def damaged(path):
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(Path, "read_bytes", damaged)  # of a card with bad sectors
    with pytest.raises(InputError, match=r"run3\.csv: the file cannot be opened \(Input/output"):
        read(path)


def test_parquet(tmp_path):
    path = tmp_path / "run.parquet"
    frame = pd.read_csv(io.StringIO(GOOD))
    frame["on"] = [True, False, True, False]
    frame["text"] = ["1", "2.5", "", None]
    frame["word"] = ["1", "2.5", "x", None]
    frame["kind"] = pd.Categorical(["1", "2", "1", "2"])
    frame["big"] = np.array([2**62, 1, 2, 3])
    frame["list"] = [[1], [2], [3], [4]]
    frame["when"] = pd.to_datetime(1_700_000_000 + frame["t"], unit="s", utc=True)
    frame["since"] = pd.to_timedelta(frame["t"], unit="s")
    frame.to_parquet(path)
    check_good(read(path))
    for column, expected in [
        ("on", [1, 0, 1, 0]), ("text", [1, 2.5, NAN, NAN]), ("kind", [1, 2, 1, 2]),
        ("big", [2.0**62, 1, 2, 3]),
    ]:  # fmt: skip
        log = read(path, measured={"q": column})
        np.testing.assert_array_equal(log.measured["q"], expected)
    for column in ("when", "since"):
        log = read(path, time=column)
        np.testing.assert_allclose(log.time, frame["t"], atol=1e-6)
        assert "dates" in log.notes[0]
    for column, words in [
        ("word", "run.parquet, row 3, column 'word': expected a number, found 'x'"),
        ("list", "run.parquet, column 'list': expected numbers"),
        ("when", "run.parquet, column 'when': expected numbers"),
        ("rpn", "the nearest is 'rpm'"),
    ]:
        with pytest.raises(InputError, match=words):
            read(path, measured={"q": column})


def test_parquet_defects(tmp_path):
    path = tmp_path / "run.parquet"
    columns = [pa.array([0.0, 1.0, 1.0]), pa.array([1.0, None, 1.0]), pa.array([1.0, 1.0, 1.0])]
    pq.write_table(pa.table(columns, names=["t", "u", "rpm"]), path)
    with pytest.raises(InputError, match="row 3, column 't'"):
        read(path)
    pq.write_table(pa.table(columns, names=["t", "u", "u"]), path)
    with pytest.raises(InputError, match="several"):
        read(path, measured={})
    pq.write_table(pa.table([c.slice(0, 0) for c in columns], names=["t", "u", "rpm"]), path)
    with pytest.raises(InputError, match="found none"):
        read(path)
    for content in (b"", b"PAR1", b"PAR1" * 100, b"\0" * 100):
        with pytest.raises(InputError, match=r"run\.parquet"):
            read(write(tmp_path, content, "run.parquet"))


def test_mat(tmp_path):
    path = tmp_path / "run.mat"
    columns = {
        "t": np.array([[0, 0.1, 0.2, 0.4]]),
        "u": np.array([[0], [1], [2], [2]], dtype=np.int8),
        "rpm": np.array([[0.0, 60, 90, 120]]),
    }
    for version in ({"format": "5"}, {"format": "4"}, {"do_compression": True}):
        savemat(path, columns, **version)
        check_good(read(path))
    savemat(path, {"t": columns["t"], "run": {"cmd": columns["u"], "out": {"n": columns["rpm"]}}})
    check_good(
        read(
            path, inputs={"command": "run.cmd"}, measured={"speed": Column("run.out.n", unit="rpm")}
        )
    )
    with pytest.raises(InputError, match=r"'t', 'run\.cmd', 'run\.out\.n'"):
        read(path)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (np.ones((2, 4)), "shape"),
        (np.ones(5), "expected 4 samples as in 't', found 5"),
        ("four", "found text"),
        (np.array([1, 2, 3, 4j]), "found complex numbers"),
        (np.array([[1], "a", [2, 3], 1.0], dtype=object), "found a cell array"),
        (scipy.sparse.eye_array(4).tocsc(), "found a sparse matrix"),
        (np.array([(1,), (2,)], dtype=[("a", float)]), "found an array of structs"),
        ({"a": 1}, "expected a variable 'rpm'"),
        (np.zeros((0, 0)), "shape|found 0"),
        (np.array([1, 2, np.inf, 4]), "element 3, variable 'rpm': expected a finite"),
    ],
)
def test_mat_defects(tmp_path, value, words):
    path = tmp_path / "run.mat"
    savemat(path, {"t": np.arange(4.0), "u": np.arange(4.0), "rpm": value})
    with pytest.raises(InputError, match=words):
        read(path)


@pytest.mark.parametrize("dtype", ["f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "?"])
@pytest.mark.parametrize("compressed", [True, False])
def test_mat_numbers_of_every_type(tmp_path, dtype, compressed):
    path = tmp_path / "run.mat"
    numbers = np.array([0, 1, 1, 0, 1]).astype(dtype)
    others = {"matrix": np.ones((2, 3)), "text": "abc", "empty": {}, "long_name" * 3: 1}
    savemat(path, {**others, "t": np.arange(5), "u": numbers}, do_compression=compressed)
    log = read(path, measured={})
    np.testing.assert_array_equal(log.inputs["command"], [0, 1, 1, 0, 1])


def test_mat_written_elsewhere_in_the_other_byte_order(tmp_path):
    def element(kind, content):
        return struct.pack(">II", kind, len(content)) + content + b"\0" * (-len(content) % 8)

    file = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack(">H", 0x0100) + b"MI"
    for name, values in {"t": [0, 1, 2], "u": [5, 6, 7]}.items():
        file += element(
            14,
            element(6, struct.pack(">II", 6, 0))
            + element(5, struct.pack(">ii", 3, 1))
            + struct.pack(">HH4s", 1, 1, name.encode())
            + element(3, struct.pack(">3h", *values)),
        )
    log = read(write(tmp_path, file, "run.mat"), measured={})
    np.testing.assert_array_equal(log.time, [0, 1, 2])
    np.testing.assert_array_equal(log.inputs["command"], [5, 6, 7])


@pytest.mark.slow
def test_a_million_rows_are_read_in_seconds(tmp_path):
    rng = np.random.default_rng(0)
    frame = pd.DataFrame({"t": np.arange(10**6) / 100, "u": rng.normal(size=10**6)})
    frame["rpm"] = 1.0
    path = write(tmp_path, frame.to_csv(index=False))
    begun = clock.perf_counter()
    log = read(path)
    assert clock.perf_counter() - begun < 30  # some 2 s, on a machine with nothing else to do
    np.testing.assert_array_equal(log.inputs["command"], frame["u"])


def test_ngs_thruster_logs_are_read_as_they_are():
    paths = sorted(data_folder("ngs_thruster").glob("CL*.csv"))
    assert len(paths) == 18
    for path in paths:
        log = read_log(
            path,
            time="time_s",
            inputs={"command": Column("command_V", unit="V")},
            measured={
                "speed": Column("tach_rad_s", unit="rad/s", unsigned=True),
                "thrust": Column("thrust_N", unit="N"),
            },
        )
        frame = pd.read_csv(path)
        np.testing.assert_allclose(log.measured["thrust"], frame["thrust_N"], rtol=1e-15)
        assert log.step == pytest.approx(0.04)


def test_blueboat_logs_are_read_as_they_are():
    paths = sorted(data_folder("blueboat").glob("*.csv"))
    assert len(paths) == 12
    for path in paths:
        log = read_log(
            path,
            time=Column("original_timestamp", unit="ms"),
            inputs={
                "left": Column("thr_left", unit="us"),
                "left_force": Column("left_force", unit="N"),
                "right_force": Column("right_force", unit="N"),
            },
            measured={
                "surge": "surge",
                "sway": "sway",
                "yaw_rate": Column("yaw_rate", unit="rad/s"),
                "heading": Column("yaw", unit="deg"),
            },
        )
        frame = pd.read_csv(path)
        assert len(log) == len(frame)
        assert np.isnan(log.measured["surge"]).sum() == frame["surge"].isna().sum()
        assert log.step == pytest.approx(0.1, rel=0.01)
        assert 1000 < log.values("left", "us").mean() < 2000


@pytest.mark.thorough
def test_esso_osaka_logs_are_read_as_they_are():
    paths = sorted(data_folder("esso_osaka").glob("*.csv"))
    assert len(paths) == 27
    for path in paths:
        log = read_log(
            path,
            time="t [s]",
            inputs={
                "propeller_speed": Column("n_prop [rps]", unit="rps"),
                "rudder_angle": Column("delta_rudder [rad]", unit="rad"),
            },
            measured={
                "surge": Column("u_velo [m/s]", unit="m/s"),
                "sway": Column("vm_velo [m/s]", unit="m/s"),
                "yaw_rate": Column("r_angvelo [rad/s]", unit="rad/s"),
            },
            stop=150.0,
        )
        assert log.duration <= 150.0 + 1e-6
        assert log.step == pytest.approx(0.1)
        assert log.units["propeller_speed"] == "rev/s"


def test_emps_logs_are_read_as_they_are():
    paths = sorted(data_folder("emps").glob("*.csv"))
    assert len(paths) == 2
    for path in paths:
        log = read_log(
            path, time="time_exp", inputs={"force": "u_in"}, measured={"position": "q_meas"}
        )
        assert len(log) > 4000
        assert log.step == pytest.approx(0.005, rel=1e-3)


@pytest.mark.parametrize(
    ("content", "notes"),
    [
        ("Logger 7\nDate: 2025-01-02\n\n" + GOOD, "2 lines were skipped: the header is line 4."),
        ("sep=;\n" + GOOD.replace(",", ";"), "a line was skipped: the header is line 2."),
        (GOOD.replace("0,0,", "s,V,rpm\n0,0,"), "line 2 was skipped: it holds units (s, V, rpm)."),
        (GOOD.replace("m\n", "m\n[s],,-\n"), "line 2 was skipped: it holds units ([s], , -)."),
        (GOOD + "0.5,1", "line 6, the last, was skipped: it is cut off."),
        (GOOD + "0.4,2,120\n", "a row was skipped: written twice."),
        (GOOD + "\0" * 5000, "5000 bytes of zeros at the end were skipped."),
        (GOOD.replace("\n", ",\n"), None),
        (GOOD.replace("\n", ",\n").replace("rpm,", "rpm"), None),
        (GOOD.replace("0.1,", '"0,1",'), "column 't': decimal commas were read as decimal points."),
    ],
)  # fmt: skip
def test_what_strangers_leave_in_their_files_is_read_and_told(tmp_path, content, notes):
    if "decimal commas" in (notes or ""):
        content = content.replace("0.2,2", '"0,2",2').replace("0.4,2", '"0,4",2')
    log = read(write(tmp_path, content))
    check_good(log)
    assert log.notes == (() if notes is None else (notes,))


def test_what_a_file_is_its_content_says_and_not_its_ending(tmp_path):
    for name in ("run.log", "run.dat", "run", "run.xlsx", "run.parquet", "run.mat", "run.bin"):
        check_good(read(write(tmp_path, GOOD, name)))
    pd.read_csv(io.StringIO(GOOD)).to_parquet(tmp_path / "run.csv")
    check_good(read(tmp_path / "run.csv"))


def test_a_header_that_is_not_the_line_above_the_numbers_is_found_by_its_names(tmp_path):
    content = GOOD.replace("rpm\n", "rpm\nseconds since start,volts at the drive,of the shaft\n")
    log = read(write(tmp_path, content))
    check_good(log)
    cells = "seconds since start, volts at the dri..."
    assert log.notes == (f"line 2 was skipped: it holds more names ({cells}).",)
    with_units = content.replace("shaft\n", "shaft\ns,V,rpm\n")
    log = read(write(tmp_path, with_units))
    check_good(log)
    assert log.notes[1] == "line 3 was skipped: it holds units (s, V, rpm)."
    missing = GOOD.replace("0,0,0", "0,unknown,unknown")  # a sample, and not names
    with pytest.raises(InputError, match="line 2, column 'u': expected a number, found 'unknown'"):
        read(write(tmp_path, missing))
    with pytest.raises(InputError, match="line 2, column 't': expected a number, found 'none'"):
        read(write(tmp_path, GOOD.replace("0,0,0", "none,none,none")))


def test_a_log_whose_long_names_repeat_below_the_short_ones_is_looked_at_by_these(tmp_path):
    """The four azimuths of a SWAMP are all "azimuth_angle" there."""
    rows = "".join(f"{k / 10},{k},{-k}\n" for k in range(30))
    path = write(tmp_path, "t,left_deg,right_deg\ntime,azimuth,azimuth\n" + rows)
    assert [column.name for column in look(path).columns] == ["t", "left_deg", "right_deg"]


def test_long_names_below_names_with_units_do_not_hide_these(tmp_path):
    rows = "".join(f"{k / 10},{k},{-k}\n" for k in range(30))
    names = "time_s,speed_rpm,thrust_kgf\ntime,propeller speed,measured thrust\n"
    columns = look(write(tmp_path, names + rows)).columns
    assert [column.name for column in columns] == ["time_s", "speed_rpm", "thrust_kgf"]
    assert [column.unit for column in columns] == ["s", "rpm", "kgf"]


@pytest.mark.parametrize(
    "above",
    [
        "clock,motor,cell", "Supply voltage,16 V,", "Motor A,Motor A,Motor A", "(s),(rpm),(N)",
        "Test,Phase A,Phase B", "Run,Motor A,Motor A",
    ],
)  # fmt: skip
def test_groups_values_and_units_above_the_names_are_not_the_header(tmp_path, above):
    rows = "".join(f"{k / 10},{k},{-k}\n" for k in range(30))
    columns = look(write(tmp_path, f"{above}\ntime,speed,thrust\n" + rows)).columns
    assert [column.name for column in columns] == ["time", "speed", "thrust"]


def test_a_clock_that_is_coarser_than_the_samples_and_its_mend(tmp_path):
    rows = "".join(f"{k // 10},{k % 3},{60 + k}\n" for k in range(35))
    path = write(tmp_path, "t,u,rpm\n" + rows)
    with pytest.raises(InputError, match="31 of 35 that repeat the previous stamp") as caught:
        read(path)
    assert "time = 0.1;" in caught.value.mend
    log = read(path, time=0.1)
    np.testing.assert_allclose(log.time, np.arange(35) / 10)
    for wrong in (0, -1, NAN, float("inf"), True):
        with pytest.raises(InputError, match="time"):
            read(path, time=wrong)


def test_times_of_day_without_colons_are_seconds(tmp_path):
    """The clock of a SWAMP, 134059.75 before 134100, stands still between the fixes besides."""
    since = 0.25 * np.arange(600)
    stamps = [f"1340{s:05.2f}" if s < 60 else f"13{41 + int(s) // 60 - 1}{s % 60:05.2f}"
              for s in since]  # fmt: skip
    path = write(tmp_path, "t,u,rpm\n" + "".join(f"{t},1,{k}\n" for k, t in enumerate(stamps)))
    log = read(path)
    np.testing.assert_allclose(log.time - log.time[0], since, atol=1e-9)
    assert "the time stamps were read as times of day, hhmmss." in log.notes
    rows = "".join(f"{t},{k % 3},{k}\n{t},1,{k + 0.5}\n" for k, t in enumerate(stamps))
    path = write(tmp_path, "t,u,rpm\n" + rows)
    with pytest.raises(InputError, match="the clock is coarser than the samples") as caught:
        read(path)
    assert "time = 0.125;" in caught.value.mend  # not 0.18, with 40 s more for each minute
    assert "149.9 s at 8.00 Hz" in str(look(path).report())
    for plain in (np.arange(0.0, 300.0, 0.5), np.arange(0.0, 5000.0, 50.0), 100.0 * np.arange(50)):
        path = write(tmp_path, "t,u,rpm\n" + "".join(f"{t},1,2\n" for t in plain))
        np.testing.assert_allclose(read(path).time, plain)


def test_gaps_are_told_with_moment_and_length(tmp_path):
    def told(time):
        rows = "".join(f"{t:.6f},1,2\n" for t in time)
        notes = read(write(tmp_path, "t,u,rpm\n" + rows)).notes
        return [note for note in notes if note.startswith("time:")]

    steady = 100 + np.arange(200) / 20
    assert told(steady) == []
    jitter = steady + np.random.default_rng(0).uniform(-0.02, 0.02, 200)
    assert told(jitter) == []
    assert told(np.delete(steady, slice(50, 70))) == [
        "time: a gap of 1.05 s after 2.45 s from the start; the usual step is 0.05 s."
    ]
    gaps = np.concatenate([steady[k * 40 : k * 40 + 40] + 3.01 * k**2 for k in range(5)])
    assert told(gaps) == [
        "time: 4 gaps, the largest of 9.08 s after 6.96 s, 15.1 s after 17.99 s, 21.1 s after "
        "35.04 s from the start; the usual step is 0.05 s."
    ]
    assert told([0.0, 0.1, 5.0]) == []
    bursts = np.sort(np.concatenate([steady, steady + 0.001]))  # two senders, merged
    assert told(bursts) == []


def test_points_beside_decimal_commas_are_told(tmp_path):
    content = "t;u;rpm\n0;0,5;1.100\n1;1,5;1.200\n"
    notes = read(write(tmp_path, content)).notes
    assert any("'rpm' has points where others have decimal commas" in note for note in notes)
    with pytest.raises(InputError, match="whose comma may be a thousands separator") as caught:
        read(write(tmp_path, 't,u,rpm\n0,1,"1,200"\n1,1,"1,300"\n'))
    assert "without thousands separators" in caught.value.mend

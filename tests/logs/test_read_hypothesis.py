"""Whatever the bytes, the reader gives a log or one clear error, and never a warning."""

import io
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.io import savemat
from text_readers import in_blocks

from diffthrust import Column, InputError, Log, read_log

common = settings(
    max_examples=150,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)

ROWS = [(k / 10, k % 3, 60.0 + k) for k in range(12)]


@cache
def valid(suffix: str) -> bytes:
    frame = pd.DataFrame(ROWS, columns=["time", "u", "rpm"])
    if suffix == ".csv":
        return frame.to_csv(index=False).encode()
    buffer = io.BytesIO()
    if suffix == ".parquet":
        frame.to_parquet(buffer)
    else:
        columns: dict = {name: frame[name].to_numpy() for name in frame}
        if suffix != ".mat4":  # version 4 knows no structs
            columns["run"] = {"rpm": columns["rpm"]}
        savemat(
            buffer,
            columns,
            format="4" if suffix == ".mat4" else "5",
            do_compression=suffix == ".matz",
        )
    return buffer.getvalue()


def attempt(reader: Callable[[], Log]) -> Log | None:
    """Call the reader: its log, or None after one InputError with its two parts."""
    try:
        return reader()
    except InputError as error:
        caught = error
    assert caught.problem.startswith("run3.")
    assert caught.problem.endswith(".")
    assert caught.mend.endswith(".")
    assert len(str(caught)) < 3000
    return None


def check(content: bytes, suffix: str, **more) -> Log | None:
    """Read the bytes: a sound log, or None after exactly one InputError with its two parts."""
    given = dict(inputs={"command": "u"}, measured={"speed": Column("rpm", unit="rpm")})
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"run3{suffix}"
        path.write_bytes(content)
        log = attempt(lambda: read_log(path, **{**given, **more}))
    if log is None:
        return None
    assert isinstance(log, Log)
    assert len(log) >= 1
    assert np.isfinite(log.time).all()
    assert (np.diff(log.time) > 0).all()
    assert np.isfinite(log.inputs["command"]).all()
    assert not np.isinf(log.measured["speed"]).any()
    assert log.inputs["command"].shape == log.measured["speed"].shape == log.time.shape
    return log


def mutate(content: bytes, changes) -> bytes:
    data = bytearray(content)
    for kind, where, piece in changes:
        at = int(where * len(data))
        if kind == "cut":
            del data[at : at + len(piece) + 1]
        elif kind == "insert":
            data[at:at] = piece
        elif kind == "truncate":
            del data[at:]
        else:
            data[at : at + len(piece)] = piece
    return bytes(data)


pieces = st.one_of(
    st.binary(min_size=1, max_size=8),
    st.sampled_from(
        [
            *[b",", b"\n", b"\r", b'"', b"\n\n", b"nan", b"inf", b"-", b"1e400", b"#", b";", b"\t"],
            *[b" ", b"\x00", b"\xff", b"0.1", b"2024-01-01T00:00:00", b",,", b"\xef\xbb\xbf"],
        ]
    ),
)
changes = st.lists(
    st.tuples(
        st.sampled_from(["cut", "insert", "overwrite", "overwrite", "truncate"]),
        st.floats(0, 1),
        pieces,
    ),
    min_size=1,
    max_size=4,
)
suffixes = st.sampled_from([".csv", ".txt", ".parquet", ".mat"])


@common
@given(content=st.binary(max_size=400), suffix=suffixes)
def test_random_bytes(content, suffix):
    check(content, suffix)


@common
@given(tail=st.binary(max_size=300), kind=st.sampled_from([".parquet", ".mat", ".mat4", ".matz"]))
def test_random_bytes_behind_a_valid_beginning(tail, kind):
    check(valid(kind)[:200] + tail, kind[:4] if kind.startswith(".mat") else kind)


@pytest.mark.thorough
@settings(common, max_examples=400)
@given(changes=changes, interpolate=st.booleans())
def test_mutated_text(changes, interpolate):
    check(mutate(valid(".csv"), changes), ".csv", interpolate_inputs=interpolate)


@common
@given(changes=changes)
def test_mutated_parquet(changes):
    check(mutate(valid(".parquet"), changes), ".parquet")


@settings(common, max_examples=300)
@given(changes=changes, kind=st.sampled_from([".mat", ".mat4", ".matz"]))
def test_mutated_mat(changes, kind):
    check(mutate(valid(kind), changes), ".mat", measured={"speed": "rpm", "again": "run.rpm"})
    check(mutate(valid(kind), changes), ".mat")


def test_the_unmutated_files_are_logs():
    for kind in (".csv", ".parquet", ".mat", ".mat4", ".matz"):
        log = check(valid(kind), kind[:4] if kind.startswith(".mat") else kind)
        assert log is not None
        np.testing.assert_allclose(log.values("speed", "rpm"), [row[2] for row in ROWS])


cells = st.one_of(
    st.floats().map(repr),
    st.integers().map(str),
    st.text(max_size=6),
    st.sampled_from(["", " ", "nan", "-nan", "NaN", "n/a", "1,5", "1.5", "+1", "1e5", "1_0", "٣"]),
    st.sampled_from(["0x10", "1e", "infinity", "2024-01-01", "#", '"', '""', "True", "1d5"]),
)


@pytest.mark.thorough
@settings(common, max_examples=300)
@given(
    rows=st.lists(st.lists(cells, min_size=3, max_size=3), min_size=1, max_size=6),
    delimiter=st.sampled_from([",", ";", "\t", " "]),
    column=st.integers(0, 2),
)
def test_random_cells_read_the_same_either_way(rows, delimiter, column):
    # Two columns stay sound, so that the third is reached, and so many rows that they are a block.
    table = [[str(k), "1.0", "2.0"] for k in range(2000 + len(rows))]
    for row, random in zip(table[2000:], rows, strict=True):
        row[column] = random[column]
    lines = [delimiter.join(row) for row in [["time", "u", "rpm"], *table]]
    content = "\n".join(lines).encode("utf-8", "surrogatepass")
    logs = []
    for blocks in (False, True):
        with pytest.MonkeyPatch.context() as patch:
            if blocks:
                in_blocks(patch)
            logs.append(check(content, ".csv", missing_values=["n/a"]))
    one, other = logs
    assert (one is None) == (other is None)
    if one is not None and other is not None:
        np.testing.assert_array_equal(one.time, other.time)
        np.testing.assert_array_equal(one.inputs["command"], other.inputs["command"])
        np.testing.assert_array_equal(one.measured["speed"], other.measured["speed"])
        assert one.notes == other.notes


numbers = st.floats(allow_nan=False, allow_infinity=False, width=64)


@common
@given(
    samples=st.lists(st.tuples(numbers, st.one_of(numbers, st.just(float("nan")))), min_size=1),
    suffix=st.sampled_from([".csv", ".parquet", ".mat"]),
)
def test_what_is_written_is_read_back_exactly(samples, suffix):
    frame = pd.DataFrame(samples, columns=["u", "rpm"], dtype=float)
    frame.insert(0, "time", np.arange(len(frame)) * 0.1)
    buffer = io.BytesIO()
    if suffix == ".csv":
        frame.to_csv(buffer, index=False)
    elif suffix == ".parquet":
        frame.to_parquet(buffer)
    else:
        savemat(buffer, {name: frame[name].to_numpy() for name in frame})
    log = check(buffer.getvalue(), suffix, measured={"speed": "rpm"})
    if frame["rpm"].isna().all():
        assert log is None
        return
    assert log is not None
    np.testing.assert_array_equal(log.time, frame["time"])
    np.testing.assert_array_equal(log.inputs["command"], frame["u"])
    np.testing.assert_array_equal(log.measured["speed"], frame["rpm"])


units = st.one_of(
    st.text(max_size=12),
    st.text(alphabet="mNsVAradkgrpu/^*() .-1239%°", max_size=12),
    st.sampled_from(["rpm", "Hz", "rad/s", "kN", "degC", "dB", "deg", "m^-1", "1/s", ""]),
)


@pytest.mark.thorough
@common
@given(unit=units, time_unit=units, channel=st.sampled_from(["speed", "thrust", "mine"]))
def test_random_units(unit, time_unit, channel):
    content = valid(".csv")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run3.csv"
        path.write_bytes(content)
        measured = {channel: Column("rpm", unit=unit, noise=1.0)}
        attempt(lambda: read_log(path, time=Column("time", unit=time_unit), measured=measured))

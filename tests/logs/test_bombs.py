"""Small files that unpack to much: told before they are unpacked, within little memory."""

from __future__ import annotations

import json
import os
import struct
import subprocess
import sys
import zipfile
import zlib
from io import BytesIO
from pathlib import Path

import h5py
import lz4.frame
import numpy as np
import openpyxl
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from file_contents import contents

from diffthrust import InputError
from diffthrust.logs import read_log

MB = 2**20
LIMIT = 24  # MB, so that the files are quickly made
LARGE = 160  # MB, what they unpack to


def mat(path: Path, size: int = LARGE * MB, said: int | None = None) -> None:
    """A column of zeros, packed; its header may lie about how long it is."""
    said = size if said is None else said
    tags = struct.pack("<IIII", 6, 8, 6, 0) + struct.pack("<IIii", 5, 8, said // 8, 1)
    tags += struct.pack("<HH4s", 1, 1, b"u\0\0\0") + struct.pack("<II", 9, said)
    packer = zlib.compressobj(1)
    packed = packer.compress(struct.pack("<II", 14, len(tags) + said) + tags)
    packed += b"".join(packer.compress(bytes(MB)) for _ in range(size // MB)) + packer.flush()
    head = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x100) + b"IM"
    path.write_bytes(head + struct.pack("<II", 15, len(packed)) + packed)


def lying_mat(path: Path) -> None:
    mat(path, said=64)


def parquet(path: Path) -> None:
    column = pa.chunked_array([pa.nulls(MB, pa.float64())] * (LARGE // 8))
    pq.write_table(pa.table({"t": column, "u": column}), path, compression="zstd")


def hdf5(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file.create_dataset("t", (LARGE * MB,), "i1", chunks=(MB,), compression="gzip")
        file["u"] = np.arange(3.0)


def sheet(path: Path, rows: bytes) -> None:
    book, out = openpyxl.Workbook(), BytesIO()
    book.active.append(["t", "u"])
    book.save(out)
    with (
        zipfile.ZipFile(out) as before,
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as after,
    ):
        for name in before.namelist():
            text = before.read(name)
            if name.endswith("sheet1.xml"):
                text = text.replace(b'<dimension ref="A1:B1"/>', b"")
                text = text.replace(b"</sheetData>", rows + b"</sheetData>")
            after.writestr(name, text)


def blank_excel(path: Path) -> None:
    sheet(path, bytes([32]) * (LARGE * MB))


def wide_excel(path: Path) -> None:
    """Rows of one cell each, in the last column that there is."""
    each = (f'<row r="{k}"><c r="XFD{k}"><v>1</v></c></row>' for k in range(2, 2000))
    sheet(path, "".join(each).encode())


def mcap(path: Path) -> None:
    packed = lz4.frame.compress(bytes(LARGE * MB))
    chunk = struct.pack("<QQQI", 0, 1, LARGE * MB, 0) + struct.pack("<I", 3) + b"lz4"
    chunk += struct.pack("<Q", len(packed)) + packed
    magic = b"\x89MCAP0\r\n"
    head = struct.pack("<BQ", 1, 8) + bytes(8)
    end = struct.pack("<BQ", 2, 20) + bytes(20)
    path.write_bytes(magic + head + struct.pack("<BQ", 6, len(chunk)) + chunk + end + magic)


def bag_1(path: Path) -> None:
    import bz2

    packed = bz2.compress(bytes(LARGE * MB // 4), 1) * 4

    def record(data: bytes, **fields: bytes) -> bytes:
        told = b"".join(
            struct.pack("<I", len(k) + 1 + len(v)) + k.encode() + b"=" + v
            for k, v in fields.items()
        )
        return struct.pack("<I", len(told)) + told + struct.pack("<I", len(data)) + data

    chunk = record(packed, op=b"\x05", compression=b"bz2", size=struct.pack("<I", LARGE * MB))
    none = struct.pack("<I", 0)
    at = struct.pack("<Q", 13 + 69 + 4027 + len(chunk))
    head = record(b" " * 4027, op=b"\x03", index_pos=at, conn_count=none, chunk_count=none)
    path.write_bytes(b"#ROSBAG V2.0\n" + head + chunk)


BOMBS = {
    "zeros.mat": mat,
    "flat.parquet": parquet,
    "zeros.h5": hdf5,
    "blank.xlsx": blank_excel,
    "wide.xlsx": wide_excel,
    "zeros.mcap": mcap,
    "zeros.bag": bag_1,
}

LOOKED_AT = """
import json, resource, sys
import h5py, openpyxl, pandas, pyarrow.parquet, rosbags.highlevel
from diffthrust.logs._contents import contents

def peak():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024

idle, told = peak(), {}
for file in sys.argv[1:]:
    try:
        contents(file)
        error = ""
    except ValueError as found:
        error = str(found)
    told[file] = error, peak() - idle
print(json.dumps(told))
"""


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    """What a process of little room says of each file, and by how much it has grown since."""
    folder = tmp_path_factory.mktemp("bombs")
    for name, write in BOMBS.items():
        write(folder / name)
    lying_mat(folder / "lying.mat")
    env = {**os.environ, "DIFFTHRUST_LARGEST_LOG": str(LIMIT)}
    names = [*BOMBS, "lying.mat"]
    ran = subprocess.run(
        [sys.executable, "-c", LOOKED_AT, *names],
        cwd=folder, env=env, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert all((folder / name).stat().st_size < 8 * MB for name in names)
    return json.loads(ran.stdout)


@pytest.mark.parametrize("name", BOMBS)
def test_what_unpacks_to_much_is_told_before(told, name):
    error, grown = told[name]
    assert error.startswith(f"{name}: expected a log of at most {LIMIT} MB in memory")
    assert "raise the limit by the environment variable DIFFTHRUST_LARGEST_LOG" in error
    assert grown < LARGE / 2


def test_a_header_that_lies_is_a_damage(told):
    error, grown = told["lying.mat"]
    assert error.startswith("lying.mat: expected a MATLAB file")
    assert "longer than it says" in error
    assert grown < LARGE / 2


def test_the_limit_can_be_raised(tmp_path, monkeypatch):
    path = tmp_path / "zeros.mat"
    mat(path, size=2 * MB)
    monkeypatch.setenv("DIFFTHRUST_LARGEST_LOG", "1")
    with pytest.raises(InputError, match="unpacks to 3 MB or more"):
        contents(path)
    monkeypatch.setenv("DIFFTHRUST_LARGEST_LOG", "4")
    assert contents(path).fields[0].values.size == 2 * MB // 8
    monkeypatch.setenv("DIFFTHRUST_LARGEST_LOG", "much")
    with pytest.raises(InputError, match="DIFFTHRUST_LARGEST_LOG: expected a number of MB"):
        contents(path)


def test_only_wanted_columns_count(tmp_path, monkeypatch):
    path = tmp_path / "run.h5"
    time = np.arange(1000) / 50
    with h5py.File(path, "w") as file:
        file["t"], file["u"] = time, np.sin(time)
        file.create_dataset("picture", (2**40,), "f8", chunks=(MB,))
    monkeypatch.setenv("DIFFTHRUST_LARGEST_LOG", "1")
    assert read_log(path, time="t", inputs={"command": "u"}).time.size == 1000
    with pytest.raises(InputError, match="expected a log of at most 1 MB"):
        read_log(path, time="t", inputs={"command": "picture"})


def test_a_long_text_that_repeats_is_kept_once(tmp_path, monkeypatch):
    path, count = tmp_path / "run.parquet", 1000
    told = pa.DictionaryArray.from_arrays(np.zeros(count, np.int32), pa.array(["x" * 100_000]))
    time = np.arange(count) / 50
    pq.write_table(pa.table({"t": time, "u": np.sin(time), "remark": told.cast(pa.string())}), path)
    monkeypatch.setenv("DIFFTHRUST_LARGEST_LOG", "4")
    found = contents(path)
    assert [field.name for field in found.fields] == ["t", "u", "remark"]


def test_texts_of_parquet_are_as_they_were_written(tmp_path):
    path = tmp_path / "run.parquet"
    cells = ["1.5", None, "2.5", "n/a"] * 3
    table = pa.table({"t": np.arange(12.0), "u": np.arange(12.0), "rpm": cells})
    pq.write_table(table, path, row_group_size=4)
    log = read_log(
        path, time="t", inputs={"command": "u"}, measured={"speed": "rpm"}, missing_values="n/a"
    )
    np.testing.assert_array_equal(log.measured["speed"], [1.5, np.nan, 2.5, np.nan] * 3)

"""Large files of text are read in blocks, and say the same as when all their lines are held."""

from __future__ import annotations

import os
import resource
import subprocess
import sys

import numpy as np
import pytest
from file_contents import contents
from text_readers import LARGE, in_blocks, read_csv

from diffthrust import InputError
from diffthrust.logs import Column, read_log

ROWS = 1200
RNG = np.random.default_rng(0)
CELLS = [
    (f"{k / 50:.2f}", repr(float(a)), repr(float(b)))
    for k, (a, b) in enumerate(RNG.standard_normal((ROWS, 2)) * [1.0, 1e9])
]


def table(delimiter=",", end="\n", close="", head=("t,u,rpm",), cells=CELLS, foot=""):
    top = [line.replace(",", delimiter) for line in head]
    lines = [*top, *(delimiter.join(row) for row in cells)]
    return "".join(line + close + end for line in lines) + foot


def changed(row, column, text):
    cells = [list(row) for row in CELLS]
    cells[row][column] = text
    return cells


def dated(k):
    return f"2025-03-21 12:{k // 3000:02}:{k / 50 % 60:06.3f}"


COMMAS = [tuple(cell.replace(".", ",") for cell in row) for row in CELLS]
PLAIN = {
    "commas": table(),
    "returns": table(end="\r\n"),
    "semicolons": table(";"),
    "tabs": table("\t"),
    "blanks": table("   "),
    "closed": table(close=","),
    "no end": table().rstrip("\n"),
    "blank lines": table(foot="\n\n").replace("\n0.5", "\n\n0.5", 1),
    "a word": table(cells=changed(1100, 1, "n/a")),
    "an empty cell": table(cells=changed(1100, 2, " ")),
    "dates": table(cells=[(dated(k), *row[1:]) for k, row in enumerate(CELLS)]),
    "decimal commas": table(";", cells=COMMAS),
    "some decimal commas": table(";", cells=changed(1100, 1, "0,5")),
    "infinity and large": table(cells=changed(900, 2, "1e308")),
    "preamble": table(head=("boat 7", "# of the second day", "t,u,rpm", "s,V,rpm")),
    "zeros": table(foot="\0" * 5000),
    "cut": table(foot="24.0,0.1"),
    "cut, zeros": table(foot="24.0,0.1" + "\0" * 5000),
    "cut, closed": table(close=",", foot="24.0,0"),
    "a number for missing": table(cells=changed(700, 1, "-999")),
}
ODD = {
    "quotes": table(cells=changed(1100, 1, '"0.5"')),
    "a comment": table().replace("\n9.00", "\n# a squall\n9.00"),
    "one closed": table(cells=changed(1100, 2, "5,")),
    "blanks in a line": table().replace("\n9.00", "\n  \n9.00"),
    "a degree": table(cells=changed(1100, 1, "\N{DEGREE SIGN}")),
    "a short line": table(cells=[*CELLS[:900], ("18.0", "1"), *CELLS[901:]]),
    "a long line": table(cells=[*CELLS[:900], ("18.0", "1", "2", "3"), *CELLS[901:]]),
    "a bad time": table(cells=changed(1100, 0, "later")),
    "time that goes back": table(cells=changed(1100, 0, "1.0")),
    "a picture": table(foot="\1\2"),
    "names of numbers": table(head=("1,2,3",)),
    "returns alone": table(end="\r"),
    "one column": table(cells=[("1",)] * ROWS, head=("t",)),
}


def outcome(path):
    """What a file is read as, or how it is refused; and what is in it."""
    try:
        log = read_log(
            path,
            time="t",
            inputs={"command": "u"},
            measured={"speed": Column("rpm", unit="rpm")},
            missing_values=["n/a", -999],
            interpolate_inputs=True,
        )
        read = (log.sha256, log.notes, log.time.size)
    except InputError as error:
        read = str(error)
    try:
        found = contents(path)
        seen = [(f.name, f.unit, f.text, f.dates, f.values.tobytes()) for f in found.fields]
        return read, seen, found.notes
    except InputError as error:
        return read, str(error)


@pytest.mark.parametrize("name", [*PLAIN, *ODD])
def test_a_file_says_the_same_in_blocks(tmp_path, monkeypatch, name):
    path = tmp_path / "run.csv"
    path.write_bytes({**PLAIN, **ODD}[name].encode())
    whole = outcome(path)
    in_blocks(monkeypatch, never_whole=name in PLAIN)
    assert outcome(path) == whole


def test_numbers_of_a_large_file_are_not_read_as_text(tmp_path, monkeypatch):
    path = tmp_path / "run.csv"
    path.write_text(table(cells=changed(1100, 1, "n/a")))
    in_blocks(monkeypatch)
    cells = read_csv(path, ["t"]).read(["t", "u", "rpm"], ())
    assert [isinstance(c, np.ndarray) for c in cells.values()] == [True, False, True]


@pytest.mark.thorough
def test_a_large_file_takes_a_little_more_than_its_columns(tmp_path):
    count = 200_000
    path = tmp_path / "run.csv"
    remark = "words " * 12
    lines = (f"{k / 100:.2f},{k % 97},{k % 89}.123456789,{remark}\n" for k in range(count))
    path.write_text("t,u,rpm,remark\n" + "".join(lines))
    assert path.stat().st_size > LARGE
    code = """
import resource, sys
import pandas
from diffthrust.logs import read_log
idle = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
log = read_log(sys.argv[1], time=0.01, inputs={"command": "u"}, measured={"speed": "rpm"})
print(log.time.size, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - idle)
"""
    ran = subprocess.run(
        [sys.executable, "-c", code, str(path)], capture_output=True, text=True, check=True
    )
    samples, grown = map(int, ran.stdout.split())
    assert samples == count
    assert grown < 90_000  # kB, of which blocks of text and the library take the most


def test_a_file_of_zeros_alone_is_no_table(tmp_path):
    path = tmp_path / "run.csv"
    path.touch()
    os.truncate(path, 2**40)  # bytes that no disk holds
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(InputError, match="expected a log of at most 512 MB"):
        contents(path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss < before + 100_000


def test_a_file_that_is_cut_while_it_is_read_is_told(tmp_path, monkeypatch):
    path = tmp_path / "run.csv"
    path.write_text(table())
    in_blocks(monkeypatch)
    opened = read_csv(path, ["t", "u"])
    os.truncate(path, path.stat().st_size // 2)
    with pytest.raises(InputError, match="was changed while it was read"):
        opened.read(["t", "u"], ())

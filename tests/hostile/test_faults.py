"""Faults at random times: files whole or absent, nothing left running, the next run equal."""

from __future__ import annotations

import os
import sys
import time

import numpy as np
import pytest

from . import commands, faults

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="processes are found as on Linux")
NIGHT = float(os.environ.get("DIFFTHRUST_NIGHT", "240"))
"""Seconds of a nightly test; a few of them make ten minutes."""


@pytest.fixture(scope="module")
def bench(tmp_path_factory) -> faults.Bench:
    return faults.Bench(tmp_path_factory.mktemp("bench"))


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("name", "kind", "moment"),
    [("report", "interrupted", 0.5), ("report", "vanished", 0.9)],
)
def test_a_fault_leaves_whole_files(bench, name, kind, moment):
    assert bench.tried(name, kind, moment).wrong == []


@pytest.mark.nightly
def test_faults_of_a_night_leave_whole_files(bench):
    begun, seed, wrong = time.monotonic(), int(time.time()), []
    for fault in faults.drawn(1000, seed):
        if time.monotonic() - begun > NIGHT:
            break
        wrong += [(*fault, word) for word in bench.tried(*fault).wrong]
    assert wrong == []


def test_the_draws_meet_every_command_with_every_fault():
    count = len(commands.COMMANDS) * len(faults.kinds())
    drawn = faults.drawn(count, seed=3)
    assert len({(name, kind) for name, kind, _ in drawn}) == count
    assert drawn == faults.drawn(count, seed=3)


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("a.json", b'{"a": 1'),
        ("a.html", b"<!doctype html><p>cut"),
        ("a.png", b"\x89PNG"),
        ("a.h5", b"\x89HDF\r\n\x1a\n"),
        ("a.nc", b""),
        ("a.parquet", b"PAR1"),
        ("a.xml", b"<a>"),
        ("a.toml", b"a = "),
        (".a.json.17.tmp", b"{}"),
    ],
)
def test_what_is_cut_off_is_seen(name, data, tmp_path):
    (tmp_path / name).write_bytes(data)
    assert len(commands.faults_of(tmp_path, temporaries=False)) == 1


def test_what_is_whole_is_no_fault(tmp_path):
    (tmp_path / "a.json").write_text("{}")
    (tmp_path / "a.toml").write_text("a = 1")
    np.savetxt(tmp_path / "a.csv", np.eye(2), delimiter=",")
    assert commands.faults_of(tmp_path, temporaries=False) == []

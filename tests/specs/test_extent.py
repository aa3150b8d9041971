"""Specs that no person writes, and names that no person gives: one clear error each."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import pytest

import diffthrust as dft
from diffthrust import InputError
from diffthrust.logs import read_log
from diffthrust.specs import load_spec
from tests.campaign_specs import SENSOR, sensor_log, sensor_spec

DEEP = 20_000


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        ("[fit]\nsubsteps = 1000000000", "line 10, fit.substeps: expected less than or equal to"),
        ("[fit]\nstarts = 1000000", "line 10, fit.starts: expected less than or equal to 1000,"),
        (f"[fit]\nhorizon = {'[' * DEEP}{']' * DEEP}", "line 10: expected tables and lists nested"),
        (f"[{'.'.join('a' * DEEP)}]\nb = 1", "line 9: expected tables and lists nested"),
        (f"[expected]\n{'.'.join('a' * DEEP)} = 1", "line 10: expected tables and lists nested"),
        (f"[fit]\nseed = {'9' * 5000}", "line 10: expected integers of at most 64 bits"),
        (f"[fit]\nseed = 0x{'f' * 5000}", "line 10: expected integers of at most 64 bits"),
        (f"[fit]\nseed = {2**64}", "line 10: expected integers of at most 64 bits"),
        (f"[parameters]\nslope = {'9' * 5000}.0", "expected a finite number, found inf"),
    ],
)
def test_what_no_machine_can_do_is_told_with_its_line(tmp_path, lines, told):
    path = sensor_spec(tmp_path / "one", slope=0.5)
    path.write_text(f"{SENSOR}{lines}\n")
    with pytest.raises(InputError) as caught:
        load_spec(path)
    assert told in caught.value.problem
    assert caught.value.problem.startswith(str(path))
    assert len(str(caught.value)) < 400


def test_the_most_that_may_be_asked_is_read(tmp_path):
    path = sensor_spec(tmp_path / "one", slope=0.5)
    path.write_text(f"{SENSOR}[fit]\nsubsteps = 10000\nstarts = 1000\nseed = {2**64 - 1}\n")
    assert load_spec(path).file.fit.starts == 1000


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"starts": 10**6}, "starts: expected at most 1000, found 1000000."),
        ({"substeps": 10**9}, "substeps: expected at most 10000, found 1000000000."),
        ({"starts": 10**5000}, "starts: expected at most 1000, found int too long"),
        (
            {"substeps": -(10**5000)},
            "substeps: expected a whole number of at least 1, found int too",
        ),
        ({"seed": 2**64}, "seed: expected at most 18446744073709551615"),
    ],
)
def test_a_fit_is_not_asked_for_more(tmp_path, given, told):
    spec = load_spec(sensor_spec(tmp_path / "one", slope=0.5))
    with pytest.raises(InputError) as caught:
        dft.fit(spec.model, spec.train_logs(), **given)
    assert caught.value.problem.startswith(told)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"draws": 10**9}, "draws: expected at most 1000000"),
        ({"warmup": 10**9}, "warmup: expected at most 1000000"),
        ({"walkers": 10**6}, "walkers: expected at most 10000"),
        ({"method": "nuts", "chains": 10**6}, "chains: expected at most 10000"),
        ({"seed": 10**5000}, "seed: expected at most 4294967295, found int too long"),
    ],
)
def test_nor_is_sampling(given, told, tmp_path):
    sensor_spec(tmp_path / "one", slope=0.5)
    with pytest.raises(InputError) as caught:  # before any work
        dft.many.campaign(tmp_path, task="sample", output=tmp_path / "out", **given)
    assert caught.value.problem.startswith(told)


def pipe(path: Path) -> None:
    os.mkfifo(path)


def plug(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as one:
        one.bind(os.path.relpath(path))  # whose names must be short


def device(path: Path) -> None:
    path.symlink_to("/dev/zero")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no pipes with names")
@pytest.mark.parametrize(
    ("make", "found"), [(pipe, "named pipe"), (plug, "socket"), (device, "device")]
)
def test_what_is_no_file_is_told_and_not_waited_for(tmp_path, monkeypatch, make, found):
    monkeypatch.chdir(tmp_path)
    path = sensor_spec(tmp_path / "one", slope=0.5)
    log = path.with_name("train.csv")
    log.unlink()
    make(log)
    with pytest.raises(InputError, match=rf"logs\.train: expected a log, found .* to be a {found}"):
        load_spec(path)
    with pytest.raises(InputError, match=f"train.csv: expected a file, found a {found}"):
        read_log(log, inputs={"depth": "depth_m"})
    with pytest.raises(InputError, match=f"train.csv: expected a file, found a {found}"):
        dft.look(log)
    for ending in (".json", ".nc"):
        with pytest.raises(InputError, match=f"{ending}: expected a saved result, found a {found}"):
            dft.load(log.rename(log.with_suffix(ending)))
        log.with_suffix(ending).rename(log)
    with pytest.raises(InputError, match="none among its 2 files"):
        dft.look(path.parent)
    make(path.with_name("own.py"))
    path.write_text(SENSOR.replace('"linear_sensor"', '"own.py:Own"'))
    outside = found == "device"  # which is a link
    told = (
        "lies outside the folder"
        if outside
        else f"own.py: expected a Python script, found a {found}"
    )
    with pytest.raises(InputError, match=told):
        load_spec(path)
    path.unlink()
    make(path)
    for named in (path, path.parent):
        with pytest.raises(InputError, match=rf"expected a spec file \(TOML\), found a {found}"):
            load_spec(named)


@pytest.mark.parametrize("name", ["run[1].csv", "run*.csv", "[red]run.csv"])
def test_a_log_is_found_by_its_very_name(tmp_path, name):
    path = sensor_spec(tmp_path / "one", slope=0.5)
    path.write_text(SENSOR.replace("train.csv", name))
    for other in (name, "run1.csv", "run2.csv", "erun.csv"):
        sensor_log(path.with_name(other), 0.5, 1.0)
    spec = load_spec(path)
    assert [file.name for file in spec.train] == [name]
    assert spec.train_logs()[0].name == name
    path.with_name(name).unlink()  # then it is a pattern
    assert name not in [file.name for file in load_spec(path).train]


def test_a_name_longer_than_names_can_be_is_told(tmp_path):
    path = sensor_spec(tmp_path / "one", slope=0.5)
    path.write_text(SENSOR.replace("train.csv", "x" * 5000))
    with pytest.raises(InputError, match="expected the file 'xxx"):
        load_spec(path)

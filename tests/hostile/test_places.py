"""Every writer, given a place that it cannot write to: one clear error, nothing half-written."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from places import FITS

from diffthrust._support.files import write_whole  # private: all writers but one are this one

from .commands import TOLD, contents, here, make_specs

pytestmark = [
    pytest.mark.skipif(os.name == "nt", reason="places are spoilt as on POSIX"),
    pytest.mark.usefixtures("no_cache"),
]

WRITERS: dict[str, tuple[str, ...]] = {
    "fit --json": ("fit", "SENSOR", "--json", "PLACE.json"),
    "fit --report": ("fit", "SENSOR", "--report", "PLACE.html"),
    "fit --save": ("fit", "SENSOR", "--save", "PLACE.json"),
    "compare --json": ("compare", "SENSOR", "--no-fit", "--json", "PLACE.json"),
    "compare --report": ("compare", "SENSOR", "--no-fit", "--report", "PLACE.html"),
    "compare --figure": ("compare", "SENSOR", "--no-fit", "--figure", "PLACE.png"),
    "diagnose --json": ("diagnose", "SENSOR", "--json", "PLACE.json"),
    "diagnose --report": ("diagnose", "SENSOR", "--report", "PLACE.html"),
    "diagnose --save": ("diagnose", "SENSOR", "--save", "PLACE.json"),
    "look --json": ("look", "LOG", "--json", "PLACE.json"),
    "look --figure": ("look", "LOG", "--figure", "PLACE.png"),
    "look --spec": ("look", "LOG", "--spec", "PLACE.toml"),
    "export --output": ("export", "THRUSTER", "--to", "python", "--output", "PLACE.py"),
    "map --json": ("map", "THRUSTER", "MAP", "--json", "PLACE.json"),
    "map --figure": ("map", "THRUSTER", "MAP", "--figure", "PLACE.png"),
    "check --json": ("check", "SENSOR", "--json", "PLACE.json"),
    "check --junit": ("check", "SENSOR", "--junit", "PLACE.xml"),
    "sample --json": ("sample", "SENSOR", "DRAWS", "--json", "PLACE.json"),
    "sample --report": ("sample", "SENSOR", "DRAWS", "--report", "PLACE.html"),
    "sample --save": ("sample", "SENSOR", "DRAWS", "--save", "PLACE.nc"),
    "sample --file": ("sample", "SENSOR", "DRAWS", "--file", "PLACE.h5"),
    "campaign --output": ("campaign", "SENSORS", "--jobs", "1", "--output", "PLACE"),
    "campaign --json": ("campaign", "SENSORS", "OUT", "--json", "PLACE.json"),
    "new": ("new", "mine", "--directory", "PLACE"),
    "demo": ("demo", "--output", "PLACE"),
    "demo --missing": ("demo", "--missing", "--output", "PLACE"),
}  # fmt: skip
SHORT = {
    "MAP": ("--input", "command", "--output", "speed", "--frequencies", "1:2:2", "--no-fit"),
    "DRAWS": ("--draws", "20", "--warmup", "0", "--walkers", "6"),
}
QUICK = {
    *(
        "fit --json",
        "fit --report",
        "fit --save",
        "compare --figure",
        "look --spec",
        "check --junit",
    ),
    *("export --output", "new"),
}
"""Those that run at each change; the others take longer to come to their writing."""
CASES = [pytest.param(name, marks=() if name in QUICK else pytest.mark.nightly) for name in WRITERS]
FOLDERS = ("campaign --output", "new", "demo", "demo --missing")


@pytest.fixture(scope="module")
def specs(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("specs")
    make_specs(folder)
    return folder


def words(name: str, specs: Path, place: Path) -> list[str]:
    known = {
        **{"SENSOR": FITS / "depth_sensor", "SENSORS": specs / "shallow"},
        **{"THRUSTER": specs / "one", "LOG": specs / "one" / "train.csv"},
    }
    out = []
    for word in WRITERS[name]:
        if word == "OUT":
            out += ["--jobs", "1", "--output", str(specs.parent / "out")]
        elif word in SHORT:
            out += SHORT[word]
        elif word.startswith("PLACE"):
            out.append(f"{place}{word.removeprefix('PLACE')}")
        else:
            out.append(str(known.get(word, word)))
    return out


def refused(name: str, specs: Path, place: Path) -> str:
    """Run a writer on a place: it must tell the place, and leave nothing there."""
    status, said = here(words(name, specs, place))
    assert status == 2, said
    assert not any(word in said for word in TOLD), said
    assert "Mend: " in said
    return said


def is_folder(place: Path) -> None:
    for ending in ("json", "html", "png", "toml", "py", "xml", "nc", "h5"):
        Path(f"{place}.{ending}").mkdir()


def is_below_a_file(place: Path) -> None:
    place.parent.rmdir()
    place.parent.write_text("a file")


def is_a_circle(place: Path) -> None:
    place.parent.rmdir()
    place.parent.symlink_to(place.parent)


SPOILT: dict[str, Callable[[Path], None]] = {
    "below a file": is_below_a_file,
    "in a circle of links": is_a_circle,
    "a folder": is_folder,
}


@pytest.mark.thorough
@pytest.mark.parametrize("spoilt", SPOILT)
@pytest.mark.parametrize("name", CASES)
def test_a_place_that_cannot_be(name, spoilt, specs, tmp_path):
    if spoilt == "a folder" and name in FOLDERS:
        pytest.skip("it writes a folder")
    place = tmp_path / "in" / "result"
    place.parent.mkdir()
    SPOILT[spoilt](place)
    before = sorted(tmp_path.rglob("*"))
    assert "in" in refused(name, specs, place)
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("name", CASES)
def test_a_name_that_is_too_long(name, specs, tmp_path):
    refused(name, specs, tmp_path / ("x" * 300))
    assert not list(tmp_path.iterdir())


@contextmanager
def little_room() -> Iterator[None]:
    """Within it no file grows beyond some bytes, as on a full disk; what is written is cut off."""
    import resource  # late: there is none on Windows

    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (16, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.thorough
@pytest.mark.parametrize("name", CASES)
def test_a_disk_without_room_leaves_what_was_there(name, specs, tmp_path):
    first, second = tmp_path / "first", tmp_path / "second"
    status, said = here(words(name, specs, first))
    assert status == 0, said
    before = contents(tmp_path)
    with little_room():
        if name == "sample --file":  # the draws that were asked for stand in it: none is made
            assert here(words(name, specs, first))[0] == 0
        else:
            refused(name, specs, first)
        told = refused(name, specs, second)
    assert "File too large" in told
    left = contents(tmp_path)
    assert {k: left.get(k) for k in before} == before
    assert not [path for path in tmp_path.rglob("second*") if path.is_file()]
    assert not list(tmp_path.rglob(".*"))


@pytest.mark.parametrize("error", [KeyboardInterrupt, MemoryError, OSError(30, "Read-only")])
def test_whatever_ends_the_writing_nothing_is_left(error, tmp_path, monkeypatch):
    path = tmp_path / "a.json"
    path.write_bytes(b"before")

    def ends(*_):
        raise error

    monkeypatch.setattr(os, "replace", ends)
    with pytest.raises((KeyboardInterrupt, MemoryError, ValueError)):
        write_whole(path, b"after")
    assert [p.read_bytes() for p in tmp_path.iterdir()] == [b"before"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no full device")
def test_standard_output_without_room():
    command = [sys.executable, "-m", "diffthrust", "compare", FITS / "depth_sensor", "--no-fit"]
    with open("/dev/full", "w") as full:
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True)
    assert done.returncode == 2
    # a slow machine has said before that it is reading
    _, _, said = done.stderr.partition("Error: ")
    assert said.startswith("the result cannot be printed (No space left on device).")
    assert not any(word in done.stderr for word in TOLD)

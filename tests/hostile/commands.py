"""Commands that write, the files that each leaves, and whether these are whole."""

from __future__ import annotations

import json
import tomllib
import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import campaign_specs
import h5py
import numpy as np
import pyarrow.parquet as pq
from command_line import run

TOLD = ("Traceback (most recent call last)", "defect of diffthrust", "Exception ignored")
"""Words that no user may meet."""
UNEQUAL = {"seconds", "kept", "updated", "created", "sha256"}
"""What differs between equal runs: times with their hash, and what was there before."""


def answer(words: Sequence[str]) -> tuple[int, str, str, str]:
    """Run a command in a worker: its status, what it said, and the way to what it raised."""
    result = run(*words, status=None)
    raised = result.exception if not isinstance(result.exception, SystemExit) else None
    way = "".join(traceback.format_exception(raised)) if raised else ""
    return result.exit_code, result.stdout, result.stderr, way


@dataclass(frozen=True)
class Command:
    """A command that writes.

    Args:
        words: the words of its call, given the folder of the specs and that of what it writes.
        prepare: makes what must lie in the second folder beforehand.
    """

    words: Callable[[Path, Path], list[str | Path]]
    prepare: Callable[[Path], None] = lambda place: None

    def call(self, specs: Path, place: Path) -> list[str]:
        """The words, as a shell hands them on."""
        return [str(word) for word in self.words(specs, place)]


def make_specs(folder: Path) -> None:
    """The specs that all commands work on: two small thrusters and two sensors."""
    for seed, name in enumerate(("one", "two")):
        campaign_specs.thruster_spec(folder / name, seed + 1)
    for name, slope in (("shallow", 0.1), ("deep", 0.2)):
        campaign_specs.sensor_spec(folder / name, slope)


def _results(place: Path) -> list[str | Path]:
    return ["--json", place / "a.json", "--report", place / "a.html"]


COMMANDS: dict[str, Command] = {
    "fit": Command(lambda s, o: ["fit", s / "one", *_results(o), "--save", o / "saved.json"]),
    "diagnose": Command(
        lambda s, o: [
            *("diagnose", s / "one", *_results(o), "--save", o / "saved.json"),
            *("--candidates", "command_deadband,actuator_lag"),
        ]
    ),
    "sample": Command(
        lambda s, o: [
            *("sample", s / "deep", "--draws", "400", "--warmup", "200", *_results(o)),
            *("--file", o / "chain.h5", "--save", o / "posterior.nc"),
        ]
    ),
    "campaign": Command(
        lambda s, o: [
            *("campaign", s, "--output", o / "out", "--jobs", "2", "--report"),
            *("--json", o / "a.json"),
        ]
    ),
    "check": Command(
        lambda s, o: [
            *("check", o / "fits", "--update", "--jobs", "2"),
            *("--json", o / "a.json", "--junit", o / "a.xml"),
        ],
        lambda o: make_specs(o / "fits"),
    ),
    "report": Command(
        lambda s, o: ["compare", s / "deep", *_results(o), "--figure", o / "a.png"],
    ),
}


def here(words: list[str]) -> tuple[int, str]:
    """Run a command in this process: its exit status and all that it said."""
    result = run(*words, status=None)
    return result.exit_code, result.output


def faults_of(folder: Path, temporaries: bool) -> list[str]:
    """The files of a folder that are not whole.

    Args:
        folder: with all that is below it.
        temporaries: hidden files that a kill may leave are no fault.
    """
    out = []
    for path in sorted(folder.rglob("*")):
        name = str(path.relative_to(folder))
        if any(part.startswith(".") for part in Path(name).parts):
            out += [] if temporaries else [f"{name} was left"]
        elif path.is_file() and (why := _why_not_whole(path)):
            out.append(f"{name}: {why}")
    return out


def _why_not_whole(path: Path) -> str:
    try:
        _WHOLE[path.suffix](path)
    except Exception as error:  # of a dozen readers: each says in its own way that it is not
        return f"{type(error).__name__}: {error}"
    return ""


def _page(path: Path) -> None:
    text = path.read_text()
    assert text.startswith("<!doctype html>"), "no beginning"
    assert text.rstrip().endswith("</html>"), "cut off"


def _figure(path: Path) -> None:
    assert path.read_bytes().endswith(b"IEND\xaeB`\x82"), "cut off"


def _hdf5(path: Path) -> dict[str, Any]:
    with h5py.File(path) as file:
        found: dict[str, Any] = {}
        file.visititems(
            lambda name, thing: (
                found.update({name: thing[()]}) if isinstance(thing, h5py.Dataset) else None
            )
        )
        return found


_WHOLE: dict[str, Callable[[Path], Any]] = {
    ".json": lambda path: json.loads(path.read_text()),
    ".html": _page,
    ".png": _figure,
    ".h5": _hdf5,
    ".nc": _hdf5,
    ".parquet": pq.read_table,
    ".xml": ElementTree.parse,
    ".toml": lambda path: tomllib.loads(path.read_text()),
    ".csv": lambda path: np.genfromtxt(path, delimiter=",", skip_header=1),
}


def contents(folder: Path) -> dict[str, Any]:
    """What the files of a folder say, by name, less what differs between equal runs."""
    return {name: _content(path) for name, path in _files(folder)}


def _files(folder: Path) -> Iterator[tuple[str, Path]]:
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            yield str(path.relative_to(folder)), path


def _content(path: Path) -> Any:
    if path.suffix == ".json":
        return _equal(json.loads(path.read_text()))
    if path.suffix == ".parquet":
        return _equal(pq.read_table(path).to_pylist())
    if path.suffix in (".h5", ".nc"):
        return {name: repr(np.asarray(value).tolist()) for name, value in _hdf5(path).items()}
    if path.suffix in (".html", ".xml", ".png"):  # of the same figures; times stand in them
        return "whole"
    return path.read_bytes()


def _equal(data: Any) -> Any:
    if isinstance(data, dict):
        return {key: _equal(value) for key, value in data.items() if key not in UNEQUAL}
    return [_equal(value) for value in data] if isinstance(data, list) else data

"""A workbench, in this process or in one of its own, and Chromium that looks at it."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import chromium
import example_names

import diffthrust as dft


def lacking_folder(folder: Path) -> Path:
    """A folder with a spec of two logs of a thruster that ignores small commands."""
    for log, name in zip(example_names.lacking(), ("run1.csv", "run2.csv"), strict=True):
        rows = zip(log.time, *log.inputs.values(), *log.measured.values(), strict=True)
        lines = [",".join(f"{number:.6f}" for number in row) for row in rows]
        (folder / name).write_text("\n".join(["time,command,speed,thrust", *lines, ""]))
    (folder / "fit.toml").write_text(f"# by hand\n{example_names.SPEC}")
    return folder


@contextmanager
def explored(what: Any, *logs: dft.Log) -> Iterator[str]:
    """The address of a workbench in this process, which has its programs compiled already."""
    bench = dft.explore(what, logs, browser=False, wait=False)
    try:
        yield bench.address
    finally:
        bench.close()
        bench.wait()


@contextmanager
def served(folder: Path, *words: str) -> Iterator[tuple[str, subprocess.Popen]]:
    """``diffthrust explore FOLDER`` in a process of its own: its address, and the process."""
    command = [sys.executable, "-m", "diffthrust", "explore", str(folder), "--no-browser"]
    with subprocess.Popen([*command, *words], stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            found = re.search(r"http://\S+", line)
            assert found, line
            yield found[0], process
        finally:
            process.kill()


@contextmanager
def looked_at(address: str, width: int = 1280, height: int = 720) -> Iterator[Any]:
    """The page in Chromium, once its sliders are there."""
    window = {"width": width, "height": height}
    with chromium.looked_at(address, r"(http|ws)://127\.0\.0\.1:", viewport=window) as page:
        page.wait_for_selector(".bk-Slider")
        yield page

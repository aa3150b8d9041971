"""The time of a whole diagnosis, cold and cached: ``pytest -m benchmark -s tests/benchmarks``.

Nothing here asserts a time: the targets stand beside the figures for people to judge.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from places import TESTS
from rich.console import Console
from rich.table import Table

pytestmark = pytest.mark.benchmark

WORK = """
import json, sys, time
begin = time.perf_counter()
import diffthrust as dft
from diffthrust._support._running.cache import enable_compilation_cache  # private: as the command
from hidden import sets

enable_compilation_cache()
imported = time.perf_counter()
drawn = sets.draw("clear/command_deadband", 11)
ready = time.perf_counter()
diag = dft.diagnose(drawn.model, drawn.train, holdout=drawn.unseen)
total = time.perf_counter() - ready + imported - begin
print(json.dumps({"import": imported - begin, **diag.seconds, "whole process": total}))
"""


def seconds(cache: Path) -> dict[str, float]:
    """Seconds by part of the work, in a process of its own."""
    env = {**os.environ, "DIFFTHRUST_CACHE": str(cache)}
    begin = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", WORK], check=True, capture_output=True, text=True, cwd=TESTS, env=env
    )
    found = json.loads(done.stdout.splitlines()[-1])
    assert found["whole process"] < time.perf_counter() - begin
    return found


def test_a_diagnosis_from_a_cold_process(tmp_path):
    cold, warm = seconds(tmp_path), seconds(tmp_path)
    table = Table("part", "first time", "compilation cached", title="Diagnosis: 3 x 2000 samples")
    for part in cold:
        target = {"whole process": (" (< 30 s)", " (< 10 s)")}.get(part, ("", ""))
        table.add_row(part, f"{cold[part]:.1f} s{target[0]}", f"{warm[part]:.1f} s{target[1]}")
    Console().print(table)
    assert warm["whole process"] > 0

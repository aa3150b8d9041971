"""The comparison with peers: that it measures what it says, and that all give the same answers."""

from __future__ import annotations

import importlib
import json
import math
import os
import platform
import subprocess
import sys
import textwrap
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from scipy.stats import linregress

from benchmarks.peers._jobs import JOBS
from benchmarks.peers._measure import Cell, growth, measure
from benchmarks.peers._problem import rk4
from benchmarks.peers._table import document, duration, machine, table, times
from benchmarks.peers._tools import INSTALL, OURS, TOOLS, Tool

SIZE = 256
"""Samples, scaled by each job: 16 points of a map, 4 logs."""
FAST = {("numba + SciPy", "simulation"), ("numba + SciPy", "fit")}
PAIRS = [(t, j) for t in TOOLS[1:] for j in JOBS if j not in t.absent]


def answer(tool, job):
    run = getattr(importlib.import_module(tool.module), job)(JOBS[job].scale(SIZE))
    return run(1)


@pytest.mark.parametrize(
    ("tool", "job"),
    [
        pytest.param(
            t, j, id=f"{t.name}-{j}", marks=[] if (t.name, j) in FAST else pytest.mark.slow
        )
        for t, j in PAIRS
    ],
)
def test_the_answers_are_ours(tool, job):
    if not tool.installed:
        pytest.skip(f"{tool.name} is not installed: {INSTALL}")
    ours, theirs = answer(OURS, job), answer(tool, job)
    assert np.shape(ours)[-1] == np.shape(theirs)[-1]
    assert JOBS[job].apart(ours, theirs) <= JOBS[job].allowed


@pytest.mark.parametrize("job", ["simulation", "fit", "describing_function"])
def test_an_answer_that_differs_is_told(job):
    ours = np.array([[1.0, 2.0, 4.0]])
    assert JOBS[job].apart(ours, ours) == 0.0
    assert JOBS[job].apart(ours, ours * (1 + 2 * JOBS[job].allowed)) > JOBS[job].allowed
    assert not JOBS[job].apart(ours, ours * math.nan) <= JOBS[job].allowed


def test_the_step_has_order_four():
    def end(steps):
        w, h = 1.0, 1.0 / steps
        for _ in range(steps):
            w = rk4(w, (0.0, 0.0, 0.0), 2.0, 1.0, h)
        return w

    off = [end(n) - 1.0 / 3.0 for n in (10, 20)]  # w' = -2 w |w| from 1 is 1 / (1 + 2 t)
    assert off[0] / off[1] == pytest.approx(16.0, rel=0.3)


def test_growth_is_the_slope_of_the_logarithms():
    sizes = [1000, 4000, 16000]
    exact = [Cell("a", "fit", n, times=[1e-6 * n**1.5] * 3) for n in sizes]
    assert growth(exact) == pytest.approx((1.5, 0.0), abs=1e-12)
    bent = [Cell("a", "fit", n, times=[t]) for n, t in zip(sizes, (1.0, 3.0, 20.0), strict=True)]
    known = linregress(np.log(sizes), np.log([1.0, 3.0, 20.0]))
    assert growth(bent) == pytest.approx((known.slope, known.stderr))
    assert growth(bent[:2])[0] == pytest.approx(math.log(3) / math.log(4))
    assert math.isnan(growth(bent[:2])[1])
    assert math.isnan(growth(bent[:1])[0])


def test_durations_and_ratios():
    found = [duration(t) for t in (12.345, 0.5, 2e-3, 4.2e-6)]
    assert found == ["12.3 s", "500 ms", "2 ms", "4.2 us"]
    assert [times(ratio) for ratio in (0.0456, 1.234, 1234.5)] == ["0.046", "1.2", "1,234"]


FAKES = {
    "ours": "lambda turn: np.ones((2, size)) * (2.0 if size > 200 else 1.0)",
    "large": "lambda turn: np.ones((1 << 23) + 2 * size)[: 2 * size].reshape(2, size)",
    "sleepy": "lambda turn: time.sleep(60)",
    "broken": "lambda turn: {}['nothing']",
}


@pytest.fixture
def fakes(tmp_path, monkeypatch):
    for name, code in FAKES.items():
        text = f"import time\nimport numpy as np\ndef simulation(size):\n    return {code}\n"
        (tmp_path / f"fake_{name}.py").write_text(textwrap.dedent(text))
    monkeypatch.syspath_prepend(tmp_path)
    accelerated = {"ours": ("simulation",)}
    made = [Tool(name, f"fake_{name}", accelerated=accelerated.get(name, ())) for name in FAKES]
    return [
        *made,
        Tool("missing", "fake_missing", ("no_module_of_this_name",)),
        Tool("other", "fake_other", absent={"simulation": "It does nothing."}),
    ]


def printed(shown):
    text = StringIO()
    Console(file=text, width=200).print(shown)
    return text.getvalue()


@pytest.mark.thorough
def test_what_becomes_of_each_tool(fakes):
    limit = 1.0
    cells = list(measure(["simulation"], [100, 400], fakes, repeats=2, limit=limit, gpu=True))
    on_gpu = [cell for cell in cells if cell.platform == "gpu"]
    cells = [cell for cell in cells if cell.platform == "cpu"]
    by = {(cell.tool, cell.size): cell for cell in cells}
    assert len(cells) == 2 * len(fakes)
    statuses = {tool.name: [by[tool.name, n].status for n in (100, 400)] for tool in fakes}
    assert statuses == {
        "ours": ["measured", "measured"],
        "large": ["measured", "wrong"],
        "sleepy": ["late", "late"],
        "broken": ["failed", "failed"],
        "missing": ["not installed"] * 2,
        "other": ["absent"] * 2,
    }
    large = by["large", 100]
    assert len(large.times) == 2
    assert large.peak - large.imported > 60  # 64 MiB of ones
    assert by["ours", 100].peak - by["ours", 100].imported < 30
    assert by["sleepy", 400].started is None  # not tried again
    assert "KeyError" in by["broken", 100].message

    shown, notes = table(cells, fakes, limit, None)
    assert "> 1 s" in printed(shown)
    assert "no GPU here" in printed(shown)
    assert [note[:3] for note in notes] == ["(a)", "(b)", "(c)", "(d)"]
    assert any(INSTALL in note for note in notes)
    assert any("differs by 5.0e-01" in note for note in notes)

    assert [(cell.tool, cell.size, cell.status) for cell in on_gpu] == [
        ("ours", 100, "measured"),
        ("ours", 400, "measured"),
    ]
    on_gpu[1].times = [7.89]
    filled = printed(table([*cells, *on_gpu], fakes, limit, "some GPU")[0])
    assert "7.89 s" in filled
    assert "no GPU here" not in filled

    told = json.dumps(document(cells, machine(None), {"limit": limit}), allow_nan=False)
    found = json.loads(told)
    assert platform.node() not in told or len(platform.node()) < 4
    assert len(found["cells"]) == len(cells)
    assert {row["tool"] for row in found["growth"]} == {"ours", "large"}


@pytest.mark.benchmark
def test_the_whole_table(tmp_path):
    file = tmp_path / "peers.json"
    command = [sys.executable, "-m", "benchmarks.peers", "--repeats", "3", "--json", str(file)]
    clean = {name: value for name, value in os.environ.items() if name != "XLA_FLAGS"}
    subprocess.run(command, check=True, cwd=Path(__file__).parents[1], env=clean)
    cells = json.loads(file.read_text())["cells"]
    assert [c for c in cells if c["status"] in ("wrong", "failed")] == []

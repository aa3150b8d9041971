"""Notebooks with a real kernel: images once, tables, short errors, a bar; and the tutorials."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import matplotlib
import nbformat
import pytest
from nbclient import NotebookClient
from places import ROOT

TUTORIALS = ROOT / "docs" / "getting-started"
CELL = re.compile(r"^```\{code-cell\}[^\n]*\n(.*?)^```$", re.MULTILINE | re.DOTALL)
PLOT = "dft.compare(dft.Thruster(), log).plot()"
BEGIN = """
import numpy as np
import diffthrust as dft
time = np.arange(60) * 0.05
log = dft.Log(time, {"command": np.sin(time)}, {"speed": 10 * np.sin(time)}, {"speed": "rpm"})
"""


@pytest.fixture
def kernel(monkeypatch):
    """An environment as a notebook has it: no backend is given, and the package is this one."""
    monkeypatch.delenv("MPLBACKEND", raising=False)
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setenv("JUPYTER_PLATFORM_DIRS", "1")


def executed(notebook: Any, folder: Path, errors: bool = False) -> list[list[Any]]:
    """What the cells of code put out, after they have run one after the other."""
    place = {"metadata": {"path": str(folder)}}
    client = NotebookClient(
        notebook, timeout=600, kernel_name="python3", allow_errors=errors, resources=place
    )
    client.execute()
    return [cell.outputs for cell in notebook.cells if cell.cell_type == "code"]


def data(outputs: list[Any], kind: str) -> list[str]:
    return [one.data[kind] for one in outputs if one.get("data", {}).get(kind)]


def printed(outputs: list[Any], stream: str = "stdout") -> str:
    return "".join(one.text for one in outputs if one.get("name") == stream)


@pytest.mark.thorough
def test_what_a_notebook_shows(kernel, tmp_path):
    one_image = (
        PLOT,
        f"fig = {PLOT}",
        f"{PLOT};",
        f"fig = {PLOT}\nfig",
        "fig",
        f"display({PLOT})",
        f"import matplotlib.pyplot as plt\n{PLOT}\nplt.show()",
        f"{PLOT}\nprint(len(plt.get_fignums()))",
    )
    fewer = (  # than the twenty that wait, and of which pyplot warns
        "from diffthrust._support import figures\n"
        "figures._MOST = plt.rcParams['figure.max_open_warning'] = 3"
    )
    many = f"{fewer}\nfor k in range(5): {PLOT}.savefig('figure.png')"
    cells = [
        BEGIN,
        *one_image,
        f"{PLOT}, {PLOT}",
        many,
        "print(dft.compare(dft.Thruster(), log).report())",
        "dft.compare(dft.Thruster(), log)",
        "log",
        "dft.Thruster()",
        "log.values('thrust', 'N')",
        "line = dft.Log(time, {'depth': time}, {'reading': 2 * time + 0.1 * np.sin(9 * time)})\n"
        "fit = dft.fit(dft.LinearSensor(), line, progress=True)",
    ]
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(c) for c in cells])
    begun, *rest = executed(notebook, tmp_path, errors=True)
    assert not begun

    for source, outputs in zip(one_image, rest, strict=False):
        assert len(data(outputs, "image/png")) == 1, source
        assert not printed(outputs, "stderr"), source
    assert printed(rest[7]) == "1\n"  # what waited for the end of its cell
    pair, loop, report, comparison, log, model, mistake, fit = rest[len(one_image) :]
    assert len(data(pair, "image/png")) == 2
    assert len(data(loop, "image/png")) == 5
    assert not printed(loop, "stderr")

    assert "Where the error sits" in printed(report)
    for outputs, words in ((comparison, "NRMSE"), (log, "rpm"), (model, "propeller load")):
        (page,) = data(outputs, "text/html")
        assert "<table" in page
        assert words in page
        (text,) = data(outputs, "text/plain")
        assert len(text) < 240

    (error,) = mistake
    assert error.ename == "InputError"
    assert error.traceback == [
        "InputError: log 'log': expected a channel 'thrust', found 'command', 'speed'.\n"
        "Mend: map a column of the log to 'thrust'."
    ]
    assert not data(fit, "text/html")  # the bar is gone when the work is done
    assert not printed(fit, "stderr")


def test_no_more_figures_wait_than_pyplot_takes_without_a_warning():
    assert matplotlib.rcParamsDefault["figure.max_open_warning"] >= 20  # as many stay open


@pytest.mark.slow  # the site's build runs them, too, and stops at an error
@pytest.mark.parametrize(
    ("name", "images", "tables"),
    [
        ("bench_thruster", 3, 4),
        ("boat_missing", 3, 2),
        ("rov_axis", 2, 2),
        ("rov_weak_thruster", 2, 1),
    ],
)
def test_the_tutorials_run(kernel, name, images, tables):
    cells = CELL.findall((TUTORIALS / f"{name}.md").read_text(encoding="utf-8"))
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(c) for c in cells])
    ran = executed(notebook, TUTORIALS)
    assert sum(len(data(outputs, "image/png")) for outputs in ran) == images
    assert all(len(image) > 20_000 for outputs in ran for image in data(outputs, "image/png"))
    assert sum("<table" in page for o in ran for page in data(o, "text/html")) == tables
    assert not any(printed(outputs, "stderr") for outputs in ran)

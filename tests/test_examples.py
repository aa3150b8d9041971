"""The examples run from top to bottom and print what they promise."""

import ast
import io
import os
import re
import subprocess
import sys
import tokenize
from pathlib import Path

import numpy as np
import pytest
from places import EXAMPLES
from shared_data import data_folder

from diffthrust.specs import load_spec


def run(name: str, folder: Path, **environment: str) -> str:
    """Run an example as its reader would, in a folder of its own, and give what it prints."""
    done = subprocess.run(
        [sys.executable, str(EXAMPLES / f"{name}.py"), str(folder / "figures")],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(EXAMPLES.parent), **environment},
        capture_output=True,
        text=True,
        timeout=900,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    return done.stdout


def unseen(text: str) -> dict[str, float]:
    """NRMSE of the unseen logs by channel, from the printed table."""
    rows = re.findall(r"^unseen +(\w+) +\S+ +\S+ +(\S+) +\S+ +\d+$", text, re.MULTILINE)
    return {channel: float(nrmse) for channel, nrmse in rows}


def figure(folder: Path, name: str) -> Path:
    path = folder / "figures" / name
    assert path.stat().st_size > 10_000
    return path


@pytest.mark.thorough
def test_fit_thruster(tmp_path):
    text = run("fit_thruster", tmp_path)
    errors = unseen(text)
    assert "Status: converged" in text
    assert errors["speed"] < 0.01
    assert errors["thrust"] < 0.02
    assert figure(tmp_path, "jason_unseen.png").stat().st_size < 150_000


@pytest.mark.thorough
def test_export(tmp_path):
    text = run("export", tmp_path)
    off = re.search(r"The module is within (\S+) of simulate, over 60 s", text).group(1)
    assert float(off) < 1e-12
    assert "uuv_simulator has no place for the effect 'command_deadband'" in text
    files = {path.suffix for path in (tmp_path / "figures").iterdir()}
    assert files == {".py", ".h", ".csv", ".sdf", ".xacro", ".scn"}


@pytest.mark.slow
def test_campaign(tmp_path):
    text = run("campaign", tmp_path)
    assert "thruster3: failed. steps.csv, line 302, column 'u': expected a number" in text
    assert "Out of line: thruster6" in text
    assert "7 of 8 were done before" in text
    figure(tmp_path, "fleet.png")


@pytest.mark.slow
def test_uncertainty(tmp_path):
    text = run("uncertainty", tmp_path)
    assert "gives an efficiency of 0.188" in text  # by the paper's own ct, whose text says 0.22
    low, high = re.search(r"^efficiency +(\S+) to (\S+)", text, re.MULTILINE).groups()
    assert float(low) < np.sqrt(0.02 / (1000 * 0.0527 * 0.101**2)) < float(high)  # the log's own ct
    for name in ("corner", "trace", "quantities", "band"):
        figure(tmp_path, f"jason_{name}.png")


@pytest.mark.slow
def test_uncertainty_measured(tmp_path):
    data_folder("ngs_thruster")
    data_folder("esso_osaka")
    text = " ".join(run("uncertainty_measured", tmp_path).split())
    for name, channels, runs in (("ngs", "speed thrust", 6), ("esso", "surge sway yaw_rate", 2)):
        told = re.findall(rf"{name}, unseen: \S+ the 95 % band holds ([^.]+)\.", text)
        assert len(told) == runs
        assert all(channel in sentence for channel in channels.split() for sentence in told)
        figure(tmp_path, f"{name}_band.png")
        figure(tmp_path, f"{name}_corner.png")
    assert "take the sandwich" in text  # their residuals last, and the table says so


@pytest.mark.slow
def test_own_model(tmp_path):
    data_folder("emps")
    text = run("own_model", tmp_path)
    found = re.search(r"without dry friction (\S+), with it (\S+)\.$", text, re.MULTILINE)
    assert found
    before, after = map(float, found.groups())
    assert after < 0.6 * before
    published = {"mass": 95.11, "viscous": 203.5, "offset": -3.165, "dry_friction.level": 20.39}
    for name, value in published.items():
        found = re.search(rf"^{re.escape(name)} +(\S+)", text, re.MULTILINE)
        assert found
        assert float(found[1]) == pytest.approx(value, rel=0.06)
    figure(tmp_path, "emps_unseen.png")


def test_own_model_in_a_spec_file(tmp_path):
    folder = os.path.relpath(data_folder("emps"), tmp_path)
    script = os.path.relpath(EXAMPLES / "own_model.py", tmp_path)
    (tmp_path / "fit.toml").write_text(
        f"""
        model = "{script}:Axis"
        effects = ["{script}:DryFriction"]
        [logs]
        train = ["{folder}/DATA_EMPS_SC.csv"]
        time = "time_exp"
        stop = 4.0
        [channels]
        force = {{ column = "u_in", unit = "N", scale = 35.15, hold = "linear" }}
        position = {{ column = "q_meas", unit = "m", scale = 0.125 }}
        [parameters]
        "dry_friction.level" = {{ value = 10.0 }}
        """
    )
    fit = load_spec(tmp_path, trust=EXAMPLES).fit()
    assert fit.status.ok, fit.message
    assert fit.parameters["mass"].value == pytest.approx(95.11, rel=0.1)


@pytest.mark.slow
def test_ngs_thruster(tmp_path):
    data_folder("ngs_thruster")
    text = run("ngs_thruster", tmp_path)
    stages = re.findall(r"^- (basic model.*): RMSE speed (\S+), thrust (\S+)$", text, re.MULTILINE)
    speed, thrust = [float(s[1]) for s in stages], [float(s[2]) for s in stages]
    assert speed[0] == pytest.approx(19.0, abs=1.5)  # the basic model fails, and the figures say so
    assert speed[-1] < 0.3 * speed[0]
    assert thrust[-1] < 0.7 * thrust[0]
    assert (
        "coulomb_friction" in stages[-1][0]
    )  # or a dead band, which these logs cannot tell from it
    figure(tmp_path, "ngs_diagnosis.html")
    figure(tmp_path, "ngs_stages.png")


@pytest.mark.slow
def test_open_loop_thrust(tmp_path):
    data_folder("ngs_thruster")
    text = run("open_loop_thrust", tmp_path)
    assert "Verdict: undecided" in text
    assert re.search(r"Left out: axial flow \([^)]*\)", text)
    assert "while the logs prescribe 'speed'" in text
    figure(tmp_path, "open_loop_stages.png")


@pytest.mark.slow
def test_blueboat(tmp_path):
    data_folder("blueboat")
    text = run("blueboat", tmp_path)
    errors = unseen(text)
    assert errors["surge"] < 1
    assert errors["yaw_rate"] > 1  # the basic model fails, and the figures say so
    assert "12 of 486 samples are missing" in text
    words = " ".join(text.split())
    assert "yaw_rate: the measurement moves opposite to the model" in words
    assert "Exchanging the inputs left_force and right_force" in words
    figure(tmp_path, "blueboat_unseen.png")


@pytest.mark.slow
def test_esso_osaka(tmp_path):
    data_folder("esso_osaka")
    text = run("esso_osaka", tmp_path)
    stages = re.findall(r"^- (basic model.*): NRMSE (\S+) \(surge", text, re.MULTILINE)
    assert float(stages[0][1]) == pytest.approx(0.552, abs=0.01)  # the basic model fails
    assert "wind" in stages[-1][0]
    assert float(stages[-1][1]) <= 0.29
    figure(tmp_path, "esso_diagnosis.html")
    figure(tmp_path, "esso_stages.png")


@pytest.mark.parametrize(
    "name",
    [
        "own_model",
        "ngs_thruster",
        "open_loop_thrust",
        "blueboat",
        "esso_osaka",
        "uncertainty_measured",
    ],
)
def test_absent_logs_end_in_one_sentence(name, tmp_path):
    text = run(name, tmp_path, DIFFTHRUST_DATA=str(tmp_path / "nowhere"))
    assert text.count("\n") == 1
    assert "DIFFTHRUST_DATA" in text


def code_lines(source: str) -> int:
    """Lines of a script without blank lines, comments and docstrings."""
    skip = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT}
    skip |= {tokenize.ENDMARKER, tokenize.ENCODING}
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type not in skip:
            lines |= set(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(ast.parse(source)):
        documented = isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)
        if documented and ast.get_docstring(node):
            first = node.body[0]
            lines -= set(range(first.lineno, (first.end_lineno or first.lineno) + 1))
    return len(lines)


def test_own_model_is_short():
    assert code_lines((EXAMPLES / "own_model.py").read_text()) <= 40


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.stem)
def test_examples_say_what_they_show(path):
    assert ast.get_docstring(ast.parse(path.read_text()))
    if not path.stem.startswith("_"):
        assert code_lines(path.read_text()) <= 65

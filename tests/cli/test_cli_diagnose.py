"""The command ``diagnose``: what it hands over, prints and writes, and its exit status."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import made_diagnosis as made
import pytest
from command_line import refused, run
from reference.records import Column, Record, write_csv

import diffthrust as dft
from diffthrust.diagnosis import Diagnosis
from diffthrust.effects import CommandDeadband

pytestmark = pytest.mark.usefixtures("no_cache")

SPEC = """model = "thruster"
effects = []
[logs]
train = ["train.csv"]
holdout = ["unseen.csv"]
time = { column = "t", unit = "s" }
[channels.command]
column = "u"
unit = "V"
[channels.speed]
column = "w"
unit = "rad/s"
[channels.thrust]
column = "f"
unit = "N"
[fit]
starts = 2
"""


@pytest.fixture
def spec(tmp_path: Path) -> Path:
    for name, log in zip(("train", "unseen"), made.logs(), strict=True):
        series = (dict(x) for x in (log.inputs, log.measured))
        columns = {"t": Column("time"), "u": Column("command"), "w": Column("speed")}
        columns["f"] = Column("thrust")
        write_csv(Record(log.time, *series, truth={}), tmp_path / f"{name}.csv", columns)
    path = tmp_path / "run.toml"
    path.write_text(SPEC)
    return path


@pytest.fixture
def handed(monkeypatch) -> dict[str, Any]:
    """What the command hands to the diagnosis, in place of which one made by hand is returned."""
    seen: dict[str, Any] = {}

    def fake(fit: dft.estimation.Fit, logs: Any, **options: Any) -> Diagnosis:
        seen.update(options, fit=fit, logs=logs)
        return made.found()

    monkeypatch.setattr("diffthrust.diagnosis._diagnose.diagnose", fake)
    return seen


@pytest.mark.thorough
def test_it_prints_and_writes(spec, handed, tmp_path):
    out, page = tmp_path / "d.json", tmp_path / "d.html"
    result = run("diagnose", spec, "--json", out, "--report", page)
    flat = " ".join(result.stdout.split())
    assert " ".join(made.found().summary.split()) in flat
    for word in ("Stages", "command dead band", f"Written: {out}", f"Written: {page}"):
        assert word in result.stdout
    data = json.loads(out.read_text())
    assert data == json.loads(json.dumps(made.found().to_json()))
    assert list(data) == [
        "schema", "verdict", "sought", "doubts", "added", "detectable", "detectable_groups",
        "worth", "possible", "groups", "stages", "ranking", "remaining", "changed", "learned",
        "odd_logs", "held", "exchanged", "idle_bounds", "untestable", "other_models", "unused",
        "recurring", "headroom",
    ]  # fmt: skip
    text = page.read_text()
    assert "<title>Diagnosis: run</title>" in text
    assert "model = &#34;thruster&#34;" in text  # the spec at its end
    assert [log.name for log in handed["logs"]] == ["train.csv"]
    assert [log.name for log in handed["holdout"]] == ["unseen.csv"]
    assert handed["candidates"] is None
    assert handed["fit"].status.ok


def test_brief_is_the_answer_alone(spec, handed):
    result = run("diagnose", spec, "--brief")
    assert result.stdout.split() == made.found().summary.split()
    assert handed["experiment"] is False
    run("diagnose", spec)
    assert handed["experiment"] is True


def test_the_effects_of_the_spec_belong_to_the_model(spec, handed):
    spec.write_text(SPEC.replace("effects = []", 'effects = ["command_deadband"]'))
    run("diagnose", spec)
    assert [effect.name for effect in handed["fit"].model.effects] == ["command_deadband"]


def test_without_unseen_logs(spec, handed):
    spec.write_text(SPEC.replace('holdout = ["unseen.csv"]\n', ""))
    run("diagnose", spec)
    assert handed["holdout"] is None


def test_candidates_are_named_or_the_users_own(spec, handed):
    (spec.parent / "own.py").write_text(
        "import diffthrust as dft\n"
        "class Mine(dft.Effect):\n"
        "    name, port = 'mine', 'shaft'\n"
        "    size: float = dft.parameter(0.1, null=0.0)\n"
        "    def __call__(self, value, s):\n"
        "        return value * (1 + self.size)\n"
    )
    run("diagnose", spec, "--candidates", "actuator_lag, own.py:Mine")
    name, own = handed["candidates"]
    assert name == "actuator_lag"
    assert issubclass(own, dft.Effect)
    assert own.name == "mine"


def test_bad_input_is_one_message_and_status_2(spec, tmp_path):
    assert "none.toml" in refused("diagnose", tmp_path / "none.toml")
    assert "--candidates" in refused("diagnose", spec, "--candidates", " , ")
    near = refused("diagnose", spec, "--candidates", "comand_deadband")
    assert "comand_deadband" in near
    assert "command_deadband" in near
    assert "own.py" in refused("diagnose", spec, "--candidates", "own.py:Mine")


def test_a_file_that_cannot_be_written_is_told_before_the_work(spec, handed, tmp_path):
    result = run("diagnose", spec, "--report", tmp_path / "no" / "d.html", status=2)
    assert "no/d.html" in result.stderr
    assert not handed


@pytest.mark.thorough
def test_a_diagnosis_from_beginning_to_end(spec, tmp_path):
    out, page = tmp_path / "d.json", tmp_path / "d.html"
    result = run(
        *("diagnose", spec, "--json", out, "--report", page),
        *("--candidates", CommandDeadband.name),
    )
    data = json.loads(out.read_text())
    assert data["added"] == ["command_deadband"]
    before, after = (stage["holdout"]["nrmse"] for stage in data["stages"])
    assert after < 0.2 * before
    told = re.search(r"lacks a command dead band of ±(\S+) V:", " ".join(result.stdout.split()))
    assert told is not None
    assert float(told[1]) == pytest.approx(made.BAND, rel=0.02)
    assert "data:image/png;base64," in page.read_text()

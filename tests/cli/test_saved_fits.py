"""Results that ``--save`` has kept: Python loads them, and commands go on without fitting again."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from command_line import run
from places import FITS
from short_logs import made_log

import diffthrust as dft

pytestmark = pytest.mark.usefixtures("no_cache")

SENSOR = FITS / "depth_sensor"
SPEC = """\
model = "{}"

[logs]
train = ["run1.csv"]
holdout = ["run2.csv"]

[channels]
command = {{ column = "command", unit = "V" }}
speed = {{ column = "speed", unit = "rad/s" }}
"""
OWN = '''\
import diffthrust as dft


class Lagged(dft.Model):
    """A speed that follows the command at a rate."""

    name = "lagged"
    inputs = {"command": "V"}
    states = {"speed": "rad/s"}
    outputs = {"speed": "rad/s"}
    rate: float = dft.parameter(5.0, "1/s", bounds=(0, None))

    def equations(self, s, port):
        return {"speed": self.rate * (20.0 * s.command - s.speed)}, {"speed": s.speed}
'''


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for seed in (1, 2):
        log = made_log(seed, count=200)
        rows = zip(log.time, log.inputs["command"], log.measured["speed"], strict=True)
        lines = "\n".join(",".join(f"{x:.6g}" for x in row) for row in rows)
        (tmp_path / f"run{seed}.csv").write_text(f"time,command,speed\n{lines}\n")
    (tmp_path / "fit.toml").write_text(SPEC.format("thruster"))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_kept_fit_is_compared_as_it_is(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run("fit", "fit.toml", "--save", "run.fit.json")
    by_spec = run("compare", "fit.toml")

    def never(*_: object, **__: object) -> None:
        raise AssertionError("it is fitted again")

    monkeypatch.setattr("diffthrust.estimation._fit.fit_records", never)
    kept = run("compare", "run.fit.json")
    assert kept.output == by_spec.output


def test_a_kept_fit_is_where_a_diagnosis_begins(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run("fit", "fit.toml", "--save", "run.fit.json")
    begun: list[object] = []

    def noted(fit: object, *_: object, **__: object) -> None:
        begun.append(fit)
        raise dft.InputError("enough", "enough")

    monkeypatch.setattr("diffthrust.diagnosis._diagnose.diagnose", noted)
    run("diagnose", "run.fit.json", status=2)
    (fit,) = begun
    assert isinstance(fit, dft.estimation.Fit)
    assert fit.parameters == dft.load("run.fit.json").parameters


def test_a_folder_that_was_moved_takes_its_spec_along(folder: Path) -> None:
    run("fit", "fit.toml", "--save", "run.fit.json")
    moved = folder.with_name("moved")
    folder.rename(moved)
    run("compare", moved / "run.fit.json")


def test_a_fit_of_another_spec_is_refused_with_the_mend(folder: Path) -> None:
    run("fit", "fit.toml", "--save", "run.fit.json")
    (folder / "fit.toml").write_text(SPEC.format("speed_loop_thruster"))
    result = run("compare", "run.fit.json", status=2)
    assert "is not as it was when run.fit.json was fitted" in result.output
    assert re.search(r"diffthrust fit .*fit\.toml --save run\.fit\.json", result.output)
    dft.fit(dft.Thruster(), made_log(1), starts=1).save("python.fit.json")
    result = run("diagnose", "python.fit.json", status=2)
    assert "diffthrust fit SPEC --save python.fit.json" in result.output


def test_a_model_of_ones_own_is_compared_and_exported(folder: Path) -> None:
    (folder / "mine.py").write_text(OWN)
    (folder / "fit.toml").write_text(SPEC.format("mine.py:Lagged"))
    run("fit", "fit.toml", "--save", "mine.fit.json")
    run("compare", "mine.fit.json")  # the spec names its script
    refused = run("export", "mine.fit.json", "--to", "c", status=2)
    mend = re.search(r"--trust (\S+)\.\n", refused.output)
    assert mend, refused.output
    exported = run("export", "mine.fit.json", "--to", "c", "--trust", mend[1])
    assert "lagged" in exported.output
    run("export", "mine.fit.json", "--to", "c", "--trust", folder / "sub", status=2)


def test_a_fit_is_saved_and_loaded(tmp_path):
    path = tmp_path / "depth.json"
    output = run("fit", SENSOR, "--save", path).output
    fit = dft.load(path)
    spec = dft.load_spec(SENSOR)
    assert fit.origin.spec == spec.sha256
    assert [log.sha256 for log in fit.data] == [log.sha256 for log in spec.train_logs()]
    assert f"Spec {spec.sha256[:8]}." in output
    assert f"Written: {path}" in output
    assert fit.parameters == spec.fit().parameters


def test_a_diagnosis_is_saved_and_loaded(tmp_path):
    path = tmp_path / "depth.json"
    run("diagnose", SENSOR, "--save", path)
    diag = dft.load(path)
    assert diag.verdict in ("adequate", "effects_found", "unexplained", "undecided")
    assert diag.origin.spec == dft.load_spec(SENSOR).sha256
    assert "\nmodel = dft.LinearSensor()" in diag.report()


def test_a_posterior_is_saved_and_loaded(tmp_path):
    path = tmp_path / "depth.nc"
    run("sample", SENSOR, "--draws", 20, "--warmup", 10, "--save", path)
    post = dft.load(path)
    fit = dft.load_spec(SENSOR).fit()
    draws = dft.predict(post, fit, dft.load_spec(SENSOR).holdout_logs()[0])
    assert np.isfinite(draws.channels["reading"].median).all()
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(("command", "name"), [("fit", "a.toml"), ("sample", "a.json")])
def test_another_ending_is_refused_before_the_work(command, name, tmp_path):
    run(command, SENSOR, "--save", tmp_path / name, status=2)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("option", ["--save", "--report", "--json"])
def test_a_folder_that_is_not_there_is_refused_before_the_work(option, tmp_path):
    """A diagnosis of half a minute ended in "No such file or directory"."""
    path = (tmp_path / "nowhere" / "depth").with_suffix(".html" if "rep" in option else ".json")
    missing = tmp_path / "no.toml"  # read only after the options
    result = run("diagnose", missing, option, path, status=2)
    told = "".join(result.output.split())  # lines are broken anywhere
    assert f"expectedthefolder'{path.parent}',foundnone" in told

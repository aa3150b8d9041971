"""A new fit runs at once, is refused where it would overwrite, and becomes a gate of its folder."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from command_line import run

import diffthrust as dft
from diffthrust.models import MODELS
from diffthrust.specs import load_spec


@pytest.fixture(autouse=True)
def _in_a_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("DIFFTHRUST_CACHE", "off")
    monkeypatch.chdir(tmp_path)


def new_fit(name, model="thruster"):
    run("new", "--model", model, "--", name)
    return Path("fits", name)


def refused(*words):
    return " ".join(run("new", *words, status=2).stderr.split())


@pytest.mark.parametrize("model", MODELS)
def test_the_spec_of_every_model_is_read_with_its_logs(model):
    folder = new_fit("first", model)
    spec = load_spec(folder)
    (train,), (unseen,) = spec.train_logs(), spec.holdout_logs()
    assert set(train.measured) == set(spec.model.outputs)
    assert not any((train.inputs[name] == unseen.inputs[name]).all() for name in train.inputs)
    assert spec.file.expected is None
    assert sum(path.stat().st_size for path in folder.iterdir()) < 60_000


@pytest.mark.parametrize("model", MODELS)
def test_what_is_commented_out_is_valid(model):
    path = new_fit("first", model) / "fit.toml"
    text = path.read_text()
    opened = re.sub(r"^# (?=\[|\w+ = )", "", text, flags=re.MULTILINE)
    assert opened.count("\n") == text.count("\n")
    assert "\n[fit]" in opened
    path.write_text(opened)
    spec = load_spec(path)
    assert spec.file.fit.starts == 8
    assert spec.file.fit == type(spec.file.fit)()  # they are the defaults, as it says


def test_from_a_new_fit_to_a_gate():
    out = run("new", "bollard").stdout
    spec = Path("fits", "bollard", "fit.toml")
    assert str(spec.parent) in out
    assert "--update" in out
    assert "no [expected] block" in run("check", "fits", status=1).stdout
    assert "rewritten: bollard" in run("check", "fits", "--update").stdout
    assert "none moved" in run("check", "fits").stdout
    expected = load_spec(spec).file.expected
    assert expected is not None
    alpha = expected.parameters["alpha"]
    assert alpha.value == pytest.approx(1.15 * 0.037, abs=4 * alpha.std_error)  # as it was made
    before = f"alpha = {{ value = {alpha.value:.10g},"
    after = f"alpha = {{ value = {alpha.value - 4 * alpha.std_error:.10g},"
    assert before in spec.read_text()
    spec.write_text(spec.read_text().replace(before, after))
    words = run("check", "fits", status=1).stdout
    (line,) = [line for line in words.splitlines() if "moved" in line and "alpha" in line]
    assert "+4.0 std errors" in line
    assert "beta" not in words
    assert "1 of 1 fit failed: bollard" in words


def test_nothing_is_overwritten():
    folder = new_fit("harbour/run1")
    before = (folder / "fit.toml").read_bytes()
    assert "expected a new name" in refused("harbour/run1", "--model", "vessel")
    assert (folder / "fit.toml").read_bytes() == before
    run("new", "--workflow")
    (workflow,) = Path(".github/workflows").iterdir()
    workflow.write_text("mine")
    run("new", "other", "--workflow", status=2)
    assert workflow.read_text() == "mine"
    assert not Path("fits", "other").exists()


@pytest.mark.parametrize(
    "name", ["", ".", "..", "../x", "/x", "a//b", "a b", "-x", ".x", "ä", "a\n"]
)
def test_names_are_those_of_folders(name, tmp_path):
    assert "expected a name" in refused("--", name)
    assert list(tmp_path.iterdir()) == []


def test_what_is_not_known_is_refused(tmp_path):
    assert "the nearest is 'thruster'" in refused("first", "--model", "thrster")
    (tmp_path / "fits").write_text("")
    assert "cannot be made" in refused("first")
    assert "expected the NAME" in run("new", status=2).stderr


def test_the_workflow_stands_in_the_root_of_the_repository(tmp_path):
    (tmp_path / "boat" / ".git").mkdir(parents=True)
    fits = tmp_path / "boat" / "tests" / "fits"
    out = run("new", "--workflow", "--directory", fits).stdout
    path = tmp_path / "boat" / ".github" / "workflows" / "fits.yml"
    assert "fits.yml" in out
    text = path.read_text()
    assert 'diffthrust check "tests/fits" --junit fits.xml' in text
    assert f"diffthrust[junit]=={dft.__version__}" in text
    assert not fits.exists()
    assert "of a git repository" in refused("--workflow", "--directory", tmp_path.parent)

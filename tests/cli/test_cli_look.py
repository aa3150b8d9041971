"""``diffthrust look``, where other commands point to it, and what ``explore`` cannot open."""

from __future__ import annotations

import json

import example_names
import pytest
from command_line import run
from survey.strange_logs import thruster, write_table

pytestmark = pytest.mark.usefixtures("no_cache")


@pytest.fixture
def run1(tmp_path):
    log = thruster()
    table = {"t": log["time"], "pwm": 1500 + 400 * log["effort"], "rpm": 9.549 * log["speed"]}
    return write_table(tmp_path / "run1.csv", table)


def test_look_prints_and_writes_a_spec_that_fits(run1, tmp_path):
    spec, data, figure = (tmp_path / name for name in ("fit.toml", "look.json", "look.png"))
    told = run("look", run1, "--spec", spec, "--json", data, "--figure", figure).stdout
    for word in ("pwm", "rpm", "Model: thruster", f"Written: {spec}", f"diffthrust fit {spec}"):
        assert word in told
    assert json.loads(data.read_text())["spec"].count("[channels.") == 2
    assert figure.read_bytes().startswith(b"\x89PNG")
    assert "per full effort" in run("fit", spec).stdout


@pytest.mark.parametrize(("columns", "least", "most"), [("60", 50, 60), ("", 101, 140)])
def test_piped_text_has_the_given_width_and_no_blanks_at_its_ends(
    columns, least, most, run1, monkeypatch
):
    monkeypatch.setenv("COLUMNS", columns)
    told = run("look", run1).stdout.split("\nNext: ")[0].splitlines()
    assert not any(line.endswith(" ") for line in told)
    assert least <= max(map(len, told)) <= most


def test_look_alone_says_how_to_go_on(run1):
    assert f"diffthrust look {run1} --spec fit.toml" in run("look", run1).stdout


def test_look_writes_nothing_where_the_spec_is_taken(run1, tmp_path):
    spec, data = tmp_path / "fit.toml", tmp_path / "look.json"
    spec.write_text("# mine\n")
    told = run("look", run1, "--spec", spec, "--json", data, status=2).output
    assert "nothing is overwritten" in told
    assert spec.read_text() == "# mine\n"
    assert not data.exists()


@pytest.mark.parametrize("command", ["fit", "compare", "diagnose", "sample"])
def test_a_log_given_for_a_spec_points_to_look(command, run1):
    told = run(command, run1, status=2).output
    assert "expected a spec file (TOML), found a log" in told
    assert f"diffthrust look {run1} --spec fit.toml, then diffthrust fit fit.toml" in told


def test_a_spec_may_have_any_ending(run1, tmp_path):
    spec = tmp_path / "fit.txt"
    run("look", run1, "--spec", tmp_path / "fit.toml")
    (tmp_path / "fit.toml").rename(spec)
    assert "thruster" in run("fit", spec).stdout


def test_a_folder_of_logs_alone_points_to_look(run1):
    told = run("fit", run1.parent, status=2).output
    assert "found only logs" in told
    assert f"diffthrust look {run1.parent} --spec fit.toml" in told


def test_a_folder_without_anything_does_not(tmp_path):
    assert "look" not in run("fit", tmp_path, status=2).output


def test_what_is_no_log_is_told_with_what_is_read(tmp_path):
    (tmp_path / "x.bin").write_bytes(bytes(range(256)))
    assert "Mend:" in run("look", tmp_path / "x.bin", status=2).output
    assert "found none" in run("look", tmp_path / "absent.csv", status=2).output
    (tmp_path / "fit.toml").write_text('model = "thruster"\nalpha = 1\n')
    assert "fewer than two columns" in run("look", tmp_path / "fit.toml", status=2).output
    (tmp_path / "empty").mkdir()
    assert "expected a folder with logs" in run("look", tmp_path / "empty", status=2).output


def test_what_cannot_be_opened_ends_with_a_message(tmp_path):
    assert "the spec file cannot be read" in run("explore", tmp_path / "no.toml", status=2).output
    text = example_names.SPEC.replace('"thruster"', '"own.py:Mine"')
    (tmp_path / "fit.toml").write_text(text)
    refused = run("explore", tmp_path, "--no-browser", status=2).output
    assert "it names the script own.py, which the workbench does not run" in refused
    assert f"--trust {tmp_path}" in refused

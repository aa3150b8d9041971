"""Names that hold orders for the terminal, markup, or bytes that are no text: shown, not obeyed."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

import command_line
import pytest
from campaign_specs import SENSOR, InPlace, sensor_log, sensor_spec

from diffthrust.many import campaign

pytestmark = pytest.mark.usefixtures("no_cache")

ESCAPE, MARKUP, BYTES = "red\x1b[31m\nline", "bold[bold red]", os.fsdecode(b"byte\xff")
SHOWN = {ESCAPE: "red\\x1b[31m\\nline", MARKUP: MARKUP, BYTES: "byte\\xff"}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A fit in a folder of each name, whose log is called alike; one spec that asks too much."""
    if sys.platform in ("darwin", "win32"):
        pytest.skip("its file systems take no such names")
    for name in SHOWN:
        spec = sensor_spec(tmp_path / "fits" / name, slope=0.5)
        spec.with_name("train.csv").rename(spec.with_name(f"{name}.csv"))
        spec.write_text(SENSOR.replace("train.csv", "*.csv"))
    greedy = sensor_spec(tmp_path / "fits" / "greedy", slope=0.5)
    greedy.write_text(f"{SENSOR}[fit]\nstarts = 1000000\n")
    os.mkfifo(greedy.with_name("more.toml"))
    return tmp_path


def run(*words: object, status: int = 0) -> str:
    result = command_line.run(*words, status=status)
    assert "\x1b" not in result.output
    return result.output


@pytest.mark.parametrize("name", SHOWN)
def test_a_fit_and_all_its_files(folder, name):
    out = {kind: folder / f"out{kind}" for kind in (".json", ".html")}
    saved = folder / "saved.json"
    told = run(
        "fit", folder / "fits" / name, "--json", out[".json"], "--report", out[".html"],
        "--save", saved,
    )  # fmt: skip
    assert f"{SHOWN[name]}.csv" in told
    assert json.loads(out[".json"].read_text("utf-8"))["status"] == "converged"
    assert "</html>" in out[".html"].read_text("utf-8")
    assert json.loads(saved.read_text("utf-8"))


@pytest.mark.parametrize("name", SHOWN)
def test_a_look(folder, name):
    log, spec = folder / "fits" / name / f"{name}.csv", folder / "new.toml"
    told = run("look", log, "--json", folder / "look.json", "--figure", folder / "look.png")
    assert SHOWN[name].split("\\n")[0] in told
    assert json.loads((folder / "look.json").read_text("utf-8"))["path"] == str(log)
    if name == BYTES:
        assert "\\xff in a name, which is no UTF-8" in run("look", log, "--spec", spec, status=2)
        assert not spec.exists()
    else:
        run("look", log, "--spec", spec)
        assert name.split("[")[0] in spec.read_text("utf-8").encode().decode("unicode_escape")


def test_a_check_tells_each_in_its_row(folder):
    first = run("check", folder / "fits", "--update", "--jobs", 1, status=1)
    assert "greedy" in first
    out, junit = folder / "check.json", folder / "check.xml"
    told = run(
        "check", folder / "fits", "--jobs", 1, "--all", "--json", out, "--junit", junit, status=1
    )
    for shown in SHOWN.values():
        assert shown in told
    assert "1 of 4 fits failed: greedy" in told
    assert json.loads(out.read_text("utf-8"))
    assert junit.is_file()


def test_a_campaign_goes_on_to_its_end(folder):
    done = campaign(folder / "fits", output=folder / "out", executor=InPlace(), report=True)
    rows = {row["name"]: row for row in json.loads(json.dumps(done.to_json()))["rows"]}
    assert set(rows) == {*SHOWN.values(), "greedy", "greedy/more"}
    assert "fit.starts" in rows["greedy"]["error"]
    assert "named pipe" in rows["greedy/more"]["error"]
    assert done.counts == {"ok": 3, "failed": 2}
    assert "\x1b" not in done.report()
    assert set(done.table["name"]) == set(rows)


def test_columns_named_so_are_shown(tmp_path):
    log = tmp_path / "run.csv"
    sensor_log(log, 0.5, 1.0)
    log.write_text(log.read_text().replace("reading_V", "[red]reading"))
    assert "[red]reading" in run("look", log)

"""The command line: what it prints, what it writes, and its exit status."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import jax
import pytest
from command_line import refused, run
from places import FITS, ROOT
from processes import enable_compilation_cache

import diffthrust
import diffthrust as dft
from diffthrust.cli._demo import hidden_effects, hidden_folder  # private: what is hidden
from diffthrust.specs import load_spec

pytestmark = pytest.mark.usefixtures("no_cache")

ERROR_KEYS = {"rmse", "nrmse", "fit_percent", "samples", "unit", "written"}


@pytest.fixture
def sensor(tmp_path: Path) -> Path:
    return shutil.copytree(FITS / "depth_sensor", tmp_path / "fits" / "depth_sensor")


def test_fit_prints_and_writes(sensor, tmp_path):
    out, page = tmp_path / "fit.json", tmp_path / "fit.html"
    result = run("fit", sensor / "fit.toml", "--json", out, "--report", page)
    for word in ("converged", "slope", "V/m", "unseen", str(out), str(page)):
        assert word in result.stdout
    data = json.loads(out.read_text())
    assert list(data) == [
        "schema", "model", "effects", "status", "parameters", "train", "holdout", "checks",
        "doubts",
    ]  # fmt: skip
    assert data["schema"] == 1
    assert data["model"] == "linear_sensor"
    slope = data["parameters"]["slope"]
    assert set(slope) == {"value", "std_error", "unit", "fixed", "at_bound", "written"}
    assert slope["value"] == pytest.approx(0.159, abs=0.002)
    for part in ("train", "holdout"):
        channel = data[part]["channels"]["reading"]
        assert set(channel) == ERROR_KEYS
    assert set(data["checks"]) == {
        "gradient", "rank", "free_parameters", "condition", "starts", "starts_agreeing",
    }  # fmt: skip
    html = re.sub("<script.*?</script>", "", page.read_text(), flags=re.DOTALL)
    assert "data:image/png;base64," in html
    assert "slope" in html
    assert not re.search(r'(src|href)="(?!data:)', html)  # it needs nothing from elsewhere


def test_reports_escape_what_the_user_wrote(sensor, tmp_path):
    spec = sensor / "fit.toml"
    spec.write_text("# <script>alert(1)</script>\n" + spec.read_text())
    run("compare", spec, "--no-fit", "--report", tmp_path / "a.html")
    assert "<script>alert" not in (tmp_path / "a.html").read_text()


def test_compare_with_and_without_a_fit(sensor, tmp_path):
    out, figure = tmp_path / "c.json", tmp_path / "c.png"
    run("compare", sensor, "--no-fit", "--json", out, "--figure", figure)
    raw = json.loads(out.read_text())
    run("compare", sensor, "--json", out)
    fitted = json.loads(out.read_text())
    assert figure.read_bytes().startswith(b"\x89PNG")
    assert raw["status"] is None
    assert fitted["status"] == "converged"
    assert [run["name"] for run in raw["train"]["runs"]] == ["train.csv"]
    assert raw["holdout"]["errors"]["nrmse"] > 3 * fitted["holdout"]["errors"]["nrmse"]


def test_check_tells_by_its_exit_status(sensor, tmp_path):
    out = tmp_path / "check.json"
    assert "none moved" in run("check", sensor.parent, "--json", out).stdout
    assert json.loads(out.read_text())["ok"]
    data = sensor / "train.csv"
    data.write_text(data.read_text().replace("1.622", "1.662"))
    result = run("check", sensor.parent, status=1)
    assert "moved" in result.stdout
    assert "std errors" in result.stdout
    assert "1 of 1 fit failed: depth_sensor" in result.stdout
    assert "rewritten: depth_sensor" in run("check", sensor.parent, "--update").stdout
    run("check", sensor.parent)


def test_demo(tmp_path):
    result = run("demo", "--output", tmp_path / "out")
    assert "NRMSE" in result.stdout
    figure = tmp_path / "out" / "comparison.png"
    assert str(figure) in result.stdout
    assert figure.read_bytes().startswith(b"\x89PNG")


def test_effects_are_listed_with_parameters_and_units():
    text = run("effects").stdout
    for word in (
        "command_deadband",
        "width [the unit of command]",
        "actuator_lag",
        "time_constant [s]",
        "drive",
        "craft (planar)",
        "rudder_propeller",
    ):
        assert word in text


def test_version_and_help():
    assert diffthrust.__version__ in run("--version").stdout
    text = run("--help").stdout
    words = ("fit", "compare", "diagnose", "sample", "check", "demo", "effects")
    assert all(word in text for word in words)
    assert "--candidates" in run("diagnose", "--help").stdout


def test_bad_input_is_one_message_and_status_2(sensor, tmp_path):
    spec = sensor / "fit.toml"
    assert "none.toml" in refused("fit", tmp_path / "none.toml")
    assert "fits" in refused("check", tmp_path / "nowhere")
    assert ".gif" in refused("compare", spec, "--no-fit", "--figure", tmp_path / "a.gif")
    assert "no/a.json" in refused("compare", spec, "--no-fit", "--json", tmp_path / "no/a.json")
    (tmp_path / "file").write_text("")
    assert "file" in refused("demo", "--output", tmp_path / "file")
    assert "found another spec" in refused("demo", "--missing", "--output", sensor)
    spec.write_text(spec.read_text().replace('"m"', '"kg"'))
    assert "depth" in refused("fit", spec)
    run("fit", status=2)
    run("fut", status=2)


def test_a_defect_is_told_as_one(sensor, monkeypatch):
    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError("oh")

    monkeypatch.setattr("diffthrust.specs._spec.load_spec", broken)
    result = run("fit", sensor, status=3)
    assert "ZeroDivisionError" in result.stderr
    assert "Traceback" not in result.output


def test_numbers_that_json_does_not_have():
    from diffthrust._support.files import plain  # private: of no folder's face

    assert plain({"a": [float("nan"), float("inf"), 1]}) == {"a": [None, None, 1]}


def test_in_a_process_of_its_own_the_cache_is_filled(sensor, tmp_path):
    cache = tmp_path / "cache"
    result = subprocess.run(
        [sys.executable, "-m", "diffthrust.cli._app", "fit", str(sensor)],
        env={**os.environ, "DIFFTHRUST_CACHE": str(cache), "JAX_PLATFORMS": "cpu"},
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    assert "cache" not in result.stderr  # a slow machine is told of its progress
    assert "slope" in result.stdout
    kept = {file.name.split("-")[0] for file in cache.iterdir()}
    search, simulation = "jit_solved_by_passes", "jit_compiled_simulation"
    assert {search, simulation} <= kept


@pytest.fixture
def _jax_cache_settings():
    names = [
        "jax_compilation_cache_dir",
        "jax_persistent_cache_min_compile_time_secs",
        "jax_persistent_cache_min_entry_size_bytes",
    ]
    before = {name: getattr(jax.config, name) for name in names}
    yield
    for name, value in before.items():
        jax.config.update(name, value)


@pytest.mark.usefixtures("_jax_cache_settings")
def test_the_cache_never_breaks_anything(tmp_path, monkeypatch):
    for off in ("", "off", "OFF"):
        monkeypatch.setenv("DIFFTHRUST_CACHE", off)
        assert enable_compilation_cache() is None
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("DIFFTHRUST_CACHE", str(tmp_path / "file"))
    assert enable_compilation_cache() is None
    monkeypatch.setenv("DIFFTHRUST_CACHE", str(tmp_path / "new"))
    assert enable_compilation_cache() == tmp_path / "new"


def test_the_demo_of_a_missing_effect_is_a_folder_like_a_users(tmp_path):
    spec = load_spec(hidden_folder(tmp_path / "out"))
    train, unseen = spec.train_logs(), spec.holdout_logs()
    plain = dft.fit(spec.model, train, holdout=unseen, starts=2)
    better = dft.fit(spec.model + list(hidden_effects()), train, holdout=unseen, starts=2)
    assert plain.holdout.nrmse > 0.05
    assert better.holdout.channels["thrust"].rmse == pytest.approx(0.2, rel=0.05)  # the sensor's
    assert better.parameters["command_deadband.half_width"].value == pytest.approx(0.25, rel=0.02)


@pytest.mark.slow
def test_the_demo_finds_what_is_missing(tmp_path):
    told = " ".join(run("demo", "--missing", "--output", tmp_path / "out").stdout.split())
    assert "lacks a command dead band of ±0.250 V and a reverse thrust asymmetry of" in told
    assert (tmp_path / "out" / "diagnosis.html").is_file()


def test_export_writes_a_file_and_tells_what_is_left_out(tmp_path):
    path = tmp_path / "jason.xacro"
    result = run("export", FITS / "jason_thruster", "--to", "uuv", "--output", path)
    assert f"Written: {path}" in result.stdout
    assert "<type>Yoerger</type>" in path.read_text()
    assert "Note: uuv_simulator" in result.stderr


def test_export_takes_a_spec_or_a_saved_fit_and_prints_without_a_file(tmp_path):
    options = ("--to", "lut", "--limits", "-1", "1.5")
    result = run("export", FITS / "jason_thruster", *options)
    rows = result.stdout.strip().splitlines()
    assert rows[0] == "thrust [N],command [V]"
    assert [float(rows[i].split(",")[1]) for i in (1, -1)] == [-1.0, 1.5]
    saved = tmp_path / "jason.json"
    load_spec(FITS / "jason_thruster").fit().save(saved)
    again = run("export", saved, *options)
    assert again.stdout == result.stdout
    result = run("export", FITS / "depth_sensor", "--to", "gz", status=2)
    assert "expected a thruster" in result.stderr

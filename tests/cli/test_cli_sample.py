"""``diffthrust sample``: what it prints, what it writes, and its exit status."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import command_line
import pytest
from places import FITS

pytestmark = pytest.mark.usefixtures("no_cache")

SHORT = ("--draws", 200, "--warmup", 60)


@pytest.fixture
def sensor(tmp_path: Path) -> Path:
    return shutil.copytree(FITS / "depth_sensor", tmp_path / "depth_sensor")


def run(*words: object, status: int = 0):
    return command_line.run("sample", *words, status=status)


@pytest.mark.thorough
def test_sample_prints_and_writes(sensor, tmp_path):
    out, page, chain = (tmp_path / name for name in ("s.json", "s.html", "s.h5"))
    result = run(sensor, *SHORT, "--seed", 3, "--file", chain, "--json", out, "--report", page)
    for word in ("Status: ", "slope", "V/m", "R-hat", "ESS tail", "±", "band holds", str(page)):
        assert word in result.stdout
    data = json.loads(out.read_text())
    assert list(data) == [
        "schema", "model", "effects", "status", "message", "method", "draws", "parameters",
        "intervals", "coverage",
    ]  # fmt: skip
    assert (data["schema"], data["model"], data["method"]) == (1, "linear_sensor", "emcee")
    assert set(data["parameters"]) == {"slope", "offset"}
    slope = data["parameters"]["slope"]
    assert set(slope) == {
        "median", "low", "high", "mean", "sd", "rhat", "ess_bulk", "ess_tail", "unit",
        "written",
    }  # fmt: skip
    assert slope["written"]["unit"] == "V/m"
    assert slope["written"]["median"] == slope["median"]
    assert slope["low"] < slope["median"] < slope["high"]
    assert slope["median"] == pytest.approx(0.159, abs=0.002)
    assert slope["unit"] == "V/m"
    coverage = data["coverage"]
    assert 0 < coverage["channels"]["reading"] <= 1
    assert coverage["level"] == 0.95
    assert coverage["logs"][0]["log"] == "holdout.csv"
    html = page.read_text()
    assert html.count("data:image/png;base64,") == 4  # corner, chains, intervals, band
    # the readings bend away from a line, so that the residuals of neighbours are alike
    assert data["intervals"]["parameters"]["slope"]["recommended"] == "sandwich"
    assert "http" not in html
    assert data["message"] in html
    assert chain.stat().st_size > 1000


@pytest.mark.thorough
def test_equal_seeds_give_equal_numbers_and_without_unseen_logs_no_coverage(sensor, tmp_path):
    spec = sensor / "fit.toml"
    text = spec.read_text()
    spec.write_text("\n".join(r for r in text.splitlines() if not r.startswith("holdout = [")))
    found = []
    for name in ("a.json", "b.json"):
        result = run(spec, *SHORT, "--json", tmp_path / name)
        found.append(json.loads((tmp_path / name).read_text()))
    assert found[0] == found[1]
    assert found[0]["coverage"] is None
    assert "no unseen log" in result.stdout
    run(spec, *SHORT, "--report", tmp_path / "a.html")
    assert "There is no unseen log" in (tmp_path / "a.html").read_text()


def test_bad_input_is_one_message_and_status_2(sensor, tmp_path):
    def refused(*words: object) -> str:
        result = run(*words, status=2)
        assert "Traceback" not in result.output
        return result.stderr

    assert "none.toml" in refused(tmp_path / "none.toml")
    assert ".h5" in refused(sensor, "--file", tmp_path / "chain.txt")
    assert "--draws" in refused(sensor, "--draws", 2)
    assert "--method" in refused(sensor, "--method", "gibbs")
    assert "Mend:" in refused(sensor, "--method", "nuts", "--file", tmp_path / "a.h5")
    assert "no/a.json" in refused(sensor, *SHORT, "--json", tmp_path / "no/a.json")
    other = tmp_path / "other.h5"
    other.write_text("not a chain")
    assert "other.h5" in refused(sensor, *SHORT, "--file", other)
    assert other.read_text() == "not a chain"

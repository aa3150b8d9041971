"""The outcome of a check as a table, as JSON, and as GitHub shows it."""

from __future__ import annotations

import re
import shutil

import numpy as np
import pytest
import written_fits
from command_line import run
from made_checks import CheckRow, outcome
from places import FITS

from diffthrust.checks import check

ROWS = (
    CheckRow("one", "alpha", 1.0, 1.0, 0.1, True),
    CheckRow("two [x]", "beta", 1.0, 2.0, 0.1, False, std_error=0.25),
    CheckRow("two [x]", "train_nrmse", 0.1, 0.2, 0.1, False),
    CheckRow("three", "cannot be run", None, "line 3 is bad", None, False, "Mend it."),
    CheckRow("four", "ct", 1.0, 0.0, 0.1, False, std_error=0.125),
    CheckRow("five", "cannot be run", None, "line 4 is bad", None, False, "Mend it."),
)


def test_the_table_shows_what_moved_the_largest_first():
    lines = outcome(*ROWS).report().splitlines()
    shown = [line.split()[0] for line in lines[1:6]]
    assert shown == ["three", "five", "four", "two", "two"]
    assert "-8.0 std errors" in lines[3]
    assert "+4.0 std errors" in lines[4]
    assert "+1e+02 %" in lines[5]
    assert "three: line 3 is bad" in lines
    assert "three, five. Mend: Mend it." in lines
    assert lines[-2:] == ["4 of 5 fits failed: two [x], three, four, five.", "1 fit unchanged."]
    assert outcome(ROWS[0]).report() == "1 fit checked, none moved.\n"
    assert outcome(ROWS[0], updated=True).report() == "1 fit run; rewritten: one.\n"


def test_the_json_of_a_check():
    data = outcome(*ROWS).to_json()
    assert (data["schema"], data["ok"], data["updated"]) == (1, False, [])
    assert set(data["rows"][1]) == {
        *("fit", "quantity", "expected", "found", "tolerance", "ok", "mend"),
        *("std_error", "unit", "difference", "verdict", "written"),
    }
    assert data["rows"][1]["difference"] == 4.0
    assert data["rows"][2]["difference"] is None
    assert [row["verdict"] for row in data["rows"][:4]] == [
        *("unchanged", "moved", "moved", "not compared")
    ]
    assert set(data["fits"][0]) == {"fit", "file", "ok", "updated", "seconds", "since"}


def test_what_github_shows_at_the_spec_files(tmp_path, monkeypatch):
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    moved = shutil.copytree(FITS / "depth_sensor", tmp_path / "100%:a")
    data = moved / "train.csv"
    data.write_text(data.read_text().replace("1.622", "1.662"))
    for i in range(11):
        (tmp_path / f"f{i}").mkdir()
        (tmp_path / f"f{i}" / "fit.toml").write_text("")
    shown = run("check", tmp_path, "--jobs", 1, status=1).stdout
    lines = [line for line in shown.splitlines() if line.startswith("::error")]
    assert len(lines) == 10  # GitHub shows no more
    file = f"{moved}/fit.toml".replace("%", "%25").replace(":", "%3A")
    assert lines[0].startswith(f"::error file={file},title=100%25%3Aa::")
    assert re.search(r"::offset: .* std errors\)%0A.* %25\)%0ASince it was stored", lines[0])


SPEC = """model = "speed_loop_thruster"
effects = ["command_deadband"]
[logs]
train = ["train.csv"]
time = "t"
[channels]
command = { column = "u", pwm = { stop = 1500, full = 1900 } }
speed = { column = "n", unit = "rpm" }
thrust = { column = "f", unit = "kgf" }
[fit]
starts = 1
"""


@pytest.mark.thorough
def test_what_moved_is_told_in_the_unit_of_the_log_and_kept_in_the_parameters(tmp_path):
    log, name = written_fits.log(), "command_deadband.half_width"
    columns = {
        "t": log.time,
        "u": 1500 + 400 * log.inputs["command"],
        "n": written_fits.RPM * log.measured["speed"],
        "f": written_fits.KGF * log.measured["thrust"],
    }
    table = np.column_stack(list(columns.values()))
    np.savetxt(tmp_path / "train.csv", table, delimiter=",", header=",".join(columns), comments="")
    spec, junit = tmp_path / "fit.toml", tmp_path / "fits.xml"
    spec.write_text(SPEC)
    assert check(tmp_path, update=True, jobs=1).ok
    (line,) = [line for line in spec.read_text().splitlines() if name in line]
    value, error = (float(word) for word in re.findall("(?:value|std_error) = ([^ ,]+)", line))
    moved = line.replace(f"value = {value:.10g}", f"value = {value + 10 * error:.10g}")
    spec.write_text(spec.read_text().replace(line, moved))
    checked = check(tmp_path, jobs=1, junit=junit)
    (row,) = [row for row in checked.rows if not row.ok]
    words, pulses = checked.report().split(), 400 * value
    assert float(words[words.index("us") - 1]) == pytest.approx(pulses, abs=0.05)
    assert f"found {pulses:.3f} us (-10.0 std errors)" in junit.read_text()
    data = row.to_json()
    assert (data["found"], data["unit"]) == (pytest.approx(value), "effort")
    assert data["written"]["found"] == pytest.approx(pulses)
    assert data["written"]["tolerance"] == 400 * data["tolerance"]
    assert data["written"]["unit"] == "us"
    assert data["difference"] == pytest.approx(-10.0, rel=1e-4)

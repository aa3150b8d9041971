"""The outcome of a check as a table, as JSON, and as GitHub shows it."""

from __future__ import annotations

from pathlib import Path

import pytest
import written_fits

from diffthrust._support.tables import report_text  # private: a table as text
from diffthrust.checks import Checked
from diffthrust.checks._expected import CheckRow, compared  # private: outcomes made by hand
from diffthrust.checks._result import (
    FitRun,  # private: outcomes made by hand
    check_report,  # private: what the command prints
)
from diffthrust.checks._tables import sentence  # private: what the command prints
from diffthrust.cli._check import error_lines  # private: what GitHub is told
from diffthrust.specs._parts import ExpectedNumber, ExpectedPart  # private: what a block holds

ROWS = (
    CheckRow("one", "alpha", 1.0, 1.0, 0.1, True),
    CheckRow("two [x]", "beta", 1.0, 2.0, 0.1, False, std_error=0.25),
    CheckRow("two [x]", "train_nrmse", 0.1, 0.2, 0.1, False),
    CheckRow("three", "cannot be run", None, "line 3 is bad", None, False, "Mend it."),
    CheckRow("four", "ct", 1.0, 0.0, 0.1, False, std_error=0.125),
    CheckRow("five", "cannot be run", None, "line 4 is bad", None, False, "Mend it."),
)


def outcome(*rows: CheckRow, updated: bool = False) -> Checked:
    names = dict.fromkeys(row.fit for row in rows)
    return Checked(
        tuple(
            FitRun(name, Path("fits", name), tuple(row for row in rows if row.fit == name), updated)
            for name in names
        )
    )


def test_the_table_shows_what_moved_the_largest_first():
    lines = report_text(check_report(outcome(*ROWS))).splitlines()
    shown = [line.split()[0] for line in lines[1:6]]
    assert shown == ["three", "five", "four", "two", "two"]
    assert "-8.0 std errors" in lines[3]
    assert "+4.0 std errors" in lines[4]
    assert "+1e+02 %" in lines[5]
    assert "three: line 3 is bad" in lines
    assert "three, five. Mend: Mend it." in lines
    assert lines[-2:] == ["4 of 5 fits failed: two [x], three, four, five.", "1 fit unchanged."]
    assert report_text(check_report(outcome(ROWS[0]))) == "1 fit checked, none moved.\n"
    written_anew = check_report(outcome(ROWS[0], updated=True))
    assert report_text(written_anew) == "1 fit run; written again: one.\n"
    everything = report_text(check_report(outcome(*ROWS), everything=True))
    assert [word in everything for word in ("one", "unchanged")] == [True, True]


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


def test_what_github_shows_at_the_spec_files():
    first, *_ = error_lines(outcome(*ROWS))
    assert first.startswith("::error file=fits/two [x],title=two [x]::beta: expected 1.000, found")
    assert "(+4.0 std errors)%0Atrain_nrmse" in first
    many = [CheckRow(f"f:{i}", "status", "a", "b%\n", None, False) for i in range(12)]
    lines = error_lines(outcome(*many))
    assert len(lines) == 10
    assert lines[0] == "::error file=fits/f%3A0,title=f%3A0::status: expected a, found b%25%0A"


def test_what_moved_is_told_in_the_unit_of_the_log_and_kept_in_the_parameters():
    fit = written_fits.fit()
    estimate = fit.parameters["command_deadband.width"]
    stored = ExpectedNumber(value=estimate.value + 0.01, std_error=0.001)
    expected = ExpectedPart(parameters={"command_deadband.width": stored})
    (row,) = compared("one", expected, fit)
    table = report_text(check_report(outcome(row)))
    pulses = 400 * estimate.value
    assert float(table.split()[table.split().index("us") - 1]) == pytest.approx(pulses, abs=0.05)
    assert f"found {pulses:.3f} us (-10.0 std errors)" in sentence(row)
    data = row.to_json()
    assert (data["found"], data["unit"]) == (estimate.value, "effort")
    assert data["written"]["found"] == pulses
    assert data["written"]["tolerance"] == 400 * data["tolerance"]
    assert data["written"]["unit"] == "us"
    assert data["difference"] == pytest.approx(-10.0)

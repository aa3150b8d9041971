"""Every result is a line where Python shows it; at 80 columns and in notebooks it is whole."""

from __future__ import annotations

import html
import re
from functools import cache
from pathlib import Path
from typing import Any

import made_diagnosis
import numpy as np
import pytest
from made_checks import CheckRow, FitRun
from places import ROOT
from presentation import Report, Rows, report_of, report_text

import diffthrust as dft
from diffthrust.checks._result import check_report  # private: printed by a command
from diffthrust.cli._lists import (  # private: printed by commands
    catalogue_report,
    datasets_report,
)
from diffthrust.effects import EFFECTS
from diffthrust.many._campaign.tables import campaign_report  # private: printed by a command


@cache
def thruster() -> tuple[dft.estimation.Fit, dft.Log]:
    """A dead band found in simulated logs, and the log that it was found in."""
    return made_diagnosis.found().fit, made_diagnosis.logs()[0]


@cache
def line() -> tuple[dft.estimation.Fit, dft.Log]:
    """A straight line with noise."""
    depth = np.linspace(0.0, 4.0, 40)
    noise = np.random.default_rng(3).normal(0, 0.01, (2, 40))
    log, unseen = (
        dft.Log(np.arange(40), {"depth": depth}, {"reading": 0.16 * depth + 1.6 + n}, name="line")
        for n in noise
    )
    return dft.fit(dft.LinearSensor(), log, holdout=unseen, starts=2), log


RESULTS = {
    "look": lambda: dft.look(ROOT / "fits" / "jason_thruster" / "train.csv"),
    "fit": lambda: thruster()[0],
    "fit of a line": lambda: line()[0],
    "comparison": lambda: dft.compare(*thruster()),
    "diagnosis": made_diagnosis.diagnosis,
    "adequate": made_diagnosis.adequate,
    "unexplained": made_diagnosis.unexplained,
    "experiment": lambda: made_diagnosis.diagnosis().experiment,
    "headroom": lambda: dft.diagnosis.headroom(*thruster()),
    "intervals": lambda: dft.intervals(*line()),
    "profiles": lambda: dft.uncertainty.profile(*line()),
    "directions": lambda: dft.uncertainty.directions(*line()),
    "prediction": lambda: dft.predict(line()[0], line()[0].model, line()[1]),
    "quantities": lambda: dft.uncertainty.quantities(
        thruster()[0], pitch=0.1, area=0.05, commands=[0.5, 1.0, 2.0]
    ),
    "map": lambda: dft.describing_function(thruster()[0], [1.0, 2.0], [0.5, 2.0]),
    "band": lambda: dft.describing.uncertainty(
        thruster()[0], amplitudes=[1.0, 2.0], frequencies=[0.5, 2.0], draws=8
    ),
    "many": lambda: dft.many.fit(dft.LinearSensor(), [line()[1]] * 2, starts=1),
    "selection": lambda: dft.blackbox.select(
        thruster()[1], input="command", output="speed", kinds=["arx"]
    ),
    "plan": lambda: dft.plans.static_test(dft.Thruster(), limits=(0, 5)).check(
        list(dft.plans.static_test(dft.Thruster(), limits=(0, 5)).runs.values())
    ),
}


def cells(report: Report) -> list[str]:
    """The texts of all cells and headings of all tables in it."""
    tables = [p for section in report.sections for p in section.texts if isinstance(p, Rows)]
    rows = [row for t in tables for row in (t.headings, *(r for block in t.blocks for r in block))]
    return [cell for row in rows for cell in row]


@pytest.mark.parametrize("name", RESULTS)
def test_a_result_is_reported_whole_and_briefly(name, monkeypatch):
    result = RESULTS[name]()
    assert "\n" not in repr(result)
    assert len(repr(result)) <= 240
    assert repr(result).startswith(f"{type(result).__name__}(")
    shown = cells(report_of(result))
    assert shown

    monkeypatch.setenv("COLUMNS", "80")
    report = result.report()
    assert max(map(len, report.splitlines())) <= 80
    words = set(report.split())
    assert {word for cell in shown for word in cell.split()} <= words
    assert "…" not in report

    page = html.unescape(re.sub(r"<[^>]+>", "", result._repr_html_()))
    assert all(cell in page for cell in shown)
    for word in report.split():
        assert word in page


LONG = "pool/thruster_of_the_starboard_side/2024-05-17_staircase_up_and_down"


def checked() -> Any:
    """A check of two fits, of which one has moved."""
    row = CheckRow(LONG, "actuator_lag.time_constant", 0.123456, 0.2345678, 0.001, False, "Look.",
                   std_error=0.0011)  # fmt: skip
    runs = tuple(FitRun(fit, Path("fit.toml"), (row,)) for fit in (LONG, "b"))
    return check_report(dft.checks.Checked(runs), everything=True)


def campaign() -> Any:
    row = {"name": LONG, "status": "ok", "fit_status": "converged_at_bound", "train_nrmse": 0.0123,
           "holdout_nrmse": 1.234e-5, "seconds": 12.3, "verdict": "effects_found",
           "added": "command_deadband, reverse_thrust_asymmetry"}  # fmt: skip
    return campaign_report([row] * 2, "diagnose", "2 specs in 24 s: 2 done.")


PRINTED = {
    "effects": lambda: catalogue_report(EFFECTS.values(), {"thruster": dft.Thruster()}),
    "datasets": lambda: datasets_report(dft.datasets.list()),
    "check": checked,
    "campaign": campaign,
}


@pytest.mark.parametrize("width", [60, 80])
@pytest.mark.parametrize("name", PRINTED)
def test_what_commands_print_is_whole(name, width, monkeypatch):
    monkeypatch.setenv("COLUMNS", str(width))
    printed = PRINTED[name]()
    text = report_text(printed)
    assert max(map(len, text.splitlines())) <= width
    seen = set(text.split())
    for word in {word for cell in cells(printed) for word in cell.split()}:
        if len(word) <= 30:
            assert word in seen
        else:  # a path may be broken, and all its parts are there
            parts = ([word[i : i + n] for i in range(0, len(word), n)] for n in range(20, width))
            assert any(seen.issuperset(some) for some in parts)

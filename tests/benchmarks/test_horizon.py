"""Errors over whole unseen runs by the horizon of the fit.

``pytest -m benchmark -s tests/benchmarks/test_horizon.py``. Nothing here asserts an error.
"""

from __future__ import annotations

import pytest
from gusty_runs import MISSING, gusty_runs, model_of
from shared_data import data_folder

import diffthrust as dft
from benchmarks import diagnoses
from benchmarks.test_benchmarks import show

pytestmark = pytest.mark.benchmark

HORIZONS = {"segments": (2, 6.7, 20), "whole runs": (2, 6.7, 20, None), "auto": "auto"}


def row(name, model, train, unseen):
    fits = {word: dft.fit(model, train, holdout=unseen, horizon=h) for word, h in HORIZONS.items()}
    errors = {word: fit.holdout.nrmse for word, fit in fits.items()}
    better = min(errors["segments"], errors["whole runs"])
    cells = [f"{error:.4f}" for error in errors.values()]
    return (name, *cells, str(fits["auto"].horizon), f"{errors['auto'] / better:.3f}")


def test_made_up_runs_under_gusts():
    rows = []
    for missing in MISSING:
        for length, memory, share in ((1.0, 3.0, 0.1), (3.0, 10.0, 0.1), (6.0, 30.0, 0.15)):
            logs = gusty_runs(41, missing, length, memory, share)
            name = f"without {missing}, {length:g} times as long, gusts of {memory:g} s"
            rows.append(row(name, model_of(length), logs[:3], logs[3:]))
    table(rows)


def test_vessels_that_were_measured(monkeypatch):
    monkeypatch.setenv("DIFFTHRUST_DATA", str(data_folder("esso_osaka").parent))
    rows = []
    for case in (diagnoses.esso, diagnoses.blueboat):
        model, train, unseen, _ = case()
        rows.append(row(case.__name__, model, train, unseen))
    table(rows)


def table(rows):
    header = ("runs", *HORIZONS, "chosen", "over the better")
    show("NRMSE of whole unseen runs", rows, header)

"""Tables for people: honest digits, and every channel with its unit."""

from __future__ import annotations

import numpy as np
import pytest
from presentation import number, report_text, with_error

import diffthrust as dft
from diffthrust.cli._lists import catalogue_report  # private: printed by a command
from diffthrust.effects import EFFECTS
from diffthrust.models import MODELS


@pytest.fixture(scope="module")
def line() -> dft.Log:
    depth = np.linspace(0.0, 4.0, 20)
    noise = 0.01 * np.sin(37.0 * np.arange(20))
    return dft.Log(
        time=np.arange(20),
        inputs={"depth": depth},
        measured={"reading": 0.16 * depth + 1.6 + noise},
        name="table",
    )


@pytest.fixture(scope="module")
def fit(line: dft.Log) -> dft.estimation.Fit:
    reading = line.measured["reading"] + 0.01 * np.cos(23.0 * np.arange(20))
    unseen = dft.Log(line.time, line.inputs, {"reading": reading}, name="later")
    return dft.fit(dft.LinearSensor(), line, holdout=unseen)


def test_the_table_of_a_fit(fit):
    text = fit.report()
    for word in ("linear_sensor", "Status: converged", "slope", "V/m", "training", "unseen"):
        assert word in text
    assert "all" not in text.split("Logs")[1]  # one channel needs no sum
    assert max(map(len, text.splitlines())) <= 100


def test_fixed_parameters_have_no_error(line):
    text = dft.fit(dft.LinearSensor(offset=1.6).fix("offset"), line).report()
    (row,) = [row for row in text.splitlines() if row.startswith("offset   ")]
    assert row.split() == ["offset", "1.600", "-", "V", "fixed"]
    assert "unseen" not in text


def test_the_table_of_a_comparison(fit, line):
    text = dft.compare(fit, [line, line.slice(0, 9)]).report()
    assert text.partition("Made")[0].count("table ") == 2
    assert "all runs" in text


def test_the_catalogue_of_effects():
    models = {name: model() for name, model in MODELS.items()}
    text = " ".join(report_text(catalogue_report(EFFECTS.values(), models)).split())
    for name, effect in EFFECTS.items():
        assert name in text
        assert (effect.__doc__ or "").strip().splitlines()[0] in text
    assert "thruster, dc_motor_thruster" in text


@pytest.mark.parametrize(
    ("value", "error", "shown"),
    [
        (0.0370107, 3.0357e-05, ("0.037011", "0.000030")),
        (41.98507, 0.02067, ("41.985", "0.021")),
        (5.0, None, ("5.000", "-")),
        (1234.5, 67.0, ("1234", "67")),
        (7.2019e-12, 1e-15, ("7.2019e-12", "1.0e-15")),
        (123456.0, 5000.0, ("1.235e+05", "5.0e+03")),
        (0.0, 0.1, ("0.00", "0.10")),
    ],
)
def test_a_value_ends_with_its_error(value, error, shown):
    assert with_error(value, error) == shown


@pytest.mark.parametrize(
    ("value", "shown"),
    [(0.0, "0.000"), (0.0123456, "0.01235"), (1e-9, "1.000e-09"), (123456.0, "123456"),
     (float("nan"), "-"), (None, "-"), (float("inf"), "inf"), (-2.5, "-2.500")],
)  # fmt: skip
def test_numbers(value, shown):
    assert number(value) == shown

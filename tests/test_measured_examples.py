"""The papers' methods, the headroom and the static map on measured data."""

import re

import numpy as np
import pytest
from shared_data import data_folder
from test_examples import figure, run

from diffthrust import InputError, datasets

CHANNELS = "surge", "sway", "yaw_rate", "all"
NUMBER = r"-?[\d.]+(?:e[+-]?\d+)?%?"


def cells(text: str, name: str) -> list[list[str]]:
    """Numbers of the rows of a printed table whose first cell is ``name``."""
    rows = [line.strip("│ ").split("│") for line in text.splitlines() if line.startswith("│")]
    return [[c for c in (cell.strip() for cell in row[1:]) if re.fullmatch(NUMBER, c)]
            for row in rows if row[0].strip() == name]  # fmt: skip


def test_the_static_map_as_a_staircase(monkeypatch):
    monkeypatch.setenv("DIFFTHRUST_DATA", str(data_folder("t200").parent))
    table, log = datasets.t200("14V")["14V"], datasets.t200("14V", held=0.25)["14V"]
    assert log.duration == pytest.approx(0.25 * len(table))
    command = log.values("command", "V")  # held from its sample to the next, where it is measured
    np.testing.assert_allclose(command[:-1], (table.values("pulse_width", "us") - 1500) / 25)
    np.testing.assert_array_equal(log.measured["thrust"][1:], table.measured["thrust"])
    np.testing.assert_array_equal(np.abs(log.measured["speed"][1:]), table.measured["speed"])
    assert np.all(log.measured["speed"][1:] * command[:-1] >= 0)
    with pytest.raises(InputError, match="t200, held: expected seconds"):
        datasets.t200(held=0.0)


@pytest.mark.slow
def test_t200_map(tmp_path):
    data_folder("t200")
    text = run("t200_map", tmp_path)
    (before,), (after,) = cells(text, "basic thruster"), cells(text, "+ reverse_thrust_asymmetry")
    for k in range(6):  # thrust [N] and speed [rpm]: fitted, then both unseen voltages
        assert float(after[k]) < float(before[k]) / 3
    assert float(after[2]) < 0.7  # at 14 V
    assert float(after[3]) < 75
    assert float(after[4]) < 3.0  # at 20 V, outside the range that was fitted
    figure(tmp_path, "t200_map.png")


@pytest.mark.slow
def test_papers_on_measured(tmp_path):
    data_folder("esso_osaka")
    data_folder("blueboat")
    text = run("papers_on_measured", tmp_path)
    assert "The paper's lines cannot be drawn" in text
    tanker, boat = (
        {name: list(map(float, cells(text, f"unseen NRMSE, {name}")[k])) for name in CHANNELS}
        for k in (0, 1)
    )
    assert all(once < steps for steps, once in tanker.values())
    assert tanker["all"][1] == pytest.approx(0.552, abs=0.01)
    assert boat["all"][1] < boat["all"][0]
    assert boat["surge"][1] > boat["surge"][0]  # what turns best does not run best
    assert boat["sway"][0] > 1  # neither foresees it
    assert boat["sway"][1] > 1


@pytest.mark.slow
def test_headroom_of_the_measured_sets(tmp_path):
    for name in ("ngs_thruster", "blueboat", "esso_osaka", "emps", "t200"):
        data_folder(name)
    text = run("headroom", tmp_path)
    for name in ("ngs_thruster", "blueboat", "esso_osaka", "emps", "t200 (static)"):
        assert f"{name} (fit: converged" in text
    harmed = cells(text, "ngs_thruster")[1]  # thrust: what the sines and ramps teach fails on steps
    assert float(harmed[1]) > float(harmed[0])
    explained = {name: [float(row[2].rstrip("%")) for row in cells(text, name)]
                 for name in ("esso_osaka", "emps", "t200 (static)")}  # fmt: skip
    assert explained["esso_osaka"][2] > 70  # yaw rate
    assert explained["emps"][1] > 90  # velocity: its friction is missing
    assert min(explained["t200 (static)"]) > 80  # as are the effects of `t200_map.py`

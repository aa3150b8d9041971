"""``diffthrust map``: what it prints, what it writes, and its exit status."""

from __future__ import annotations

import json

import command_line
import numpy as np
import pytest
from places import FITS

pytestmark = pytest.mark.usefixtures("no_cache")

JASON = FITS / "jason_thruster"


def run(*words: object, status: int = 0):
    return command_line.run("map", *words, status=status)


@pytest.mark.thorough
def test_map_prints_and_writes(tmp_path):
    out, picture = tmp_path / "map.json", tmp_path / "map.png"
    options = ("--amplitudes", "0.5:4:4", "--frequencies", "0.1,1,10")
    result = run(JASON, *options, "--json", out, "--figure", picture)
    for word in ("Status: converged", "12 points, 12 of them settled", "Bandwidth", str(out)):
        assert word in result.stdout
    data = json.loads(out.read_text())
    assert (data["schema"], data["model"], data["method"]) == (1, "thruster", "simulation")
    assert data["fit"]["status"] == "converged"
    assert data["amplitudes"] == pytest.approx([0.5, 1.0, 2.0, 4.0])
    assert data["gain_unit"] == "N/V"
    p = data["parameters"]
    assert data["gain"][-1][0] == pytest.approx(p["ct"] * p["beta"] / p["alpha"], rel=0.01)
    assert np.all(np.array(data["settled"]))
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_draws_give_intervals(tmp_path):
    out, picture = tmp_path / "band.json", tmp_path / "band.png"
    options = ("--amplitudes", "2, 1,1", "--frequencies", "0.1,1", "--method", "consistent")
    result = run(JASON, *options, "--draws", 50, "--json", out, "--figure", picture)
    assert "50 draws from the covariance" in result.stdout
    assert "95 % from" in result.stdout
    rows = [
        line.split()[:2] for line in result.stdout.splitlines() if line.strip()[:2] in ("1 ", "2 ")
    ]
    assert rows == [["1", "0.1"], ["1", "1"], ["2", "0.1"], ["2", "1"]]  # few points: all of them
    data = json.loads(out.read_text())
    assert data["fit"]["status"] == "converged"
    low, middle, high = (np.array(data["gain"][part]) for part in ("low", "median", "high"))
    assert np.all((low < middle) & (middle < high))
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_formulas_and_amplitudes_from_the_logs(tmp_path):
    out = tmp_path / "map.json"
    run(JASON, "--no-fit", "--method", "consistent", "--frequencies", "1", "--json", out)
    data = json.loads(out.read_text())
    assert data["fit"] is None
    assert data["distortion"] is None
    assert len(data["amplitudes"]) == 24
    assert data["amplitudes"][-1] == pytest.approx(50 * data["amplitudes"][0])


@pytest.mark.parametrize(
    ("words", "match"),
    [
        (("--amplitudes", "big"), "--amplitudes: expected numbers"),
        (("--frequencies", "3:1:5"), "--frequencies: expected numbers"),
        (("--frequencies", "1:2"), "--frequencies: expected numbers"),
        (("--frequencies", "1:2:x"), "--frequencies: expected numbers"),
        (("--frequencies", "0:1:4"), "--frequencies: expected numbers"),
        (("--frequencies", "1:2:1"), "--frequencies: expected numbers"),
        (("--frequencies", "a,b"), "--frequencies: expected numbers"),
        (("--amplitudes", "0,1"), "expected positive numbers, found 0"),
        (("--output", "trust"), "nearest is 'thrust'"),
        (("--input", "speeed", "--amplitudes", "1"), "nearest is 'speed'"),
        (("--draws", "50"), "found --no-fit"),
        (("--input", "inflow"), "do not show how far 'inflow' swings"),
    ],
)
def test_bad_words_end_with_status_2(words, match):
    result = run(JASON, "--no-fit", *words, status=2)
    assert match in result.stderr

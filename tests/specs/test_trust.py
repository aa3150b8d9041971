"""Scripts are run from the folder of a spec or below, and from elsewhere only where trusted."""

import os

import numpy as np
import pytest
from command_line import run

import diffthrust as dft
from diffthrust.checks import check

OWN = """import diffthrust as dft
from pathlib import Path

(Path(__file__).parent / "was_run").touch()

class Drag(dft.Effect):
    "Brakes the shaft."
    name = "own_drag"
    port = "shaft"
    slope: float = dft.parameter(0.0)

    def __call__(self, value, s):
        return value - self.slope * s.speed
"""
SPEC = """model = "thruster"
effects = ["{script}:Drag"]
[logs]
train = "run.csv"
[channels]
command = {{ column = "command", unit = "V" }}
speed = {{ column = "speed", unit = "rad/s" }}
[parameters]
ct = {{ fixed = true }}
[fit]
starts = 2
"""


@pytest.fixture
def place(tmp_path):
    """A folder of fits with one spec, and folders for scripts."""
    time = 0.05 * np.arange(100)
    command = np.sin(2.0 * time)
    run = dft.simulate(dft.Thruster(), dft.Log(time, {"command": command}))
    speed = run["speed"] + np.random.default_rng(1).normal(0.0, 0.1, time.size)
    rows = np.column_stack([time, command, speed])
    for folder in ("fits/a/below", "shared"):
        (tmp_path / folder).mkdir(parents=True)
    np.savetxt(
        tmp_path / "fits/a/run.csv", rows, delimiter=",", header="time,command,speed", comments=""
    )
    return tmp_path


def spec(place, script):
    path = place / "fits/a/fit.toml"
    path.write_text(SPEC.format(script=script), "utf-8")
    return path


@pytest.mark.parametrize("where", ["own.py", "below/own.py"])
def test_a_script_beside_the_spec_is_run(place, where):
    script = place / "fits/a" / where
    script.write_text(OWN, "utf-8")
    assert "own_drag.slope" in dft.load_spec(spec(place, where)).model.parameters


@pytest.mark.parametrize("how", ["relative", "absolute", "link"])
def test_a_script_from_elsewhere_is_run_where_its_folder_is_trusted(place, how):
    script = place / "shared/own.py"
    script.write_text(OWN, "utf-8")
    word = {"relative": "../../shared/own.py", "absolute": script.as_posix(), "link": "own.py"}[how]
    if how == "link":
        os.symlink(script, place / "fits/a/own.py")
    path = spec(place, word)
    with pytest.raises(dft.InputError, match=r"fit\.toml.*outside the folder.*is not run") as told:
        dft.load_spec(path)
    assert "--trust DIR" in told.value.mend
    assert not (place / "shared/was_run").exists()
    for trust in (place / "shared", str(place), [place / "shared"]):
        assert "own_drag.slope" in dft.load_spec(path, trust=trust).model.parameters


@pytest.mark.thorough
def test_all_that_work_on_specs_take_trust(place):
    (place / "shared/own.py").write_text(OWN, "utf-8")
    spec(place, "../../shared/own.py")
    fits, shared = place / "fits", place / "shared"
    (row,) = check(fits).runs[0].rows
    assert "outside the folder" in str(row.found)
    done = dft.many.campaign(fits, output=place / "out", jobs=1)
    assert done.counts == {"failed": 1}
    assert not (shared / "was_run").exists()
    assert check(fits, update=True, trust=shared, jobs=1).ok
    assert dft.many.campaign(fits, output=place / "out", jobs=1, trust=shared).ok
    assert "is not run" in run("fit", fits / "a", status=2).output
    run("fit", fits / "a", "--trust", shared)

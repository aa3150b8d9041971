"""Scripts that specs name: the text that lies there runs, where its folder is trusted."""

import os
import py_compile
from pathlib import Path

import numpy as np
import pytest
from command_line import run

import diffthrust as dft
from diffthrust import InputError
from diffthrust.checks import check
from diffthrust.specs._scripts import (  # private: what a script is alone
    error_in_script,
    model_class,
)

OWN = """import diffthrust as dft

class Own(dft.LinearSensor):
    name = "own"
    mark = {mark}
"""


def written(folder: Path, text: str) -> Path:
    script = folder / "own.py"
    script.write_text(text)
    return script


def own(folder: Path) -> type:
    return model_class("own.py:Own", folder)


@pytest.mark.parametrize("ending", ["sys.exit(0)", "sys.exit()", "exit(0)", "raise SystemExit"])
def test_a_script_that_ends_the_interpreter_is_an_error(tmp_path, ending):
    written(tmp_path, f"import sys\n{ending}\n{OWN.format(mark=1)}")
    with pytest.raises(InputError, match=r"own\.py, line 2: the script fails with SystemExit"):
        own(tmp_path)


def test_a_script_that_answers_for_every_name_names_no_class(tmp_path):
    """It was asked for the class, and what it raised ended a command."""
    written(tmp_path, "def __getattr__(name): raise RuntimeError(name)")
    with pytest.raises(InputError, match="expected the class 'Own' of a Model"):
        own(tmp_path)


def test_an_interrupt_is_not_taken_for_an_error_of_the_script(tmp_path):
    written(tmp_path, "raise KeyboardInterrupt")
    with pytest.raises(KeyboardInterrupt):
        own(tmp_path)


def test_a_script_that_was_edited_is_read_anew(tmp_path):
    script = written(tmp_path, OWN.format(mark=1))
    first = own(tmp_path)
    assert own(tmp_path) is first
    script.write_text(OWN.format(mark=2))
    assert (first.mark, own(tmp_path).mark) == (1, 2)


def test_compiled_code_that_lies_beside_a_script_is_not_run(tmp_path):
    script = written(tmp_path, OWN.format(mark=6))
    planted = py_compile.compile(
        str(script), invalidation_mode=py_compile.PycInvalidationMode.UNCHECKED_HASH
    )
    script.write_text(OWN.format(mark=7))
    assert Path(planted).is_file()
    assert own(tmp_path).mark == 7


def test_a_script_may_define_dataclasses(tmp_path):
    begin = "from __future__ import annotations\nfrom dataclasses import dataclass, field\n"
    plain = "@dataclass\nclass Plain:\n    size: float = field(default=1.0)\n"
    written(tmp_path, begin + plain + OWN.format(mark="Plain().size"))
    assert own(tmp_path).mark == 1.0


@pytest.mark.parametrize("text", ["class Own(:\n", "\0", "import nothing_of_that_name\n"])
def test_what_does_not_run_is_told_with_its_line(tmp_path, text):
    written(tmp_path, text)
    with pytest.raises(InputError, match=r"own\.py, line 1: the script fails with"):
        own(tmp_path)


FAILING = """import diffthrust as dft

class Own(dft.LinearSensor):
    name = "own"

    def equations(self, s, port):
        raise KeyError("mine")
"""


def test_what_a_script_raises_when_it_is_called_is_an_error_of_it(tmp_path):
    written(tmp_path, FAILING)
    with pytest.raises(KeyError) as raised:
        own(tmp_path)().equations({}, None)
    told = error_in_script(raised.value)
    assert told is not None
    assert told.problem == "own.py, line 7, in equations: the script fails with KeyError: 'mine'"
    with pytest.raises(ZeroDivisionError) as ours:
        _ = 1 / 0
    assert error_in_script(ours.value) is None


DRAG = """import diffthrust as dft
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
    script.write_text(DRAG, "utf-8")
    assert "own_drag.slope" in dft.load_spec(spec(place, where)).model.parameters


@pytest.mark.parametrize("how", ["relative", "absolute", "link"])
def test_a_script_from_elsewhere_is_run_where_its_folder_is_trusted(place, how):
    script = place / "shared/own.py"
    script.write_text(DRAG, "utf-8")
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
    (place / "shared/own.py").write_text(DRAG, "utf-8")
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

"""Scripts that specs name: what runs is the text that lies there, and an end of it is told."""

import py_compile
from pathlib import Path

import pytest

from diffthrust import InputError
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

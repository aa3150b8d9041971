"""A script with an effect of one's own, and its tests, from a formula."""

from __future__ import annotations

import keyword
import tomllib
from pathlib import Path
from typing import Any

from diffthrust._support.errors import InputError
from diffthrust._support.files import made_folder, write_whole
from diffthrust.effects import Formula
from diffthrust.effects._class_test_text import effect_test_text
from diffthrust.effects._class_text import effect_class_text
from diffthrust.models import MODELS, Vessel
from diffthrust.models._base.registry import catalogue


def new_effect(
    formula: Formula, *, doc: str = "", directory: Path | str = "."
) -> tuple[Path, Path]:
    """Write a class that does what a formula does, and tests of it that pass.

    Args:
        formula: the effect. Its name becomes that of the files, and the class's: ``tip_loss`` is
            ``TipLoss`` in ``tip_loss.py``, which a spec file names as ``"tip_loss.py:TipLoss"``.
        doc: what happens, in a sentence.
        directory: where the files go.

    Returns:
        The script and its tests.

    Raises:
        InputError: a name that a known effect or a word of Python has, a file that exists already,
            or a folder that cannot be written to.
    """
    name, folder = formula.name, Path(directory)
    if name in catalogue() or keyword.iskeyword(name):
        raise InputError(
            f"the name {name!r} is taken by "
            f"{'a word of Python' if keyword.iskeyword(name) else 'an effect of the catalogue'}.",
            "Take another name.",
        )
    texts = {
        folder / f"{name}.py": effect_class_text(formula, name, **({"doc": doc} if doc else {})),
        folder / f"test_{name}.py": effect_test_text(formula, name),
    }
    for path in texts:
        if path.exists():
            raise InputError(
                f"{path}: expected a new name, found something there.",
                "Take another name; nothing is overwritten.",
            )
    made_folder(folder, "Name another place.")
    for path, text in texts.items():
        write_whole(path, text.encode())
    script, tests = texts
    return script, tests


def parameter_asked(text: str) -> tuple[str, Any]:
    """A parameter as a command line has it: ``a=rad/s^2``, or fields, ``p={ value = 1.5 }``.

    Raises:
        InputError: it is neither.

    Example:
        >>> parameter_asked("p={ value = 1.5, bounds = [0.5, 3] }")
        ('p', {'value': 1.5, 'bounds': [0.5, 3]})
    """
    name, equal, described = (part.strip() for part in text.partition("="))
    if not equal:
        raise InputError(
            f"--parameter {text}: expected NAME=UNIT, found no '='.",
            "Write --parameter a=rad/s^2, of a pure number --parameter p=.",
        )
    if not described.startswith("{"):
        return name, described.strip("\"'")
    try:
        return name, tomllib.loads(f"described = {described}")["described"]
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise InputError(
            f"--parameter {text}: the fields of {name!r} cannot be read ({error}).",
            "Write --parameter 'p={ unit = \"rad/s\", value = 1.5, bounds = [0.5, 3] }'.",
        ) from None


def at_home(formula: Formula) -> Formula:
    """The formula in the first model of the catalogue that has its port and its signals.

    It then knows which channels a log must have. Where no model has the port it is left as it is:
    that of a model of the user's own.

    Raises:
        InputError: models have the port, and none the signals.
    """
    error = None
    for model in (*(cls() for cls in MODELS.values()), Vessel(drive="twin")):
        if formula.port in (*model.ports, *model.channel_units):
            try:
                added = (model + formula).effects[-1]
                assert isinstance(added, Formula)
                return added
            except InputError as problem:
                error = error or problem
    if error is not None:
        raise error
    return formula

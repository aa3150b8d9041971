"""Write a script with a user's own effect, and its tests, from a formula."""

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
    """Write a class equivalent to a formula, and passing tests of it.

    The formula's name gives file and class: ``tip_loss`` becomes ``TipLoss`` in ``tip_loss.py``, in
    a spec file ``"tip_loss.py:TipLoss"``; ``doc`` is the docstring, one sentence.
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


def parse_parameter(text: str) -> tuple[str, Any]:
    """Parse a parameter of the command line: ``a=rad/s^2``, or with fields, ``p={ value = 1.5 }``.

    Raises:
        InputError: neither form fits.

    Example:
        >>> parse_parameter("p={ value = 1.5, bounds = [0.5, 3] }")
        ('p', {'value': 1.5, 'bounds': [0.5, 3]})
    """
    name, equal, described = (piece.strip() for piece in text.partition("="))
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


def bound_to_model(formula: Formula) -> Formula:
    """Bind a formula to the first model of the catalogue that has its port and its signals.

    It then knows which channels a log must have. If no model has the port, it belongs to a user's
    own model and is returned unchanged.

    Raises:
        InputError: models have the port, but none has the signals.
    """
    error = None
    # The twin drive has ports of its own, and a model of the catalogue is made with its default
    # options.
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

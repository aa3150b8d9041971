"""A folder for a new fit, which runs at once, and the workflow that checks all of them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path

from diffthrust._support.errors import InputError
from diffthrust._support.files import made_folder, write_whole
from diffthrust._support.names import listing, nearest
from diffthrust.models import MODELS
from diffthrust.models._base.model import Model
from diffthrust.specs._file import NAME
from diffthrust.specs._new_logs import example_table

_TRAIN, _HOLDOUT = "example_train.csv", "example_unseen.csv"
_WORKFLOW = Path(".github", "workflows", "fits.yml")
_WORD = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*")
_HELD = {"dc_motor_thruster": ("inertia",)}
"""Parameters that no log tells apart from the others: torques over inertia are all that shows."""
_UNITS = {"rad/s": "rpm", "rad": "deg", "rev/s": "rpm", "V": "mV", "m/s": "kn", "N": "kN"}
"""Another unit that logs often have, as a hint."""


def new_fit(name: str, model: str = "thruster", directory: Path | str = "fits") -> Path:
    """Make a folder with a commented spec file and two small logs that were made up.

    Args:
        name: of the fit, and of its folder; ``harbour/run1`` makes a folder in a folder.
        model: a model of the catalogue.
        directory: where the fits are.

    Returns:
        The folder, as `load_spec` takes it.

    Raises:
        InputError: a name that cannot be that of a folder, or is taken; a model that is not known;
            a folder that cannot be written to.

    Example:
        >>> load_spec(new_fit("bollard")).fit().status.value
        'converged'
    """
    directory = Path(directory)
    folder = directory / _checked(name)
    if model not in MODELS:
        near = nearest(model, MODELS)
        raise InputError(
            f"the model {model!r} is not known{'; ' + near if near else ''}.",
            f"Name one of {listing(MODELS)}; then put your own into the spec, as script.py:Class.",
        )
    if folder.exists():
        raise InputError(
            f"{folder}: expected a new name, found something there.",
            "Take another name; nothing is overwritten.",
        )
    example = MODELS[model]()
    texts = {
        _TRAIN: example_table(example, seed=1),
        _HOLDOUT: example_table(example, seed=2),
        NAME: _spec(example, folder, directory),
    }
    _write(folder, texts)
    return folder


def new_workflow(directory: Path | str = "fits") -> Path:
    """Write a GitHub workflow that checks the fits at each push.

    Args:
        directory: where the fits are.

    Returns:
        The file, as `workflow_place` names it.

    Raises:
        InputError: as `workflow_place`, or the file cannot be written.
    """
    from diffthrust import __version__

    path, fits = workflow_place(directory)
    text = _template(path.name).replace("VERSION", __version__).replace("DIRECTORY", fits)
    _write(path.parent, {path.name: text})
    return path


def workflow_place(directory: Path | str) -> tuple[Path, str]:
    """Where the workflow goes, and what it calls the folder of the fits.

    Returns:
        ``.github/workflows/fits.yml`` in the root of the git repository that holds the fits, or in
        the present folder where there is none; and the folder of the fits as seen from there.

    Raises:
        InputError: there is such a file, or the fits lie outside the present folder and no
            repository holds them.
    """
    fits = Path(directory).resolve()
    root = next((place for place in (fits, *fits.parents) if (place / ".git").exists()), Path.cwd())
    if not fits.is_relative_to(root):
        raise InputError(
            f"{directory}: expected a folder of a git repository, or of this one, found neither.",
            "Call it in the root of your repository.",
        )
    path, name = root / _WORKFLOW, fits.relative_to(root).as_posix()
    if path.exists():
        raise InputError(
            f"{path}: expected no workflow of that name, found one; nothing is overwritten.",
            f"Add the step to it yourself: diffthrust check {name} --junit fits.xml.",
        )
    return path, name


def _checked(name: str) -> str:
    parts = name.split("/")
    if not all(_WORD.fullmatch(part) for part in parts):
        raise InputError(
            f"{name!r}: expected a name of letters, digits and '_', with '-' and '.' within, as "
            "that of a folder.",
            "Take a name such as bollard_pull or harbour/run1.",
        )
    return name


def _spec(model: Model, folder: Path, directory: Path) -> str:
    import jinja2

    environment = jinja2.Environment(
        undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    return (
        environment.from_string(_template(f"{NAME}.jinja")).render(
            model=model,
            folder=folder.as_posix(),
            directory=directory.as_posix(),
            train=_TRAIN,
            holdout=_HOLDOUT,
            held=_HELD.get(model.name, ()),
            hint=lambda unit: f' # or "{_UNITS[unit]}"' if unit in _UNITS else "",
        )
        + "\n"
    )


def _template(name: str) -> str:
    return files("diffthrust.specs").joinpath("templates", name).read_text(encoding="utf-8")


def _write(folder: Path, texts: Mapping[str, str]) -> None:
    made_folder(folder, "Name another place.")
    for name, text in texts.items():
        write_whole(folder / name, text.encode())

"""Folders and files to begin with: a fit that runs at once, a workflow for all fits, an effect."""

from __future__ import annotations

import keyword
import re
import tomllib
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.files import made_folder, write_whole
from diffthrust._support.names import listing, nearest
from diffthrust.effects import Formula
from diffthrust.effects._class_text import effect_class_text, effect_test_text
from diffthrust.logs._log import Log
from diffthrust.models import MODELS, Vessel
from diffthrust.models._base.effect import catalogue
from diffthrust.models._base.model import Model
from diffthrust.simulation._runs import simulate
from diffthrust.specs._file import NAME

_TRAIN, _HOLDOUT = "example_train.csv", "example_unseen.csv"
_WORKFLOW = Path(".github", "workflows", "fits.yml")
_WORD = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*")
_HELD = {"dc_motor_thruster": ("inertia",)}
"""Parameters that logs cannot identify: only torques divided by inertia are observable."""
_UNITS = {"rad/s": "rpm", "rad": "deg", "rev/s": "rpm", "V": "mV", "m/s": "kn", "N": "kN"}
"""Alternative units, common in logs, for a hint."""


def new_fit(name: str, model: str = "thruster", directory: Path | str = "fits") -> Path:
    """Make a folder (``harbour/run1`` is nested) with a commented spec and two simulated logs."""
    directory = Path(directory)
    folder = directory / _checked(name)
    if model not in MODELS:
        raise InputError(
            f"the model {model!r} is not known{nearest(model, MODELS, '; ')}.",
            f"Name one of {listing(MODELS)}; then put your own into the spec, as script.py:Class.",
        )
    _check_new(folder)
    example = MODELS[model]()
    texts = {
        _TRAIN: example_table(example, seed=1),
        _HOLDOUT: example_table(example, seed=2),
        NAME: _spec(example, folder, directory),
    }
    _write(folder, texts)
    return folder


def new_workflow(directory: Path | str = "fits") -> Path:
    """Write a GitHub workflow that checks the fits at each push, where `workflow_place` says."""
    from diffthrust import __version__

    path, fits = workflow_place(directory)
    text = _template(path.name).replace("VERSION", __version__).replace("DIRECTORY", fits)
    _write(path.parent, {path.name: text})
    return path


def workflow_place(directory: Path | str) -> tuple[Path, str]:
    """The path of the workflow, and the folder of the fits relative to its root.

    It lies in the root of the git repository of the fits, or in the working directory if there is
    none.
    """
    fits = Path(directory).resolve()
    # .git is a file in worktrees and submodules: `exists`, not `is_dir`.
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
            "Add the step to it yourself, with the extra 'junit' installed: diffthrust check "
            f"{name} --junit fits.xml.",
        )
    return path, name


def _checked(name: str) -> str:
    segments = name.split("/")
    if not all(_WORD.fullmatch(segment) for segment in segments):
        raise InputError(
            f"{name!r}: expected a name of letters, digits and '_', with '-' and '.' within, as "
            "that of a folder.",
            "Take a name such as bollard_pull or harbour/run1.",
        )
    return name


def _check_new(path: Path) -> None:
    if path.exists():
        raise InputError(
            f"{path}: expected a new name, found something there.",
            "Take another name; nothing is overwritten.",
        )


def _spec(model: Model, folder: Path, directory: Path) -> str:
    import jinja2

    from diffthrust.estimation._arguments import LOSSES

    losses = [f'"{word}" {law.suits}' for word, law in LOSSES.items() if not law.closed]
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
            losses=", ".join(losses),
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


_OTHER = 1.15
"""Parameters of the simulated system, relative to the initial guess: the fit has work to do."""
_NOISE = 0.02
"""Noise of a channel, as a share of its spread."""


class _Run(NamedTuple):
    """Input signal of a model: random levels within ranges, each held for some samples."""

    step: float
    hold: int
    samples: int
    ranges: Mapping[str, tuple[float, float]]


_RUNS = {
    "thruster": _Run(0.05, 25, 300, {"command": (-3.0, 3.0)}),
    "speed_loop_thruster": _Run(0.05, 25, 300, {"command": (-1.0, 1.0)}),
    "ducted_thruster": _Run(0.05, 25, 300, {"command": (-1.0, 1.0)}),
    "dc_motor_thruster": _Run(0.02, 40, 400, {"command": (-12.0, 12.0)}),
    "axis_vehicle": _Run(0.2, 25, 300, {"thrust": (-100.0, 100.0)}),
    "linear_sensor": _Run(1.0, 1, 20, {"depth": (0.0, 4.0)}),
    "vessel": _Run(0.2, 30, 300, {"propeller_speed": (60.0, 120.0), "rudder_angle": (-0.45, 0.45)}),
}


def example_table(model: Model, seed: int) -> str:
    """A log of a model as CSV: time, inputs at random levels, and outputs with white noise."""
    run = _RUNS[model.name]
    rng = np.random.default_rng(seed)
    time = run.step * np.arange(run.samples)
    inputs = {
        name: np.repeat(rng.uniform(*ends, -(-run.samples // run.hold)), run.hold)[: run.samples]
        for name, ends in run.ranges.items()
    }
    perturbed = {name: _OTHER * p.value for name, p in model.parameters.items() if not p.fixed}
    outputs = simulate(model.replace(perturbed), Log(time, inputs, {}))
    noisy = {
        name: values + _NOISE * np.std(values) * rng.standard_normal(run.samples)
        for name, values in outputs.items()
        if name in model.outputs
    }
    columns = {"time": time, **inputs, **noisy}
    rows = (
        ",".join(f"{value:.5g}" for value in row) for row in zip(*columns.values(), strict=True)
    )
    return "\n".join([",".join(columns), *rows, ""])


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
    script, tests = folder / f"{name}.py", folder / f"test_{name}.py"
    for path in (script, tests):
        _check_new(path)
    described = {"doc": doc} if doc else {}
    texts = {
        script.name: effect_class_text(formula, name, **described),
        tests.name: effect_test_text(formula, name),
    }
    _write(folder, texts)
    return script, tests


def parse_parameter(text: str) -> tuple[str, Any]:
    """A parameter of the command line: ``a=rad/s^2``, or with fields, ``p={ value = 1.5 }``."""
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

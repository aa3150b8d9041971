"""The command ``diffthrust demo``: a fit, or a diagnosis, of logs that come with the package."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Option

from diffthrust._support.errors import InputError
from diffthrust._support.files import made_folder, write_whole
from diffthrust.cli import _session as ui
from diffthrust.cli._fit import diagnose_command

if TYPE_CHECKING:
    from diffthrust.models._base.effect import Effect

_STEP = 0.05
_SAMPLES = 1200
_SEEDS = {"train_1.csv": 1, "train_2.csv": 2, "unseen.csv": 3}
_SPEC = """\
# A simulated thruster with effects that the plain model lacks. Which? Ask:
#
#     diffthrust diagnose {folder} --report diagnosis.html

model = "thruster"

[logs]
train = ["train_1.csv", "train_2.csv"]
holdout = ["unseen.csv"]
time = {{ column = "time", unit = "s" }}

[channels.command]
column = "command"
unit = "V"

[channels.speed]
column = "speed"
unit = "rad/s"

[channels.thrust]
column = "thrust"
unit = "N"
"""


def demo_command(
    output: Annotated[Path, Option(metavar="DIR", help="The folder for its files.")] = Path(
        "demo_output"
    ),
    missing: Annotated[
        bool, Option("--missing", help="Diagnose a thruster with effects that its model lacks.")
    ] = False,
) -> None:
    """Fit the thruster to a log of the package, and test it on an unseen log."""
    if missing:
        _diagnosed(output)
    else:
        _fitted(output)


def _diagnosed(output: Path) -> None:
    with ui.session():
        folder = hidden_folder(output)
    ui.show(f"Made three logs of a thruster, and a spec of a plainer one, in {folder}.")
    diagnose_command(folder, report=output / "diagnosis.html")


def _fitted(output: Path) -> None:
    with ui.session() as progress:
        from diffthrust.comparison._page import comparisons_of
        from diffthrust.specs._spec import load_spec

        loaded = load_spec(_demo_folder())
        train, holdout = loaded.train_logs(), loaded.holdout_logs()
        fit = loaded.fit(progress=progress, train=train, holdout=holdout)
        figure = _made(output) / "comparison.png"
        ui.write_figure(figure, comparisons_of(fit, train, holdout)["unseen logs"].plot)
    ui.show(fit)
    assert fit.holdout is not None
    ui.show(f"Error on the unseen log: NRMSE {fit.holdout.nrmse:.4f}.")
    ui.written(figure)


def _demo_folder() -> Path:
    """The folder of the demo's spec and logs, in a wheel or in a checkout."""
    here = Path(__file__).resolve().parent
    # The build of the wheel copies the logs into the package; a checkout has them in fits/.
    places = (here / "demo_log", here.parents[1] / "fits" / "jason_thruster")
    for place in places:
        if (place / "fit.toml").is_file():
            return place
    raise InputError(
        f"The demo's log is missing; expected it in {places[0]} or {places[1]}.",
        "Install the package again.",
    )


def hidden_folder(folder: Path) -> Path:
    """Write three logs of a thruster with hidden effects, and a spec of the plain model."""
    _made(folder)
    spec = folder / "fit.toml"
    # A second run may overwrite its own files, never a spec that somebody wrote: the demo's starts
    # with its first comment.
    if spec.exists() and not spec.read_text(errors="replace").startswith(_SPEC.split(".")[0]):
        raise InputError(
            f"{spec}: expected an empty folder or that of an earlier demo, found another spec.",
            "Name another folder: diffthrust demo --missing --output DIR.",
        )
    for name, seed in _SEEDS.items():
        write_whole(folder / name, _table(seed).encode())
    write_whole(spec, _SPEC.format(folder=folder).encode())
    return folder


def _made(folder: Path) -> Path:
    return made_folder(folder, "Name another: diffthrust demo --output DIR.")


def hidden_effects() -> tuple[Effect, ...]:
    """What the thruster of the logs has, and the model of their spec has not."""
    from diffthrust import effects

    return (
        effects.CommandDeadband(half_width=0.25),
        effects.ReverseThrustAsymmetry(change=-0.15),
    )


def _table(seed: int) -> str:
    """One log as CSV: a staircase of random commands, and sensors with noise."""
    import numpy as np

    from diffthrust.logs._log import Log
    from diffthrust.models import Thruster
    from diffthrust.simulation._runs import simulate

    rng = np.random.default_rng(seed)
    time = _STEP * np.arange(_SAMPLES)
    command = np.repeat(rng.uniform(-4.0, 4.0, _SAMPLES // 30), 30)
    real = Thruster(alpha=0.037, beta=42.0, ct=0.02) + list(hidden_effects())
    outputs = simulate(real, Log(time, {"command": command}, {}))
    speed = outputs["speed"] + rng.normal(0.0, 0.3, _SAMPLES)
    thrust = outputs["thrust"] + rng.normal(0.0, 0.2, _SAMPLES)
    rows = zip(time, command, speed, thrust, strict=True)
    lines = [",".join(f"{value:.4f}" for value in row) for row in rows]
    return "\n".join(["time,command,speed,thrust", *lines, ""])

"""The command ``diffthrust demo``: a fit, or a diagnosis, of logs that come with the package."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Option

from diffthrust._support.errors import InputError
from diffthrust.cli import _session as ui
from diffthrust.cli._fit import diagnose_command


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
        from diffthrust.cli._demo_logs import hidden_folder

        folder = hidden_folder(output)
    ui.show(f"Made three logs of a thruster, and a spec of a plainer one, in {folder}.")
    diagnose_command(folder, report=output / "diagnosis.html")


def _fitted(output: Path) -> None:
    with ui.session() as progress:
        from diffthrust.cli._demo_logs import folder_at
        from diffthrust.comparison._page import comparisons_of
        from diffthrust.specs._spec import load_spec

        loaded = load_spec(_demo_folder())
        train, holdout = loaded.train_logs(), loaded.holdout_logs()
        fit = loaded.fit(progress=progress, train=train, holdout=holdout)
        figure = folder_at(output) / "comparison.png"
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

"""The command line: fit, compare, diagnose, sample, campaign, map, check, demo and lists."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from diffthrust._support.errors import InputError
from diffthrust.cli._campaign import campaign
from diffthrust.cli._check import check_command
from diffthrust.cli._datasets import datasets
from diffthrust.cli._map import map_command
from diffthrust.cli._new import new_command
from diffthrust.cli._options import JsonPath, ReportPath, SpecPath, names_in
from diffthrust.cli._options import show as _show
from diffthrust.cli._options import written as _written
from diffthrust.cli._sample import sample
from diffthrust.cli._session import DONE, session

if TYPE_CHECKING:
    from diffthrust.comparison._compare import Comparison
    from diffthrust.estimation._result import Fit
    from diffthrust.specs._spec import Spec

app = typer.Typer(
    name="diffthrust",
    help="Fit models of underwater thrusters and small vessels to logs, and see what they lack.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def main() -> None:
    """Entry point of the ``diffthrust`` command."""
    app()


@app.callback(invoke_without_command=True)
def _start(
    version: Annotated[bool, typer.Option("--version", help="Show the version.")] = False,
) -> None:
    if version:
        from diffthrust import __version__

        typer.echo(f"diffthrust {__version__}")
        raise typer.Exit(DONE)


@app.command()
def fit(spec: SpecPath, json: JsonPath = None, report: ReportPath = None) -> None:
    """Estimate the free parameters of a model from logs, and try it on unseen ones."""
    with session() as progress:
        loaded = _load(spec)
        train, holdout = loaded.train_logs(), loaded.holdout_logs()
        found = loaded.fit(progress, train=train, holdout=holdout)
        if json:
            _write_json(json, found.to_json())
        if report:
            _write_report(report, loaded, found, _comparisons(loaded, found, train, holdout))
    from diffthrust.estimation._tables import fit_table

    _show(fit_table(found))
    _written(json, report)


@app.command()
def compare(
    spec: SpecPath,
    no_fit: Annotated[
        bool, typer.Option("--no-fit", help="Take the parameters as the spec gives them.")
    ] = False,
    json: JsonPath = None,
    report: ReportPath = None,
    figure: Annotated[
        Path | None,
        typer.Option("--figure", metavar="FILE.png", help="Draw the unseen logs, or all if none."),
    ] = None,
) -> None:
    """Hold a model against its logs, run by run, after a fit or as it stands."""
    with session() as progress:
        loaded = _load(spec)
        train, holdout = loaded.train_logs(), loaded.holdout_logs()
        found = None if no_fit else loaded.fit(progress, train=train, holdout=holdout)
        comparisons = _comparisons(loaded, found, train, holdout)
        if json:
            parts = {name.split()[0]: c.to_json() for name, c in comparisons.items()}
            head = {k: next(iter(parts.values()))[k] for k in ("schema", "model", "effects")}
            short = {k: {n: v[n] for n in ("errors", "runs")} for k, v in parts.items()}
            short = {"train": short["training"], "holdout": short.get("unseen")}
            status = found.status.value if found else None
            _write_json(json, {**head, "status": status, **short})
        if report:
            _write_report(report, loaded, found, comparisons)
        if figure:
            _write_figure(figure, list(comparisons.values())[-1])
    from diffthrust.comparison._tables import comparison_table

    if found:
        _show(f"Status: {found.status.value}. {found.message}")
    for name, comparison in comparisons.items():
        _show(comparison_table(comparison, name))
    _written(json, report, figure)


@app.command()
def diagnose(
    spec: SpecPath,
    candidates: Annotated[
        str | None,
        typer.Option(
            "--candidates",
            metavar="A,B,...",
            help="Effects to try, also script.py:Class; 'all', the default, is the catalogue.",
        ),
    ] = None,
    json: JsonPath = None,
    report: ReportPath = None,
) -> None:
    """Find what a model lacks: where it fails, which effect is missing, what cannot be told."""
    with session() as progress:
        loaded = _load(spec)
        found = loaded.diagnose(progress, candidates=names_in(candidates))
        if json:
            _write_json(json, found.to_json())
        if report:
            from diffthrust.diagnosis._page import write_report

            write_report(found, report, title=f"Diagnosis: {loaded.name}", spec=loaded.text)
        from diffthrust.diagnosis._tables import diagnosis_table

        table = diagnosis_table(found)
    _show(table)
    _written(json, report)


app.command()(sample)
app.command()(campaign)
app.command()(datasets)
app.command("map")(map_command)
app.command("check")(check_command)
app.command("new")(new_command)


@app.command()
def demo(
    output: Annotated[
        Path, typer.Option("--output", metavar="DIR", help="Where to put what it writes.")
    ] = Path("demo_output"),
    missing: Annotated[
        bool,
        typer.Option("--missing", help="Diagnose a thruster with effects that its model lacks."),
    ] = False,
) -> None:
    """Fit the thruster to a log that comes with the package, and try it on an unseen one."""
    from diffthrust.cli._demo import folder_at, hidden_folder

    if missing:
        with session():
            folder = hidden_folder(output)
        _show(f"Made three logs of a thruster, and a spec of a plainer one, in {folder}.")
        return diagnose(folder, report=output / "diagnosis.html")
    with session() as progress:
        loaded = _load(demo_folder())
        train, holdout = loaded.train_logs(), loaded.holdout_logs()
        found = loaded.fit(progress, train=train, holdout=holdout)
        figure = folder_at(output) / "comparison.png"
        _write_figure(figure, _comparisons(loaded, found, train, holdout)["unseen logs"])
    from diffthrust.estimation._tables import fit_table

    _show(fit_table(found))
    assert found.holdout is not None
    _show(f"Error on the unseen log: NRMSE {found.holdout.nrmse:.4f}.")
    _written(figure)


@app.command()
def effects() -> None:
    """List the effects that a model can be given: what each does, where, and its parameters."""
    with session():
        from diffthrust.cli._effects import effects_table
        from diffthrust.models import MODELS, Vessel
        from diffthrust.models._base.registry import catalogue

        models = {name: model() for name, model in MODELS.items()}
        models["vessel (twin)"] = Vessel(drive="twin")
        table = effects_table(catalogue().values(), models)
    _show(table)


def demo_folder() -> Path:
    """The folder of the demo's spec and logs, in a wheel or in a checkout.

    Raises:
        InputError: neither place has it.
    """
    here = Path(__file__).resolve().parent
    places = (here / "demo_log", here.parents[1] / "fits" / "jason_thruster")
    for place in places:
        if (place / "fit.toml").is_file():
            return place
    raise InputError(
        f"The demo's log is missing; it is looked for in {places[0]} and {places[1]}.",
        "Install the package again.",
    )


def _load(path: Path) -> Spec:
    from diffthrust.specs._spec import load_spec

    return load_spec(path)


def _comparisons(
    loaded: Spec, found: Fit | None, train: Any, holdout: Any
) -> dict[str, Comparison]:
    from diffthrust.comparison._page import comparisons_of

    return comparisons_of(found or loaded.model, train, holdout)


def _write_json(path: Path, data: dict[str, Any]) -> None:
    from diffthrust._support.files import write_json

    write_json(path, data)


def _write_report(
    path: Path, loaded: Spec, found: Fit | None, comparisons: dict[str, Comparison]
) -> None:
    from diffthrust.comparison._page import write_report

    write_report(path, title=loaded.name, spec=loaded.text, comparisons=comparisons, fit=found)


def _write_figure(path: Path, comparison: Comparison) -> None:
    from io import BytesIO

    from diffthrust._support.files import ending, write_whole

    kind = ending(path, ".png", ".svg", ".pdf").removeprefix(".")
    out = BytesIO()
    comparison.plot().savefig(out, format=kind, dpi=120)
    write_whole(path, out.getvalue())


if __name__ == "__main__":
    main()

"""The commands that write what users go on with: a fit, a workflow, an effect of their own."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from diffthrust._support.errors import InputError
from diffthrust.cli import _session as ui

if TYPE_CHECKING:
    from diffthrust.effects import Formula
    from diffthrust.models import Model


def new_command(
    name: Annotated[
        str | None, Argument(metavar="NAME", help="Name of the fit and of its folder.")
    ] = None,
    model: Annotated[str, Option(metavar="MODEL", help="A model of the catalogue.")] = "thruster",
    directory: Annotated[Path, Option(metavar="DIR", help="The folder of the fits.")] = Path(
        "fits"
    ),
    workflow: Annotated[
        bool, Option("--workflow", help="Also write .github/workflows/fits.yml, the CI gate.")
    ] = False,
) -> None:
    """Make DIR/NAME with a commented spec and example logs, ready to take logs of your own."""
    with ui.session():
        from diffthrust.specs._new import new_fit, new_workflow, workflow_place

        if name is None and not workflow:
            raise InputError(
                "expected the NAME of a fit, found none.", "Write diffthrust new bollard_pull."
            )
        if workflow:
            workflow_place(directory)  # refuse it before anything is written
        folder = new_fit(name, model, directory) if name is not None else None
        gate = new_workflow(directory) if workflow else None
    ui.written(folder, gate)
    if folder:
        ui.show(
            f"Next: put your logs into {folder}, name them in its fit.toml, and run diffthrust fit "
            f"{folder}.\nOnce you trust it: diffthrust check {directory} --update"
        )


def new_effect_command(
    name: Annotated[str, Argument(metavar="NAME", help="Name of the effect and its files.")],
    formula: Annotated[
        str, Option(metavar="TEXT", help='The law: "-a * speed * abs(speed)**p".')
    ] = "",
    port: Annotated[
        str, Option(metavar="PORT", help="Where it acts; see diffthrust effects.")
    ] = "",
    learned: Annotated[
        Path | None,
        Option(
            metavar="DIAG.json",
            help="Instead of --formula: the law learned by diagnose --save DIAG.json.",
        ),
    ] = None,
    parameter: Annotated[
        list[str] | None,
        Option(
            metavar="NAME=UNIT",
            help="A parameter; with more fields, 'p={ value = 1.5, bounds = [0.5, 3] }'.",
        ),
    ] = None,
    doc: Annotated[str, Option(metavar="TEXT", help="What the effect does, in a sentence.")] = "",
    directory: Annotated[Path, Option(metavar="DIR", help="Where the files go.")] = Path(),
) -> None:
    """Write NAME.py with the class of an effect, and test_NAME.py with tests that pass."""
    with ui.session():
        from diffthrust.effects import Formula
        from diffthrust.effects._class_text import class_name
        from diffthrust.specs._new import bound_to_model, new_effect, parse_parameter

        if learned:
            if formula or port or parameter:
                raise InputError(
                    f"--learned {learned}: expected no other law, found one.",
                    "Leave out --formula, --port and --parameter.",
                )
            law, provenance, model = _learned(learned)
            named = Formula(law.port, law.expression, name=name, **law.given)
            effect, doc = (model + named).effects[-1], doc or provenance
            assert isinstance(effect, Formula)
        elif formula and port:
            requested = dict(map(parse_parameter, parameter or []))
            effect = bound_to_model(Formula(port, formula, name=name, **requested))
        else:
            raise InputError(
                "new-effect: expected a law and its port, found neither or only one of them.",
                'Give --formula "-a * speed" --port shaft --parameter a=1/s, '
                "or --learned DIAG.json.",
            )
        files = new_effect(effect, doc=doc, directory=directory)
    ui.written(*files)
    ui.show(
        f'Next: name it beside a spec, effects = ["{name}.py:{class_name(name)}"], and run '
        f"diffthrust fit; its tests: pytest {files[1]}"
    )


def _learned(path: Path) -> tuple[Formula, str, Model]:
    """The learned law in a saved diagnosis, with its description and model."""
    from diffthrust._support.words import capitalised
    from diffthrust.diagnosis import Diagnosis
    from diffthrust.diagnosis._report.learned import form_words
    from diffthrust.saved import load

    diag = load(path)
    if not isinstance(diag, Diagnosis):
        raise InputError(
            f"{path}: expected a diagnosis, found {type(diag).__name__!r}.",
            "Write one: diffthrust diagnose SPEC --save DIAG.json.",
        )
    named = [(law, law.form) for law in diag.laws if law.form]
    if not named:
        raise InputError(
            f"{path}: expected a learned law with a closed form, found "
            f"{'one without' if diag.laws else 'no learned law'}.",
            "Write the law that you suspect: --formula TEXT --port PORT.",
        )
    law, form = named[0]
    goes, _, _ = form_words(law, form).partition(":")
    description = f"{capitalised(goes.removeprefix('it '))}, as learned from logs."
    return form.formula, description, diag.model

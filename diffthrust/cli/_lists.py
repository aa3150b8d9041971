"""The commands that list: effects, public data sets, and what is kept between runs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from diffthrust._support.report import Line, Report, Rows, Section, Styled
from diffthrust.cli import _session as ui

if TYPE_CHECKING:
    from diffthrust.datasets._fetch import DataSet
    from diffthrust.models._base.effect import Effect
    from diffthrust.models._base.model import Model


def effects_command() -> None:
    """List the effects of the catalogue: what each does, its port, and its parameters."""
    with ui.session():
        from diffthrust.actuators import ACTUATORS
        from diffthrust.bodies import BODIES
        from diffthrust.models import MODELS, Vessel
        from diffthrust.models._base.effect import catalogue
        from diffthrust.models._craft.craft import Craft
        from diffthrust.specs._thrusters import model_of

        models = {name: model_of(name) for name in (*MODELS, *ACTUATORS)}
        models["vessel (twin)"] = Vessel(drive="twin")
        # its thrusters' effects are listed with the thrusters
        models |= {f"craft ({name})": Craft(body()) for name, body in BODIES.items()}
        report = catalogue_report(catalogue().values(), models)
    ui.show(report)


def datasets_command(
    name: Annotated[
        str | None,
        Argument(metavar="NAME", help="A data set to download; without it all are listed."),
    ] = None,
) -> None:
    """List public logs with licence and known defects, or download a set."""
    with ui.session():
        from diffthrust import datasets

        if name is None:
            text = datasets_report(datasets.list())
        else:
            folder = datasets.fetch(name)
            about = next(about for about in datasets.list() if about.name == name)
            text = f"{about}\n  folder    {folder}"
    ui.show(text)


def cache_command(
    clear: Annotated[bool, Option("--clear", help="Delete the traced programs.")] = False,
) -> None:
    """Show what is kept between runs so that nothing is traced twice, or clear it.

    The environment variable DIFFTHRUST_CACHE names another folder; "off" switches it off.
    """
    with ui.session():
        from diffthrust._support._running.stored import program_store

        store = program_store()
        if store is None:
            text = "Nothing is kept: DIFFTHRUST_CACHE is off, or the folder cannot be written to."
        else:
            sizes = [size for _, _, size in store.files()]
            lines = [
                f"{store.folder}: {len(sizes)} traced programs, {sum(sizes) / 1e6:.1f} MB of at "
                f"most {store.largest / 1e6:.0f} MB."
            ]
            if clear:
                store.shrink()
                lines.append(
                    "The programs are deleted. What JAX has compiled stays: the folder may serve "
                    "other projects; delete it by hand where it does not."
                )
            text = "\n".join(lines)
    ui.show(text)


def catalogue_report(effects: Iterable[type[Effect]], models: Mapping[str, Model]) -> Report:
    """The catalogue: what each effect does, where, with which parameters, for which models."""
    effects = sorted(effects, key=lambda effect: (effect.port, effect.name))
    return Report(*(_effect_section(effect, models) for effect in effects))


def _effect_section(effect: type[Effect], models: Mapping[str, Model]) -> Section:
    suited = [name for name, model in models.items() if _suits(model, effect())]
    first, *_ = [*(effect.__doc__ or "").strip().splitlines(), ""]
    rows = [("port", ", ".join(effect.ports))]
    for name, p in effect.declared.items():
        start = f"{name} [{p.in_units({}).unit or '-'}]" + (" (fixed)" if p.fixed else "")
        null = f", null {p.null:g}" if p.null is not None else ""
        rows.append(("parameter", f"{start}, starts at {p.value:g}{null}"))
    rows.append(("needs", ", ".join(effect.needs) or "nothing besides the model's channels"))
    rows.append(("models", ", ".join(suited) or "none of the catalogue"))
    table = Rows.of((), ((Styled(f"  {key}", "quiet"), text) for key, text in rows), unbroken=(0,))
    return Section("", Line((Styled(effect.name, "term"), f": {first}")), table)


def _suits(model: Model, effect: Effect) -> bool:
    try:
        _ = model + effect
    except ValueError:
        return False
    return True


def datasets_report(sets: Iterable[DataSet]) -> Report:
    """The public logs: what each set is, its licence, and where it comes from."""
    local = "a local folder only (DIFFTHRUST_DATA)"
    rows = (
        (
            Styled(about.name, "term"),
            about.title,
            about.licence,
            "its public repository" if about.address else local,
        )
        for about in sets
    )
    headings = ("name", "what it is", "licence", "from")
    return Report(Section("", Rows.of(headings, rows, unbroken=(0,))))

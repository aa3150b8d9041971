"""The catalogue of effects and the list of data sets, as rows of a report."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

from diffthrust._support.report import Line, Report, Rows, Section, Styled
from diffthrust.models._base.effect import Effect
from diffthrust.models._base.model import Model

if TYPE_CHECKING:
    from diffthrust.datasets._record import DataSet


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

"""The effects and the data sets that there are, as tables for people."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

from rich.console import Group, RenderableType
from rich.markup import escape
from rich.text import Text

from diffthrust._support.tables import FittedTable
from diffthrust.models._base.effect import Effect
from diffthrust.models._base.model import Model

if TYPE_CHECKING:
    from diffthrust.datasets._record import DataSet


def catalogue_table(effects: Iterable[type[Effect]], models: Mapping[str, Model]) -> RenderableType:
    """The catalogue: what each effect does, where, with which parameters, for which models."""
    parts: list[RenderableType] = []
    for effect in sorted(effects, key=lambda e: (e.port, e.name)):
        suits = [name for name, model in models.items() if _suits(model, effect())]
        first = (effect.__doc__ or "").strip().splitlines()
        table = FittedTable(box=None, show_header=False, padding=(0, 1), pad_edge=False)
        table.add_column(style="dim", no_wrap=True)
        table.add_column()
        table.add_row("  port", ", ".join(effect.ports))
        for name, p in effect.declared.items():
            start = f"{name} [{p.in_units({}).unit or '-'}]" + (" (fixed)" if p.fixed else "")
            null = f", null {p.null:g}" if p.null is not None else ""
            table.add_row("  parameter", escape(f"{start}, starts at {p.value:g}{null}"))
        table.add_row("  needs", ", ".join(effect.needs) or "nothing besides the model's channels")
        table.add_row("  models", ", ".join(suits) or "none of the catalogue")
        title = Text.assemble((effect.name, "bold cyan"), f": {first[0] if first else ''}")
        parts += [title, table, Text()]
    return Group(*parts)


def _suits(model: Model, effect: Effect) -> bool:
    try:
        _ = model + effect
    except ValueError:
        return False
    return True


def datasets_table(sets: Iterable[DataSet]) -> RenderableType:
    """The public logs: what each set is, its licence, and where it comes from."""
    table = FittedTable(box=None, pad_edge=False)
    table.add_column("name", style="bold cyan", no_wrap=True)
    table.add_column("what it is")
    table.add_column("licence")
    table.add_column("from")
    for about in sets:
        table.add_row(
            about.name,
            about.title,
            about.licence,
            "its public repository" if about.address else "a local folder only (DIFFTHRUST_DATA)",
        )
    return table

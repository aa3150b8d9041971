"""A comparison as a table for people."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from rich.console import Group, RenderableType
from rich.text import Text

from diffthrust.estimation._tables import error_table
from diffthrust.models._base.model import Model
from diffthrust.simulation._errors import Errors
from diffthrust.simulation._runs import Run


def comparison_table(
    heading: str,
    model: Model,
    runs: Sequence[Run],
    pooled: Errors,
    findings: Iterable[tuple[str, Iterable[str]]],
    closing: Iterable[str] = (),
) -> RenderableType:
    """Errors of each run and pooled over the runs, then what was found, in sentences."""
    errors = [(run.name, run.errors) for run in runs]
    if len(errors) > 1:
        errors.append(("all runs", pooled))
    parts: list[RenderableType] = [
        Text(heading, style="bold"),
        error_table(errors),
        Text(),
    ]
    for name, sentences in findings:
        parts += [Text(name, style="bold"), *(Text(f"- {words}") for words in sentences), Text()]
    return Group(*parts, *(Text(line, style="dim") for line in closing))

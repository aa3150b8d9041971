"""A comparison as tables for people."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.console import Group, RenderableType
from rich.text import Text

if TYPE_CHECKING:
    from diffthrust.comparison._compare import Comparison
from diffthrust.estimation._tables import error_table, units


def comparison_table(comparison: Comparison, title: str = "") -> RenderableType:
    """Errors of each run and pooled over the runs, where they sit, residual tests and hints."""
    errors = [(run.name, run.errors) for run in comparison.runs]
    if len(errors) > 1:
        errors.append(("all runs", comparison.errors))
    heading = f"{comparison.model}{f', {title}' if title else ''}"
    parts: list[RenderableType] = [
        Text(heading, style="bold"),
        error_table(errors, units(comparison.model)),
        Text(),
    ]
    for name, sentences in findings(comparison):
        parts += [Text(name, style="bold"), *(Text(f"- {words}") for words in sentences), Text()]
    return Group(*parts)


def findings(comparison: Comparison) -> list[tuple[str, list[str]]]:
    """What a comparison found besides errors: headings with their sentences; none is empty."""
    regimes = [regime.sentence for regime in comparison.regimes]
    if not regimes and not comparison.tabular:
        regimes = ["No regime stands out from what chance would give."]
    noise = [tests.sentence for tests in comparison.tests.values()]
    fit, advice = comparison.fit, comparison.noise_advice
    followed = fit and advice and (fit.noise_model, fit.loss) == (advice.noise_model, advice.loss)
    if advice and not followed and not (fit and fit.likelihood == "innovations"):
        noise.append(advice.sentence)
    found = [
        ("What does not fit together", [*comparison.hints, *comparison.outstanding]),
        ("Where the error sits (inputs as recorded, other signals as modelled)", regimes),
        ("Is the residual noise?", noise),
    ]
    return [(name, sentences) for name, sentences in found if sentences]

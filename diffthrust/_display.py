"""Results as tables for people (rich)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from io import StringIO
from typing import TYPE_CHECKING

from rich.console import Console, Group, RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from diffthrust._effect import Effect
from diffthrust._metrics import Errors
from diffthrust._model import Model

if TYPE_CHECKING:
    from diffthrust._compare import Comparison
    from diffthrust._result import Estimate, Fit


def rendered(thing: RenderableType, width: int = 100) -> str:
    """A table as plain text, without colours."""
    out = StringIO()
    Console(file=out, width=width, force_terminal=False, color_system=None).print(thing)
    return "\n".join(line.rstrip() for line in out.getvalue().splitlines()) + "\n"


def fit_table(fit: Fit) -> RenderableType:
    """Status, parameters with their uncertainty, errors on training and unseen logs, notes."""
    status = Text.assemble(
        ("Status: ", "bold"),
        (fit.status.value, "bold green" if fit.status.ok else "bold red"),
    )
    parts: list[RenderableType] = [
        Text(str(fit.model), style="bold"),
        status,
        Text(fit.message),
        Text(),
        parameter_table(fit.parameters),
        *_observer_parts(fit),
        Text(),
        error_table([("training", fit.train), ("unseen", fit.holdout)], units(fit.model)),
        *(Text(f"Note: {note}") for note in fit.notes),
    ]
    return Group(*parts)


def _observer_parts(fit: Fit) -> list[RenderableType]:
    """What the innovations form found of random forces and lasting sensor errors."""
    if not fit.disturbance:
        return []
    table = _table("Noise", "Value", "Unit", "", numbers=(1,))
    for name, e in fit.disturbance.items():
        told = name.removeprefix("noise.")
        table.add_row(told, number(e.value, 3), escape(e.unit), "at its bound" * e.at_bound)
    return [Text(), table]


def parameter_table(parameters: Mapping[str, Estimate]) -> Table:
    """One row for each parameter; numbers end at the second digit of their standard error."""
    table = _table("Parameter", "Value", "Std error", "Unit", "", numbers=(1, 2))
    for name, e in parameters.items():
        if e.fixed:
            remark = "fixed"
        elif e.at_bound:
            remark = "at its bound"
        else:
            remark = "" if e.std_error is not None else "not determined by these logs"
        value, error = with_error(e.value, e.std_error)
        table.add_row(escape(name), value, error, escape(e.unit), remark)
    return table


def error_table(errors: Iterable[tuple[str, Errors | None]], unit: Mapping[str, str]) -> Table:
    """Errors by log and channel, and over all channels."""
    table = _table("Logs", "Channel", "RMSE", "Unit", "NRMSE", "Fit %", "Samples")
    for column in (2, 4, 5, 6):
        table.columns[column].justify = "right"
    for logs, error in errors:
        if error is None:
            continue
        for name, e in error.channels.items():
            table.add_row(
                escape(logs),
                escape(name),
                number(e.rmse),
                escape(unit.get(name, "")),
                number(e.nrmse),
                f"{round(e.fit_percent, 1) + 0.0:.1f}",
                str(e.samples),
            )
        if len(error.channels) > 1:
            table.add_row(escape(logs), "all", "", "", number(error.nrmse), "", "", style="bold")
        table.add_section()
    return table


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


def effects_table(effects: Iterable[type[Effect]], models: Mapping[str, Model]) -> RenderableType:
    """The catalogue: what each effect does, where, with which parameters, for which models."""
    parts: list[RenderableType] = []
    for effect in sorted(effects, key=lambda e: (e.port, e.name)):
        suits = [name for name, model in models.items() if _suits(model, effect())]
        first = (effect.__doc__ or "").strip().splitlines()
        table = Table(box=None, show_header=False, padding=(0, 1), pad_edge=False)
        table.add_column(style="dim", no_wrap=True)
        table.add_column()
        table.add_row("  port", ", ".join(effect.ports))
        for name, p in effect.declared.items():
            start = f"{name} [{p.unit or '-'}]" + (" (fixed)" if p.fixed else "")
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


def units(model: Model) -> dict[str, str]:
    """The unit of each channel that the model puts out."""
    return dict(model.outputs)


def number(value: float | None, digits: int = 4) -> str:
    """A number with some significant digits, ``-`` where there is none.

    Example:
        >>> number(0.0123456)
        '0.01235'
    """
    if value is None or math.isnan(value):
        return "-"
    if value == 0 or 1e-4 <= abs(value) < 1e6:
        places = digits - 1 - (math.floor(math.log10(abs(value))) if value else 0)
        return f"{value:.{min(max(places, 0), digits + 3)}f}"
    return f"{value:.{digits - 1}e}" if math.isfinite(value) else f"{value}"


def with_error(value: float, error: float | None) -> tuple[str, str]:
    """A value and its standard error, both to the second digit of the error.

    Example:
        >>> with_error(0.0370107, 3.0357e-05)
        ('0.037011', '0.000030')
    """
    if error is None or not error > 0 or not math.isfinite(value):
        return number(value), "-" if error is None else number(error, 2)
    places = 1 - math.floor(math.log10(error))
    if 0 <= places <= 8 and abs(value) < 1e6:
        return f"{value:.{places}f}", f"{error:.{places}f}"
    digits = 2
    if value:
        digits = max(2, 2 + math.floor(math.log10(abs(value))) - math.floor(math.log10(error)))
    return f"{value:.{min(digits, 12) - 1}e}", f"{error:.1e}"


def _table(*headings: str, numbers: Iterable[int] = ()) -> Table:
    table = Table(box=None, padding=(0, 1), pad_edge=False, header_style="dim")
    for i, heading in enumerate(headings):
        justify = "right" if i in tuple(numbers) else "left"
        table.add_column(heading, justify=justify, overflow="fold")
    return table

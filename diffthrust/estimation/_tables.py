"""Results as tables for people (rich)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Protocol

from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from diffthrust._support.tables import line_text, number, plain_table, with_error
from diffthrust.estimation._estimate import Estimate
from diffthrust.estimation._origin import Origin, closing
from diffthrust.estimation._status import Status
from diffthrust.models._base.model import Model
from diffthrust.simulation._errors import ChannelError, Errors
from diffthrust.soundness._doubt import Doubt


class _Reported(Protocol):
    """What is shown of a fit."""

    @property
    def model(self) -> Model: ...
    @property
    def status(self) -> Status: ...
    @property
    def message(self) -> str: ...
    @property
    def parameters(self) -> Mapping[str, Estimate]: ...
    @property
    def disturbance(self) -> Mapping[str, Estimate] | None: ...
    @property
    def train(self) -> Errors: ...
    @property
    def holdout(self) -> Errors | None: ...
    @property
    def notes(self) -> tuple[str, ...]: ...
    @property
    def origin(self) -> Origin | None: ...
    @property
    def doubts(self) -> tuple[Doubt, ...]: ...


def fit_table(fit: _Reported) -> RenderableType:
    """Doubts, status, parameters with their uncertainty, errors on logs, notes."""
    status = Text.assemble(
        ("Status: ", "bold"),
        (fit.status.value, "bold green" if fit.status.ok else "bold red"),
    )
    parts: list[RenderableType] = [
        Text(str(fit.model), style="bold"),
        *doubt_lines(fit.doubts),
        status,
        Text(fit.message),
        Text(),
        parameter_table(fit.parameters),
        *_observer_parts(fit),
        Text(),
        error_table([("training", fit.train), ("unseen", fit.holdout)]),
        *(Text(f"Note: {note}") for note in fit.notes),
        *closing_parts(closing(fit.origin, fit.model)),
    ]
    return Group(*parts)


def closing_parts(lines: Iterable[str]) -> list[RenderableType]:
    """The last lines of a report, apart from what stands above."""
    texts: list[RenderableType] = [line_text(line, "dim") for line in lines]
    return [Text(), *texts] if texts else []


def doubt_lines(doubts: Iterable[Doubt]) -> list[RenderableType]:
    """What to look at before anything else; mostly nothing."""
    return [
        Text.assemble(
            (f"Doubt: {doubt.channel} ({doubt.kind}): ", "bold yellow"),
            f"{doubt.evidence}\nMend: {doubt.mend}",
        )
        for doubt in doubts
    ]


def _observer_parts(fit: _Reported) -> list[RenderableType]:
    """What the innovations form found of random forces and lasting sensor errors."""
    if not fit.disturbance:
        return []
    table = plain_table("Noise", "Value", "Unit", "", numbers=(1,))
    for name, e in fit.disturbance.items():
        short = name.removeprefix("noise.")
        table.add_row(short, number(e.value, 3), escape(e.unit), "at its bound" * e.at_bound)
    return [Text(), table]


def parameter_table(parameters: Mapping[str, Estimate]) -> Table:
    """One row for each parameter; numbers end at the second digit of their standard error."""
    table = plain_table("Parameter", "Value", "Std error", "Unit", "", numbers=(1, 2))
    for name, e in parameters.items():
        if e.fixed:
            remark = "fixed"
        elif e.at_bound:
            remark = "at its bound"
        else:
            remark = "" if e.std_error is not None else "not determined by these logs"
        size, spread, unit = e.shown
        table.add_row(escape(name), *with_error(size, spread), escape(unit), remark)
    return table


def error_cells(e: ChannelError) -> tuple[str, str, str, str, str]:
    """RMSE, its unit, NRMSE, fit per cent and samples; ``-`` where a simulation failed."""
    percent = f"{round(e.fit_percent, 1) + 0.0:.1f}" if math.isfinite(e.fit_percent) else "-"
    return error_cell(e.shown.value), e.shown.unit, error_cell(e.nrmse), percent, str(e.samples)


def error_cell(value: float) -> str:
    """An error as text; ``-`` where a simulation failed."""
    return number(value) if math.isfinite(value) else "-"


def error_table(errors: Iterable[tuple[str, Errors | None]]) -> Table:
    """Errors by log and channel, and over all channels."""
    table = plain_table("Logs", "Channel", "RMSE", "Unit", "NRMSE", "Fit %", "Samples")
    for column in (2, 4, 5, 6):
        table.columns[column].justify = "right"
    for logs, error in errors:
        if error is None:
            continue
        for name, e in error.channels.items():
            table.add_row(escape(logs), escape(name), *map(escape, error_cells(e)))
        if len(error.channels) > 1:
            whole = error_cell(error.nrmse)
            table.add_row(escape(logs), "all", "", "", whole, "", "", style="bold")
        table.add_section()
    return table

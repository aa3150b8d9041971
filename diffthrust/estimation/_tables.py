"""The rows of a fit's report, as data."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping

from diffthrust._support.report import Line, Rows, Styled
from diffthrust._support.words import number, with_error
from diffthrust.estimation._estimate import Estimate
from diffthrust.simulation._errors import ChannelError, Errors
from diffthrust.soundness._doubt import Doubt


def doubt_lines(doubts: Iterable[Doubt]) -> Iterator[Line]:
    """What to look at before anything else; mostly nothing."""
    for doubt in doubts:
        name = Styled(f"Doubt: {doubt.channel} ({doubt.kind}): ", "doubtful")
        yield Line((name, f"{doubt.evidence}\nMend: {doubt.mend}"))


def noise_rows(disturbance: Mapping[str, Estimate]) -> Rows:
    """What the innovations form estimated of random forces and lasting sensor errors."""
    rows = (
        (name.removeprefix("noise."), number(e.value, 3), e.unit, "at its bound" * e.at_bound)
        for name, e in disturbance.items()
    )
    return Rows.of(("Noise", "Value", "Unit", ""), rows, numbers=(1,))


def parameter_rows(parameters: Mapping[str, Estimate]) -> Rows:
    """One row for each parameter; numbers end at the second digit of their standard error."""
    rows = []
    for name, e in parameters.items():
        if e.fixed:
            remark = "fixed"
        elif e.at_bound:
            remark = "at its bound"
        else:
            remark = "" if e.std_error is not None else "not determined by these logs"
        size, spread, unit = e.shown
        rows.append((name, *with_error(size, spread), unit, remark))
    return Rows.of(("Parameter", "Value", "Std error", "Unit", ""), rows, numbers=(1, 2))


def error_rows(errors: Iterable[tuple[str, Errors | None]]) -> Rows:
    """Errors by log and channel, and over all channels."""
    headings = ("Logs", "Channel", "RMSE", "Unit", "NRMSE", "Fit %", "Samples")
    blocks = tuple(tuple(_channel_rows(logs, e)) for logs, e in errors if e is not None)
    return Rows(headings, blocks, numbers=(2, 4, 5, 6))


def _channel_rows(logs: str, errors: Errors) -> Iterator[tuple[str, ...]]:
    for name, e in errors.channels.items():
        yield logs, name, *_error_cells(e)
    if len(errors.channels) > 1:
        total = (logs, "all", "", "", _error_cell(errors.nrmse), "", "")
        yield tuple(Styled(cell, "strong") for cell in total)


def _error_cells(e: ChannelError) -> tuple[str, str, str, str, str]:
    """RMSE, its unit, NRMSE, fit per cent and samples."""
    # + 0.0 turns -0.0 into 0.0
    percent = f"{round(e.fit_percent, 1) + 0.0:.1f}" if math.isfinite(e.fit_percent) else "-"
    return _error_cell(e.shown.value), e.shown.unit, _error_cell(e.nrmse), percent, str(e.samples)


def _error_cell(value: float) -> str:
    """An error as text; ``-`` where the simulation failed."""
    return number(value) if math.isfinite(value) else "-"

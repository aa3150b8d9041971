"""The tables of a diagnosis: the same rows for the terminal and for the page."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from diffthrust._support.tables import line_text, number, plain_table, with_error
from diffthrust._support.words import percent, spelt
from diffthrust.diagnosis._learned_words import learned_words
from diffthrust.diagnosis._matter_words import leading, share_cells
from diffthrust.diagnosis._skeleton import HOW, skeleton
from diffthrust.diagnosis._words import (
    bound_words,
    caution_words,
    closing_words,
    dropped_words,
    effects_known,
    failure_words,
    first_line,
    group_words,
    missing_words,
    refused_words,
    remaining_words,
    silent_words,
    stage_words,
    summary,
    verdict_words,
)
from diffthrust.estimation._tables import closing_parts

if TYPE_CHECKING:
    from diffthrust.diagnosis._findings import Findings, Stage
    from diffthrust.estimation._result import Fit
    from diffthrust.simulation._errors import Errors

_SHOWN, _LEAST = 6, 1.0
"""Candidates listed of each stage, and the likelihood ratio that they have; the best always."""


@dataclass(frozen=True)
class Rows:
    """A table as text.

    Args:
        headings: one for each column; those in ``numbers`` are set to the right.
        blocks: rows that belong together, each with a cell for every heading.
        numbers: indices of the columns that hold numbers.
    """

    headings: tuple[str, ...]
    blocks: tuple[tuple[tuple[str, ...], ...], ...]
    numbers: tuple[int, ...] = ()

    def __bool__(self) -> bool:
        return any(self.blocks)


def diagnosis_table(diag: Findings) -> RenderableType:
    """Summary, stages, missing signal, ranking, groups, test, what remains, parameters, notes."""
    colour = "green" if diag.verdict == "adequate" else "yellow"
    parts: list[RenderableType] = [
        Text.assemble(("Verdict: ", "bold"), (verdict_words(diag), f"bold {colour}")),
        Text(summary(diag)),
        *_section("Stages", _rich(stage_rows(diag)), dropped_words(diag)),
        *_section(
            "What each effect removes of the squared error over whole runs",
            *([_rich(worth_rows(diag))] if worth_rows(diag) else []),
        ),
        *_section(
            "How much there is to find",
            *([_rich(headroom_rows(diag))] if diag.headroom else []),
            *headroom_words(diag),
        ),
        *_section("Where the model as given fails", *failure_words(diag.before)),
        *_section(
            "Missing signal", *(missing_words(m, diag.model) for m in diag.shown(diag.missing))
        ),
        *_section("Errors by log", _rich(log_rows(diag))),
        *_section(
            "Effects tried",
            *([_rich(ranking_rows(diag))] if diag.ranking else []),
            *refused_words(diag),
            *bound_words(diag),
            silent_words(diag),
        ),
        *_section("What these logs cannot tell apart", *group_words(diag)),
        *_section("Proposed test", *([diag.experiment.sentence] if diag.experiment else [])),
    ]
    if diag.remaining:
        parts += _section(
            "What remains",
            remaining_words(diag),
            *(missing_words(m, diag.model) for m in diag.shown(diag.left[:1])),
            *([] if diag.laws else [HOW, skeleton(diag.fit.model, diag.remaining, diag.missing)]),
        )
    if diag.laws:
        parts += _section("What was learned", *learned_words(diag), *map(_rich, form_rows(diag)))
    for heading, rows in closing_tables(diag):
        parts += _section(heading, _rich(rows))
    notes = (Text(f"Note: {note}") for note in caution_words(diag))
    return Group(*parts, *notes, *closing_parts(closing_words(diag)))


def headroom_rows(diag: Findings) -> Rows:
    """What a flexible correction explains of the model as given and of the last stage."""
    rows = [
        (
            "as given" if k == 0 else "last stage",
            spelt(name),
            f"{c.physics:.3g}",
            f"{c.corrected:.3g}",
            percent(max(c.share, 0.0)),
            f"{percent(max(c.low, 0.0))} to {percent(max(c.high, 0.0))}",
            c.rung,
        )
        for k, room in enumerate((diag.headroom or ())[: len(diag.stages)])
        for name, c in room.channels.items()
    ]
    headings = ("Model", "Channel", "NRMSE", "corrected", "Share", "90 % interval", "Correction")
    return Rows(headings, (tuple(rows),), numbers=(2, 3, 4, 5))


def headroom_words(diag: Findings) -> list[str]:
    """Whether there is something to find, before the search and after it."""
    if diag.headroom is None:
        return []
    first, last = diag.headroom
    said = [first.summary]
    if len(diag.stages) > 1:
        said.append(f"At the last stage: {last.summary}")
    if diag.remaining is not None and not last.worth:
        said.append("From one sample to the next structure remains all the same: see what remains.")
    return said


def worth_rows(diag: Findings) -> Rows:
    """What each effect removes of the squared errors over whole runs."""
    kinds = {
        "matters": leading(diag),
        "detectable, changes nothing": diag.detectable,
        "possible": tuple(diag.possible),
    }
    worth = {**diag.worth, **diag.possible}
    rows = tuple(
        (spelt(name), kind, *share_cells(worth[name]))
        for kind, names in kinds.items()
        for name in names
        if name in worth
    )
    return Rows(("Effect", "", "Removes", "90 % interval"), (rows,), numbers=(2, 3))


def stage_rows(diag: Findings) -> Rows:
    """Errors of each channel at each stage, on the training logs and on unseen ones."""
    return Rows(
        (
            "Stage",
            "Model",
            "Channel",
            "RMSE training",
            "unseen",
            "Unit",
            "NRMSE training",
            "unseen",
        ),
        tuple(
            tuple(_channels(str(i), stage_words(diag, i), stage))
            for i, stage in enumerate(diag.stages)
        ),
        numbers=(3, 4, 6, 7),
    )


def log_rows(diag: Findings) -> Rows:
    """Errors of each log by the model as given and by the last stage, so that a bad run shows."""
    several = len(diag.stages) > 1
    held = [("unseen" if diag.stages[0].holdout else "training", diag.before, diag.after)]
    if diag.trained and diag.stages[0].holdout:
        held.append(("training", *diag.trained))
    blocks = []
    for kind, first, last in held:
        for before, after in zip(first.runs, last.runs, strict=True):
            shown = [before.errors, after.errors] if several else [before.errors]
            rows = [
                (
                    spelt(name),
                    *(number(_rmse(e, name), 3) for e in shown),
                    before.errors.channels[name].shown.unit,
                    *(number(_nrmse(e, name), 2) for e in shown),
                )
                for name in before.errors.channels
            ]
            head = (before.name, kind)
            blocks.append(tuple((*(head if i == 0 else ("", "")), *r) for i, r in enumerate(rows)))
    if several:
        sizes, shares = ("RMSE as given", "last stage"), ("NRMSE as given", "last stage")
    else:
        sizes, shares = ("RMSE",), ("NRMSE",)
    numbers = (3, 4, 6, 7) if several else (3, 5)
    return Rows(("Log", "", "Channel", *sizes, "Unit", *shares), tuple(blocks), numbers)


def ranking_rows(diag: Findings) -> Rows:
    """The best candidates of each stage; the added one is marked."""
    blocks = []
    for stage in sorted({c.stage for c in diag.ranking}):
        tried = [c for c in diag.ranking if c.stage == stage]
        rows = []
        for c in [c for c in tried[:_SHOWN] if c.likelihood_ratio >= _LEAST] or tried[:1]:
            shown = {spelt(name): e.shown for name, e in c.parameters.items()}
            estimates = [f"{name} {number(v, 3)} {u}".rstrip() for name, (v, _, u) in shown.items()]
            rows.append(
                (
                    str(c.stage),
                    spelt(c.effect),
                    f"{c.delta_bic:.1f}",
                    f"{c.likelihood_ratio:.1f}",
                    "<\u00a00.001" if c.p_value < 0.001 else number(c.p_value, 2),
                    number(c.train_nrmse, 3),
                    number(c.holdout_nrmse, 3),
                    ", ".join(estimates),
                )
            )
        more = len(tried) - len(rows)
        if more:
            rows.append((str(stage), f"and {more} more that rank lower", *[""] * 6))
        blocks.append(tuple(rows))
    return Rows(
        (
            *("Stage", "Effect tried", "BIC change", "Likelihood ratio", "p"),
            *("NRMSE training", "unseen", "Estimate"),
        ),
        tuple(blocks),
        numbers=(2, 3, 4, 5, 6),
    )


def stage_parameter_rows(diag: Findings) -> Rows:
    """Each parameter at the first and at the last stage; once where there is one stage."""
    first, last = diag.stages[0].fit, diag.fit
    shown = [first, last] if len(diag.stages) > 1 else [first]
    units = {name: e.shown[2] for fit in shown for name, e in fit.parameters.items()}
    rows = tuple(
        (name, *(cell for fit in shown for cell in _valued(fit, name)), unit)
        for name, unit in units.items()
    )
    values = ("As given", "Std error", "Last stage", "Std error")[: 2 * len(shown)]
    return Rows(("Parameter", *values, "Unit"), (rows,), numbers=tuple(range(1, 1 + len(values))))


def meaning_rows(diag: Findings) -> Rows:
    """What each effect that is named does, in the words of its docstring."""
    known = effects_known(diag)
    named = [*diag.added, *(name for group in diag.groups for name in group)]
    named += [c.effect for c in diag.ranking]
    lines = [(spelt(name), first_line(name, known)) for name in dict.fromkeys(named)]
    return Rows(("Effect", "What it does"), (tuple(row for row in lines if row[1]),))


def form_rows(diag: Findings) -> list[Rows]:
    """The closed forms that were tried in the place of each learned curve, beside it."""
    tables = []
    for law in diag.laws:
        each = [("the curve", law.fit, None), *((f.name, f.fit, f.bic) for f in law.forms)]
        rows = tuple(
            (
                name,
                "" if bic is None else number(bic, 3),
                number(fit.train.nrmse, 2),
                number(fit.holdout.nrmse, 2) if fit.holdout else "",
            )
            for name, fit, bic in each
        )
        tables.append(Rows(("Form", "ΔBIC", "NRMSE", "unseen"), (rows,), numbers=(1, 2, 3)))
    return tables


def untestable_rows(diag: Findings) -> Rows:
    """Effects that the logs cannot test, and why."""
    rows = tuple((spelt(name), reason) for name, reason in diag.untestable.items())
    return Rows(("Effect", "Reason"), (rows,))


CLOSING: tuple[tuple[str, Callable[[Findings], Rows]], ...] = (
    ("Parameters", stage_parameter_rows),
    ("Not testable by these logs", untestable_rows),
)
"""The tables at the end of the report and of the page; a new one is a function and its line."""


def closing_tables(diag: Findings) -> Iterator[tuple[str, Rows]]:
    """Those of them that have rows, with their headings."""
    for heading, rows_of in CLOSING:
        if rows := rows_of(diag):
            yield heading, rows


def check_rows(diag: Findings) -> Rows:
    """How far each stage's fit can be trusted."""
    rows = tuple(
        (str(i), stage_words(diag, i), stage.fit.status.value, stage.fit.message)
        for i, stage in enumerate(diag.stages)
    )
    return Rows(("Stage", "Model", "Status of the fit", ""), (rows,))


def _channels(index: str, words: str, stage: Stage) -> Iterator[tuple[str, ...]]:
    train, unseen = stage.train, stage.holdout
    unit = {n: c.shown.unit for e in (unseen, train) if e for n, c in e.channels.items()}
    names = list({**train.channels, **(unseen.channels if unseen else {})})
    for name in names:
        sizes = [number(_rmse(e, name), 3) for e in (train, unseen)]
        shares = [number(_nrmse(e, name), 2) for e in (train, unseen)]
        yield index, words, spelt(name), *sizes, unit[name], *shares
        index = words = ""
    if len(names) > 1:
        yield (
            "",
            "",
            "all",
            "",
            "",
            "",
            *(number(e.nrmse if e else None, 2) for e in (train, unseen)),
        )


def _rmse(errors: Errors | None, name: str) -> float | None:
    return errors.channels[name].shown.value if errors and name in errors.channels else None


def _nrmse(errors: Errors | None, name: str) -> float | None:
    return errors.channels[name].nrmse if errors and name in errors.channels else None


def _valued(fit: Fit, name: str) -> tuple[str, str]:
    if name not in fit.parameters:
        return "", ""
    e = fit.parameters[name]
    value, error = with_error(*e.shown[:2])
    return value, "fixed" if e.fixed else "at its bound" if e.at_bound else error


def _section(title: str, *things: RenderableType) -> list[RenderableType]:
    """A titled part; nothing where there is nothing to tell."""
    texts = [line_text(thing) if isinstance(thing, str) else thing for thing in things]
    kept = [thing for thing in texts if not isinstance(thing, Text) or thing.plain]
    return [Text(), Text(title, style="bold"), *kept] if kept else []


def _rich(rows: Rows) -> Table:
    table = plain_table(*rows.headings, numbers=rows.numbers)
    for block in rows.blocks:
        for row in block:
            table.add_row(*(escape(cell) for cell in row))
        table.add_section()
    return table

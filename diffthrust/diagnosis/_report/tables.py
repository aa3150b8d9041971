"""The tables of a diagnosis as rows."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from diffthrust._support.report import Rows
from diffthrust._support.words import humanize, joined, number, with_error
from diffthrust.diagnosis._explained_share import Worth, sure_share, surely_removes
from diffthrust.diagnosis._findings import Findings, Stage
from diffthrust.diagnosis._report.error_text import GIVEN, LEFT, WITHOUT, judged_logs, squared_error
from diffthrust.diagnosis._report.text import (
    adding_little,
    candidate_words,
    copied_fit,
    leading,
    stage_words,
)
from diffthrust.estimation._result import Fit
from diffthrust.models._base.effect import catalogue
from diffthrust.simulation._errors import Errors

_LISTED = 6
"""Candidates of each stage in the ranking."""
_LEAST_RATIO = 1.0
"""Candidates below this likelihood ratio are not listed, except the best of a stage."""


def headroom_rows(diag: Findings) -> Rows:
    """What a flexible correction explains of the errors, as given and at the last stage."""
    shown = zip(("as given", "last stage"), (diag.headroom or ())[: len(diag.stages)], strict=False)
    rows = (
        (model, humanize(name), *channel.cells)
        for model, room in shown
        for name, channel in room.channels.items()
    )
    headings = ("Model", "Channel", "NRMSE", "corrected", "Share", "90 % interval", "Correction")
    return Rows.of(headings, rows, numbers=(2, 3, 4, 5))


def worth_rows(diag: Findings) -> Rows:
    """What each effect surely removes of the squared errors over whole runs, and of which."""
    small = adding_little(diag)
    added = [name for name in leading(diag) if name not in small]
    unsure = tuple(n for n in added if n in diag.worth and not surely_removes(diag.worth[n]))
    kinds = {
        "matters": tuple(name for name in added if name not in unsure),
        "perhaps": unsure,  # as the answer says of them
        "adds little": small,
        "detectable, changes nothing": diag.detectable,
        "possible": tuple(diag.possible),
    }
    worth = {**diag.worth, **diag.possible}
    rows = (
        row
        for kind, names in kinds.items()
        for name in names
        if name in worth
        for row in _worth_rows(diag, name, kind, worth[name])
    )
    headings = ("Effect", "", "Removes", "90 % interval", "Of the")
    return Rows.of(headings, rows, numbers=(2, 3))


def _worth_rows(diag: Findings, name: str, kind: str, worth: Worth) -> Iterator[tuple[str, ...]]:
    of = GIVEN if name in diag.added else LEFT
    yield candidate_words(diag, name, humanize), kind, *_sure_cells(diag, worth, of)
    if worth.beside_others:
        yield "", "beside the others", *_sure_cells(diag, worth.beside_others, WITHOUT)


def _sure_cells(diag: Findings, worth: Worth, of: str) -> tuple[str, str, str]:
    sure = sure_share(worth)
    if sure is None:
        return "errs more" if worth.high < 0 else "nothing sure", worth.cells[1], ""
    others = [humanize(name) for name in worth.together]
    whole = f"{squared_error(sure.channel, of)}, {judged_logs(diag, sure.everywhere)}"
    return *sure.worth.cells, whole + f" ({joined(others)} together)" * bool(others)


def stage_rows(diag: Findings) -> Rows:
    """Errors of each channel at each stage, and with what was learned at the end."""
    sizes, shares = ("RMSE training", "unseen"), ("NRMSE training", "unseen")
    heads = ("Stage", "Model", "Channel", *sizes, "Unit", *shares)
    stages = [((str(i), stage_words(diag, i)), stage) for i, stage in enumerate(diag.stages)]
    if diag.laws:
        stages.append((("", "with what was learned"), Stage((), diag.laws[-1].reported)))
    blocks = []
    for head, stage in stages:
        sets = (stage.train, stage.holdout)
        rows = _channel_rows(sets)
        if len(rows) > 1:
            rows.append(("all", "", "", "", *(number(e.nrmse if e else None, 2) for e in sets)))
        blocks.append(_headed(head, rows))
    return Rows(heads, tuple(blocks), numbers=(3, 4, 6, 7))


def _headed(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> tuple[tuple[str, ...], ...]:
    """Rows that belong together: the first one begins with their head, the others with blanks."""
    blank = ("",) * len(head)
    return tuple((*(blank if i else head), *row) for i, row in enumerate(rows))


def _channel_rows(sets: Sequence[Errors | None]) -> list[tuple[str, ...]]:
    """Of each channel the RMSE of each set of errors, its unit in the logs, and the NRMSE."""
    rows = []
    for name in dict.fromkeys(n for e in sets if e for n in e.channels):
        errors = [e.channels.get(name) if e else None for e in sets]
        sizes = [number(e.shown.value if e else None, 3) for e in errors]
        shares = [number(e.nrmse if e else None, 2) for e in errors]
        unit = next(e.shown.unit for e in errors if e)
        rows.append((humanize(name), *sizes, unit, *shares))
    return rows


def other_model_rows(diag: Findings) -> Rows:
    """Other models of the same logs: as they are, with effects of their own, and their worth."""
    rows = (
        (
            humanize(other.name),
            joined(humanize(effect.name) for effect in fit.model.effects),
            *(number(errors.nrmse if errors else None, 2) for errors in (fit.train, fit.holdout)),
            *(other.worth.cells if fit is other.best else ("", "")),
        )
        for other in diag.other_models
        for fit in (other.plain, other.extended)
        if fit is not None
    )
    removes = "Removes of what is left"
    headings = ("Model", "with", "NRMSE training", "unseen", removes, "90 % interval")
    return Rows.of(headings, rows, numbers=(2, 3, 4, 5))


def log_rows(diag: Findings) -> Rows:
    """Errors of each log by the model as given and by the last stage, so that a bad run shows."""
    several = len(diag.stages) > 1
    compared = [("unseen" if diag.stages[0].holdout else "training", diag.before, diag.after)]
    if diag.trained and diag.stages[0].holdout:
        compared.append(("training", *diag.trained))
    blocks = [
        _headed((run.name, kind), _channel_rows([run.errors, updated.errors][: 1 + several]))
        for kind, first, last in compared
        for run, updated in zip(first.runs, last.runs, strict=True)
    ]
    first, *later = ("{} as given", "last stage") if several else ("{}",)
    sizes, shares = (first.format("RMSE"), *later), (first.format("NRMSE"), *later)
    numbers = (3, 4, 6, 7) if several else (3, 5)
    return Rows(("Log", "", "Channel", *sizes, "Unit", *shares), tuple(blocks), numbers)


def ranking_rows(diag: Findings) -> Rows:
    """The best candidates of each stage; the added one is marked."""
    blocks = []
    for stage in sorted({c.stage for c in diag.ranking}):
        tried = [c for c in diag.ranking if c.stage == stage]
        rows = []
        for c in [c for c in tried[:_LISTED] if c.likelihood_ratio >= _LEAST_RATIO] or tried[:1]:
            shown = {humanize(name): e.shown for name, e in c.parameters.items()}
            estimates = [f"{name} {number(v, 3)} {u}".rstrip() for name, (v, _, u) in shown.items()]
            likely = "<\u00a00.001" if c.p_value < 0.001 else number(c.p_value, 2)
            gains = (f"{c.delta_bic:.1f}", f"{c.likelihood_ratio:.1f}", likely)
            sizes = (number(c.train_nrmse, 3), number(c.holdout_nrmse, 3))
            rows.append((str(stage), humanize(c.effect), *gains, *sizes, ", ".join(estimates)))
        more = len(tried) - len(rows)
        if more:
            rows.append((str(stage), f"and {more} more that rank lower", *[""] * 6))
        blocks.append(tuple(rows))
    headings = ("Stage", "Effect tried", "BIC change", "Likelihood ratio", "p", "NRMSE training",
                "unseen", "Estimate")  # fmt: skip
    return Rows(headings, tuple(blocks), numbers=(2, 3, 4, 5, 6))


def stage_parameter_rows(diag: Findings) -> Rows:
    """Each parameter as given and at the last stage, or with what was learned: as it is copied."""
    first = diag.stages[0].fit
    last = copied_fit(diag)
    shown = [first] if last is first else [first, last]
    units = {name: e.shown[2] for fit in shown for name, e in fit.parameters.items()}
    rows = (
        (name, *(cell for fit in shown for cell in _valued(fit, name)), unit)
        for name, unit in units.items()
    )
    end = "With what was learned" if diag.laws else "Last stage"
    values = ("As given", "Std error", end, "Std error")[: 2 * len(shown)]
    return Rows.of(("Parameter", *values, "Unit"), rows, numbers=range(1, 1 + len(values)))


def meaning_rows(diag: Findings) -> Rows:
    """What each effect that is named does, in the words of its docstring."""
    effects = {**catalogue(), **{e.name: e for e in (*diag.model.effects, *diag.best)}}
    named = [*diag.added, *(name for group in diag.groups for name in group)]
    named += [c.effect for c in diag.ranking]
    docs = {name: effects[name].__doc__ for name in named if name in effects}
    rows = ((humanize(name), doc.strip().splitlines()[0]) for name, doc in docs.items() if doc)
    return Rows.of(("Effect", "What it does"), rows)


def form_rows(diag: Findings) -> list[Rows]:
    """The closed forms that were tried in the place of each learned curve, beside it."""
    tables = []
    for law in diag.laws:
        tried = [
            ("the curve", law.fit, ""),
            *((f.title, f.fit, number(f.bic, 3)) for f in law.forms),
        ]
        rows = (
            (name, bic, *(number(e.nrmse, 2) if e else "" for e in (fit.train, fit.holdout)))
            for name, fit, bic in tried
        )
        tables.append(Rows.of(("Form", "ΔBIC", "NRMSE", "unseen"), rows, numbers=(1, 2, 3)))
    return tables


def untestable_rows(diag: Findings) -> Rows:
    """Effects that the logs cannot test, and why."""
    # once for all thrusters of a craft
    reasons = {(n.rpartition(".")[2], reason): None for n, reason in diag.untestable.items()}
    rows = ((humanize(name), reason) for name, reason in reasons)
    return Rows.of(("Effect", "Reason"), rows)


def check_rows(diag: Findings) -> Rows:
    """How far each stage's fit can be trusted."""
    rows = (
        (str(i), stage_words(diag, i), stage.fit.status.value, stage.fit.message)
        for i, stage in enumerate(diag.stages)
    )
    return Rows.of(("Stage", "Model", "Status of the fit", ""), rows)


def _valued(fit: Fit, name: str) -> tuple[str, str]:
    if name not in fit.parameters:
        return "", ""
    e = fit.parameters[name]
    value, error = with_error(*e.shown[:2])
    return value, "fixed" if e.fixed else "at its bound" if e.at_bound else error

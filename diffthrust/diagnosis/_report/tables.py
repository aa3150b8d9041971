"""The tables of a diagnosis as rows."""

from __future__ import annotations

from collections.abc import Iterator

from diffthrust._support.report import Rows
from diffthrust._support.words import humanize, number, percent, with_error
from diffthrust.diagnosis._findings import Findings, Stage
from diffthrust.diagnosis._report.learned import share_cells
from diffthrust.diagnosis._report.remarks import effects_by_name, first_line
from diffthrust.diagnosis._report.text import leading, stage_words
from diffthrust.estimation._result import Fit
from diffthrust.simulation._errors import Errors

_LISTED = 6
"""Candidates of each stage in the ranking."""
_LEAST_RATIO = 1.0
"""Candidates below this likelihood ratio are not listed, except the best of a stage."""


def headroom_rows(diag: Findings) -> Rows:
    """What a flexible correction explains of the errors, as given and at the last stage."""
    rows = [
        (
            "as given" if k == 0 else "last stage",
            humanize(name),
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


def worth_rows(diag: Findings) -> Rows:
    """What each effect removes of the squared errors over whole runs."""
    kinds = {
        "matters": leading(diag),
        "detectable, changes nothing": diag.detectable,
        "possible": tuple(diag.possible),
    }
    worth = {**diag.worth, **diag.possible}
    rows = tuple(
        (humanize(name), kind, *share_cells(worth[name]))
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
    sets = [("unseen" if diag.stages[0].holdout else "training", diag.before, diag.after)]
    if diag.trained and diag.stages[0].holdout:
        sets.append(("training", *diag.trained))
    blocks = []
    for kind, first, last in sets:
        for baseline, updated in zip(first.runs, last.runs, strict=True):
            shown = [baseline.errors, updated.errors] if several else [baseline.errors]
            rows = [
                (
                    humanize(name),
                    *(number(_rmse(e, name), 3) for e in shown),
                    baseline.errors.channels[name].shown.unit,
                    *(number(_nrmse(e, name), 2) for e in shown),
                )
                for name in baseline.errors.channels
            ]
            head = (baseline.name, kind)
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
        for c in [c for c in tried[:_LISTED] if c.likelihood_ratio >= _LEAST_RATIO] or tried[:1]:
            shown = {humanize(name): e.shown for name, e in c.parameters.items()}
            estimates = [f"{name} {number(v, 3)} {u}".rstrip() for name, (v, _, u) in shown.items()]
            rows.append(
                (
                    str(c.stage),
                    humanize(c.effect),
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
    effects = effects_by_name(diag)
    named = [*diag.added, *(name for group in diag.groups for name in group)]
    named += [c.effect for c in diag.ranking]
    lines = [(humanize(name), first_line(name, effects)) for name in dict.fromkeys(named)]
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
    rows = tuple((humanize(name), reason) for name, reason in diag.untestable.items())
    return Rows(("Effect", "Reason"), (rows,))


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
        yield index, words, humanize(name), *sizes, unit[name], *shares
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

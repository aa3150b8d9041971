"""A campaign as text for people."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.console import Group, RenderableType
from rich.markup import escape
from rich.text import Text

from diffthrust._support.tables import number, plain_table
from diffthrust.many._campaign.store import Row

if TYPE_CHECKING:
    from diffthrust.many._campaign.campaign import Campaign

SHOWN = 40
"""Rows of results to print; the file has all."""


def summary(done: Campaign) -> str:
    """The outcome in a sentence or two."""
    what = "1 spec" if len(done.rows) == 1 else f"{len(done.rows)} specs"
    parts = [f"{what} in {done.seconds:.0f} s: {done.counts.get('ok', 0)} done"]
    if done.kept:
        parts[0] += f" ({done.kept} of them before)"
    parts += [f"{n} {how.replace('_', ' ')}" for how, n in done.counts.items() if how != "ok"]
    told = f"{', '.join(parts)}."
    return told if done.ok else f"{told} The same campaign again tries those without a result."


def campaign_table(done: Campaign) -> RenderableType:
    """The results, then each error with its mend, and a summary."""
    good = [row for row in done.rows if row["status"] == "ok"]
    bad = [row for row in done.rows if row["status"] != "ok"]
    parts: list[RenderableType] = [_results(good, done.task)] if good else []
    if len(good) > SHOWN:
        parts.append(Text(f"... and {len(good) - SHOWN} more in the table."))
    for row in bad:
        how = row["status"].replace("_", " ")
        parts.append(Text.assemble((f"{row['name']}: {how}", "bold red"), f". {row['error']}"))
        parts.append(Text(f"  Mend: {row['mend']}"))
    return Group(*parts, Text(), Text(summary(done), style="bold"))


def _results(rows: list[Row], task: str) -> RenderableType:
    last = {"diagnose": ("Verdict", "Added"), "sample": ("Chains",)}.get(task, ())
    table = plain_table(
        "Spec", "Fit", "Training NRMSE", "Unseen NRMSE", "Seconds", *last, numbers=(2, 3, 4)
    )
    for row in rows[:SHOWN]:
        told = [row["verdict"], row["added"]] if task == "diagnose" else [row.get("verdict")]
        table.add_row(
            escape(row["name"]),
            row["fit_status"],
            number(row["train_nrmse"]),
            number(row["holdout_nrmse"]),
            f"{row['seconds']:.1f}",
            *(escape(word or "") for word in told[: len(last)]),
        )
    return table

"""The outcome of a check, for each stored fit."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from diffthrust._support.report import Report, Section
from diffthrust._support.results import Brief, Result
from diffthrust.checks._expected import CheckRow
from diffthrust.checks._tables import by_size, counts, moved_rows, remarks


@dataclass(frozen=True, repr=False)
class FitRun(Brief):
    """A rerun of one fit."""

    fit: str  # its name: the path of its folder, relative to the folder of all fits
    file: Path  # its spec
    rows: tuple[CheckRow, ...]  # one for each quantity
    updated: bool = False  # its [expected] block was rewritten
    seconds: float = 0.0
    warnings: tuple[str, ...] = ()
    since: str = ""
    """For a failure, which of data, spec and library changed since it was stored; where all
    agrees, data that changed all the same."""

    @property
    def ok(self) -> bool:
        """Whether every row agrees."""
        return all(row.ok for row in self.rows)

    def to_json(self) -> dict[str, Any]:
        """The run without its rows as plain data."""
        kept = {name: getattr(self, name) for name in ("ok", "updated", "seconds", "since")}
        return {"fit": self.fit, "file": str(self.file), **kept}


def not_run(
    fit: str, file: Path, problem: str | None, mend: str, what: str = "cannot be run"
) -> FitRun:
    """A fit that could not be run or compared, with the reason: one failed row."""
    return FitRun(fit, file, (CheckRow(fit, what, None, problem, None, False, mend),))


@dataclass(frozen=True, repr=False)
class Checked(Result):
    """The outcome of a check.

    Args:
        runs: one for each fit, in the order of their names.

    Example:
        >>> checked = dft.checks.check(".", update=True)
        >>> checked.ok, len(checked.fits), len(checked.updated)
        (True, 1, 1)
        >>> len(checked.rows), list(checked.to_json())
        (6, ['schema', 'ok', 'updated', 'rows', 'fits'])
    """

    runs: tuple[FitRun, ...]

    @property
    def rows(self) -> tuple[CheckRow, ...]:
        """One for each quantity of each fit."""
        return tuple(row for run in self.runs for row in run.rows)

    @property
    def ok(self) -> bool:
        """Whether every row agrees."""
        return all(run.ok for run in self.runs)

    def _line(self) -> str:
        return f"{len(self.runs)} fits, {sum(not run.ok for run in self.runs)} failed"

    def _report(self) -> Report:
        return check_report(self)

    @property
    def fits(self) -> tuple[str, ...]:
        """Names of the fits, in order."""
        return tuple(run.fit for run in self.runs)

    @property
    def updated(self) -> tuple[str, ...]:
        """Names of the fits whose [expected] block was rewritten."""
        return tuple(run.fit for run in self.runs if run.updated)

    def to_json(self) -> dict[str, Any]:
        """The rows as plain data."""
        return {
            "schema": 1,
            "ok": self.ok,
            "updated": list(self.updated),
            "rows": [row.to_json() for row in self.rows],
            "fits": [run.to_json() for run in self.runs],
        }


def check_report(checked: Checked, everything: bool = False) -> Report:
    """The quantities that moved, the largest move first, their mends, and a summary.

    With ``everything`` all quantities, in the order of the fits.
    """
    # By size, not by fit: one cause often moves many quantities, and the largest move shows it
    # best.
    rows = checked.rows if everything else by_size(row for row in checked.rows if not row.ok)
    rows = [row.shown for row in rows]
    passed = {run.fit: run.ok for run in checked.runs}
    changed = (f"{run.fit}: {run.since}" for run in checked.runs if run.since)
    table = moved_rows(rows, by_fit=everything)
    return Report(Section("", table, *remarks(rows), *changed, *counts(passed, checked.updated)))

"""Checks of stored fits whose outcomes are made by hand: fits that move so take minutes to make."""

from __future__ import annotations

from pathlib import Path

from diffthrust.checks import Checked
from diffthrust.checks._expected import CheckRow  # private: only a check makes rows
from diffthrust.checks._junit import write_junit  # private: a check writes it of its own fits
from diffthrust.checks._result import FitRun, not_run  # private: only a check makes runs

__all__ = ["CheckRow", "FitRun", "not_run", "outcome", "write_junit"]


def outcome(*rows: CheckRow, updated: bool = False) -> Checked:
    """A check with these rows, of which those with one name are of one fit."""
    names = dict.fromkeys(row.fit for row in rows)
    return Checked(
        tuple(
            FitRun(name, Path("fits", name), tuple(row for row in rows if row.fit == name), updated)
            for name in names
        )
    )

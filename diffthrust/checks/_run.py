"""One stored fit run again, and what became of it."""

from __future__ import annotations

import os
import time
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from diffthrust._support.errors import InputError
from diffthrust._support.files import write_whole
from diffthrust.checks._expected import Row, compared, updated
from diffthrust.specs._spec import load_spec


@dataclass(frozen=True)
class Run:
    """One fit, run again.

    Args:
        fit: its name, the path of its folder as seen from the folder of all fits.
        file: its spec file.
        rows: one for each quantity.
        updated: its [expected] block was written anew.
        seconds: how long it took.
        warnings: what the fit warned of.
    """

    fit: str
    file: Path
    rows: tuple[Row, ...]
    updated: bool = False
    seconds: float = 0.0
    warnings: tuple[str, ...] = ()

    @property
    def ok(self) -> bool:
        """Whether every row agrees."""
        return all(row.ok for row in self.rows)

    def to_json(self) -> dict[str, Any]:
        """The run without its rows as plain data."""
        return {
            "fit": self.fit,
            "file": str(self.file),
            "ok": self.ok,
            "updated": self.updated,
            "seconds": self.seconds,
        }


def not_run(fit: str, problem: str, mend: str) -> Row:
    """The only row of a fit that could not be run: it failed, and says why."""
    return Row(fit, "cannot be run", None, problem, None, False, mend)


def run_again(fit: str, file: Path, update: bool) -> Run:
    """Run a stored fit and hold it against its [expected] block, or bring the block up to it.

    Args:
        fit: its name.
        file: its spec file.
        update: write the block, where the fit moved or has none.

    Returns:
        What became of it; a fit that cannot be run, or that expects nothing, is a row that failed.
    """
    from diffthrust.simulation._step_size import CoarseStepWarning

    begin, new = time.perf_counter(), False
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", CoarseStepWarning)
        try:
            rows, new = _rows(fit, file, update)
        except InputError as error:
            rows = [not_run(fit, error.problem, error.mend)]
        except Exception as error:  # one defect must not hide what became of the other fits
            if os.environ.get("DIFFTHRUST_DEBUG"):
                raise
            problem = f"a defect of diffthrust, not of your input: {type(error).__name__}: {error}"
            mend = f"Please report it, with what DIFFTHRUST_DEBUG=1 diffthrust fit {file} prints."
            rows = [not_run(fit, problem, mend)]
    told = tuple(str(w.message) for w in caught if issubclass(w.category, CoarseStepWarning))
    return Run(fit, file, tuple(rows), new, time.perf_counter() - begin, told)


def _rows(name: str, path: Path, update: bool) -> tuple[list[Row], bool]:
    spec = load_spec(path)
    expected = spec.file.expected
    if expected is None and not update:
        mend = "Look at it with diffthrust fit, then write the block: diffthrust check --update."
        return [Row(name, "no [expected] block", None, None, None, False, mend)], False
    fit = spec.fit()
    if update:
        text = updated(spec.text, path, expected, fit)
        if text != spec.text:
            write_whole(path, text.encode("utf-8"))
            expected = load_spec(path).file.expected
            assert expected is not None
            return list(compared(name, expected, fit)), True
    assert expected is not None
    rows = list(compared(name, expected, fit))
    if not rows:
        mend = "Remove the empty [expected] block and run diffthrust check --update."
        rows = [Row(name, "empty [expected] block", None, None, None, False, mend)]
    return rows, False

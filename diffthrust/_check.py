"""Regression fits: every stored fit is run again and held against what it gave before."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from diffthrust._errors import InputError
from diffthrust._expected import Row, compared, updated
from diffthrust._files import write_whole
from diffthrust._spec import load_spec
from diffthrust._spec_file import NAME


@dataclass(frozen=True)
class Checked:
    """The outcome of a check.

    Args:
        rows: one for each quantity of each fit.
        updated: names of the fits whose [expected] block was written anew.
    """

    rows: tuple[Row, ...]
    updated: tuple[str, ...] = ()

    @property
    def ok(self) -> bool:
        """Whether every row agrees."""
        return all(row.ok for row in self.rows)

    @property
    def fits(self) -> tuple[str, ...]:
        """Names of the fits, in order."""
        return tuple(dict.fromkeys(row.fit for row in self.rows))

    def to_json(self) -> dict[str, Any]:
        """The rows as plain data."""
        return {
            "schema": 1,
            "ok": self.ok,
            "updated": list(self.updated),
            "rows": [dict(vars(row)) for row in self.rows],
        }


def check(
    directory: Path | str,
    update: bool = False,
    progress: Callable[[str, float], None] | None = None,
) -> Checked:
    """Run every ``<directory>/<name>/fit.toml`` and compare with its [expected] block.

    Args:
        directory: a folder of fits, or the folder of one fit.
        update: write the [expected] blocks of fits that moved, or that have none.
        progress: called with a message and the share done.

    Returns:
        A row for each quantity. A fit that cannot be run, or that expects nothing, is a row that
        failed, so that the other fits are still checked.

    Raises:
        InputError: there are no fits.

    Example:
        >>> check("fits").ok
        True
    """
    directory = Path(directory)
    if (directory / NAME).is_file():
        specs = [directory / NAME]
    else:
        specs = sorted(directory.glob(f"*/{NAME}"))
    if not specs:
        found = "no such folder" if not directory.is_dir() else "none"
        raise InputError(
            f"{directory}: expected fits as {directory / 'NAME' / NAME}, found {found}.",
            "Name the folder that holds the folders of the fits.",
        )
    rows: list[Row] = []
    written: list[str] = []
    for i, path in enumerate(specs):
        name = path.resolve().parent.name
        if progress:
            progress(name, i / len(specs))
        try:
            found, new = _one(name, path, update)
        except InputError as error:
            rows.append(Row(name, "cannot be run", None, error.problem, None, False, error.mend))
            continue
        rows += found
        written += [name] if new else []
    return Checked(tuple(rows), tuple(written))


def _one(name: str, path: Path, update: bool) -> tuple[list[Row], bool]:
    spec = load_spec(path)
    expected = spec.file.expected
    if expected is None and not update:
        mend = f"Look at the fit with diffthrust fit {path}, then run diffthrust check --update."
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

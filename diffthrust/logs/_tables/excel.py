"""Read columns of Excel's .xlsx files."""

from __future__ import annotations

import warnings
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np

from diffthrust._support.errors import InputError, Place
from diffthrust._support.extras import extra
from diffthrust._support.names import listing, nearest
from diffthrust.logs._tables.frame import object_cells, text_of
from diffthrust.logs._tables.placement import SEARCHED, Placement, locate, skipped_notes
from diffthrust.logs._tables.table import Cells, OpenTable
from diffthrust.logs._untrusted import MemoryBudget, reading

_Row = Sequence[Any]


def read_excel(path: Path, wanted: Collection[str], sheet: str | None = None) -> OpenTable:
    """Open a sheet of an Excel file; without a name the one that has the wanted columns.

    Rows above the header and a row of units below it are skipped and noted.
    """
    sheets = _sheets(path)
    if sheet is not None and sheet not in sheets:
        raise InputError(
            f"{path.name}: expected a sheet {sheet!r}, found {listing(sheets)}.",
            f"name a sheet of this file{nearest(sheet, sheets, '; ')}.",
        )
    tops = {
        name: [["" if cell is None else text_of(cell).strip() for cell in row] for row in top]
        for name, top in ((name, rows[:SEARCHED]) for name, rows in sheets.items())
    }
    placements = {name: at for name, top in tops.items() if (at := locate(top, wanted))}
    chosen = sheet or _chosen(path, placements, set(wanted))
    if chosen not in placements:
        raise InputError(
            f"{path.name}, sheet {chosen!r}: expected a header and samples, found an empty sheet.",
            f"name another sheet; there are {listing(sheets)}.",
        )
    placement, rows = placements[chosen], sheets[chosen]
    notes = skipped_notes(placement, tops[chosen], range(1, len(rows) + 1), "row")
    other_sheets = [name for name in placements if name != chosen]
    if other_sheets and sheet is None:
        notes.append(f"sheet {chosen!r} was read; there are also {listing(other_sheets, 5)}.")
    body = rows[placement.first :]

    def read(names: Sequence[str], missing: Collection[str]) -> Mapping[str, Cells]:
        if not body:
            raise InputError(
                f"{path.name}, sheet {chosen!r}: expected samples below the header in row "
                f"{placement.header + 1}, found none.",
                "check that the recording was saved.",
            )
        return {name: _column(path, chosen, placement, body, name) for name in names}

    return OpenTable(
        f"{path.name}, sheet {chosen!r}",
        f"Excel sheet {chosen!r}",
        placement.names,
        read,
        np.arange(placement.first, len(rows)) + 1,
        units=placement.units,
        notes=notes,
        sheet=chosen if other_sheets else "",
    )


def _sheets(path: Path, results: bool = True) -> dict[str, list[_Row]]:
    """The rows of each sheet; formulas as their results, or as text."""
    with extra("excel", f"{path.name}: reading a spreadsheet"):
        from openpyxl import load_workbook

    budget = MemoryBudget(path)
    sheets: dict[str, list[_Row]] = {}
    with reading(path, "spreadsheet (.xlsx)"), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # openpyxl warns about drawings that it skips
        with ZipFile(path) as archive:
            # The directory of the zip states the unpacked sizes: the bomb is refused before it is
            # unpacked.
            budget.take(sum(member.file_size for member in archive.infolist()))
        with path.open("rb") as stream:  # given a path, openpyxl insists on its own suffixes
            for sheet in load_workbook(stream, read_only=True, data_only=results).worksheets:
                rows = sheets[sheet.title] = []
                # Rows are padded to the widest: a single stray cell makes all of them wide.
                for row in sheet.iter_rows(values_only=True):
                    budget.take(8 * len(row))
                    rows.append(row)
    return sheets


def _chosen(path: Path, placements: Mapping[str, Placement], wanted: set[str]) -> str:
    if not placements:
        raise InputError(
            f"{path.name}: expected a header and samples, found empty sheets.",
            "check that the recording was saved.",
        )
    having = [name for name, placement in placements.items() if wanted <= set(placement.names)]
    if wanted and len(having) > 1:
        raise InputError(
            f"{path.name}: several sheets have the wanted columns: {listing(having)}.",
            f"name one: sheet = {having[0]!r}.",
        )
    return max(having or placements, key=lambda name: placements[name].measure[1:])


def _column(path: Path, sheet: str, placement: Placement, body: Sequence[_Row], name: str) -> Cells:
    index = placement.names.index(name)
    cells: list[Any] = [row[index] if index < len(row) else None for row in body]
    cells = [None if isinstance(cell, str) and not cell.strip() else cell for cell in cells]
    # A program that writes formulas without computing them (openpyxl) leaves their results empty,
    # and the column would look as if nothing was recorded.
    if all(cell is None for cell in cells) and _is_formula(path, sheet, placement, index):
        raise InputError.at(
            Place(f"{path.name}, sheet {sheet!r}, column {name!r}", name),
            "expected numbers, found formulas whose results are not in the file.",
            "open the file in a spreadsheet and save it, which writes the results.",
        )
    return object_cells(cells)


def _is_formula(path: Path, sheet: str, placement: Placement, index: int) -> bool:
    body = _sheets(path, results=False)[sheet][placement.first :]
    return any(index < len(row) and str(row[index]).startswith("=") for row in body)

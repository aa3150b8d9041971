"""Open files with tables, by format."""

from collections.abc import Collection
from pathlib import Path

from diffthrust._support.errors import InputError
from diffthrust.logs._kinds import EXCEL, HDF5, MAT, PARQUET, Kind
from diffthrust.logs._tables.csv import read_csv
from diffthrust.logs._tables.excel import read_excel
from diffthrust.logs._tables.frame import read_parquet
from diffthrust.logs._tables.mat import read_hdf5, read_mat
from diffthrust.logs._tables.table import OpenTable

_READERS = {PARQUET: read_parquet, HDF5: read_hdf5, MAT: read_mat}


def open_table(
    path: Path, kind: Kind, wanted: Collection[str], sheet: str | None = None, strict: bool = True
) -> OpenTable:
    """Open a file with a table, whose header has the wanted names.

    If not ``strict``, rows that do not fit the header are cut or padded instead of refused.
    """
    if sheet is not None and kind is not EXCEL:
        raise InputError(
            f"{path.name}: a sheet is named, expected an Excel file, found {kind.article}.",
            "leave the sheet out.",
        )
    try:
        if kind is EXCEL:
            return read_excel(path, wanted, sheet)
        if kind in _READERS:
            return _READERS[kind](path)
        return read_csv(path, wanted, strict)
    except OSError as error:
        raise InputError(
            f"{path}: the file cannot be opened ({error}).", "check its name and permissions."
        ) from None

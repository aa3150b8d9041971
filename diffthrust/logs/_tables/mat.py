"""Vectors of numbers out of MATLAB files."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError, Place
from diffthrust.logs._tables.mat5 import parse
from diffthrust.logs._tables.table import Table, absent_column, damaged, twice


def read_mat(path: Path, wanted: Sequence[str]) -> Table:
    """Read the wanted vectors of a MATLAB file (up to version 7); structs are reached as ``a.b``.

    Args:
        path: the file.
        wanted: names of the variables.

    Returns:
        The table.

    Raises:
        InputError: the file is damaged or of version 7.3, or a variable is absent, not a vector
            of numbers, or of another length than the others.
    """
    data = path.read_bytes()
    if b"MATLAB 7.3" in data[:128] or data[:4] == b"\x89HDF" or data[512:516] == b"\x89HDF":
        raise InputError(
            f"{path.name}: expected a MATLAB file up to version 7, found version 7.3 (HDF5).",
            "save it again in MATLAB with save(..., '-v7').",
        )
    try:
        leaves = _leaves(parse(data))
    except (ValueError, OverflowError, MemoryError) as error:
        raise damaged(path, "MATLAB", error) from None
    names = [name for name, _ in leaves]
    columns: dict[str, np.ndarray] = {}
    for name in wanted:
        if name not in names:
            raise absent_column(path.name, name, names, "variable")
        if names.count(name) > 1:
            raise twice(path.name, name, "variable")
        place = Place(f"{path.name}, variable {name!r}", name)
        columns[name] = _vector(leaves[names.index(name)][1], place)
        size = columns[wanted[0]].size
        if columns[name].size != size:
            raise InputError.at(
                place,
                f"expected {size} samples as in {wanted[0]!r}, found {columns[name].size}.",
                "save vectors of equal length.",
            )
    rows = np.arange(1, columns[wanted[0]].size + 1)
    return Table(path.name, columns, rows, row_word="element", column_word="variable")


def _vector(value: Any, place: Place) -> np.ndarray:
    if isinstance(value, np.ndarray) and value.size and value.size == max(value.shape):
        # An unsigned or single-precision vector is as good as a double one.
        return value.reshape(-1).astype(np.float64)
    found = value if isinstance(value, str) else f"an array of shape {value.shape}"
    raise InputError.at(
        place,
        f"expected a vector of real numbers, found {found}.",
        "save each channel as a numeric vector of its own; a timetable must be split.",
    )


def _leaves(variables: Sequence[tuple[str, Any]], prefix: str = "") -> list[tuple[str, Any]]:
    """List what is not a struct, with the path that leads to it."""
    leaves: list[tuple[str, Any]] = []
    for name, value in variables:
        if isinstance(value, dict):
            leaves += _leaves(list(value.items()), f"{prefix}{name}.")
        else:
            leaves.append((prefix + name, value))
    return leaves

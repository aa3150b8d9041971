"""Vectors of numbers out of MATLAB files, and out of HDF5 files of any origin."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from diffthrust.logs._tables.mat5 import parse
from diffthrust.logs._tables.source import Cells, OpenTable, Other
from diffthrust.logs._tables.table import damaged

_WIDEST = 64
"""A matrix of more columns than this is no set of channels."""


def read_mat(path: Path) -> OpenTable:
    """Open a MATLAB file up to version 7; structs are reached as ``a.b``.

    Raises:
        InputError: the file is damaged.
    """
    try:
        leaves = _leaves(parse(path.read_bytes()))
    except (ValueError, OverflowError, MemoryError) as error:
        raise damaged(path, "MATLAB", error) from None
    return vectors(path, "MATLAB file", leaves)


def vectors(path: Path, kind: str, leaves: Sequence[tuple[str, Any]]) -> OpenTable:
    """A table of the vectors among some variables.

    Args:
        path: the file.
        kind: what it is, for people.
        leaves: names and variables, each an array or words that say what else it is. Columns of a
            matrix are named as MATLAB writes them, ``data(:,2)``.
    """
    columns: list[tuple[str, Callable[[], Cells]]] = []
    for name, value in leaves:
        columns.append((name, partial(_vector, value)))
        if isinstance(value, np.ndarray) and value.ndim == 2 and 1 < min(value.shape) <= _WIDEST:
            tall = value.shape[0] >= value.shape[1]
            for k, part in enumerate(value.T if tall else value):
                own = f"{name}(:,{k + 1})" if tall else f"{name}({k + 1},:)"
                columns.append((own, partial(_vector, part)))
    found = dict(reversed(columns))

    def read(wanted: Sequence[str], missing: Collection[str]) -> Mapping[str, Cells]:
        return {name: found[name]() for name in wanted}

    return OpenTable(
        path.name,
        kind,
        [name for name, _ in columns],
        read,
        row_word="element",
        column_word="variable",
        other="save each channel as a numeric vector, or as a column of a matrix; a timetable must "
        "be split.",
    )


def _vector(value: Any) -> Cells:
    if isinstance(value, str):
        return Other(value)
    if not value.size or value.size != max(value.shape):
        return Other(f"an array of shape {value.shape}")
    # An unsigned or single-precision vector is as good as a double one.
    return value.reshape(-1).astype(np.float64)


def _leaves(variables: Sequence[tuple[str, Any]], prefix: str = "") -> list[tuple[str, Any]]:
    """List what is not a struct, with the path that leads to it."""
    leaves: list[tuple[str, Any]] = []
    for name, value in variables:
        if isinstance(value, dict):
            leaves += _leaves(list(value.items()), f"{prefix}{name}.")
        else:
            leaves.append((prefix + name, value))
    return leaves

"""Vectors of numbers from MATLAB files, and from HDF5 files of any origin."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust.logs._largest import MemoryBudget
from diffthrust.logs._tables.mat5 import parse
from diffthrust.logs._tables.source import Cells, OpenTable, Other
from diffthrust.logs._tables.table import damaged

_WIDEST = 64
"""A matrix with more columns than this is not a set of channels."""


@dataclass(frozen=True, eq=False)
class Unread:
    """An array in a file that is not read yet.

    Args:
        shape: of the array.
        load: reads the array.
        size: bytes of the loaded array.
    """

    shape: tuple[int, ...]
    load: Callable[[], np.ndarray]
    size: int

    @property
    def is_vector(self) -> bool:
        """Whether all numbers lie along one axis."""
        return 0 < math.prod(self.shape) == max(self.shape, default=0)

    @property
    def channels(self) -> int:
        """Number of vectors of a matrix, along its shorter side; 0 if it is not a matrix."""
        narrow = min(self.shape) if len(self.shape) == 2 else 0
        return narrow if 1 < narrow <= _WIDEST else 0


def read_mat(path: Path) -> OpenTable:
    """Open a MATLAB file up to version 7; structs are reached as ``a.b``."""
    budget = MemoryBudget(path)
    budget.take(path.stat().st_size)
    try:
        leaves = _leaves(parse(path.read_bytes(), budget))
    except InputError:
        raise
    except (ValueError, OverflowError, MemoryError) as error:
        raise damaged(path, "MATLAB", error) from None
    return vectors(path, "MATLAB file", leaves)


def vectors(path: Path, kind: str, leaves: Sequence[tuple[str, Unread | str]]) -> OpenTable:
    """A table of those variables that are vectors, or columns of a matrix: ``data(:,2)``.

    What is not an array comes as a description.
    """
    columns: list[tuple[str, Unread | str, int | None]] = []
    for name, value in leaves:
        columns.append((name, value, None))
        if isinstance(value, Unread):
            tall = value.shape[0] >= value.shape[-1] if value.shape else False
            for k in range(value.channels):
                label = f"{name}(:,{k + 1})" if tall else f"{name}({k + 1},:)"
                columns.append((label, value, k))
    # Reversed: of equal names the first one counts, as in the other formats.
    by_name = {name: (value, k) for name, value, k in reversed(columns)}

    def read(wanted: Sequence[str], missing: Collection[str]) -> Mapping[str, Cells]:
        needed: dict[int, Unread] = {}
        for value, k in (by_name[name] for name in wanted):
            if isinstance(value, Unread) and (k is not None or value.is_vector):
                needed[id(value)] = value
        budget = MemoryBudget(path)
        for value in needed.values():
            budget.take(value.size)
        loaded = {key: value.load() for key, value in needed.items()}
        return {name: _cells(*by_name[name], loaded) for name in wanted}

    return OpenTable(
        path.name,
        kind,
        [name for name, *_ in columns],
        read,
        row_word="element",
        column_word="variable",
        mend="save each channel as a numeric vector, or as a column of a matrix; a timetable must "
        "be split.",
    )


def _cells(value: Unread | str, k: int | None, loaded: Mapping[int, np.ndarray]) -> Cells:
    if isinstance(value, str):
        return Other(value)
    if id(value) not in loaded:
        return Other(f"an array of shape {value.shape}")
    numbers = loaded[id(value)]
    if k is not None:
        numbers = numbers[:, k] if numbers.shape[0] >= numbers.shape[1] else numbers[k]
    # An unsigned or single-precision vector is as good as a double one.
    return numbers.reshape(-1).astype(np.float64)


def _leaves(variables: Sequence[tuple[str, Any]], prefix: str = "") -> list[tuple[str, Any]]:
    """All variables that are not structs, with their paths."""
    leaves: list[tuple[str, Any]] = []
    for name, value in variables:
        if isinstance(value, dict):
            leaves += _leaves(list(value.items()), f"{prefix}{name}.")
        elif isinstance(value, np.ndarray):
            leaves.append((prefix + name, _held(value)))
        else:
            leaves.append((prefix + name, value))
    return leaves


def _held(numbers: np.ndarray) -> Unread:
    return Unread(numbers.shape, lambda: numbers, 8 * numbers.size)

"""Vectors of numbers from MATLAB's files, and from HDF5 files of any origin."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from diffthrust.logs._largest import MemoryBudget, reading
from diffthrust.logs._tables.mat5 import parse
from diffthrust.logs._tables.table import Cells, OpenTable, Other

_WIDEST = 64
"""A matrix with more columns than this is not a set of channels."""
_DEEPEST = 20
_NUMBERS = (
    "double",
    "single",
    "logical",
    *(f"{u}int{bits}" for u in ("", "u") for bits in (8, 16, 32, 64)),
)
_WORDS = {
    "char": "text",
    "cell": "a cell array",
    "function_handle": "a function",
    "table": "a table",
    "timetable": "a timetable",
    "datetime": "an array of datetime",
}


@dataclass(frozen=True, eq=False)
class _Array:
    """An array in a file that is not read yet: its shape, and its bytes once loaded."""

    shape: tuple[int, ...]
    load: Callable[[], np.ndarray]
    size: int

    @property
    def is_vector(self) -> bool:
        """Whether all numbers lie along one axis."""
        return 0 < math.prod(self.shape) == max(self.shape, default=0)

    @property
    def vectors(self) -> int:
        """Number of vectors of a matrix, along its shorter side; 0 if it is not a matrix."""
        narrow = min(self.shape) if len(self.shape) == 2 else 0
        return narrow if 1 < narrow <= _WIDEST else 0


def read_mat(path: Path) -> OpenTable:
    """Open a MATLAB file up to version 7; structs are reached as ``a.b``."""
    budget = MemoryBudget(path)
    budget.take(path.stat().st_size)
    data = path.read_bytes()
    with reading(path, "MATLAB"):
        variables = parse(data, budget)
    return _vectors(path, "MATLAB file", [(name, _loaded(value)) for name, value in variables])


def _loaded(value: np.ndarray | str) -> _Array | str:
    if isinstance(value, str):
        return value
    return _Array(value.shape, lambda: value, 8 * value.size)


def read_hdf5(path: Path) -> OpenTable:
    """Open an HDF5 file; groups (structs in MATLAB) are named ``a.b``."""
    import h5py

    with reading(path, "MATLAB 7.3 or HDF5"), h5py.File(path, "r") as file:
        variables = list(_variables(path, file))
    matlab = any(by_matlab for *_, by_matlab in variables)
    leaves = [(name, value) for name, value, _ in variables if value is not None]
    return _vectors(path, "MATLAB 7.3 file" if matlab else "HDF5 file", leaves)


def _variables(
    path: Path, group: Any, prefix: str = "", depth: int = 0
) -> Iterator[tuple[str, _Array | str | None, bool]]:
    """Name, array or description of each dataset, None for a group, and whether MATLAB wrote it."""
    import h5py

    for name in group:
        node, link = group.get(name), group.get(name, getlink=True)
        if name.startswith("#") or node is None or not isinstance(link, h5py.HardLink):
            continue  # internal to MATLAB, a broken link, or a link to a listed variable
        kind = node.attrs.get("MATLAB_class", b"")
        kind = kind.decode("latin-1") if isinstance(kind, bytes) else str(kind)
        if isinstance(node, h5py.Dataset):
            yield prefix + name, _variable(path, node, kind), bool(kind)
        elif "MATLAB_sparse" in node.attrs:
            yield prefix + name, "a sparse matrix", bool(kind)
        elif isinstance(node, h5py.Group):
            yield name, None, bool(kind)
            if depth < _DEEPEST:
                yield from _variables(path, node, f"{prefix}{name}.", depth + 1)


def _variable(path: Path, node: Any, kind: str) -> _Array | str:
    if kind and kind not in _NUMBERS:
        return _WORDS.get(kind, f"an object of class {kind}")
    # MATLAB stores an empty array as its size, such as the two numbers 0 and 5: they are no
    # samples.
    if node.attrs.get("MATLAB_empty"):
        return _Array((0, 0), lambda: np.zeros((0, 0)), 0)
    if node.dtype.kind == "O":
        return "an array of structs or of objects" if kind == "" else "an array of references"
    if node.dtype.names and set(node.dtype.names) == {"real", "imag"}:
        return "complex numbers"
    if node.dtype.kind not in "biuf" or node.shape is None:
        return f"values of type {node.dtype}"
    shape = tuple(map(int, node.shape))
    chunk = math.prod(node.chunks or ()) * node.dtype.itemsize  # a chunk is unpacked at once
    size = max(8 * math.prod(shape), chunk)
    # MATLAB is column-major: the first axis varies fastest
    return _Array(shape[::-1] if kind else shape, partial(_load, path, node.name, bool(kind)), size)


def _load(path: Path, name: str, matlab: bool) -> np.ndarray:
    """Read a dataset, by its path in the file."""
    import h5py

    with reading(path, "MATLAB 7.3 or HDF5"), h5py.File(path, "r") as file:
        dataset: Any = file[name]
        values = np.asarray(dataset[()])
    return values.T if matlab else values


def _vectors(path: Path, kind: str, leaves: Sequence[tuple[str, _Array | str]]) -> OpenTable:
    """A table of those variables that are vectors, or columns of a matrix: ``data(:,2)``.

    What is not an array comes as a description.
    """
    columns: list[tuple[str, _Array | str, int | None]] = []
    for name, value in leaves:
        columns.append((name, value, None))
        if isinstance(value, _Array):
            for k in range(value.vectors):
                tall = value.shape[0] >= value.shape[1]
                columns.append((f"{name}(:,{k + 1})" if tall else f"{name}({k + 1},:)", value, k))
    # Reversed: of equal names the first one counts, as in the other formats.
    by_name = {name: (value, k) for name, value, k in reversed(columns)}

    def read(wanted: Sequence[str], missing: Collection[str]) -> Mapping[str, Cells]:
        needed: dict[int, _Array] = {}
        for value, k in (by_name[name] for name in wanted):
            if isinstance(value, _Array) and (k is not None or value.is_vector):
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


def _cells(value: _Array | str, k: int | None, loaded: Mapping[int, np.ndarray]) -> Cells:
    if isinstance(value, str):
        return Other(value)
    if id(value) not in loaded:
        return Other(f"an array of shape {value.shape}")
    numbers = loaded[id(value)]
    if k is not None:
        numbers = numbers[:, k] if numbers.shape[0] >= numbers.shape[1] else numbers[k]
    # An unsigned or single-precision vector is as good as a double one.
    return numbers.reshape(-1).astype(np.float64)

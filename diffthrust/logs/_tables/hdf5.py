"""Vectors from HDF5 files: saved by MATLAB since '-v7.3', or by other programs."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from diffthrust.logs._tables.mat import Unread, vectors
from diffthrust.logs._tables.source import OpenTable
from diffthrust.logs._tables.table import damaged

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


def read_hdf5(path: Path) -> OpenTable:
    """Open an HDF5 file; groups (structs in MATLAB) are named ``a.b``."""
    import h5py

    leaves: list[tuple[str, Any]] = []

    def visit(group: Any, prefix: str, depth: int) -> bool:
        matlab = False
        for name in group:
            node = group.get(name)
            link = group.get(name, getlink=True)
            if name.startswith("#") or node is None or not isinstance(link, h5py.HardLink):
                continue  # internal to MATLAB, a broken link, or a link to a listed variable
            kind = node.attrs.get("MATLAB_class", b"")
            kind = kind.decode("latin-1") if isinstance(kind, bytes) else str(kind)
            matlab = matlab or bool(kind)
            if isinstance(node, h5py.Group):
                if "MATLAB_sparse" in node.attrs:
                    leaves.append((prefix + name, "a sparse matrix"))
                elif depth:
                    matlab = visit(node, f"{prefix}{name}.", depth - 1) or matlab
            elif isinstance(node, h5py.Dataset):
                leaves.append((prefix + name, _variable(path, node, kind)))
        return matlab

    try:
        with h5py.File(path, "r") as file:
            matlab = visit(file, "", 20)
    except Exception as error:  # a damaged file raises exceptions of any kind
        raise damaged(path, "MATLAB 7.3 or HDF5", error) from None
    return vectors(path, "MATLAB 7.3 file" if matlab else "HDF5 file", leaves)


def _variable(path: Path, node: Any, kind: str) -> Unread | str:
    if kind and kind not in _NUMBERS:
        return _WORDS.get(kind, f"an object of class {kind}")
    # MATLAB stores an empty array as its size, such as the two numbers 0 and 5: they are no
    # samples.
    if node.attrs.get("MATLAB_empty"):
        return Unread((0, 0), lambda: np.zeros((0, 0)), 0)
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
    return Unread(shape[::-1] if kind else shape, partial(_load, path, node.name, bool(kind)), size)


def _load(path: Path, name: str, matlab: bool) -> np.ndarray:
    """Read a dataset, by its path in the file."""
    import h5py

    try:
        with h5py.File(path, "r") as file:
            dataset: Any = file[name]
            values = np.asarray(dataset[()])
    except Exception as error:  # as above
        raise damaged(path, "MATLAB 7.3 or HDF5", error) from None
    return values.T if matlab else values

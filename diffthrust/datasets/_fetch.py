"""Data sets: owner, licence, known defects, and files found in a folder or downloaded once.

If the environment variable ``DIFFTHRUST_DATA`` names a folder, files are taken from
``$DIFFTHRUST_DATA/NAME/`` unchecked. Otherwise they are downloaded from the set's public
repository, pinned to a commit, into the user's cache. Their checksum is verified at every use,
against the one of its `DataFile`, or else against the one recorded at the first download: the first
download of such a file is trusted, and any later change is refused.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from types import MappingProxyType

from diffthrust._support.errors import InputError, os_errors_as
from diffthrust._support.files import write_json
from diffthrust._support.names import listing, nearest
from diffthrust.logs._log import Log


@dataclass(frozen=True)
class DataFile:
    """One file of a data set.

    Args:
        name: its name in a local folder and in the cache.
        path: its path in the public repository; empty if it cannot be downloaded.
        commit: its commit there.
        sha256: its checksum there, if known.

    Example:
        >>> about = dft.datasets.list()[0]
        >>> about.files[0].name
        'CL1stateRamp.csv'
    """

    name: str
    path: str = ""
    commit: str = ""
    sha256: str | None = None


@dataclass(frozen=True)
class DataSet:
    """A public data set. Its files are not part of the package.

    Args:
        name: its name, also that of its folder.
        title: one line.
        licence: permissions of its owners.
        citation: reference to cite.
        homepage: where it is published.
        files: its files.
        defects: known defects, one sentence each.
        address: download address with ``{commit}`` and ``{path}``; empty if the set is only read
            from a local folder.
        local_only: why it cannot be downloaded, and where to get it.

    Example:
        >>> about = dft.datasets.list()[0]
        >>> about.name, about.licence
        ('ngs_thruster', 'none given: look at it and test with it, do not pass it on')
    """

    name: str
    title: str
    licence: str
    citation: str
    homepage: str
    files: tuple[DataFile, ...]
    defects: tuple[str, ...]
    address: str = ""
    local_only: str = ""

    def __str__(self) -> str:
        lines = [
            f"{self.name}: {self.title}",
            f"  licence   {self.licence}",
            f"  cite      {self.citation}",
            f"  homepage  {self.homepage}",
            f"  files     {len(self.files)}" + (f"; {self.local_only}" if self.local_only else ""),
        ]
        return "\n".join([*lines, *(f"  defect    {defect}" for defect in self.defects)])


@dataclass(frozen=True, repr=False)
class Runs:
    """The logs of a data set.

    Args:
        logs: the requested logs, by name.
        train: training logs of the usual split, in order; empty without a split.
        unseen: unseen logs of the usual split.
        about: the data set itself.

    Example:
        >>> about = dft.datasets.list()[0]
        >>> runs = dft.datasets.Runs({"a": log, "b": unseen}, (log,), (unseen,), about)
        >>> runs["a"].name, len(runs.train)
        ('run1.csv', 1)
    """

    logs: Mapping[str, Log]
    train: tuple[Log, ...]
    unseen: tuple[Log, ...]
    about: DataSet

    def __repr__(self) -> str:
        return (
            f"Runs({self.about.name!r}: {len(self.logs)} logs, {len(self.train)} to train on, "
            f"{len(self.unseen)} unseen)"
        )

    def __getitem__(self, name: str) -> Log:
        """The log of that name.

        Raises:
            InputError: there is none, or it was not requested.
        """
        if name in self.logs:
            return self.logs[name]
        raise InputError(
            f"data set {self.about.name!r}: expected the name of a log, found {name!r}"
            f"{nearest(str(name), self.logs, '; ')}.",
            f"Choose one of {listing(self.logs)}.",
        )


FOLDER = "DIFFTHRUST_DATA"
_SUMS = "sha256.json"


def loaded(
    about: DataSet,
    names: str | Sequence[str] | None,
    read: Callable[[Path], Log],
    train: Sequence[str],
    unseen: Sequence[str],
) -> Runs:
    """The requested logs of a set, from its files NAME.csv, and those of its usual split."""
    chosen = wanted(about, [file.name.removesuffix(".csv") for file in about.files], names)
    paths = located(about, [f"{name}.csv" for name in chosen])
    logs = {name: read(paths[f"{name}.csv"]) for name in chosen}
    return Runs(
        logs=MappingProxyType(logs),
        train=tuple(logs[name] for name in train if name in logs),
        unseen=tuple(logs[name] for name in unseen if name in logs),
        about=about,
    )


def wanted(
    about: DataSet, available: Sequence[str], names: str | Sequence[str] | None
) -> tuple[str, ...]:
    """The requested names, in the set's order; patterns such as ``"zigzag*"`` are allowed."""
    patterns = ("*",) if names is None else (names,) if isinstance(names, str) else tuple(names)
    for pattern in patterns:
        if not any(fnmatchcase(name, pattern) for name in available):
            raise InputError(
                f"data set {about.name!r}: expected names of logs, found {pattern!r}"
                f"{nearest(str(pattern), available, '; ')}.",
                f"Choose among {listing(available)}, or leave the names out for all.",
            )
    return tuple(n for n in available if any(fnmatchcase(n, pattern) for pattern in patterns))


def located(about: DataSet, names: Iterable[str] | None = None) -> dict[str, Path]:
    """The path of each file of a data set, or of those named; downloads missing ones."""
    files = {file.name: file for file in about.files}
    chosen = list(files) if names is None else list(names)
    folder = place(about)
    if os.environ.get(FOLDER):
        return {name: _local(about, folder / name) for name in chosen}
    if not about.address:
        raise InputError(
            f"data set {about.name!r}: {about.local_only}.",
            f"Set {FOLDER} to the folder that holds {about.name}/{chosen[0]}.",
        )
    return {name: _cached(about, files[name], folder) for name in chosen}


def place(about: DataSet) -> Path:
    """The folder of the files of a data set, existing or not."""
    root = os.environ.get(FOLDER)
    return (Path(root).expanduser() if root else _cache_folder()) / about.name


def _cache_folder() -> Path:
    """The folder of downloaded data sets, in the user's cache or in that of DIFFTHRUST_CACHE."""
    named = os.environ.get("DIFFTHRUST_CACHE", "").strip()
    if named and named.lower() != "off":
        return Path(named).expanduser() / "datasets"
    import platformdirs

    return Path(platformdirs.user_cache_dir("diffthrust", appauthor=False)) / "datasets"


def _local(about: DataSet, path: Path) -> Path:
    if path.is_file():
        return path
    folder = path.parent
    if not folder.parent.is_dir():
        reason = "there is no such folder"
    elif not folder.is_dir():
        reason = f"it has no folder {about.name!r}"
    else:
        near = nearest(path.name, (file.name for file in folder.iterdir()), "; ")
        reason = f"there is no such file{near}"
    raise InputError(
        f"data set {about.name!r}: expected the file {path}, which {FOLDER} leads to; {reason}.",
        f"Put the file there, or unset {FOLDER} to have it downloaded."
        if about.address
        else f"Put the file there, or set {FOLDER} to another folder; {about.local_only}.",
    )


def _cached(about: DataSet, file: DataFile, folder: Path) -> Path:
    path = folder / file.name
    expected = file.sha256 or _sums(folder).get(file.name)
    if path.is_file():
        digest = _sha256(path)
        if digest == expected:
            return path
        if expected is not None:
            raise InputError(
                f"data set {about.name!r}: {path} has changed since it was downloaded: expected "
                f"the sha256 {expected}, found {digest}.",
                "Delete the file, and it is downloaded again.",
            )
    return _download(about, file, path, expected)


def _download(about: DataSet, file: DataFile, path: Path, expected: str | None) -> Path:
    """Download under a temporary name, verify, record the checksum, and rename last."""
    import pooch  # imported late: takes a fifth of a second

    address = about.address.format(commit=file.commit, path=file.path)
    folder = path.parent
    logging.getLogger("pooch").setLevel(logging.WARNING)
    elsewhere = "Set DIFFTHRUST_CACHE to a folder that you may write to."
    with os_errors_as(f"{folder}: the folder cannot be written to", elsewhere):
        folder.mkdir(parents=True, exist_ok=True)
        inside = tempfile.TemporaryDirectory(prefix=".", dir=folder)
    with inside:
        partial = Path(inside.name, file.name)
        try:
            # Not as a stream: that would leave the connection open when it breaks.
            pooch.HTTPDownloader(timeout=60, stream=False)(address, str(partial), None)
        except (OSError, ValueError) as error:  # exceptions of requests are OSErrors
            reason = " ".join(str(error).split())[:200]
            raise InputError(
                f"data set {about.name!r}: {file.name} cannot be downloaded from {address} "
                f"({type(error).__name__}: {reason}).",
                f"Connect to the network, or set {FOLDER} to a folder that holds "
                f"{about.name}/{file.name}.",
            ) from None
        digest = _sha256(partial)
        if expected is None:
            # Read again: another process may have recorded checksums meanwhile.
            write_json(folder / _SUMS, {**_sums(folder), file.name: digest})
        elif digest != expected:
            mend = "Do not trust it before you know why it changed"
            meant = f"if it is meant to be another, remove its line from {folder / _SUMS}"
            raise InputError(
                f"data set {about.name!r}: {address} is no longer the same file: expected the "
                f"sha256 {expected}, found {digest}.",
                f"{mend}." if file.sha256 else f"{mend}; {meant}.",
            )
        # Caches are often shared: others may read it, whatever files one's own system makes.
        partial.chmod(0o644)
        os.replace(partial, path)
    return path


def _sums(folder: Path) -> dict[str, str]:
    """The checksums recorded at the first download of each file."""
    path = folder / _SUMS
    try:
        sums = json.loads(path.read_bytes())
    except FileNotFoundError:
        return {}
    except (OSError, ValueError) as error:
        raise InputError(
            f"{path}: the recorded checksums cannot be read ({error}).",
            f"Delete the folder {folder}, and its files are downloaded again.",
        ) from None
    return {str(name): str(value) for name, value in dict(sums).items()}


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()

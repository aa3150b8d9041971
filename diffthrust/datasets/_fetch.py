"""Locate the files of a data set: in a local folder, or downloaded once.

If the environment variable ``DIFFTHRUST_DATA`` names a folder, files are taken from
``$DIFFTHRUST_DATA/NAME/`` unchecked. Otherwise they are downloaded from the set's public
repository, pinned to a commit, into the user's cache. Their checksum is verified at every use,
against the known one, or else against the one recorded at the first download: the first download
of such a file is trusted, and any later change is refused.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import tempfile
from collections.abc import Iterable
from pathlib import Path

from diffthrust._support.errors import InputError
from diffthrust._support.files import write_json
from diffthrust._support.names import nearest
from diffthrust.datasets._record import DataFile, DataSet

FOLDER = "DIFFTHRUST_DATA"
_SUMS = "sha256.json"


def located(about: DataSet, names: Iterable[str] | None = None) -> dict[str, Path]:
    """The path of each file of a data set, or of those named; downloads missing ones."""
    files = {file.name: file for file in about.files}
    chosen = list(files) if names is None else list(names)
    root = os.environ.get(FOLDER)
    if root:
        return {name: _local(about, Path(root).expanduser(), name) for name in chosen}
    if not about.address:
        raise InputError(
            f"data set {about.name!r}: {about.local_only}.",
            f"Set {FOLDER} to the folder that holds {about.name}/{chosen[0]}.",
        )
    folder = _cache_folder() / about.name
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


def _local(about: DataSet, root: Path, name: str) -> Path:
    path = root / about.name / name
    if path.is_file():
        return path
    if not root.is_dir():
        reason = "there is no such folder"
    elif not path.parent.is_dir():
        reason = f"it has no folder {about.name!r}"
    else:
        near = nearest(name, (file.name for file in path.parent.iterdir()))
        reason = f"there is no such file{'; ' + near if near else ''}"
    raise InputError(
        f"data set {about.name!r}: expected the file {path}, which {FOLDER} leads to; {reason}.",
        f"Put the file there, or unset {FOLDER} to have it downloaded."
        if about.address
        else f"Put the file there, or set {FOLDER} to another folder; {about.local_only}.",
    )


def _cached(about: DataSet, file: DataFile, folder: Path) -> Path:
    path = folder / file.name
    recorded = _sums(folder)
    expected = file.sha256 or recorded.get(file.name)
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
    return _download(about, file, path, expected, recorded)


def _download(
    about: DataSet, file: DataFile, path: Path, expected: str | None, recorded: dict[str, str]
) -> Path:
    """Download under a temporary name, verify, record the checksum, and rename last."""
    import pooch  # imported late: takes a fifth of a second

    address = about.address.format(commit=file.commit, path=file.path)
    folder = path.parent
    logging.getLogger("pooch").setLevel(logging.WARNING)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=f".{file.name}.", suffix=".part", dir=folder)
        os.close(handle)
    except OSError as error:
        raise InputError(
            f"{folder}: the folder cannot be written to ({error.strerror or error}).",
            "Set DIFFTHRUST_CACHE to a folder that you may write to.",
        ) from None
    partial = Path(name)
    try:
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
        if expected is not None and digest != expected:
            raise InputError(
                f"data set {about.name!r}: {address} is no longer the same file: expected the "
                f"sha256 {expected}, found {digest}.",
                f"Do not trust it before you know why it changed; if it is meant to be another, "
                f"remove its line from {folder / _SUMS}."
                if file.sha256 is None
                else "Do not trust it before you know why it changed.",
            )
        if file.sha256 is None and file.name not in recorded:
            # Read again: another process may have recorded checksums meanwhile.
            write_json(folder / _SUMS, {**_sums(folder), file.name: digest})
        # mkstemp makes files that only their owner may read; caches are often shared.
        partial.chmod(0o644)
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)
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

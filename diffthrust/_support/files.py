"""Files written whole or not at all."""

from __future__ import annotations

import errno
import json
import math
import os
import shutil
import stat
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from diffthrust._support.errors import InputError, os_errors_as

PathLike = str | os.PathLike[str]
MAKE_ROOM = "Make room there, or name a file in another place."
_ELSEWHERE = "Name a file in a folder that exists and that you may write to."


def write_by_rename(target: Path, temporary: Path, data: bytes, *, durable: bool = False) -> None:
    """Write a file under a temporary name, then rename it: never half of it.

    It is on the disk before it replaces another if it is to be ``durable``: os.replace is atomic
    for names, not for contents, and a power cut might leave a new name with an empty file.
    """
    try:
        with open(temporary, "wb") as file:
            file.write(data)
            if durable:
                file.flush()
                os.fsync(file.fileno())
        if target.exists():
            shutil.copymode(target, temporary)
        os.replace(temporary, target)
    except BaseException:  # Ctrl-C, too, must not leave the temporary file behind
        with suppress(OSError):
            temporary.unlink()
        raise


def write_whole(path: Path, data: bytes) -> None:
    """Write a file whole or not at all; `InputError` where the system refuses."""
    # Through symbolic links: os.replace would replace the link, not the file that it points to.
    target = Path(os.path.realpath(path))
    temporary = target.with_name(f".{target.name}.{os.getpid()}.tmp")
    try:
        write_by_rename(target, temporary, data)
    except OSError as error:
        raise InputError(
            f"{path}: the file cannot be written ({error.strerror or error}).",
            MAKE_ROOM if is_full(error) else _ELSEWHERE,
        ) from None


def is_full(error: OSError) -> bool:
    """Whether there was no room for what was to be written."""
    return error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def ending(path: Path, *kinds: str) -> str:
    """The ending of a file to write; `InputError` if its content may not have that ending."""
    suffix = path.suffix.lower()
    if suffix not in kinds:
        raise InputError(
            f"{path}: expected a file ending in {' or '.join(kinds)}.", "Change the ending."
        )
    return suffix


def existing_folder(path: Path) -> None:
    """Raise `InputError` where the folder of a file to write is none."""
    folder = path.absolute().parent
    if not folder.is_dir():
        raise InputError(f"{path}: expected the folder '{folder}', found none.", _ELSEWHERE)


def write_page(path: Path, text: str) -> None:
    """Write a page of HTML."""
    ending(path, ".html", ".htm")
    write_whole(path, text.encode("utf-8", "backslashreplace"))


def write_json(path: Path, data: Mapping[str, Any]) -> None:
    """Write plain data as JSON, with ``null`` where a number is not finite."""
    ending(path, ".json")
    text = json.dumps(plain(data), indent=2, allow_nan=False, ensure_ascii=False)
    # Names of files may hold bytes that are not UTF-8 (surrogates in Python): written as escapes.
    write_whole(path, f"{text}\n".encode("utf-8", "backslashreplace"))


def plain(data: Any) -> Any:
    """The same data in the types of JSON: NaN and infinities become ``None``."""
    if isinstance(data, Mapping):
        return {str(key): plain(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [plain(value) for value in data]
    if hasattr(data, "tolist"):  # numbers and arrays of NumPy
        return plain(data.tolist())
    if isinstance(data, float) and not math.isfinite(data):
        return None
    return data


def oddity(path: Path) -> str | None:
    """What a path is if neither file nor folder, "a socket": reading it may block; else None."""
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):
        return None
    kinds = (
        (stat.S_ISFIFO, "a named pipe (FIFO)"),
        (stat.S_ISSOCK, "a socket"),
        (stat.S_ISCHR, "a device"),
        (stat.S_ISBLK, "a device"),
    )
    return next((words for holds, words in kinds if holds(mode)), None)


def made_folder(folder: Path, mend: str) -> Path:
    """The folder, made with those above it where it does not exist."""
    with os_errors_as(f"{folder}: the folder cannot be made", mend):
        folder.mkdir(parents=True, exist_ok=True)
    return folder

"""The files that are looked at: one, several of one kind, or those of a folder."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust.logs._contents import Contents, contents
from diffthrust.logs._kinds import is_bag, is_log
from diffthrust.survey._choice import Choice

_UNSEEN = re.compile("holdout|unseen|valid")
"""What people call the logs that they keep."""


@dataclass(frozen=True)
class Files:
    """Files that were read, and the one that stands for all.

    Args:
        read: what is in each, by the order of their names.
        refused: files that nobody could read, and why.
    """

    read: tuple[Contents, ...]
    refused: tuple[str, ...]

    @property
    def contents(self) -> Contents:
        """The first of the kind that most files are of."""
        kinds = [_kind(one) for one in self.read]
        return max(self.read, key=lambda one: (kinds.count(_kind(one)), len(one.fields)))

    def split(self, choice: Choice) -> tuple[tuple[Path, ...], tuple[Path, ...], tuple[str, ...]]:
        """Files to fit, to keep unseen (named so, or the last), and words on those left out."""
        wanted = {pick.field.name for pick in choice.channels.values()}
        wanted |= {choice.time.field.name} if choice.time else set()
        suited = [
            one.path
            for one in self.read
            if one.messages == choice.contents.messages
            and (wanted or {""}) <= ({field.name for field in one.fields} | {""})
        ]
        left = [one.path.name for one in self.read if one.path not in suited]
        apart = [f"Left out, without these columns: {listing(left, 6)}."] if left else []
        if len(suited) < 2:
            return tuple(suited), (), (*apart, *self.refused)
        unseen = [path for path in suited if _UNSEEN.search(path.stem.lower())]
        if not 0 < len(unseen) < len(suited):
            unseen = suited[-1:]
        train = [path for path in suited if path not in unseen]
        return tuple(train), tuple(unseen), (*apart, *self.refused)


def files_at(paths: Sequence[Path]) -> Files:
    """Read what is in some files, and in those of folders.

    Raises:
        InputError: there is none, or none can be read.
    """
    files: list[Path] = []
    for path in paths:
        if path.is_dir() and not is_bag(path):
            inside = sorted(path.iterdir())
            found = [one for one in inside if is_log(one)]
            if not found:
                raise InputError(
                    f"{path}: expected a folder with logs, found none among its {len(inside)} "
                    "files.",
                    "Name the file of a log.",
                )
            files += found
        else:
            files.append(path)
    read, refused = [], []
    for file in files:
        try:
            read.append(_read(file))
        except InputError as error:
            refused.append(error)
    if not read:
        raise refused[0]
    return Files(tuple(read), tuple(f"Left out: {error.problem}" for error in refused))


def _read(file: Path) -> Contents:
    found = contents(file)
    if sum(np.isfinite(field.values).any() for field in found.fields) < 2:
        raise InputError(
            f"{file}: expected a log, found hardly a column of numbers.",
            "Name a file with columns of numbers under a header, or a robot's log.",
        )
    return found


def _kind(one: Contents) -> tuple[object, ...]:
    return one.kind, None if one.messages else tuple(field.name for field in one.fields)

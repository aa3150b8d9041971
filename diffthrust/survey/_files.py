"""The surveyed files: one, several of one kind, or those of a folder."""

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
"""Words in the names of logs kept for validation."""


@dataclass(frozen=True)
class Files:
    """The contents of the files read, by name, and sentences on those refused."""

    read: tuple[Contents, ...]
    refused: tuple[str, ...]

    @property
    def contents(self) -> Contents:
        """The first file of the most frequent kind."""
        kinds = [_kind(content) for content in self.read]
        return max(
            self.read, key=lambda content: (kinds.count(_kind(content)), len(content.fields))
        )

    def split(self, choice: Choice) -> tuple[tuple[Path, ...], tuple[Path, ...], tuple[str, ...]]:
        """Files to fit, files to hold out (by name, or the last), and notes on those left out."""
        wanted = {pick.field.name for pick in choice.channels.values()}
        wanted |= {choice.time.field.name} if choice.time else set()
        suited = [
            content.path
            for content in self.read
            if content.messages == choice.contents.messages
            and (wanted or {""}) <= ({field.name for field in content.fields} | {""})
        ]
        unsuited = [content.path.name for content in self.read if content.path not in suited]
        apart = [f"Left out, without these columns: {listing(unsuited, 6)}."] if unsuited else []
        if len(suited) < 2:
            return tuple(suited), (), (*apart, *self.refused)
        unseen = [path for path in suited if _UNSEEN.search(path.stem.lower())]
        if not 0 < len(unseen) < len(suited):
            # Logs are named by date or number: the last is the latest, and a fit that predicts it
            # is of use.
            unseen = suited[-1:]
        train = [path for path in suited if path not in unseen]
        return tuple(train), tuple(unseen), (*apart, *self.refused)


def files_at(paths: Sequence[Path]) -> Files:
    """Read the contents of files, and of those in folders."""
    files: list[Path] = []
    for path in paths:
        if path.is_dir() and not is_bag(path):
            inside = sorted(path.iterdir())
            logs = [entry for entry in inside if is_log(entry)]
            if not logs:
                raise InputError(
                    f"{path}: expected a folder with logs, found none among its {len(inside)} "
                    "files.",
                    "Name the file of a log.",
                )
            files += logs
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
    content = contents(file)
    # A text file with a few numbers (a README) parses as a table as well.
    if sum(np.isfinite(field.values).any() for field in content.fields) < 2:
        raise InputError(
            f"{file}: expected a log, found fewer than two columns of numbers.",
            "Name a file with columns of numbers under a header, or a robot's log.",
        )
    return content


def _kind(content: Contents) -> tuple[object, ...]:
    return content.kind, None if content.messages else tuple(field.name for field in content.fields)

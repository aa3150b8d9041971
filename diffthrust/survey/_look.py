"""Survey a log file before anything is fitted."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.figures import showing
from diffthrust._support.files import ending, write_whole
from diffthrust._support.names import listing
from diffthrust._support.report import Bullets, Report, Section
from diffthrust._support.results import Result
from diffthrust._support.visible import in_line
from diffthrust.logs._contents import Contents, contents
from diffthrust.logs._kinds import is_bag, is_log
from diffthrust.survey._choice import Choice
from diffthrust.survey._draft import drafted
from diffthrust.survey._suited import choice_of, doubted
from diffthrust.survey._tables import (
    ColumnRow,
    column_rows,
    first_line,
    grouped,
    model_line,
    remarks,
    rows_of,
    split_rows,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False, repr=False)
class Look(Result):
    """The contents of a log file, their likely meaning, and a draft of a spec file.

    Args:
        path: the file, or the first of several of one kind.
        choice: the model that suits it, and its channels.
        columns: a row for each column, or field of a message, in the order of the file.
        train: the files that the drafted spec fits.
        holdout: the files it holds out; empty if there is only one file.
        apart: sentences on files that were left out.

    Example:
        >>> seen = dft.look("run1.csv")
        >>> seen.kind, seen.model, len(seen.doubts)
        ('CSV table', 'thruster', 3)
        >>> seen.save_spec("drafted.toml").name
        'drafted.toml'
        >>> print(seen.report().splitlines()[0])
        run1.csv: CSV table, 240 rows of 4 columns, 11.95 s at 20.0 Hz, largest gap 0.0500 s.
        >>> "[channels" in seen.spec, sorted(seen.to_json())[:2]
        (True, ['columns', 'doubts'])
        >>> figure = seen.plot()
    """

    path: Path
    choice: Choice = field(repr=False)
    columns: tuple[ColumnRow, ...] = field(repr=False)
    train: tuple[Path, ...]
    holdout: tuple[Path, ...] = ()
    apart: tuple[str, ...] = ()

    @property
    def kind(self) -> str:
        """The kind of file, such as ``"CSV table"``."""
        return self.choice.contents.kind

    @property
    def model(self) -> str | None:
        """The name of the model that suits the file; None if none does."""
        return self.choice.model

    @property
    def doubts(self) -> tuple[str, ...]:
        """Open questions for whoever knows the test, one sentence each."""
        where: dict[str, list[str]] = {}
        for name, pick in self.choice.timed.items():
            for word in pick.meaning.doubts:
                where.setdefault(word, []).append(name)
        channel_doubts = [f"{', '.join(names)}: {word}" for word, names in where.items()]
        return (*self.choice.doubts, *channel_doubts, *self.apart)

    @property
    def spec(self) -> str:
        """The drafted spec file (TOML), with paths relative to the working directory."""
        return self._drafted(Path())

    def _drafted(self, folder: Path) -> str:
        return drafted(self.choice, self.train, self.holdout, folder, " ".join(self.apart))

    def save_spec(self, path: str | PathLike[str]) -> Path:
        """Write the drafted spec file, with paths relative to its folder.

        Args:
            path: ending in .toml; an existing file is never overwritten.

        Raises:
            InputError: the file exists, or cannot be written.
        """
        target = Path(path)
        ending(target, ".toml")
        if target.exists():
            raise InputError(
                f"{target}: expected a new name, found a file; nothing is overwritten.",
                "Take another name.",
            )
        try:
            data = self._drafted(target.parent).encode()
        except UnicodeEncodeError as error:
            raise InputError(
                f"{target}: expected logs whose names are text, since a spec file is text; found "
                f"{error.object[error.start]} in a name, which is no UTF-8.",
                "Rename the log.",
            ) from None
        write_whole(target, data)
        return target

    def _line(self) -> str:
        model = self.model or "no model"
        return f"{self.path.name!r}: {self.kind}, {len(self.columns)} columns, {model}"

    def _report(self) -> Report:
        return look_report(self)

    def report(self, *, all: bool = False) -> str:
        """The contents of the file, as a table and sentences.

        Args:
            all: show every field of a robot's log, not only those that a model may use.
        """
        from diffthrust._support.tables import report_text

        return report_text(look_report(self, all=all))

    @showing
    def plot(self) -> Figure:
        """Plot the channels of the drafted spec over time, or all columns if it has none."""
        from diffthrust.survey._figures import look_figure

        return look_figure(self.choice, in_line(self.path.name))

    def to_json(self) -> dict[str, Any]:
        """Plain data: the content of the report, and the drafted spec."""
        return {
            "schema": 1,
            "path": str(self.path),
            "kind": self.kind,
            "model": self.model,
            "columns": [row.to_json() for row in self.columns],
            "doubts": [*self.doubts],
            "train": [str(path) for path in self.train],
            "holdout": [str(path) for path in self.holdout],
            "spec": self.spec,
        }


def look_report(survey: Look, *, all: bool = False) -> Report:
    """The content of a file: a line on it, a row for each column, the model, and the doubts."""
    listed, remaining = split_rows(survey.columns, all)
    hidden = f"{len(remaining)} more fields (--all shows them): {grouped(remaining)}"
    return Report(
        Section("", first_line(survey.path.name, survey.choice, survey.columns)),
        Section("", column_rows(listed, survey.choice.contents.messages)),
        Section("", Bullets(remarks(listed))),
        Section("", hidden if remaining else ""),
        Section("", model_line(survey.choice, survey.train, survey.holdout)),
        Section("", *(["In doubt:", Bullets(survey.doubts)] if survey.doubts else [])),
    )


_UNSEEN = re.compile("holdout|unseen|valid")
"""Words in the names of logs kept for validation."""


def _files_at(path: Path) -> list[Path]:
    """A file; of a folder, the logs in it."""
    if not path.is_dir() or is_bag(path):
        return [path]
    inside = sorted(path.iterdir())
    logs = [entry for entry in inside if is_log(entry)]
    if not logs:
        raise InputError(
            f"{path}: expected a folder with logs, found none among its {len(inside)} files.",
            "Name the file of a log.",
        )
    return logs


def _read(files: Iterable[Path]) -> tuple[list[Contents], list[str]]:
    """The contents of the files, and sentences on those that are refused."""
    read, refused = [], []
    for file in files:
        try:
            content = contents(file)
            # A text file with a few numbers (a README) parses as a table as well.
            if sum(np.isfinite(field.values).any() for field in content.fields) < 2:
                raise InputError(
                    f"{file}: expected a log, found fewer than two columns of numbers.",
                    "Name a file with columns of numbers under a header, or a robot's log.",
                )
            read.append(content)
        except InputError as error:
            refused.append(error)
    if not read:
        raise refused[0]
    return read, [f"Left out: {error.problem}" for error in refused]


def _most_frequent(read: Sequence[Contents]) -> Contents:
    """The first file of the most frequent kind."""
    kinds = [
        (c.kind, None if c.messages else tuple(field.name for field in c.fields)) for c in read
    ]
    ranks = [(kinds.count(kind), len(c.fields)) for kind, c in zip(kinds, read, strict=True)]
    return read[ranks.index(max(ranks))]


def _split(paths: Sequence[Path]) -> tuple[tuple[Path, ...], tuple[Path, ...]]:
    """Files to fit, and files to hold out: by name, or the last."""
    unseen = [path for path in paths if _UNSEEN.search(path.stem.lower())]
    if not 0 < len(unseen) < len(paths):
        # Logs are named by date or number: the last is the latest, and a fit that predicts it
        # is of use.
        unseen = [*paths[-1:]] if len(paths) > 1 else []
    return tuple(path for path in paths if path not in unseen), tuple(unseen)


def look(path: str | PathLike[str] | Sequence[str | PathLike[str]]) -> Look:
    """Survey a log file, and draft a spec file for a first fit.

    Quantities, units and roles are guessed from names, from units in the file, and from the
    numbers. Uncertain guesses are listed as doubts, as are the findings of `soundness.doubts` in
    the channels of a table. Nothing is fitted.

    Args:
        path: a file that `read_log` or `read_robot_log` reads, several of one kind, or a folder of
            them. Of several, the draft holds out those whose name says so (holdout, unseen,
            validation), or else the last by name.

    Returns:
        The columns, the doubts and the draft.

    Raises:
        InputError: there is no such file, its format is not supported, or it is a DataFrame.

    Example:
        >>> dft.look("run1.csv").model
        'thruster'
    """
    if hasattr(path, "columns"):
        raise InputError(
            f"expected the file of a log, found a {type(path).__name__}.",
            "Make a log of it: Log.from_dataframe(frame, inputs={...}, measured={...}); or look "
            "at the file that it came from.",
        )
    several = [Path(path)] if isinstance(path, str | PathLike) else [Path(entry) for entry in path]
    read, refused = _read([file for entry in several for file in _files_at(entry)])
    first = _most_frequent(read)
    choice = choice_of(first)
    wanted = {pick.field.name for pick in choice.timed.values()} - {""}
    alike = [content for content in read if content.messages == first.messages]
    suited = [c.path for c in alike if wanted <= {field.name for field in c.fields}]
    unsuited = [content.path.name for content in read if content.path not in suited]
    apart = [f"Left out, without these columns: {listing(unsuited, 6)}."] if unsuited else []
    train, holdout = _split(suited)
    choice = doubted(choice, (*train, *holdout))
    return Look(first.path, choice, rows_of(choice), train, holdout, (*apart, *refused))

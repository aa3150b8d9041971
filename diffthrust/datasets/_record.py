"""Description of a data set: owner, licence, files, known defects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from diffthrust._support.errors import InputError
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

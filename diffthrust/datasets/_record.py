"""What a data set is: whose, under which licence, which files, and what is wrong with them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from types import MappingProxyType

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing, nearest
from diffthrust.logs._log import Log


@dataclass(frozen=True)
class DataFile:
    """One file of a data set.

    Args:
        name: its name in a local folder and in the cache.
        path: its path in the public repository; empty where it cannot be downloaded.
        commit: the commit at which it stands there.
        sha256: its checksum there, where it is known beforehand.

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
        name: its name, that of its folder too.
        title: one line for people.
        licence: what its owners allow.
        citation: whom to cite.
        homepage: where it is published.
        files: its files.
        defects: what is known to be wrong with them, one sentence each.
        address: where a file is downloaded from, with ``{commit}`` and ``{path}``; empty where the
            set is read from a local folder only.
        local_only: why it cannot be downloaded, and where a person gets it.

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
        logs: every log that was asked for, by name.
        train: those of the usual split to fit to, in its order; empty where there is no split.
        unseen: those of the usual split to try the fit on.
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
            InputError: there is none, or it was not asked for.
        """
        if name in self.logs:
            return self.logs[name]
        near = nearest(str(name), self.logs)
        raise InputError(
            f"data set {self.about.name!r}: expected the name of a log, found {name!r}"
            f"{'; ' + near if near else ''}.",
            f"Choose one of {listing(self.logs)}.",
        )


def runs(
    about: DataSet, logs: Mapping[str, Log], train: tuple[str, ...], unseen: tuple[str, ...]
) -> Runs:
    """Sort logs into those of the usual split; a log that was not asked for is left out of it."""
    return Runs(
        logs=MappingProxyType(dict(logs)),
        train=tuple(logs[name] for name in train if name in logs),
        unseen=tuple(logs[name] for name in unseen if name in logs),
        about=about,
    )


def wanted(
    about: DataSet, known: tuple[str, ...], names: str | Sequence[str] | None
) -> tuple[str, ...]:
    """The names that were asked for, in the set's order; patterns such as ``"zigzag*"`` are known.

    Raises:
        InputError: a name or pattern that no log has.
    """
    if names is None:
        return known
    patterns = (names,) if isinstance(names, str) else tuple(names)
    for pattern in patterns:
        if not any(fnmatchcase(name, pattern) for name in known):
            near = nearest(str(pattern), known)
            raise InputError(
                f"data set {about.name!r}: expected names of logs, found {pattern!r}"
                f"{'; ' + near if near else ''}.",
                f"Choose among {listing(known)}, or leave the names out for all.",
            )
    return tuple(n for n in known if any(fnmatchcase(n, pattern) for pattern in patterns))

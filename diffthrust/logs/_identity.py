"""Identity of a log: a hash of its content, and the file it came from."""

from __future__ import annotations

from dataclasses import dataclass
from hashlib import file_digest, sha256
from pathlib import Path

import numpy as np

from diffthrust.logs._edits import LogEdits


@dataclass(frozen=True)
class LogFile:
    """The file that a log was read from.

    Args:
        name: the path as it was given.
        sha256: of its bytes; of a folder, of the files in it.
    """

    name: str
    sha256: str


@dataclass(frozen=True)
class LogIdentity:
    """What identifies a log.

    Args:
        name: of the log.
        samples: number of samples.
        duration: from the first to the last [s].
        sha256: of its content; see `Log.sha256`.
        file: where it was read from; ``None`` for a log of arrays.
    """

    name: str
    samples: int
    duration: float
    sha256: str
    file: LogFile | None = None


def content_hash(log: LogEdits) -> str:
    """The sha256 of a log's content: the bits of its numbers, in the library's units.

    Name, notes and the order of channels do not count, and all NaN are equal.
    """
    digest = sha256()

    def add(words: object, samples: np.ndarray) -> None:
        # NaN has many bit patterns (a sign, a payload), and which one appears depends on the
        # processor.
        numbers = np.where(np.isnan(samples), np.nan, samples)
        digest.update(f"{words!r} {numbers.size}\n".encode())
        # Little-endian on every machine.
        digest.update(np.ascontiguousarray(numbers, "<f8").tobytes())

    add("time", log.time)
    for name, samples in sorted(log.inputs.items()):
        add(("input", name, log.units[name], log.hold[name]), samples)
    for name, samples in sorted(log.measured.items()):
        # Options are added only if set, so that hashes in stored results stay valid.
        sigma = float(log.noise.get(name, np.nan))
        description: tuple[object, ...] = (
            *("measured", name, log.units[name], name in log.unsigned, sigma),
            *((log.rails[name],) if name in log.rails else ()),
            *(("censored",) if name in log.censored else ()),
        )
        add(description, samples)
    return digest.hexdigest()


def log_file(path: Path) -> LogFile:
    """The file of a log with its hash; for a folder, the hash of its files and their names."""
    files = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
    hashes = []
    for file in files:
        with file.open("rb") as opened:
            hashes.append(file_digest(opened, "sha256").hexdigest())
    if path.is_dir():
        listed = [(f.relative_to(path).as_posix(), h) for f, h in zip(files, hashes, strict=True)]
        return LogFile(path.as_posix(), sha256(repr(listed).encode()).hexdigest())
    return LogFile(path.as_posix(), hashes[0])

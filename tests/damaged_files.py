"""Files of which bytes were changed or cut away: each is read or told, and none is a traceback."""

from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from diffthrust import InputError


def outcomes(
    path: Path, readers: Iterable[Callable[[Path], Any]], rounds: int, first: int = 0
) -> Counter[str]:
    """Damage a file in seeded ways and read it: how often it was read, told, and told unnamed.

    Args:
        path: a sound file, which is overwritten.
        readers: what reads it.
        rounds: how many damaged files to try.
        first: the first byte that may be changed.
    """
    rng = np.random.default_rng(0)
    good = path.read_bytes()
    ended: Counter[str] = Counter()
    for _ in range(rounds):
        path.write_bytes(damaged(good, rng, first))
        for reader in readers:
            error = _error(reader, path)
            ended["read" if error is None else "told"] += 1
            if error is not None and (path.name not in error.problem or not error.mend):
                ended["unnamed"] += 1
    return ended


def damaged(good: bytes, rng: np.random.Generator, first: int = 0) -> bytearray:
    """The bytes with a few of them changed, from ``first`` on; a fifth of the time cut off, too."""
    data = bytearray(good)
    for _ in range(int(rng.integers(1, 6))):
        data[int(rng.integers(first, len(data)))] = int(rng.integers(256))
    if rng.random() < 0.2:
        data = data[: int(rng.integers(max(first, 1), len(data)))]
    return data


def _error(reader: Callable[[Path], Any], path: Path) -> InputError | None:
    try:
        reader(path)
    except InputError as error:
        return error
    return None

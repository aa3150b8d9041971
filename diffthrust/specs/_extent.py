"""TOML that no person writes: nested thousands deep, or with numbers of thousands of digits."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from diffthrust._support.errors import InputError

_DEEPEST = 50
_BITS = 64
"""What TOML has of an integer, at least."""
_LONG = re.compile(r"[0-9a-fA-F_]{17,}")

_DOTTED = re.compile(r"(?:\.[ \t]{0,9}[\w\"'-]{1,99}[ \t]{0,9}){50}")


def check_keys(text: str, file: Path | str) -> None:
    """Look for a key of many dots, which Python takes minutes to read.

    Raises:
        InputError: there is one.
    """
    if _DOTTED.search(text):
        raise too_deep(text, file)


def check_extent(tables: Mapping[str, Any], text: str, file: Path | str) -> None:
    """Look through the tables of a TOML text.

    Raises:
        InputError: they are nested too deep, or an integer is too long.
    """
    level: list[Any] = [tables]
    for _ in range(_DEEPEST):
        level = [inner for each in level for inner in _inside(each)]
        if any(isinstance(each, int) and each.bit_length() > _BITS for each in level):
            raise too_long(text, file)
    if level:
        raise too_deep(text, file)


def too_deep(text: str, file: Path | str) -> InputError:
    """The error for tables or lists inside each other without end."""
    lines = text.splitlines()
    counts = [sum(map(line.count, "[{.")) for line in lines]
    return InputError(
        f"{file}, line {counts.index(max(counts)) + 1}: expected tables and lists nested at most "
        f"{_DEEPEST} deep, found more.",
        "Remove the brackets or dots.",
    )


def too_long(text: str, file: Path | str) -> InputError:
    """The error for an integer that no machine holds."""
    lengths = [max(map(len, _LONG.findall(line)), default=0) for line in text.splitlines()]
    return InputError(
        f"{file}, line {lengths.index(max(lengths)) + 1}: expected integers of at most {_BITS} "
        "bits, found one of more.",
        "Correct the number.",
    )


def _inside(value: Any) -> Iterator[Any]:
    if isinstance(value, Mapping):
        yield from value.values()
    elif isinstance(value, list):
        yield from value

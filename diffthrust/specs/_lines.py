"""Locate a key in the text of a spec file."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from diffthrust._support.errors import InputError


def line_of(text: str, file: Path | str, loc: Iterable[Any]) -> str:
    """The place of a key: file, line if it can be found, and the path of the key.

    The text is searched line by line, since Python's TOML parser keeps no line numbers.
    """
    path = tuple(str(key) for key in loc if not isinstance(key, int))
    line, best, table = 0, 0, ()
    for number, row in enumerate(text.splitlines(), 1):
        if header := re.match(r"\s*\[+([^\[\]]+)\]+\s*(#.*)?$", row):
            table = _split(header[1])
            here = table
        elif pair := re.match(r"\s*([\w\-.\"' ]+?)\s*=", row):
            here = (*table, *_split(pair[1]))
        else:
            continue
        joined, shared = ".".join(here), ".".join(path)
        if (shared == joined or shared.startswith(f"{joined}.")) and len(here) > best:
            line, best = number, len(here)
    # A missing key gets the line of its table, the longest part of its path that was found.
    at = f", line {line}" if line else ""
    return f"{file}{at}, {'.'.join(path)}" if path else f"{file}"


def _split(dotted: str) -> tuple[str, ...]:
    return tuple(a or b or c for a, b, c in re.findall(r'"([^"]*)"|\'([^\']*)\'|([^.\s]+)', dotted))


def with_place(text: str, path: Path, loc: Iterable[Any], error: InputError) -> InputError:
    """The same error, preceded by its place in the spec file."""
    return InputError(f"{line_of(text, path, loc)}: {error.problem}", error.mend)

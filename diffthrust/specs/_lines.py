"""Where in the text of a spec file a key stands."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any


def line_of(text: str, file: Path | str, loc: Iterable[Any]) -> str:
    """Where a key stands: file, line where it can be found, and the path of the key."""
    path = tuple(str(part) for part in loc if not isinstance(part, int))
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
    # a key that stands nowhere, because it is missing, is placed at its table
    at = f", line {line}" if line else ""
    return f"{file}{at}, {'.'.join(path)}" if path else f"{file}"


def _split(dotted: str) -> tuple[str, ...]:
    return tuple(a or b or c for a, b, c in re.findall(r'"([^"]*)"|\'([^\']*)\'|([^.\s]+)', dotted))

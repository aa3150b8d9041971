"""Docstrings as they are written here, made into what reStructuredText understands."""

from __future__ import annotations

import re
from collections.abc import Sequence

_SECTION = re.compile(r"^(Args|Returns|Raises|Attributes|Example|Examples|Note|Yields|Warns):\s*$")
_LITERAL = re.compile(r"(``.+?``|`[^`]+`)")


def as_rst(lines: Sequence[str]) -> list[str]:
    """Bars, stars and trailing underscores as text; indented equations as literal blocks."""
    converted: list[str] = []
    inside, code = "", False
    for number, line in enumerate(lines):
        if _SECTION.match(line):
            inside = line
        elif line and not line.startswith(" "):
            inside = ""
        example = inside.startswith("Example")
        blank_before = number > 0 and not lines[number - 1].strip()
        if code and line and not line.startswith("    "):
            code = False
        if not inside and line.startswith("    ") and blank_before and not code:
            converted += ["::", ""]
            code = True
        converted.append(line if example or code else _plain(line))
    return converted


def _plain(line: str) -> str:
    parts = _LITERAL.split(line)
    return "".join(part if i % 2 else _escaped(part) for i, part in enumerate(parts))


def _escaped(text: str) -> str:
    text = text.replace("|", "\\|")
    text = re.sub(r"(?<=\S)( ?)\*( ?)(?=[\w(|])", r"\1\\*\2", text)
    return re.sub(r"(\w)_(?=[\s,.;:)\]\\]|$)", r"\1\\_", text)

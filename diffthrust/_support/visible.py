"""Text from outside made fit to be shown: a file's name may hold orders for the terminal."""

from __future__ import annotations

import re

_UNSEEN = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\ud800-\udfff]")
"""What moves the cursor, colours or turns the text, or is no character at all."""
_BYTE = 0xDC00
"""Python keeps the bytes of a name that are no UTF-8 as characters from here on."""


def visible(text: str) -> str:
    r"""The text with an escape in place of each character that does not show.

    Ends of lines and tabs stay. Nothing else is told apart, so that the result is for people only.

    Example:
        >>> visible("run\x1b[31m.csv")
        'run\\x1b[31m.csv'
    """
    return _UNSEEN.sub(_escape, text)


def in_line(name: str) -> str:
    """A name as `visible` has it, and in one line whatever it holds."""
    return visible(name.replace("\n", "\\n").replace("\t", "\\t"))


def _escape(match: re.Match[str]) -> str:
    code = ord(match[0])
    if _BYTE <= code < _BYTE + 0x100:
        code -= _BYTE
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}"

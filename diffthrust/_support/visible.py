"""Text from outside, made safe to print: a file's name may hold control sequences."""

from __future__ import annotations

import re

_UNSEEN = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\ud800-\udfff]")
"""Control characters (cursor, colour), marks that reverse the text, and lone surrogates."""
_BYTE = 0xDC00
"""Python maps bytes of a file's name that are not UTF-8 to characters from here on (PEP 383)."""


def visible(text: str) -> str:
    """The text with an escape in place of each invisible character; line ends and tabs stay."""
    return _UNSEEN.sub(_escape, text)


def in_line(name: str) -> str:
    """A name as `visible` has it, and in one line whatever it holds."""
    return visible(name.replace("\n", "\\n").replace("\t", "\\t"))


def _escape(match: re.Match[str]) -> str:
    code = ord(match[0])
    if _BYTE <= code < _BYTE + 0x100:
        code -= _BYTE
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}"

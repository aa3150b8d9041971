"""Numbers as text, and helpers for English sentences about results."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable

_SPELT = {"deadband": "dead band", "coulomb": "Coulomb", "dc": "DC"}
_UNCOUNTED = (
    *("cavitation", "coupling", "damping", "degradation", "drag", "flow", "friction", "inflow"),
    *("relief", "thrusters", "wind"),
)


def number(value: float | None, digits: int = 4) -> str:
    """A number with some significant digits, ``-`` where there is none."""
    if value is None or math.isnan(value):
        return "-"
    if value == 0 or 1e-4 <= abs(value) < 1e6:
        places = digits - 1 - (math.floor(math.log10(abs(value))) if value else 0)
        return f"{value:.{min(max(places, 0), digits + 3)}f}"
    return f"{value:.{digits - 1}e}" if math.isfinite(value) else f"{value}"


def with_error(value: float, error: float | None) -> tuple[str, str]:
    """A value and its standard error, both to the second digit of the error."""
    if error is None or not error > 0 or not math.isfinite(value):
        return number(value), "-" if error is None else number(error, 2)
    places = 1 - math.floor(math.log10(error))
    if 0 <= places <= 8 and abs(value) < 1e6:
        return f"{value:.{places}f}", f"{error:.{places}f}"
    digits = 2
    if value:
        digits = max(2, 2 + math.floor(math.log10(abs(value))) - math.floor(math.log10(error)))
    return f"{value:.{min(digits, 12) - 1}e}", f"{error:.1e}"


def humanize(name: str) -> str:
    """A name of the code in words."""
    words = re.sub(r"\w+", lambda word: _SPELT.get(word[0], word[0]), name.replace("_", " "))
    return words.replace("half width", "half-width")


def an(words: str) -> str:
    """The words with their article, where they take one."""
    if words.endswith(_UNCOUNTED):
        return words
    return f"{'an' if words[0].lower() in 'aeiou' else 'a'} {words}"


def joined(words: Iterable[str], last: str = "and") -> str:
    """Words in a row: ``a``, ``a and b``, ``a, b and c``."""
    *first, final = [*words] or [""]
    return f"{', '.join(first)} {last} {final}" if first else final


def distinct_numbers(first: float, second: float) -> tuple[str, str]:
    """Two numbers with as many digits (two to four) as make them look different."""
    for digits in (2, 3):
        texts = number(first, digits), number(second, digits)
        if texts[0] != texts[1]:
            return texts
    return number(first, 4), number(second, 4)


def probability(p_value: float) -> str:
    """A p-value in words."""
    return "p < 0.001" if p_value < 0.001 else f"p = {number(p_value, 2)}"


def percent(share: float) -> str:
    """A share as a percentage; a small one is not rounded to zero."""
    return f"{100 * share:.{0 if share >= 0.0095 or share == 0 else 1}f} %"


def capitalised(words: str) -> str:
    """The words as the start of a sentence."""
    return words[:1].upper() + words[1:]


_COUNTS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")


def count_words(count: int) -> str:
    """A small number in words."""
    return _COUNTS[count] if count < len(_COUNTS) else "many"


def counted(count: int, noun: str) -> str:
    """So many of something."""
    return f"{count_words(count)} {noun}{'s' * (count != 1)}"

"""A text that a tired reader takes in: few words, few figures, the least important left out."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

_MOST_WORDS = 60
"""Display: of a summary. More is not read to its end on a ship; less cannot say what to do next."""
_MOST_FIGURES = 4
"""Display: of a summary: one size, an error before and after, and what is left of it."""
_FIGURE = re.compile(r"(?<![\w.^*])[-±]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w.]*\w)(?!/)")
"""A number that is read: none in a name ("run_2.csv", "14V") or in a unit ("m/s^2", "1/s")."""
_MORE = "More below."


class Wording(NamedTuple):
    """A wording of a part, and how much it matters that no shorter one takes its place."""

    text: str
    importance: int


Part = Sequence[Wording]
"""A part of a text, worded at several lengths, the longest first; then it is left out."""


def as_part(*wordings: tuple[int, str]) -> Part:
    """A part from how much each of its wordings matters, and its sentence without a full stop.

    From 1, how a law looks in full, over what is left (5) and the error (9) to 13, that anything
    was found at all.
    """

    def ended(text: str) -> str:
        line = text.startswith("Copy") and " = " in text  # is pasted into a spec file
        return text if line or text.endswith(("?", "]", "}", '"')) else f"{text}."

    return [Wording(ended(text), importance) for importance, text in wordings]


def words_in(text: str) -> int:
    """How many words a text has, each that is set off by blanks."""
    return len(text.split())


def figures_in(text: str) -> int:
    """How many figures a text has: "run_2.csv: 0.10 -> 0.052 m/s^2, 1e-3 V at 14V" has three."""
    return len(_FIGURE.findall(text))


def within_budget(parts: Sequence[Part]) -> str:
    """The parts as lines of at most `_MOST_WORDS` and `_MOST_FIGURES`, and whether more was to say.

    A part that says more is worded shorter, or left out.
    """
    left = [part for part in parts if part]

    def worded() -> str:
        lines = [_first(part) for part in left]
        return "\n".join([*filter(None, lines), *[_MORE] * (not all(lines))])

    # words last: leaving out a part for its figures adds that there is more
    for at, most in ((1, _MOST_FIGURES), (0, _MOST_WORDS)):
        while _sizes(worded())[at] > most:
            # a part that is left out loses all its wordings, not its longest alone
            lost = {k: part[:count] for k, part in enumerate(left) if (count := _longer(part, at))}
            least = min(lost, key=lambda k: max(wording.importance for wording in lost[k]))
            left[least] = left[least][len(lost[least]) :]
    return worded()


def _first(part: Part) -> str:
    return part[0].text if part else ""


def _sizes(text: str) -> tuple[int, int]:
    return words_in(text), figures_in(text)


def _longer(part: Part, at: int) -> int:
    """How many wordings stand before one of fewer words, or of fewer figures; 0 if none is left."""
    now = _sizes(_first(part))
    for count in range(1, len(part) + 1):
        then = _sizes(_first(part[count:]))
        if then[at] < now[at] and then[1 - at] <= now[1 - at]:
            return count
    return 0

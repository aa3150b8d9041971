"""Reports as plain data: sections of sentences, tables and figures.

A folder states once what a result reports. The terminal (`tables`), notebooks (`notebook`) and
pages (`page`) read the same data, so that none of them can omit something.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from diffthrust._support.literals import ToCopy

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from diffthrust._support.live import Live

Style = Literal["", "strong", "quiet", "good", "bad", "doubtful", "term"]


class Styled(str):
    """Text, and what it is: each medium has a weight and a colour for that."""

    style: Style
    breakable: bool

    def __new__(cls, text: str, style: Style) -> Styled:
        styled = super().__new__(cls, text)
        styled.style = style
        styled.breakable = not isinstance(text, ToCopy)
        return styled


@dataclass(frozen=True)
class Rows:
    """A table as text.

    Args:
        headings: one for each column; none for a table without a line of headings.
        blocks: rows that belong together, each with a cell for every column.
        numbers: indices of the columns that hold numbers, which are set to the right.
        unbroken: indices of columns whose cells are never folded.
    """

    headings: tuple[str, ...]
    blocks: tuple[tuple[tuple[str, ...], ...], ...]
    numbers: Collection[int] = ()
    unbroken: Collection[int] = ()

    @classmethod
    def of(
        cls,
        headings: Iterable[str],
        rows: Iterable[Iterable[str]],
        *,
        numbers: Iterable[int] = (),
        unbroken: Iterable[int] = (),
    ) -> Rows:
        """A table whose rows all belong together."""
        block = tuple(tuple(row) for row in rows)
        return cls(tuple(headings), (block,), tuple(numbers), tuple(unbroken))

    def __bool__(self) -> bool:
        return any(self.blocks)


class Line(tuple[str, ...]):
    """One line of several pieces, some of them `Styled`."""


class Bullets(tuple[str, ...]):
    """Sentences that are listed, each with a mark before it."""


@dataclass(frozen=True)
class Outcome:
    """The conclusion of a report: a label such as "Status", a word, and a few sentences."""

    label: str
    word: Styled
    sentences: str


@dataclass(frozen=True)
class Picture:
    """A figure, which only pages show; ``live`` makes one that lives, where it can."""

    draw: Callable[[], Figure]
    caption: str
    live: Callable[[], Live | None] = lambda: None


@dataclass(frozen=True)
class OnPage:
    """Content of pages only: explanations for readers who do not have the library."""

    part: Text

    def __bool__(self) -> bool:
        return bool(self.part)


Text = str | Line | Bullets | Rows | Outcome
Part = Text | Picture | OnPage


class Section:
    """Parts of a report under one heading, the empty ones left out; it may be shown ``folded``."""

    def __init__(self, title: str, *parts: Part, folded: bool = False) -> None:
        self.title: str = title
        self.folded: bool = folded
        self.parts: tuple[Part, ...] = tuple(part for part in parts if part)

    def fold(self) -> Section:
        """The same, folded."""
        return Section(self.title, *self.parts, folded=True)

    @property
    def texts(self) -> tuple[Text, ...]:
        """What terminals and notebooks show."""
        return tuple(p for p in self.parts if not isinstance(p, Picture | OnPage))


class Report:
    """Sections in order; those without any content are left out."""

    def __init__(self, *sections: Section) -> None:
        self.sections: tuple[Section, ...] = tuple(section for section in sections if section.parts)


def notes(sentences: Iterable[str]) -> tuple[str, ...]:
    """Remarks at the end of a report."""
    return tuple(f"Note: {sentence}" for sentence in sentences)


def closing_section(lines: Iterable[str]) -> Section:
    """The last lines of a report: where it comes from, and what to copy."""
    return Section("", *(Styled(line, "quiet") for line in lines))

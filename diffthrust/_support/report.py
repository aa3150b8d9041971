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
    """Text with the weight and colour that `STYLES` of a medium give it.

    Args:
        text: a sentence, or a piece of one.
        style: what the text is, not how it looks.
    """

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
    """The conclusion of a report: a word, and a few sentences.

    Args:
        label: what the word is, such as "Status".
        word: the outcome, ``Styled`` as good or bad.
        sentences: what it means.
    """

    label: str
    word: Styled
    sentences: str


@dataclass(frozen=True)
class Picture:
    """A figure, which only pages show.

    Args:
        draw: makes the figure.
        caption: what it shows.
        live: makes one that lives, for readers with a script; ``None`` where it cannot.
    """

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
    """Parts of a report under one heading; those that are empty are left out.

    Args:
        title: the heading; none if empty.
        parts: what stands under it, in order.
        folded: whether pages and notebooks show it only where a reader opens it.
    """

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

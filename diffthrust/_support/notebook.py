"""Reports as HTML for notebooks, which keep inline styles and strip style sheets."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from html import escape

from diffthrust._support.report import Bullets, Line, Outcome, Report, Rows, Section, Styled, Text
from diffthrust._support.visible import visible

_STYLES = {
    "strong": "font-weight: bold",
    "quiet": "opacity: .6",
    "good": "color: #00694d; font-weight: bold",
    "bad": "color: #b04a00; font-weight: bold",
    "doubtful": "color: #8a6d00; font-weight: bold",
    "term": "color: #006680; font-weight: bold",
}
_LINE = '<div style="white-space: pre-wrap; min-height: .6em">{}</div>'


def notebook_html(report: Report) -> str:
    """The report as one block: sentences as paragraphs, tables as tables, the folded part last."""
    told = [section for section in report.sections if section.texts]
    shown, folded = ([s for s in told if s.folded == fold] for fold in (False, True))
    body = _sections(shown)
    if folded:
        body += f"<details><summary>Details</summary>{_sections(folded)}</details>"
    return f'<div style="max-width: 60em">{body}</div>'


def _sections(sections: Iterable[Section]) -> str:
    return "".join(piece for i, section in enumerate(sections) for piece in _section(section, i))


def _section(section: Section, index: int) -> Iterator[str]:
    if index:
        yield _LINE.format("")
    if section.title:
        yield _LINE.format(_marked(Styled(section.title, "strong")))
    for text in section.texts:
        yield from _text(text)


def _text(text: Text) -> Iterator[str]:
    if isinstance(text, Rows):
        yield _table(text)
    elif isinstance(text, Bullets):
        yield from (_LINE.format(f"- {_marked(sentence)}") for sentence in text)
    elif isinstance(text, Outcome):
        yield _LINE.format(f"<b>{escape(text.label)}: </b>{_marked(text.word)}")
        yield _LINE.format(_marked(text.sentences))
    else:
        pieces = text if isinstance(text, Line) else (text,)
        yield _LINE.format("".join(map(_marked, pieces)))


def _table(rows: Rows) -> str:
    aligned = [
        f"padding: .1em .5em; text-align: {'right' if column in rows.numbers else 'left'}"
        for column in range(len(rows.headings or rows.blocks[0][0]))
    ]
    headings = "".join(
        f'<th style="{align}">{_marked(heading)}</th>'
        for align, heading in zip(aligned, rows.headings, strict=False)
    )
    head = f"<thead><tr>{headings}</tr></thead>" if headings else ""
    lines = []
    for index, block in enumerate(filter(None, rows.blocks)):
        for i, row in enumerate(block):
            rule = "; border-top: 1px solid #8888" if index and not i else ""
            cells = zip(aligned, row, strict=True)
            lines.append("".join(f'<td style="{a}{rule}">{_marked(c)}</td>' for a, c in cells))
    body = "".join(f"<tr>{line}</tr>" for line in lines)
    style = "margin: .5em 0; border-collapse: collapse"
    return f'<table style="{style}">{head}<tbody>{body}</tbody></table>'


def _marked(text: str) -> str:
    words = escape(visible(text))
    style = _STYLES.get(text.style) if isinstance(text, Styled) else None
    return f'<span style="{style}">{words}</span>' if style else words

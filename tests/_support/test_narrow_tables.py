"""Tables lose nothing where they are narrow, and are tables in notebooks."""

from __future__ import annotations

import re

import numpy as np
import pytest
from presentation import Report, Rows, Section, Styled, notebook_html, plain_text, report_text

WORDS = ("speed", "thruster", "with", "a", "command_deadband", "[rad/s]", "staircase.csv", "N")


def printed(table: Rows, width: int) -> list[str]:
    return plain_text(Report(Section("", table)), width).splitlines()


def made(seed: int) -> Rows:
    """A table of two to nine columns, of words and of numbers, as they come."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 10))
    numbers = [i for i in range(1, count) if rng.random() < 0.6]

    def cell(column: int) -> str:
        if column in numbers:
            return f"{rng.normal() * 10.0 ** rng.integers(-6, 6):.5g}"
        return " ".join(rng.choice(WORDS, rng.integers(1, 7)))

    headings = [" ".join(rng.choice(WORDS, rng.integers(1, 3))) for _ in range(count)]
    rows = [[cell(i) for i in range(count)] for _ in range(4)]
    return Rows.of(headings, rows, numbers=numbers)


@pytest.mark.parametrize("width", [60, 80, 100])
@pytest.mark.parametrize("seed", range(40))
def test_no_word_and_no_number_is_cut(seed, width):
    table = made(seed)
    lines = printed(table, width)
    assert max(map(len, lines)) <= width
    seen = " ".join(lines).split()
    (rows,) = table.blocks
    for i, column in enumerate(zip(table.headings, *rows, strict=True)):
        for cell in column:
            for word in cell.split():
                assert word in seen
                seen.remove(word) if i else None
    assert not any("…" in line for line in lines)


def test_what_fits_is_one_table_without_wrapped_cells():
    table = Rows.of(("Channel", "RMSE", "Unit"), [("speed", "0.21", "rad/s")] * 3, numbers=(1,))
    assert [line.rstrip() for line in printed(table, 80)] == [
        "Channel  RMSE  Unit",
        *["speed    0.21  rad/s"] * 3,
    ]


def test_columns_that_do_not_fit_go_on_below_beside_the_first_ones():
    headings = ("Log", "Channel", *(f"number_{i}" for i in range(9)))
    rows = [(log, "speed", *[f"{i}.125" for i in range(9)]) for log in ("a", "b")]
    lines = printed(Rows.of(headings, rows, numbers=range(2, 11)), 60)
    tops = [line.split() for line in lines if line.startswith("Log")]
    assert len(tops) == 3
    assert ["Log", "Channel", *(name for top in tops for name in top[2:])] == list(headings)
    assert all(top[:2] == ["Log", "Channel"] for top in tops)


def test_a_report_is_as_wide_as_the_terminal_and_no_wider_than_a_page(monkeypatch):
    prose = Report(Section("", "word " * 60))
    for columns, widest in (("50", 50), ("80", 80), ("500", 100)):
        monkeypatch.setenv("COLUMNS", columns)
        assert widest - 5 < max(map(len, report_text(prose).splitlines())) <= widest


def test_a_notebook_gets_tables_whose_texts_are_no_markup():
    rows = [("<b>[bold]x[/bold]", "1.5"), ("y", "2.25")]
    table = Rows.of(("Name [rad/s]", "Value"), rows, numbers=(1,))
    page = notebook_html(Report(Section("", "Status & more", table)))
    assert page.count("<tr>") == 3
    assert "Status &amp; more" in page
    assert "&lt;b&gt;[bold]x[/bold]" in page
    assert "Name [rad/s]" in page
    assert re.search(r"text-align: right[^>]*>2\.25<", page)


def test_a_notebook_shows_weights_colours_and_blocks():
    table = Rows(("a", "b"), ((("1", "2"),), ((Styled("3", "strong"), "4"),)))
    page = notebook_html(Report(Section("", Styled("failed", "bad"), table)))
    assert re.search(r"color: #[0-9a-f]{6}[^>]*font-weight: bold[^>]*>failed", page)
    assert re.search(r"font-weight: bold[^>]*>3<", page)
    assert page.count("border-top") == 2

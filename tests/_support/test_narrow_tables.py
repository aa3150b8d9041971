"""Tables lose nothing where they are narrow, and are tables in notebooks."""

from __future__ import annotations

import re

import numpy as np
import pytest
from rich.console import Console
from rich.text import Text

from diffthrust._support.tables import (  # private: the looks of all tables
    FittedTable,
    html,
    plain_table,
    rendered,
    texts_table,
    together,
)

WORDS = ("speed", "thruster", "with", "a", "command_deadband", "[rad/s]", "staircase.csv", "N")


def printed(table: FittedTable, width: int) -> list[str]:
    console = Console(width=width, force_terminal=False, force_jupyter=False, color_system=None)
    with console.capture() as capture:
        console.print(table)
    return capture.get().splitlines()


def made(seed: int) -> FittedTable:
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
    return texts_table(headings, rows, numbers)


@pytest.mark.parametrize("width", [60, 80, 100])
@pytest.mark.parametrize("seed", range(40))
def test_no_word_and_no_number_is_cut(seed, width):
    table = made(seed)
    lines = printed(table, width)
    assert max(map(len, lines)) <= width
    seen = " ".join(lines).split()
    for column in table.columns:
        for cell in (column.header, *column.cells):
            for word in str(cell).split():
                assert word in seen
                seen.remove(word) if column not in table.columns[:1] else None
    assert not any("…" in line for line in lines)


def test_what_fits_is_one_table_without_wrapped_cells():
    table = texts_table(("Channel", "RMSE", "Unit"), [("speed", "0.21", "rad/s")] * 3, (1,))
    assert [line.rstrip() for line in printed(table, 80)] == [
        "Channel  RMSE  Unit",
        *["speed    0.21  rad/s"] * 3,
    ]


def test_columns_that_do_not_fit_go_on_below_beside_the_first_ones():
    headings = ("Log", "Channel", *(f"number_{i}" for i in range(9)))
    rows = [(log, "speed", *[f"{i}.125" for i in range(9)]) for log in ("a", "b")]
    lines = printed(texts_table(headings, rows, range(2, 11)), 60)
    tops = [line.split() for line in lines if line.startswith("Log")]
    assert len(tops) == 3
    assert ["Log", "Channel", *(name for top in tops for name in top[2:])] == list(headings)
    assert all(top[:2] == ["Log", "Channel"] for top in tops)


def test_a_report_is_as_wide_as_the_terminal_and_no_wider_than_a_page(monkeypatch):
    prose = Text("word " * 60)
    for columns, widest in (("50", 50), ("80", 80), ("500", 100)):
        monkeypatch.setenv("COLUMNS", columns)
        assert widest - 5 < max(map(len, rendered(prose).splitlines())) <= widest


def test_a_notebook_gets_tables_whose_texts_are_no_markup():
    rows = [("<b>[bold]x[/bold]", "1.5"), ("y", "2.25")]
    page = html(together("Status & more", texts_table(("Name [rad/s]", "Value"), rows, (1,))))
    assert page.count("<tr>") == 3
    assert "Status &amp; more" in page
    assert "&lt;b&gt;[bold]x[/bold]" in page
    assert "Name [rad/s]" in page
    assert re.search(r"text-align: right[^>]*>2\.25<", page)


def test_a_notebook_shows_weights_colours_and_sections():
    table = plain_table("a", "b")
    table.add_row("1", "2")
    table.add_section()
    table.add_row("3", "4", style="bold")
    page = html(together(Text("failed", style="bold red"), table))
    assert re.search(r"color: #[0-9a-f]{6}[^>]*font-weight: bold[^>]*>failed", page)
    assert page.count("border-top") == 2

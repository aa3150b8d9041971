"""What is shown of text that comes from outside, and what a misspelt name most likely meant."""

from __future__ import annotations

from presentation import Report, Rows, Section, in_line, nearest, report_text, visible

from diffthrust import InputError


def test_what_does_not_show_becomes_an_escape():
    assert visible("a\x1b[2Jb\x07\x9b\x7f") == "a\\x1b[2Jb\\x07\\x9b\\x7f"
    assert visible("turned \u202e\u2066") == "turned \\u202e\\u2066"
    assert visible("byte \udcff, half \ud800") == "byte \\xff, half \\ud800"
    plain = "a\tb\nc \N{DEGREE SIGN}C \N{GREEK SMALL LETTER ALPHA} \U0001f6a4"
    assert visible(plain) == plain
    assert in_line("a\tb\nc") == "a\\tb\\nc"


def test_messages_and_tables_hold_no_orders_for_the_terminal():
    error = InputError("run\x1b[31m.csv: bad.", "rename \x1b]0;x\x07 it.")
    assert str(error) == "run\\x1b[31m.csv: bad.\nMend: rename \\x1b]0;x\\x07 it."
    table = Rows.of(["Name"], [["run\x1b[31m.csv"]])
    assert "\x1b" not in report_text(Report(Section("", table)))
    assert report_text(Report(Section("", "[red]run\x1b"))) == "[red]run\\x1b\n"


def test_letters_that_changed_places_are_seen_through():
    columns = ["t_ms", "rpm", "pwm", "thrust_kgf"]
    assert nearest("pmw", columns) == "the nearest is 'pwm'"
    assert nearest("Rmp ", columns) == "the nearest is 'rpm'"
    assert nearest("thrust", columns, "; ") == "; the nearest is 'thrust_kgf'"
    assert nearest("heading", columns) == ""

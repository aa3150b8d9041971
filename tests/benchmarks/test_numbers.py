"""The measured numbers of the texts stand where they are said to, and are those of a run."""

import re

import pytest
from places import ROOT

from benchmarks import numbers

QUICK = [claim for claim in numbers.CLAIMS if claim.compute and not claim.long]
PAGES = ["README.md", *(f"docs/{page.name}" for page in sorted((ROOT / "docs").glob("*.md")))]
CHOSEN = {"5 %", "95 %"}
"""Shares that nobody measured: levels of intervals and tests."""


@pytest.mark.parametrize("claim", numbers.CLAIMS, ids=lambda claim: claim.text[:30])
def test_each_text_stands_where_it_is_said_to(claim):
    assert len(claim.told) == claim.text.count("{}")


@pytest.mark.parametrize("claim", QUICK, ids=lambda claim: claim.where)
def test_numbers_that_take_seconds_are_those_of_a_run(claim):
    assert not numbers.differing(claim.told, claim.compute())


@pytest.mark.parametrize("page", PAGES)
def test_every_share_and_ratio_of_a_page_has_its_run(page):
    found = set(re.findall(r"\d+(?:\.\d+)? (?:%|times)", (ROOT / page).read_text(encoding="utf-8")))
    claims = [claim for claim in numbers.CLAIMS if claim.where == page]
    told = {f"{number} {unit}" for claim in claims for number in claim.told
            for unit in ("%", "times")}  # fmt: skip
    assert not found - told - CHOSEN


def test_what_differs_is_told_to_the_digits_of_the_text():
    assert numbers.differing(["94.8", "49"], [94.83, 49.4]) == []
    assert numbers.differing(["94.8", "49"], [94.86, 49.6]) == ["94.86 for 94.8", "49.6 for 49"]


def test_a_text_that_was_changed_and_a_number_that_moved_end_with_1(monkeypatch, capsys):
    true = numbers.Claim("docs/many.md", "On {} simulated fleets", "a command", lambda: [40.0])
    monkeypatch.setattr(numbers, "CLAIMS", (true,))
    assert numbers.main([]) == 0
    monkeypatch.setattr(numbers, "CLAIMS", (true, numbers.Claim(true.where, "{} fleas", "none")))
    assert numbers.main([]) == 1
    moved = numbers.Claim(true.where, true.text, "a command", lambda: [41.0])
    monkeypatch.setattr(numbers, "CLAIMS", (moved,))
    assert numbers.main(["README.md"]) == 0  # of another file
    assert numbers.main(["docs/many.md"]) == 1
    assert "41.0 for 40" in capsys.readouterr().out

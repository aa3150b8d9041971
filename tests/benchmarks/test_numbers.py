"""The measured numbers of the texts stand where they are said to, and are those of a run."""

import re

import pytest
from places import ROOT, docs_pages

from benchmarks import numbers, pages

QUICK = [claim for claim in numbers.CLAIMS if claim.compute and not claim.long]
MADE = pages.rendered()
"""Pages of measured numbers, with commit and machine, as a script writes them."""
PAGES = ["README.md", *(str(page.relative_to(ROOT)) for page in docs_pages() if page not in MADE)]
CHOSEN = {"5 %", "90 %", "95 %"}
"""Shares that nobody measured: levels of intervals and tests."""


@pytest.mark.parametrize("claim", numbers.CLAIMS, ids=lambda claim: claim.text[:30])
def test_each_text_stands_where_it_is_said_to(claim):
    assert len(claim.told) == claim.text.count("{}")


@pytest.mark.thorough
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
    true = numbers.Claim(
        "docs/guides/many.md", "On {} simulated fleets", "a command", lambda: [40.0]
    )
    monkeypatch.setattr(numbers, "CLAIMS", (true,))
    assert numbers.main([]) == 0
    monkeypatch.setattr(numbers, "CLAIMS", (true, numbers.Claim(true.where, "{} fleas", "none")))
    assert numbers.main([]) == 1
    moved = numbers.Claim(true.where, true.text, "a command", lambda: [41.0])
    monkeypatch.setattr(numbers, "CLAIMS", (moved,))
    assert numbers.main(["README.md"]) == 0  # of another file
    assert numbers.main(["docs/guides/many.md"]) == 1
    assert "41.0 for 40" in capsys.readouterr().out


@pytest.mark.parametrize("page", MADE, ids=lambda page: page.stem)
def test_pages_of_measured_numbers_are_as_the_script_writes_them(page):
    assert page.read_text(encoding="utf-8") == MADE[page]


def test_results_of_a_bench_and_of_a_comparison_become_rows():
    rows = [{"group": g, "kind": g, "right": g != "pairs", "ratio": r}
            for g, r in (("clear", 1.01), ("vessel", 1.2), ("pairs", None))]  # fmt: skip
    missed = {"group": "outside", "kind": "outside/load_hump", "seed": 5, "right": False,
              "ratio": None, "unseen": [1.0], "diagnosis": None}  # fmt: skip
    run = pages.of_bench([*rows, missed], seed=7)
    assert run["classes"] == {"clear": [2, 2], "pairs": [0, 1], "outside": [0, 1]}
    assert run["learned"]["close to the plant, where it halves the error"] == [0, 1]
    assert "learned" not in pages.of_bench(rows, seed=7)
    assert run["close"] == [1, 2]
    page = pages.bench_page({"notes": "None.", "runs": [run]})
    assert "| one effect, clear (thrusters, vessels) | 2 of 2 |" in page
    assert "| learned where nothing is hidden | 0 of 0 | at most 5 % | 0 to 100 % |" in page
    same = {"job": "simulation", "platform": "cpu", "status": "ok", "size": 1000}
    cells = [{**same, "tool": t, "seconds": s} for t, s in (("diffthrust", 2e-3), ("numba", 1e-3))]
    settings = {"repeats": 3, "limit": 30.0}
    machine = {"cores": 2, "processor": "x86_64", "python": "3.11", "versions": {"jax": "0.10"}}
    document = {"cells": cells, "growth": [], "settings": settings, "machine": machine}
    told = [row["told"] for row in pages.of_peers(document)["rows"]]
    assert told == ["2 ms", "0.5"]

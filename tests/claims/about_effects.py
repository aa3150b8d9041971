"""Claims of what effects remove, of what remains, and of what was learned."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import numpy as np
from reference import equations
from reference import whole_runs as wr

from .about_errors import SIMULATED
from .page import Page
from .parsing import NUMBER, SHARE, WORTH, claim, error_of, in_words, is_said, shares_in, worth_is

REMOVED = 0.05
"""Shares of squared errors may differ by this much: of one fit of whole runs and of another."""


@claim(rf"Of the squared error over whole runs of (?P<logs>[a-z ]+?) each removes: (?P<list>.+? "
       rf"{WORTH})\.")  # fmt: skip
def _each_removes(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    for words, worth in re.findall(rf"(?:^|, |and )([^,()]+?) ({WORTH})", m["list"]):
        yield from _removes(words, worth, diag.worth, diag)
        names = [n for n in diag.added if in_words(n) == words.strip()]
        if page and names:
            yield from _plainly(names[0], worth, diag, page)


def _removes(words: str, text: str, worths: Any, diag: Any) -> Iterator[str]:
    names = [n for n in worths if in_words(n) == re.sub(r"^(?:an?|or) ", "", words.strip())]
    if len(names) != 1:
        yield f"{words!r} is of no worth"
    elif not worth_is(text, worths[names[0]]):
        yield f"{names[0]} removes {worths[names[0]]}"
    share, low, high = shares_in(text)
    if np.isfinite([share, low, high]).all() and not low <= share <= high:
        yield "its share lies outside its interval"
    if not np.isfinite([low, high]).all():
        yield "an interval that excludes nothing is no worth"


def _plainly(name: str, text: str, diag: Any, page: Page) -> Iterator[str]:
    """The share by two plain least squares: of all that was added, and of all but one."""
    from dataclasses import replace

    less = replace(
        diag.fit,
        model=diag.fit.model - name,
        parameters={n: e for n, e in diag.fit.parameters.items() if not n.startswith(f"{name}.")},
    )
    try:
        given, last, without = (page.plain(f) for f in (diag.stages[0].fit, diag.fit, less))
    except equations.Unwritten:
        return
    first, with_it, without_it = (
        wr.errors(f.system, page.judged, f.values)["all"] ** 2 for f in (given, last, without)
    )
    share = (without_it - with_it) / first
    _, low, high = shares_in(text)
    if not low - REMOVED <= share <= high + REMOVED:
        yield f"{name} removes {share:.2f} by a plain least squares"


@claim(r"These logs also show (?P<list>.+?): certain from one sample to the next, but over whole "
       r"runs without a change that surely matters\.")  # fmt: skip
def _also(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    for name in diag.detectable:
        if in_words(name) not in m["list"]:
            yield f"{name} is detectable"
    for words, worth in re.findall(rf"([^,()]+?) \(it removes ({WORTH}) of", m["list"]):
        first = re.sub(r"^and ", "", words.strip()).partition(" or ")[0]
        yield from _removes(first, worth, diag.worth, diag)


@claim(rf"Possible, judged by whole runs alone, with the share of the squared error on "
       rf"(?P<logs>[a-z ]+?) that each would remove: (?P<list>.+? {WORTH})\.")  # fmt: skip
def _possible(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    for words, worth in re.findall(rf"(?:^|, |or )([^,()]+?) ({WORTH})", m["list"]):
        yield from _removes(words, worth, diag.possible, diag)


@claim(r"Structure (?P<still>still )?remains that no known effect explains: "
       r"(?P<manner>it enters at|it scales what passes) (?P<place>.+?) and depends on "
       rf"(?P<on>.+?), which explains (?P<share>{SHARE}) of the squared one-step errors "
       r"there\.")  # fmt: skip
def _remains(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    remaining = diag.remaining
    if remaining is None:
        yield "nothing remains"
        return
    if (m["manner"] == "it enters at") != (remaining.manner == "adds"):
        yield f"it {remaining.manner}"
    if f"'{remaining.port}'" not in m["place"] or m["on"] != str(remaining.depends_on):
        yield f"it is at {remaining.port}, by {remaining.depends_on}"
    if not is_said(m["share"].removesuffix(" %"), 100 * remaining.share):
        yield f"it explains {remaining.share:.3g}"
    if page and page.hidden is not None:
        if page.law is None:
            yield "known effects explain all"
        elif remaining.port not in page.law[0] or not re.search(page.law[1], m["on"]):
            yield f"it is at {page.law[0]}, by {page.law[1]}"


@claim(r"Structure remains that no known effect explains: over whole runs of [a-z ]+? a flexible "
       r"model of these signals explains (?P<shares>.+?), so it is repeatable; where it enters is "
       r"not clear\.")  # fmt: skip
def _repeats(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    shares = re.findall(rf"({SHARE}) \(({SHARE}) to ({SHARE})\) of the squared ([a-zA-Z ]+?) error",
                        m["shares"])  # fmt: skip
    for share, low, high, words in shares:
        room = diag.room.channels[words.replace(" ", "_")]
        for text, value in zip((share, low, high), (room.share, room.low, room.high), strict=True):
            if not is_said(text.removesuffix(" %"), 100 * max(value, 0.0)):
                yield f"{words}: {text} is {value:.3g}"
        if page and page.best:
            first = error_of(diag.judged, words.replace(" ", "_"))[1]
            true = 1.0 - (page.best[words.replace(" ", "_")] / first) ** 2
            if true > shares_in(high)[0] + REMOVED:
                yield f"{words}: the truth removes {true:.2f}, more than at most {high}"


@claim(r"Structure remains that no known effect explains; its place is not clear\.")
def _placeless(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    if diag.verdict != "unexplained" or diag.remaining is not None:
        yield f"verdict {diag.verdict}, remaining {diag.remaining}"


@claim(rf"Learned: at (?P<place>.+?'(?P<port>\w+)'.*?) (?P<manner>what passes is scaled by a curve "
       r"of|a curve of) (?P<of>.+?)(?: is added)?(?P<bare>, for which no closed form was found)?\. "
       rf"Of the squared error over whole runs of [a-z ]+? it removes (?P<worth>{WORTH}); with it "
       rf"the NRMSE there is (?P<last>{NUMBER}), as given (?P<first>{NUMBER})\."
       r"(?: These logs determine it from .+? to .+? only\.)?")  # fmt: skip
def _learned(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    laws = [law for law in diag.laws if law.curve.port == m["port"]]
    if not laws:
        yield f"no law is at {m['port']}"
        return
    if not any(worth_is(m["worth"], law.worth) for law in laws):
        yield f"it removes {laws[0].worth}"
    reported = [(law.reported.holdout or law.reported.train).nrmse for law in laws]
    if not any(is_said(m["last"], nrmse, SIMULATED) for nrmse in reported):
        yield f"NRMSE {m['last']} is {reported}"
    if not is_said(m["first"], diag.before.errors.nrmse, SIMULATED):
        yield f"NRMSE {m['first']} is {diag.before.errors.nrmse:.3g}"
    if page and page.hidden is not None:
        if page.law is None:
            yield "no unknown law is hidden"
        elif m["port"] not in page.law[0] or not re.search(page.law[1], m["of"]):
            yield f"it is at {page.law[0]}, by {page.law[1]}"


@claim(r"(?:These logs cannot tell this from another form: .+?|"
       r"(?:It|What is added|Its factor) .+?: [^.]*?(?:\d\.\d+[^.]*?)*?, with .+?)"
       r"(?<=[\w)\]])\.")  # fmt: skip
def _form(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    tried = [t for law in diag.laws for t in (law.form, *law.alike) if t]
    sizes = [e.shown[0] for t in tried for n, e in t.fit.parameters.items()]
    if not any(t.formula.expression in m[0] for t in tried):
        yield "no law has this form"
    for number in re.findall(rf"= ({NUMBER})", m[0].rpartition(", with ")[2]):
        if not any(is_said(number, size, 1e-9) for size in sizes):
            yield f"no number of a law is {number}"


@claim(r"[A-Z][\w ,]+? only imitated it, or did nothing beside it\.")
def _imitated(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    for name in (name for law in diag.laws for name in law.superfluous):
        if in_words(name).lower() not in m[0].lower():
            yield f"{name} is superfluous"

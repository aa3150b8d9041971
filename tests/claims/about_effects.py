"""Claims of what effects remove, of what remains, and of what was learned."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from reference import equations
from reference import whole_runs as wr

from .about_errors import SIMULATED
from .page import Page
from .parsing import (
    NUMBER,
    SHARE,
    WORTH,
    all_shares,
    claim,
    error_of,
    in_words,
    is_provisional,
    is_said,
    shares_in,
    worth_is,
)

REMOVED = 0.05
"""Shares of squared errors may differ by this much: of one fit of whole runs and of another."""
SURE = 5e-4
"""A smaller lower end of an interval is printed as zero."""


@claim(rf"Of the squared (?:(?P<channel>[a-zA-Z ]+?) )?error (?:of all channels )?as given over "
       rf"whole runs of (?P<logs>unseen logs|the training logs|training and unseen logs) "
       rf"(?:each removes, added in this order: )?(?P<list>.+? {WORTH})\.")  # fmt: skip
def _each_removes(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    channel, everywhere = _whole(m)
    shares = re.findall(rf"(?:^|, |and )([^,()]+?)(?: removes?)? ({WORTH})", m["list"])
    if sum(shares_in(text)[0] for _, text in shares) > 1.0 + 0.005 * len(shares):
        yield "more is removed than there is"
    whole = {n: w for n in diag.worth if (w := _of(diag.worth[n], channel, everywhere))}
    said = []
    for words, text in shares:
        names = [n for n in diag.added if n in whole and _shared(n, diag) == words.strip()]
        said += names[:1]
        yield from _removes(words, text, names, whole)
        if page and names:
            yield from _plainly(names, text, channel, everywhere, diag, page)
    if said != sorted(said, key=diag.added.index):
        yield "they were added in another order"


def _whole(m: re.Match) -> tuple[str, bool]:
    """Of which error shares are told: the channel, and whether of training logs, too."""
    return (m["channel"] or "").replace(" ", "_"), m["logs"] == "training and unseen logs"


def _shared(name: str, diag: Any) -> str:
    """An effect, or those with which it has one share together, in words."""
    together = diag.worth[name].together
    return " and ".join(map(in_words, together)) + " together" if together else in_words(name)


def _of(worth: Any, channel: str, everywhere: bool) -> Any:
    """The share that is told, ``None`` where there is none of that channel."""
    worth = worth.everywhere if everywhere else worth
    return worth.channels.get(channel) if worth and channel else worth


def _named(words: str, worths: Any) -> list[str]:
    return [n for n in worths if in_words(n) == re.sub(r"^(?:an?|or) ", "", words.strip())]


def _removes(words: str, text: str, names: Sequence[str], worths: Any) -> Iterator[str]:
    if not names:
        yield f"{words!r} is of no worth"
    elif not worth_is(text, worths[names[0]]):
        yield f"{names[0]} removes {worths[names[0]]}"
    share, low, high = shares_in(text)
    if np.isfinite([share, low, high]).all() and not low <= share <= high:
        yield "its share lies outside its interval"
    if not low > 0 or not np.isfinite(high):
        yield "an interval that excludes nothing is no worth"


@claim(rf"Beside all others, of the squared (?:(?P<channel>[a-zA-Z ]+?) )?error (?:of all "
       rf"channels )?that is left without it over whole runs of (?P<logs>unseen logs|the training "
       rf"logs|training and unseen logs) (?:each removes: )?(?P<list>.+? {WORTH})\.")  # fmt: skip
def _beside_others(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    channel, everywhere = _whole(m)
    beside = {n: diag.worth[n].beside_others for n in diag.added if n in diag.worth}
    whole = {n: w for n in beside if (w := _of(beside[n], channel, everywhere))}
    for words, text in re.findall(rf"(?:^|, |and )([^,()]+?)(?: removes)? ({WORTH})", m["list"]):
        names = _named(words, whole)
        yield from _removes(words, text, names, whole)
        if page and names and not diag.laws:
            yield from _by_leaving_out(names[0], text, channel, everywhere, diag, page)


def _by_leaving_out(
    name: str, text: str, channel: str, everywhere: bool, diag: Any, page: Page
) -> Iterator[str]:
    """The share by plain least squares of the last stage, with the effect and without it."""
    runs = [*page.train, *page.unseen] if everywhere else page.judged
    try:
        fits = page.plain(diag.fit), page.plain(diag.fit, without=name)
    except equations.Unwritten:
        return
    last, fewer = (wr.errors(f.system, runs, f.values)[channel or "all"] ** 2 for f in fits)
    _, low, high = shares_in(text)
    if not low - REMOVED <= 1.0 - last / fewer <= high + REMOVED:
        yield f"beside the others {name} removes {1.0 - last / fewer:.2f} by a plain least squares"


def _plainly(
    names: Sequence[str], text: str, channel: str, everywhere: bool, diag: Any, page: Page
) -> Iterator[str]:
    """The share by plain least squares of the stages: the fall where the effects came."""
    squares = []
    for before, stage in pairwise(diag.stages):
        if {*before.effects} - {*stage.effects}:
            return  # one effect has taken the place of another
        if {*names} & ({*stage.effects} - {*before.effects}):
            squares.append((before.fit, stage.fit))
    runs = [*page.train, *page.unseen] if everywhere else page.judged

    def squared(fit: Any) -> float:
        found = page.plain(fit)
        return wr.errors(found.system, runs, found.values)[channel or "all"] ** 2

    try:
        falls = sum(squared(before) - squared(after) for before, after in squares)
        share = falls / squared(diag.stages[0].fit)
    except equations.Unwritten:
        return
    _, low, high = shares_in(text)
    if not low - REMOVED <= share <= high + REMOVED:
        yield f"{names[0]} removes {share:.2f} by a plain least squares"


@claim(r"(?P<list>[A-Z][\w ,]+?) ha(?:s|ve) no sure effect on whole runs\.")
def _nothing_sure(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    names = [n for n in diag.added if n in diag.worth and in_words(n).lower() in m["list"].lower()]
    if not names:
        yield "no added effect is named"
    for name in names:
        worth = diag.worth[name]
        for shares in all_shares(worth):
            if shares.low >= SURE or any(c.low >= SURE and c.share > 0.1
                                         for c in shares.channels.values()):  # fmt: skip
                yield f"{name} removes {shares}"


@claim(r"In the place of (?P<old>.+?) came (?P<new>.+?): whole runs err less with it\.")
def _exchanged(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    pairs = [(old, new) for old, new in diag.exchanged.items()
             if in_words(old) in m["old"] and in_words(new) in m["new"]]  # fmt: skip
    if not pairs:
        yield f"exchanged: {diag.exchanged}"
    for old, new in pairs:
        stage = next((k for k, s in enumerate(diag.stages) if new in s.effects
                      and old not in s.effects and k), 0)  # fmt: skip
        errors = [(s.holdout or s.train).nrmse for s in diag.stages[max(stage - 1, 0) : stage + 1]]
        if len(errors) < 2 or errors[1] >= errors[0]:
            yield f"with {new} the NRMSE goes through {errors}"


@claim(r"Left out: (?P<list>.+?)\. With (?:it|each of them) the next (?:sample|row) is predicted "
       r"better, and (?:whole runs are not, or not by enough to matter|"
       r"(?P<open>what (?:it does|they do) to whole runs this fit does not tell))\.")  # fmt: skip
def _also(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    if bool(m["open"]) is not is_provisional(diag):
        yield f"of fits of status {diag.fit.status}"
    for name in diag.detectable:
        if in_words(name) not in m["list"]:
            yield f"{name} is detectable"
    said = (
        rf"([^,()]+?) \((?:it would remove ({WORTH}) of the squared (?:([a-zA-Z ]+?) )?error "
        rf"(?:of all channels )?that is left( on training and unseen logs)?|(no sure gain))"
    )
    for words, text, channel, everywhere, nothing in re.findall(said, m["list"]):
        first = re.sub(r"^and ", "", words.strip()).partition(" or ")[0]
        names = _named(first, diag.worth)
        if not nothing:
            whole = {n: _of(diag.worth[n], channel.replace(" ", "_"), everywhere) for n in names}
            yield from _removes(first, text, names, whole)
        elif not names or diag.worth[names[0]].low >= SURE:
            yield f"{first} has a gain over whole runs"
    raising = (
        r"([^,();]+?) \(it would remove [^;()]+?\([^()]+\)[^;()]+?, "
        r"and raise the squared ([a-zA-Z ]+?) error .+? by (\S+) %"
    )
    for words, channel, by in re.findall(raising, m["list"]):
        names = _named(re.sub(r"^and ", "", words.strip()).partition(" or ")[0], diag.worth)
        shares = [w.channels.get(channel.replace(" ", "_"))
                  for name in names for w in all_shares(diag.worth[name])]  # fmt: skip
        if not any(w and w.high < 0 and abs(-100 * w.share - float(by)) < 1 for w in shares):
            yield f"{words} raises {channel} by {shares}"


@claim(rf"Possible, judged by whole runs alone, with the share of the squared error of all "
       rf"channels that is left on (?P<logs>[a-z ]+?) that each would remove"
       rf"(?: beside what was learned)?: (?P<list>.+? {WORTH}[a-z ]*)\.")  # fmt: skip
def _possible(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    said = (
        rf"(?:^|, |or )([^,()]+?) ({WORTH})(?: of that of ([a-z ]+?))?( on training and)?(?=[, ]|$)"
    )
    for words, text, channel, everywhere in re.findall(said, m["list"]):
        channel = channel.replace(" ", "_")
        shares = {n: _of(w, channel, bool(everywhere)) for n, w in diag.possible.items()}
        whole = {n: w for n, w in shares.items() if w}
        yield from _removes(words, text, _named(words, whole), whole)


@claim(r"Structure (?P<still>still )?remains that none of the effects tried explains: "
       r"from one (?:sample|row) to the next (?P<manner>it enters at|it scales what passes) "
       r"(?P<place>.+?) and depends on (?P<on>.+?)(?P<only>; no curve of it that was "
       r"tried was worth keeping)?\.")  # fmt: skip
def _remains(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    remaining = diag.remaining
    if remaining is None:
        yield "nothing remains"
        return
    if bool(m["only"]) == bool(diag.laws):
        yield f"laws: {diag.laws}"
    if (m["manner"] == "it enters at") != (remaining.manner == "adds"):
        yield f"it {remaining.manner}"
    if f"'{remaining.port}'" not in m["place"] or m["on"] != str(remaining.depends_on):
        yield f"it is at {remaining.port}, by {remaining.depends_on}"
    if page and page.hidden is not None:
        if page.law is None:
            yield "known effects explain all"
        elif remaining.port not in page.law[0] or not re.search(page.law[1], m["on"]):
            yield f"it is at {page.law[0]}, by {page.law[1]}"


@claim(rf"Structure remains that none of the effects tried explains: over whole runs of [a-z ]+? "
       rf"(?:a flexible model of these signals explains (?P<shares>.+?))?(?: and )?(?:where logs "
       rf"repeat their inputs (?P<recurs>{WORTH}.+?) recurs)?, so it is repeatable; where it "
       r"enters is not clear\.")  # fmt: skip
def _repeats(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    for text, words in re.findall(
        rf"({WORTH}) of the squared ([a-zA-Z ]+?) error", m["recurs"] or ""
    ):
        if not worth_is(text, diag.recurring[words.replace(" ", "_")]):
            yield f"{words}: {text} recurs"
    shares = re.findall(rf"({SHARE}) \(({SHARE}) to ({SHARE})\) of the squared ([a-zA-Z ]+?) error",
                        m["shares"] or "")  # fmt: skip
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


@claim(r"Structure remains that none of the effects tried explains; its place is not clear\.")
def _placeless(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    if diag.verdict != "unexplained" or diag.remaining is not None:
        yield f"verdict {diag.verdict}, remaining {diag.remaining}"


@claim(r"Structure remains that none of the effects tried explains: whole runs show it\.")
def _shown_by_whole_runs(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    if diag.remaining is not None or not diag.laws:
        yield f"remaining {diag.remaining}, {len(diag.laws)} laws"


@claim(rf"Learned from whole runs, of states that are not measured too: (?P<terms>.+?)\. Of the "
       rf"squared error of all channels (?P<whole>as given|that is left without them) over whole "
       rf"runs of unseen logs they remove (?P<worth>{WORTH}); with them the "
       rf"NRMSE there is (?P<last>{NUMBER}), as given (?P<first>{NUMBER})\.")  # fmt: skip
def _learned_together(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    told = m["terms"].split("; ")
    if (m["whole"] == "as given") == (len(diag.stages) > 1):
        yield f"they were learned beside {diag.stages[-1].effects}"
    if len(told) != len(diag.laws):
        yield f"{len(diag.laws)} terms"
    for text, law in zip(told, diag.laws, strict=False):
        if f"'{law.curve.port}'" not in text or law.form.formula.expression not in text:
            yield f"{law.form.formula.expression} at {law.curve.port}"
        if not worth_is(m["worth"], law.worth):
            yield f"they remove {law.worth}"
    first, last = diag.stages[0].holdout.nrmse, diag.laws[0].reported.holdout.nrmse
    if not is_said(m["first"], first) or not is_said(m["last"], last):
        yield f"the NRMSE is {last:.3g}, as given {first:.3g}"


@claim(rf"Learned: at (?P<place>.+?'(?P<port>\w+)'.*?) (?P<manner>what passes is scaled by a curve "
       r"of|a curve of) (?P<of>.+?)(?: is added)?(?P<bare> \(no closed form was chosen\))?\. "
       rf"Of the squared (?:(?P<channel>[a-zA-Z ]+?) )?error (?:of all channels )?"
       rf"(?P<whole>as given|that is left without it) over "
       rf"whole runs of (?P<logs>[a-z ]+?) it removes "
       rf"(?P<worth>{WORTH}); with it the NRMSE on [a-z ]+? is (?P<last>{NUMBER}), as given "
       rf"(?P<first>{NUMBER})\."
       r"(?: Valid from .+? to .+?\.(?=\s|$))?")  # fmt: skip
def _learned(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    laws = [law for law in diag.laws if law.curve.port == m["port"]]
    if not laws:
        yield f"no law is at {m['port']}"
        return
    if (m["whole"] == "as given") == (len(diag.stages) > 1):
        yield f"it was learned beside {diag.stages[-1].effects}"
    whole = [w for law in laws if (w := _of(law.worth, *_whole(m)))]
    if not any(worth_is(m["worth"], worth) for worth in whole):
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


@claim(r"Estimated anew beside what was learned: (?P<what>.+?)\.(?=\s|$)")
def _beside_the_law(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    last, told = diag.laws[-1].reported, re.findall(rf"(?<![\w.^]){NUMBER}(?!\^)", m["what"])
    effects = {e.name: e for e in last.model.effects}
    for name in (n for n in diag.added if in_words(n) in m["what"]):
        if effects[name].differs or effects[name].over_logs(last.ranges):
            continue  # told by log, or over the range of the logs
        own = {n: e for n, e in last.parameters.items() if n.rpartition(".")[0] == name}
        for full, estimate in own.items():
            if not estimate.fixed and not any(
                is_said(number, estimate.shown[0], 1e-9) for number in told
            ):
                yield f"{full} is {estimate.shown[0]:.4g} beside what was learned"
    if not any(in_words(n) in m["what"] for n in diag.added):
        yield "no added effect is named"


@claim(r"Superfluous beside it: [\w ,]+?\.")
def _imitated(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    for name in (name for law in diag.laws for name in law.superfluous):
        if in_words(name).lower() not in m[0].lower():
            yield f"{name} is superfluous"

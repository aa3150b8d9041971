"""The sentences of a summary as claims: each is parsed, and held against what it says.

A summary is read from its beginning; at each place one of `CLAIMS` must match, or the sentence is
one that nobody checks, and that is an error. A claim is held against the object's numbers, worked
out anew from its runs, and against a `Page`: the same logs and equations in `reference.whole_runs`,
and what is known of the plant.

    wrong = claims.contradictions(diag, page)         # [] where every sentence is so
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from reference import equations
from reference import whole_runs as wr

ROUNDING = 0.51
"""Of the last digit: what a printed number may be away from what it stands for."""
SIMULATED = 0.01
"""Share by which two integrations of the same model may differ in their error."""
AS_GOOD = 1.03
"""The training error may be so many times that of a plain least squares of several starts."""
NOISE = 1.5
"""Where the truth reaches so many times the error of the sensors, no random force is at work."""
REMOVED = 0.05
"""Shares of squared errors may differ by this much: of one fit of whole runs and of another."""


@dataclass
class Page:
    """The logs as plain arrays, and what is true of them.

    Attributes:
        train: as `whole_runs.Run`; ``unseen`` likewise.
        hidden: names of the effects that the plant has; ``None`` where nobody knows (measured).
        law: port and signal (a regular expression) of what no effect of the catalogue names.
        true: the plant's equations, where they are known.
        truth: the plant's numbers.
        noise: standard deviation of each channel's sensor.
        mistaken: whether a channel of the logs does not mean what its name says.
        starts: of each least squares.
    """

    train: Sequence[wr.Run]
    unseen: Sequence[wr.Run]
    hidden: frozenset[str] | None = None
    law: tuple[str, str] | None = None
    true: wr.System | None = None
    truth: dict[str, float] = field(default_factory=dict)
    noise: dict[str, float] = field(default_factory=dict)
    mistaken: bool = False
    starts: int = 2
    _fits: dict[Any, wr.Found] = field(default_factory=dict)

    @property
    def judged(self) -> Sequence[wr.Run]:
        """The logs that errors are told of."""
        return self.unseen or self.train

    def modelled(self, fit: Any) -> dict[str, float]:
        """NRMSE on the judged logs of a fit of the package, simulated here."""
        name, effects, numbers, _ = _read(fit)
        system = equations.system_of(name, effects)
        return wr.errors(system, self.judged, equations.values_of(name, effects, numbers))

    def plain(self, fit: Any) -> wr.Found:
        """A plain least squares of the equations of a fit."""
        name, effects, numbers, fixed = _read(fit)
        key = (name, effects)
        if key not in self._fits:
            self._fits[key] = equations.fit_of(
                name, effects, numbers, fixed, self.train, starts=self.starts, most=25, ftol=1e-6
            )
        return self._fits[key]

    @cached_property
    def best(self) -> dict[str, float]:
        """Errors of the truth on the judged logs; empty where nobody knows it."""
        return wr.errors(self.true, self.judged, self.truth) if self.true else {}

    @cached_property
    def quiet(self) -> bool:
        """Whether the truth reaches the noise of every sensor: then no random force is at work."""
        spread = wr.spreads(self.true, self.judged) if self.true else {}
        return bool(self.best) and all(
            self.best[c] * spread[c] <= NOISE * self.noise[c] for c in spread
        )


def _read(fit: Any) -> tuple[str, tuple[str, ...], dict[str, float], list[str]]:
    numbers = {n: e.value for n, e in fit.parameters.items()}
    fixed = [n for n, e in fit.parameters.items() if e.fixed]
    return fit.model.name, tuple(e.name for e in fit.model.effects), numbers, fixed


def contradictions(diag: Any, page: Page | None = None, text: str = "") -> list[str]:
    """What is not so in a summary, sentence by sentence; and sentences that nobody checks.

    Args:
        diag: the diagnosis.
        page: what is known besides; without it the sentences are held against the object alone.
        text: in the place of its summary.
    """
    wrong, text = [], (text or diag.summary).strip()
    while text:
        matched = next((s for s in _of_the_logs(diag) if text.startswith(s)), "")
        if not matched:
            found = next(((c, m) for c in CLAIMS if (m := c.pattern.match(text))), None)
            if found is None:
                return [*wrong, f"nobody checks this sentence: {text[:300]!r}"]
            wrong += [f"{why}: {found[1][0]!r}" for why in found[0].check(found[1], diag, page)]
            matched = found[1][0]
        text = text[len(matched) :].lstrip()
    return wrong


def _of_the_logs(diag: Any) -> Iterator[str]:
    """Sentences on what channels mean, from the doubts and the comparison."""
    yield from diag.before.hints
    for doubt in diag.doubts:
        yield f"A doubt on {_words(doubt.channel)}: {doubt.evidence} Mend: {doubt.mend}"
    for mend in diag.mends:
        yield f"First the logs: {mend.doubt.evidence}"
        for logs in ("", f", for {' and '.join(mend.doubt.logs)} alone"):
            yield f"Mend{logs}: {mend.reading.line}"


# -- numbers as they are printed ------------------------------------------------------------------

NUMBER = r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?"
SHARE = r"(?:-?\d+(?:\.\d+)? %|\?)"
WORTH = rf"{SHARE} \({SHARE} to {SHARE}\)"


def is_said(text: str, value: float, slack: float = 0.0) -> bool:
    """Whether a printed number is this value, to its last digit and to a share of it."""
    mantissa, _, power = text.partition("e")
    places = len(mantissa.partition(".")[2])
    digit = 10.0 ** (int(power or 0) - places)
    return abs(float(text) - value) <= ROUNDING * digit + slack * abs(value)


def _shares(text: str) -> list[float]:
    return [
        np.nan if part == "?" else float(part.removesuffix(" %")) / 100
        for part in re.findall(SHARE, text)
    ]


def _worth_is(text: str, worth: Any) -> bool:
    values = (worth.share, worth.low, worth.high)
    parts = re.findall(SHARE, text)
    return all(
        part == "?" if not np.isfinite(value) else is_said(part.removesuffix(" %"), 100 * value)
        for part, value in zip(parts, values, strict=True)
    )


def _words(name: str) -> str:
    return name.replace("_", " ").replace("deadband", "dead band").replace("coulomb", "Coulomb")


def _rmse(comparison: Any, channel: str) -> tuple[float, float]:
    """RMSE and NRMSE of a channel, from the traces of a comparison."""
    traces = [r.channels[channel] for r in comparison.runs if channel in r.channels]
    measured = np.concatenate([t.measured for t in traces])
    difference = np.concatenate([t.measured - t.modelled for t in traces])
    if channel == "heading":
        difference = (difference + np.pi) % (2 * np.pi) - np.pi
    rmse = float(np.sqrt(np.nanmean(difference**2)))
    spread = np.nanstd(np.unwrap(measured[np.isfinite(measured)]) if channel == "heading"
                       else measured)  # fmt: skip
    return rmse, rmse / float(spread)


# -- the checks -----------------------------------------------------------------------------------

Check = Callable[[re.Match, Any, Page | None], Iterator[str]]


@dataclass(frozen=True)
class Claim:
    """A kind of sentence, and what holds it against the truth."""

    pattern: re.Pattern
    check: Check


CLAIMS: list[Claim] = []


def claim(pattern: str) -> Callable[[Check], Check]:
    """Make a function the check of sentences of a pattern, which matches up to their full stop."""

    def keep(check: Check) -> Check:
        CLAIMS.append(Claim(re.compile(pattern + r"(?=\s|$)", re.DOTALL), check))
        return check

    return keep


_CHANGE = re.compile(
    rf"the (?P<channel>[a-zA-Z ]+?) error(?: on (?P<logs>unseen logs|the training logs))? "
    rf"(?:(?P<verb>falls|rises) from (?P<start>{NUMBER}) to (?P<end>{NUMBER})"
    rf"|stays at (?P<same>{NUMBER})) ?(?P<unit>[^()]*?) ?"
    rf"\(NRMSE (?P<first>{NUMBER}) to (?P<last>{NUMBER})\)"
)
_LEVEL = re.compile(
    rf"(?:[Tt]he|[a-z ]+ the) (?P<channel>[a-zA-Z ]+?) error"
    rf"(?: on (?P<logs>[a-z ]+?))? is (?P<size>{NUMBER}) ?(?P<unit>[^()]*?) ?"
    rf"\(NRMSE (?P<nrmse>{NUMBER})\)"
)
_TOTAL = re.compile(
    rf"the NRMSE over all (?P<count>\d+) channels goes from "
    rf"(?P<first>{NUMBER}) to (?P<last>{NUMBER})"
)


def _changes(text: str, diag: Any, page: Page | None) -> Iterator[str]:
    """That errors fall: the numbers, the way, and the same by the evaluation written here."""
    found = [*_CHANGE.finditer(text)]
    if not found:
        yield "no error is told"
    stages = diag.stages[0].fit, diag.fit
    for m in found:
        channel = m["channel"].replace(" ", "_")
        pairs = [_rmse(c, channel) for c in (diag.before, diag.after)]
        per = diag.stages[0].train.channels[channel].per
        sizes = [per * rmse for rmse, _ in pairs]
        told = (m["same"], m["same"]) if m["same"] else (m["start"], m["end"])
        for number, size in zip(told, sizes, strict=True):
            if not is_said(number, size, SIMULATED):
                yield f"{channel}: {number} is {size:.4g}"
        for number, (_, nrmse) in zip((m["first"], m["last"]), pairs, strict=True):
            if not is_said(number, nrmse, SIMULATED):
                yield f"{channel}: NRMSE {number} is {nrmse:.4g}"
        if m["verb"] and (m["verb"] == "falls") != (pairs[1][0] < pairs[0][0]):
            yield f"{channel}: it {m['verb']}, from {pairs[0][0]:.4g} to {pairs[1][0]:.4g}"
        if page:
            for number, fit in zip((m["first"], m["last"]), stages, strict=True):
                yield from _simulated(page, fit, channel, number)
    for m in _TOTAL.finditer(text):
        for number, comparison in zip(
            (m["first"], m["last"]), (diag.before, diag.after), strict=True
        ):
            if not is_said(number, comparison.errors.nrmse, SIMULATED):
                yield f"over all channels {number} is {comparison.errors.nrmse:.4g}"
    if page:
        yield from _as_good(page, stages[0], diag.stages[0].train.nrmse)
        yield from _as_good(page, stages[1], diag.stages[-1].train.nrmse)


def _simulated(page: Page, fit: Any, channel: str, number: str) -> Iterator[str]:
    try:
        errors = page.modelled(fit)
    except equations.Unwritten:
        return
    if not is_said(number, errors[channel], 2 * SIMULATED):
        yield f"{channel}: NRMSE {number} is {errors[channel]:.4g} by an independent simulation"


def _as_good(page: Page, fit: Any, nrmse: float) -> Iterator[str]:
    """Whole runs are told of a fit that has reached what a plain least squares reaches."""
    try:
        found = page.plain(fit)
    except equations.Unwritten:
        return
    reached = found.errors["all"]
    if nrmse > AS_GOOD * reached:
        yield f"training NRMSE {nrmse:.4g}, where a plain least squares reaches {reached:.4g}"


def _levels(text: str, diag: Any, page: Page | None) -> Iterator[str]:
    found = [*_LEVEL.finditer(text)]
    if not found:
        yield "no error is told"
    for m in found:
        channel = m["channel"].replace(" ", "_")
        rmse, nrmse = _rmse(diag.judged, channel)
        per = diag.judged.errors.channels[channel].per
        if not is_said(m["size"], per * rmse, SIMULATED):
            yield f"{channel}: {m['size']} is {per * rmse:.4g}"
        if not is_said(m["nrmse"], nrmse, SIMULATED):
            yield f"{channel}: NRMSE {m['nrmse']} is {nrmse:.4g}"
        if page and diag.apart is None:
            yield from _simulated(page, diag.fit, channel, m["nrmse"])


@claim(r"The (?P<model>[^:.]+?) lacks something that no known effect explains\.")
def _lacks_unknown(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    if diag.verdict != "unexplained" or diag.added:
        yield f"verdict {diag.verdict}, added {diag.added}"
    if page and page.hidden is not None and page.law is None:
        yield f"known effects explain it: {sorted(page.hidden)}" if page.hidden else "it lacks none"


@claim(r"The (?P<model>[^:.]+?) lacks (?P<what>[^:]+?): with (?:it|them) (?P<gain>the .+?)\.")
def _lacks(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    named = re.sub(r"\(these logs cannot tell it from .*?\)", "", m["what"])
    for name in diag.added:
        if _words(name) not in named:
            yield f"{name} was added"
    estimates = [e for n, e in diag.fit.parameters.items() if n.rpartition(".")[0] in diag.added]
    for number in re.findall(rf"(?<![\w.]){NUMBER}", named):
        if not any(is_said(number, e.shown[0], 1e-9) for e in estimates):
            yield f"no added parameter is {number}"
    if page and page.hidden is not None:
        for name, group in zip(diag.added, diag.groups, strict=True):
            if not page.hidden & {name, *group}:
                yield f"nothing of {name} is hidden"
    yield from _changes(m["gain"], diag, page)


@claim(rf"Of the squared error over whole runs of (?P<logs>[a-z ]+?) each removes: (?P<list>.+? "
       rf"{WORTH})\.")  # fmt: skip
def _each_removes(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    for words, worth in re.findall(rf"(?:^|, |and )([^,()]+?) ({WORTH})", m["list"]):
        yield from _removes(words, worth, diag.worth, diag)
        names = [n for n in diag.added if _words(n) == words.strip()]
        if page and names:
            yield from _plainly(names[0], worth, diag, page)


def _removes(words: str, text: str, worths: Any, diag: Any) -> Iterator[str]:
    names = [n for n in worths if _words(n) == re.sub(r"^(?:an?|or) ", "", words.strip())]
    if len(names) != 1:
        yield f"{words!r} is of no worth"
    elif not _worth_is(text, worths[names[0]]):
        yield f"{names[0]} removes {worths[names[0]]}"
    share, low, high = _shares(text)
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
    _, low, high = _shares(text)
    if not low - REMOVED <= share <= high + REMOVED:
        yield f"{name} removes {share:.2f} by a plain least squares"


@claim(r"These logs also show (?P<list>.+?): certain from one sample to the next, but over whole "
       r"runs without a change that surely matters\.")  # fmt: skip
def _also(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    for name in diag.detectable:
        if _words(name) not in m["list"]:
            yield f"{name} is detectable"
    for words, worth in re.findall(rf"([^,()]+?) \(it removes ({WORTH}) of", m["list"]):
        first = re.sub(r"^and ", "", words.strip()).partition(" or ")[0]
        yield from _removes(first, worth, diag.worth, diag)


@claim(r"(?:The (?P<model>[^:.]+?) is adequate: (?:none of the (?P<count>\d+) effects that were "
       r"tried|no effect) (?:matters over whole runs|helps on these logs)\.)")  # fmt: skip
def _adequate(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    if diag.verdict != "adequate":
        yield f"verdict {diag.verdict}"
    tried = len({c.effect for c in diag.ranking} | {*diag.silent})
    if m["count"] and int(m["count"]) != tried:
        yield f"{tried} were tried"
    if page and page.hidden:
        yield f"it lacks {sorted(page.hidden)}"
    if page and page.law:
        yield f"it lacks a law at {page.law[0]}"
    if page:
        yield from _as_good(page, diag.stages[0].fit, diag.stages[0].train.nrmse)


@claim(r"(?:These logs can test none of the effects|No effect was tried): these logs cannot show "
       r"whether .+? lacks an effect\.")  # fmt: skip
def _untried(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    if diag.ranking or diag.silent:
        yield "effects were tried"


@claim(r"These logs show no effect that .+? lacks, and yet it follows (?P<channels>.+?) no better "
       r"than a constant would: do they excite what drives it\?")  # fmt: skip
def _blind(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    for channel in diag.judged.errors.channels:
        bad = _rmse(diag.judged, channel)[1] >= 1.0
        if bad != (_words(channel) in m["channels"]):
            yield f"{channel}: NRMSE {_rmse(diag.judged, channel)[1]:.3g}"


@claim(r"(?:Without what was learned t|T)he [a-zA-Z ]+? error on (?:[a-z ]+?) is .+?"
       r"\(NRMSE [^()]+\)"
       r"(?:(?:, | and )the [a-zA-Z ]+? error is .+?\(NRMSE [^()]+\))*\.")  # fmt: skip
def _level(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    yield from _levels(m[0], diag, page)


@claim(r"(?:Without what was learned t|T)he [a-zA-Z ]+? error on [a-z ]+? "
       r"(?:falls|rises|stays) .+?\(NRMSE [^()]+\)"
       r"(?:(?:, | and )the .+?(?:\(NRMSE [^()]+\)|to \d[\d.]*))*\.")  # fmt: skip
def _change(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    text = m[0][:-1].replace("Without what was learned ", "")
    yield from _changes(text[0].lower() + text[1:], diag, page)


@claim(rf"Undecided: over whole runs of (?P<logs>[a-z ]+?) (?P<level>the [a-zA-Z ]+? error is "
       rf"{NUMBER} ?[^()]*?\(NRMSE {NUMBER}\)), (?P<multiple>\S+) times that from one sample to "
       r"the next; on these logs random forces explain it as well as missing "
       r"physics\.")  # fmt: skip
def _undecided(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    if diag.verdict != "undecided":
        yield f"verdict {diag.verdict}"
    yield from _levels(m["level"], diag, page)
    channel = _LEVEL.search(m["level"])["channel"].replace(" ", "_")
    multiple = _rmse(diag.judged, channel)[0] / diag.one_step.get(channel, np.nan)
    if not is_said(m["multiple"], multiple, SIMULATED):
        yield f"{m['multiple']} is {multiple:.3g}"
    if page and page.quiet:
        yield "no random force is at work: the truth reaches the noise of the sensors"


@claim(r"To decide, record a run that repeats the inputs of one of these logs: errors that recur "
       r"are physics, the others are random forces\.")  # fmt: skip
def _to_decide(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    if diag.verdict != "undecided":
        yield f"verdict {diag.verdict}"


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
            first = _rmse(diag.judged, words.replace(" ", "_"))[1]
            true = 1.0 - (page.best[words.replace(" ", "_")] / first) ** 2
            if true > _shares(high)[0] + REMOVED:
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
    if not any(_worth_is(m["worth"], law.worth) for law in laws):
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
        if _words(name).lower() not in m[0].lower():
            yield f"{name} is superfluous"


@claim(rf"From one sample to the next the (?P<channel>[a-zA-Z ]+?) is predicted to within "
       rf"(?P<step>{NUMBER}) ?[^,]*?, over whole runs of [a-z ]+? to (?P<run>{NUMBER}) ?[^:]*?: "
       r"(?P<why>missing physics and random forces add up|the difference is attributed to random "
       r"forces and lasting sensor errors, which no signal of these logs surely explains)"
       r"\.")  # fmt: skip
def _growth(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    channel = m["channel"].replace(" ", "_")
    per = diag.judged.errors.channels[channel].per
    values = per * diag.one_step[channel], per * _rmse(diag.judged, channel)[0]
    for number, value in zip((m["step"], m["run"]), values, strict=True):
        if not is_said(number, value, SIMULATED):
            yield f"{number} is {value:.3g}"
    if page and page.quiet:
        yield "no random force is at work: the truth reaches the noise of the sensors"


@claim(rf"(?P<name>[\w.]+) is fixed at (?P<value>{NUMBER}) ?.*?; these logs suggest "
       rf"(?P<wanted>{NUMBER}) ± (?P<error>{NUMBER}) ?.*?\. Measure it again, or free it: "
       r"model\.free\('[\w.]+'\)\.")  # fmt: skip
def _held(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    held = diag.held.get(m["name"])
    if held is None:
        yield f"held: {sorted(diag.held)}"
        return
    for number, value in zip(
        (m["value"], m["wanted"], m["error"]),
        (held.value, held.wanted, held.std_error),
        strict=True,
    ):
        if not is_said(number, value, 1e-3):
            yield f"{number} is {value:.4g}"


@claim(r"(?P<name>[\w. ]+?) (?:stopped at its bound of (?P<bound>.+?): (?:these logs favour a "
       r"(?P<way>higher|lower) value\. What follows holds under that bound: widen it, if "
       r"physically possible, and diagnose again|the effect may explain more beyond it\. Widen "
       r"the bound, if physically possible)|was at its bound of .+? without .+?, which may stand "
       r"in for a "
       r"(?:higher|lower) .+?: widen the bound, if physically possible, and diagnose again)"
       r"\.")  # fmt: skip
def _stopped(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    shown = {n: e for s in diag.stages for n, e in s.fit.parameters.items() if e.at_bound}
    plain = m["name"].partition(" of a")[0].lower().replace(" ", "_")
    stopped = [n for n in shown if n == m["name"] or n.rpartition(".")[2] == plain]
    if not stopped:
        yield f"at bounds: {sorted(shown)}"
    elif m["way"]:
        e, (low, high) = shown[stopped[0]], diag.fit.model.parameters[stopped[0]].limits
        if (m["way"] == "higher") != (abs(e.value - high) < abs(e.value - low)):
            yield f"{e.value:.4g} is at the other end of {low:.4g} to {high:.4g}"


@claim(rf"Log (?P<log>.+?) deviates from the others: (?P<evidence>.+?)\. It carries "
       rf"(?P<share>{SHARE}) of the squared (?P<channel>.+?) error of all logs\. Check how it was "
       r"recorded\.")  # fmt: skip
def _odd(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    odd = next((o for o in diag.odd_logs if o.log == m["log"]), None)
    if odd is None or not is_said(m["share"].removesuffix(" %"), 100 * odd.share):
        yield f"odd logs: {diag.odd_logs}"
    if page and page.hidden is not None:
        yield "every log was recorded alike"


@claim(r"The verdict rests on the other logs alone, with the model fitted to them: .+?\.")
def _rests(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    if diag.apart is None:
        yield "no log is apart"


@claim(r"A channel may not mean what its name says:")
def _hints_follow(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    if not diag.before.hints:
        yield "nothing hints at it"


@claim(r"A further record would decide: .+?\.")
def _record(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    if diag.experiment is None or m[0].rpartition("decide: ")[2] not in diag.experiment.sentence:
        yield "no such record is proposed"


@claim(r"What follows is said of the logs as they are: mend them first\.")
def _as_they_are(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    if not diag.helpful_mends:
        yield "no mend helps"


@claim(rf"With (?P<what>.+?) the error over whole (?P<logs>unseen|training) runs (?:(?P<verb>falls|"
       rf"rises) from (?P<first>{NUMBER}) to (?P<last>{NUMBER})|stays at (?P<same>{NUMBER})) "
       rf"\(NRMSE[^()]*\), fitted to the logs so mended; it removes (?P<worth>{WORTH}) of its "
       r"square\.")  # fmt: skip
def _mended(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    mend = next((x for x in diag.mends if x.reading.words == m["what"]), None)
    if mend is None:
        yield "no such mend was measured"
        return
    told = (m["same"], m["same"]) if m["same"] else (m["first"], m["last"])
    for number, errors in zip(told, (mend.before, mend.after), strict=True):
        if not is_said(number, errors.nrmse, SIMULATED):
            yield f"{number} is {errors.nrmse:.4g}"
    if not _worth_is(m["worth"], mend.worth):
        yield f"it removes {mend.worth}"
    if m["verb"] and (m["verb"] == "falls") != (mend.after.nrmse < mend.before.nrmse):
        yield f"it {m['verb']}"
    if page and page.hidden is not None and not page.mistaken:
        yield "the logs are as they should be"
    if page:
        new = Page(*([_reread(r, mend.reading.sources) for r in runs]
                     for runs in (page.train, page.unseen)), starts=page.starts)  # fmt: skip
        fit = diag.stages[0].fit
        try:
            reached = [wr.errors(p.plain(fit).system, p.judged, p.plain(fit).values)["all"]
                       for p in (page, new)]  # fmt: skip
        except equations.Unwritten:
            return
        if (reached[1] < reached[0]) != (mend.after.nrmse < mend.before.nrmse):
            yield f"by a plain least squares it goes from {reached[0]:.3g} to {reached[1]:.3g}"


def _reread(run: wr.Run, sources: Any) -> wr.Run:
    """A run with channels taken from others."""
    values = {"time": run.time, **run.inputs, **run.measured}
    new = {name: factor * values[source] for name, (source, factor) in sources.items()}
    return wr.replace(
        run,
        time=new.get("time", run.time),
        inputs={n: new.get(n, x) for n, x in run.inputs.items()},
        measured={n: new.get(n, x) for n, x in run.measured.items()},
    )

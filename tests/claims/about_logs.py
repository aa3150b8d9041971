"""Claims of the logs, of fixed constants, of bounds, and of what mends do."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from reference import equations
from reference import whole_runs as wr

import diffthrust as dft

from .about_errors import SIMULATED, levels
from .page import Page
from .parsing import NUMBER, SHARE, WORTH, claim, is_said, worth_is


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
       r"the bound, if physically possible|(?P<idle>beyond it whole runs do not surely err less))"
       r"|was at its bound of .+? without .+?, which may stand "
       r"in for a "
       r"(?:higher|lower) .+?: widen the bound, if physically possible, and diagnose again)"
       r"\.")  # fmt: skip
def _stopped(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    shown = {n: e for s in diag.stages for n, e in s.fit.parameters.items() if e.at_bound}
    plain = m["name"].partition(" of a")[0].lower().replace(" ", "_")
    stopped = [n for n in shown if n == m["name"] or n.rpartition(".")[2] == plain]
    if not stopped:
        yield f"at bounds: {sorted(shown)}"
    elif bool(m["idle"]) != (stopped[0] in diag.idle_bounds and " without " not in m[0]):
        yield f"bounds that gain nothing: {diag.idle_bounds}"
    elif m["way"]:
        e, (low, high) = shown[stopped[0]], diag.fit.model.parameters[stopped[0]].limits
        if (m["way"] == "higher") != (abs(e.value - high) < abs(e.value - low)):
            yield f"{e.value:.4g} is at the other end of {low:.4g} to {high:.4g}"
    elif stopped[0].endswith((".share", ".fraction")) and shown[stopped[0]].value in (-1.0, 1.0):
        yield f"{stopped[0]} is whole: nothing lies beyond"


@claim(r"(?:The logs are tables without time|These logs are tables without time: what takes time, "
       r"as a lag does, was not tried)\.")  # fmt: skip
def _tables(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    if not all(run.log.static for run in diag.before.runs):
        yield "the logs have a time"
    for name in {*diag.added, *diag.detectable, *(tried.effect for tried in diag.ranking)}:
        if name in dft.effects.EFFECTS and dft.effects.EFFECTS[name].states:
            yield f"{name} takes time, and was tried"


@claim(r"Beside (?P<what>[^:]+?) (?P<names>\w+(?:(?:, | and )\w+)*) go(?:es)? to zero: the model "
       r"does as well without (?:its term|their terms)\.")  # fmt: skip
def _vanished(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    for name in re.split(", | and ", m["names"]):
        estimate = diag.fit.parameters[name]
        usual = diag.stages[0].fit.parameters[name].value
        if not (estimate.at_bound and abs(estimate.value) < 1e-6 * abs(usual)):
            yield f"{name} is {estimate.value:.3g}"
        without = diag.fit.model.replace({name: 1e-30 * usual})
        again = dft.compare(without, [run.log for run in diag.before.runs])
        if again.errors.nrmse > 1.01 * diag.after.errors.nrmse:
            yield f"without {name} the NRMSE is {again.errors.nrmse:.3g}"


@claim(rf"Log (?P<log>.+?) deviates from the others: (?P<evidence>.+?)\. It carries "
       rf"(?P<share>{SHARE}) of the squared (?P<channel>.+?) error of all logs\. Check how it was "
       r"recorded\.")  # fmt: skip
def _odd(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    odd = next((o for o in diag.odd_logs if o.log == m["log"]), None)
    if odd is None or not is_said(m["share"].removesuffix(" %"), 100 * odd.share):
        yield f"odd logs: {diag.odd_logs}"
    if page and page.hidden is not None:
        yield "every log was recorded alike"


@claim(rf"Log (?P<log>.+?) goes where at most half of the training logs do \((?P<what>[^()]+)\), "
       rf"and what the model lacks there shows in it: (?P<evidence>.+?)\. It carries "
       rf"(?P<share>{SHARE}) of the squared (?P<channel>.+?) error of all logs\.")  # fmt: skip
def _beyond(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    odd = next((o for o in diag.odd_logs if o.log == m["log"]), None)
    if odd is None or not is_said(m["share"].removesuffix(" %"), 100 * odd.share):
        yield f"odd logs: {diag.odd_logs}"
    elif not all(way in m["what"] for way in odd.beyond):
        yield f"it goes {odd.beyond}"


@claim(r"Left: most(?:ly| of the (?P<channel>[^.]+?) error,) in log (?P<log>[^()\n]+?)"
       r"(?: \((?P<what>[^()]+)\))?\.(?=\n|$)")  # fmt: skip
def _left_in(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    odd = next((o for o in diag.odd_logs if o.log == m["log"]), None)
    if odd is None or not (odd.share > 0.5 and odd.beyond):
        yield f"odd logs: {diag.odd_logs}"
    elif m["what"] and not all(way in m["what"] for way in odd.beyond):
        yield f"it goes {odd.beyond}"


@claim(r"The verdict rests on the other logs alone, with the model fitted to them: .+?\. So "
       r"fitted, (?P<levels>the .+?\(NRMSE [^()]+\)(?:(?:, | and )the .+?"
       r"\(NRMSE [^()]+\))*)\.")  # fmt: skip
def _rests(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    if diag.apart is None:
        yield "no log is apart"
    yield from levels(m["levels"], diag, diag.judged, None)


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
    if not worth_is(m["worth"], mend.worth):
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


@claim(r"Look which of these is true, and mend that alone(?:, for [^:]+? alone)?: "
       r"(?P<lines>[^\n]+?)(?= (?:First the logs|What follows)\b|$)")  # fmt: skip
def _either_mend(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    """All readings of one doubt, but for those whose mend does harm."""
    tried = {id(mend.reading): mend for mend in diag.mends}
    for doubt in (mend.doubt for mend in diag.helpful_mends):
        told = [r for r in doubt.readings if f"{r.words}, {r.line}" in m["lines"]]
        missed = [r for r in doubt.readings if r not in told]
        harmful = all(id(r) in tried and tried[id(r)].worth.high <= 0 for r in missed)
        if len(told) > 1 and harmful:
            return
    yield f"doubts: {[d.readings for d in diag.doubts]}"

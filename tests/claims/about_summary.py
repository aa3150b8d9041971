"""Claims of the summary, the answer in few words: each is held against the numbers themselves."""

from __future__ import annotations

import re
import string
import tomllib
from collections.abc import Iterator
from typing import Any

import numpy as np
from reference import equations

from .about_effects import SURE
from .about_errors import (
    BLOWING,
    MOVING,
    SIMULATED,
    amplitudes,
    blowing_wind,
    moving_water,
    recorded,
)
from .page import Page
from .parsing import (
    NUMBER,
    WORTH,
    all_shares,
    claim,
    error_of,
    in_words,
    is_provisional,
    is_said,
    last_fit,
    worth_is,
)

KEPT_OUT = "logs kept out of the fit"
LOGS = rf"{KEPT_OUT}|the training logs"
COUNTS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")
FAR = 3.0
"""Errors over whole runs are told to have grown where they are so many times those of one step."""


# -- what is missing -------------------------------------------------------------------------------


@claim(r"(?P<label>Missing|Unexplained): something(?: unknown)?"
       r"(?P<place> (?:in|at) [^\n]+?(?: that depends on (?P<on>[^\n]+?))?)?"
       r"(?P<repeats>; the error of (?P<channels>.+?) repeats from run to run)?\.")  # fmt: skip
def _unknown(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    if diag.verdict != "unexplained" or diag.laws:
        yield f"verdict {diag.verdict}, {len(diag.laws)} laws"
    if (m["label"] == "Unexplained") != bool(diag.added or diag.held):
        yield f"added {diag.added}, held {[*diag.held]}"
    signal = diag.remaining.signal if m["on"] else None
    if signal and signal.rate and in_words(signal.name) not in m["on"]:
        yield f"it depends on the rate of {signal.name}"
    if signal and signal.rate == (m["on"] == str(signal)):
        yield f"it depends on {signal}"
    for name in diag.repeating if m["repeats"] else ():
        if in_words(name) not in m["channels"]:
            yield f"{name} repeats"


@claim(r"Found: (?P<count>\w+) effects?, see below\.")
def _counted(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    if m["count"] != COUNTS[len(diag.added)]:
        yield f"added {diag.added}"


@claim(rf"(?P<label>Found|Perhaps) (?P<place>(?:in|at) [^:\n]+): "
       rf"a (?P<kind>factor|term) that (?P<what>[^\n]+?)"
       rf"(?:, (?:up to )?(?P<reach>{NUMBER}) (?P<unit>% (?:less|more)|[^,\n]+?))?"
       rf"(?:, valid from (?P<low>{NUMBER}) to (?P<high>{NUMBER})(?: [^,\n]+?)?)?\.")  # fmt: skip
def _law(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    if (m["label"] == "Perhaps") != is_provisional(diag):
        yield f"its fit: {last_fit(diag).status.value}"
    laws = [law for law in diag.laws if (law.manner == "scales") == (m["kind"] == "factor")
            or law.form]  # fmt: skip
    if not laws:
        yield f"laws: {diag.laws}"
        return
    sizes = [e.shown[0] for law in laws if law.form for e in law.form.fit.parameters.values()]
    sizes += [2.0 * np.pi / size for size in sizes if size]
    sizes += [getattr(law.curve, name) for law in laws for name in law.curve.given]
    for number in re.findall(rf"(?<![\w.^*]){NUMBER}", m["what"]):
        if not any(is_said(number, size, 1e-3) for size in sizes):
            yield f"no number of a law is {number}"
    reached = [_reach(law, m["unit"]) for law in laws] if m["reach"] else []
    if reached and not any(is_said(m["reach"], reach, 1e-3) for reach in reached):
        yield f"it reaches {reached}"
    ends = [(law.shown.value * law.curve.low, law.shown.value * law.curve.high) for law in laws]
    if m["low"] and not any(is_said(m["low"], a) and is_said(m["high"], b) for a, b in ends):
        yield f"it is valid over {ends}"
    if page and page.law and not any(law.curve.port in page.law[0] for law in laws):
        yield f"it is at {page.law[0]}"


def _reach(law: Any, unit: str) -> float:
    """How far a law goes at the samples of the logs: in its unit, or in per cent.

    By its closed form as it is printed; by the splines of its curve where it has none.
    """
    if law.form and not law.together:
        names = {"tanh": np.tanh, "exp": np.exp, "abs": np.abs, "sign": np.sign,
                 "max": np.maximum, "min": np.minimum, "sin": np.sin}  # fmt: skip
        own = f"{law.form.formula.name}."
        names |= {n.removeprefix(own): e.value for n, e in law.form.fit.parameters.items()
                  if n.startswith(own)}  # fmt: skip
        names |= {"at": law.samples, "value": 1.0 if "%" in unit else 0.0}
        signal, text = law.curve.signal, law.form.formula.expression
        text = re.sub(rf"(?<!\w){re.escape(signal)}(?!\w)", "at", text)
        values = np.broadcast_to(eval(text, names), law.samples.shape)
        values = values - law.samples * (signal == "value")
    else:
        values = np.array([float(law.curve.at_signal(x)) for x in law.samples]) + ("%" in unit)
    low, middle, high = np.quantile(values, [0.0, 0.5, 1.0])
    if "%" in unit:
        return 100.0 * (1.0 - low / middle if "less" in unit else high / middle - 1.0)
    return max(abs(low), abs(high))


@claim(r"Also: (?P<list>[^\n]+?)\.")
def _also(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    told = re.findall(r"(?m)^(?:Found|Perhaps|Adds little): (.+)\.$", diag.summary)
    left = [e for e in diag.best if in_words(e.name) in m["list"]]
    if len(told) + len(left) < len(diag.added):
        yield f"added: {diag.added}"


@claim(r"(?P<label>Found|Perhaps|Adds little): (?P<what>[^\n]+?)\.")
def _effect(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    effects = [e for e in diag.fit.model.effects if e.name in diag.added]
    what, _, rivals = m["what"].partition(", or it is ")
    said = next((e for e in effects if re.fullmatch(_wording(e, diag.fit), what)), None)
    if said and rivals:
        yield from _other_rivals(said.name, rivals, diag)
    named = [e for e in effects if in_words(e.name) in m["what"]]
    if said is None and m["label"] == "Adds little" and named:  # their names alone
        for effect in named:
            yield from _adds_little(effect.name, diag)
        return
    if said is None:
        yield f"added: {diag.added}"
        return
    worth = diag.worth.get(said.name)
    if m["label"] == "Adds little":
        yield from _adds_little(said.name, diag)
    shares = all_shares(worth)
    sure = [w.low >= SURE or any(c.low >= SURE for c in w.channels.values()) for w in shares]
    believed = (not shares or any(sure)) and not is_provisional(diag)
    if m["label"] != "Adds little" and (m["label"] == "Found") != believed:
        yield f"{said.name} is worth {worth}"
    if moving := re.search(MOVING, m["what"]):
        yield from moving_water(moving, diag)
    if blowing := re.search(BLOWING, m["what"]):
        yield from blowing_wind(blowing, diag)
    values = {n: diag.fit.parameters[f"{said.name}.{n}"] for n in said.declared}
    told = [*[e.shown[0] for e in values.values()], *[100 * abs(e.value) for e in values.values()]]
    for number in re.findall(rf"(?<![\w.^*]){NUMBER}", m["what"]):
        near = [*told, *amplitudes(diag.fit)]
        if not said.consequence(diag.fit.model, recorded(diag.fit)) and not any(
            is_said(number, x, 1e-3) for x in near
        ):
            yield f"no parameter of {said.name} is {number}"
    for word, way in ((" more", 1), (" less", -1)):
        if f" %{word}" in m["what"] and not any(way * e.value > 0 for e in values.values()):
            yield f"{said.name}: {values} is not{word}"


@claim(r"Next: fit again(?: from more starts|, from more starts or with constants held that you "
       r"know)\.")  # fmt: skip
def _fit_again(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    if not is_provisional(diag):
        yield "its fit has ended"


def _adds_little(name: str, diag: Any) -> Iterator[str]:
    """It removes no tenth of any squared error, by its shares and by the errors of its stage."""
    worth = diag.worth[name]
    shares = all_shares(worth)
    if any(one.share > 0.1 for each in shares for one in (each, *each.channels.values())):
        yield f"{name} removes {worth}"
    at = next(k for k, stage in enumerate(diag.stages) if name in stage.effects)
    stages = (diag.stages[0], *diag.stages[at - 1 : at + 1])
    first, before, after = ((s.holdout or s.train).nrmse for s in stages)
    if not worth.together and (before**2 - after**2) / first**2 > 0.1 * (1 + SIMULATED):
        yield f"{name}: the NRMSE falls from {before:.3g} to {after:.3g}"


def _wording(effect: Any, fit: Any) -> str:
    """How an effect may be told: in its own words with any numbers, or by its name."""
    if effect.differs:
        return rf"(?:an? )?{re.escape(in_words(effect.name))} of [^\n]+ in each log"
    if consequence := effect.consequence(fit.model, recorded(fit)):
        return re.escape(consequence)
    if not effect.in_words:
        return rf"(?:an? )?{re.escape(in_words(effect.name))}(?: of [^\n]+)?"
    pieces = [re.escape(text) + (".+?" if field else "")
              for text, field, *_ in string.Formatter().parse(effect.in_words)]  # fmt: skip
    return "".join(pieces)


@claim(r"Nothing found, and yet (?P<what>.+?) (?:is|are) followed no better than by a constant"
       r"(?:: do the logs excite it\?|\.)")  # fmt: skip
def _blind(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    bad = [c for c in diag.judged.errors.channels if error_of(diag.judged, c)[1] >= 1.0]
    if not bad or (m["what"] != "the logs" and any(in_words(c) not in m["what"] for c in bad)):
        yield f"no better than a constant: {bad}"


# -- errors ----------------------------------------------------------------------------------------


@claim(rf"The (?P<channel>[a-zA-Z ]+?) error(?: on (?P<logs>{LOGS}|unseen logs))? "
       rf"(?:(?P<verb>falls|rises) from (?P<first>{NUMBER}|inf|nan) to (?P<last>{NUMBER}|inf|nan)"
       rf"|stays at (?P<same>{NUMBER}))"
       rf"(?: (?P<unit>[^\n]+?))?\.")  # fmt: skip
def _falls(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    unseen = diag.stages[0].holdout is not None
    if unseen != (m["logs"] in (KEPT_OUT, "unseen logs")):
        yield f"unseen logs: {unseen}"
    fits = diag.stages[0].fit, last_fit(diag)
    errors = [f.holdout if unseen else f.train for f in fits]
    channel = m["channel"].replace(" ", "_")
    if None in errors or channel not in errors[0].channels:
        yield f"no error of {channel}"
        return
    if m["unit"] != (errors[0].channels[channel].shown.unit or None):
        yield f"it is in {errors[0].channels[channel].shown.unit}"
    per = errors[0].channels[channel].per
    rmse = [per * e.channels[channel].rmse for e in errors]
    if unseen and not diag.laws:
        rmse = [per * error_of(c, channel)[0] for c in (diag.before, diag.after)]
    told = (m["first"] or m["same"], m["last"] or m["same"])
    if m["verb"] and (m["verb"] == "rises") != (rmse[1] > rmse[0]):
        yield f"{channel}: from {rmse[0]:.4g} to {rmse[1]:.4g}"
    for number, value in zip(told, rmse, strict=True):
        if np.isfinite(value) and not is_said(number, value, SIMULATED):
            yield f"{channel}: {number} is {value:.4g}"
    falls = {c: errors[0].channels[c].nrmse ** 2 - errors[1].channels[c].nrmse ** 2
             for c in errors[0].channels}  # fmt: skip
    followed = {c: fall for c, fall in falls.items() if errors[1].channels[c].nrmse < 1.0}
    falls = followed or falls
    if channel not in falls:
        yield f"{channel} is followed no better than by a constant"
    elif falls[channel] < max(falls.values()):
        yield f"the error of another channel falls more: {falls}"
    if page and unseen:
        spread = rmse[0] / errors[0].channels[channel].nrmse
        for number, fit in zip(told, fits, strict=True):
            try:
                simulated = spread * page.modelled(fit)[channel]
            except equations.Unwritten:
                return
            if not is_said(number, simulated, 2 * SIMULATED):
                yield f"{channel}: {number} is {simulated:.4g} by an independent simulation"


@claim(rf"But the (?P<channel>[a-zA-Z ]+?) error rises"
       rf"(?: to (?P<size>{NUMBER}) (?P<unit>[^\n]+?))?\.")  # fmt: skip
def _raised(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    """It does, on the logs of the errors that are told, and no channel rises more."""
    channel = m["channel"].replace(" ", "_")
    errors = [f.holdout or f.train for f in (diag.stages[0].fit, last_fit(diag))]
    first, last = (e.channels[channel].per * e.channels[channel].rmse for e in errors)
    if not last > 1.04 * first:
        yield f"{channel}: from {first:.4g} to {last:.4g}"
    rises = {
        c: errors[1].channels[c].nrmse ** 2 - e.nrmse**2 for c, e in errors[0].channels.items()
    }
    if rises[channel] < max(rises.values()):
        yield f"the error of another channel rises more: {rises}"
    if m["size"] and not is_said(m["size"], last, SIMULATED):
        yield f"{channel}: {m['size']} is {last:.4g}"
    if m["unit"] and m["unit"] != errors[0].channels[channel].shown.unit:
        yield f"it is in {errors[0].channels[channel].shown.unit}"


@claim(rf"Error on (?P<logs>{LOGS}): (?P<list>[a-zA-Z ]+ (?:{NUMBER}|inf|nan)[^\n]*)\.")
def _levels(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    for text in m["list"].split(", "):
        words, number = re.match(rf"([a-zA-Z ]+) ({NUMBER}|inf|nan)", text).groups()
        channel = words.replace(" ", "_")
        per = diag.stages[0].train.channels[channel].per
        comparison = diag.after if m["logs"] == KEPT_OUT or not diag.stages[0].holdout else None
        if comparison and not is_said(number, per * error_of(comparison, channel)[0], SIMULATED):
            yield f"{channel}: {number} is {per * error_of(comparison, channel)[0]:.4g}"


@claim(
    rf"Unexplained: (?P<rest>what is left of the )?(?P<channel>[a-zA-Z ]+?)(?: error)?"
    rf"(?: off by (?P<size>{NUMBER})[^;\n]*)?; repeat one run(?:: what recurs is physics)?\."
)
def _left(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    channel = m["channel"].replace(" ", "_")
    per = diag.judged.errors.channels[channel].per
    run = error_of(diag.judged, channel)[0]
    if diag.laws:
        run = (last_fit(diag).holdout or last_fit(diag).train).channels[channel].rmse
    if m["rest"] and f" {m['channel']} error " not in diag.summary.partition("Unexplained")[0]:
        yield f"the error of {channel} is told nowhere"
    if m["size"] and not is_said(m["size"], per * run, SIMULATED):
        yield f"it is off by {per * run:.3g}"
    if not run > FAR * diag.one_step[channel]:
        yield f"one step errs by {per * diag.one_step[channel]:.3g}, whole runs by {per * run:.3g}"


@claim(rf"(?:Unexplained: t|T)he (?P<name>[^\n]+?) changes "
       rf"(?:at|where the (?P<signal>[^\n]+?) is) (?P<level>{NUMBER})(?: (?P<unit>[^\s,:.]+))?"
       rf"(?: after the start of a log)?"
       rf"(?:[,:] (?P<before>{NUMBER})(?: ->| (?P<up>before|below),) (?P<after>{NUMBER})"
       rf"[^\n.]*?(?P<beyond>after|above)?)?\."
       rf"(?: By the slopes of the fit that removes (?P<share>{WORTH}) of the squared error of all "
       r"channels that is left over whole runs of (?P<logs>[^.]+)\.)?")  # fmt: skip
def _changes(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    changed = diag.changed
    if changed is None:
        yield "nothing changes"
        return
    per = diag.fit.parameters[changed.parameter].per
    if (m["signal"] or "time") != in_words(changed.signal):
        yield f"it changes with {changed.signal}"
    if (m["unit"] or "") != changed.shown.unit:
        yield f"the level is in {changed.shown.unit}"
    sides = ("before", "after") if changed.signal == "time" else ("below", "above")
    if (m["up"], m["beyond"]) not in (sides, (None, None)):
        yield f"it is told with {m['up']} and {m['beyond']}"
    pairs = ((m["level"], changed.shown.value), (m["before"], per * changed.before.value),
             (m["after"], per * changed.after.value))  # fmt: skip
    for number, value in pairs:
        if number and not is_said(number, value):
            yield f"{number} is {value:.4g}"
    if in_words(changed.parameter.rpartition(".")[2]) not in m["name"].replace("-", " "):
        yield f"{changed.parameter} changes"
    if m["share"] and not worth_is(m["share"], changed.worth):
        yield f"it removes {changed.worth}"


# -- how sure, and what to do ----------------------------------------------------------------------


@claim(r"These logs cannot tell (?P<effect>.+?) from (?P<rivals>[^\n.]+?)\.")
def _rivals(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    named = [n for n in diag.added if in_words(n) in m["effect"]]
    if not any(not [*_other_rivals(n, m["rivals"], diag)] for n in named):
        yield f"groups: {diag.groups}"


def _other_rivals(name: str, rivals: str, diag: Any) -> Iterator[str]:
    """Where an effect is told as another than those that these logs cannot tell from it."""
    group = dict(zip(diag.added, diag.groups, strict=True))[name]
    if not all(in_words(r) in rivals for r in group if r not in diag.added):
        yield f"groups: {name} may be any of {group}"


@claim(r"No fit is to be believed: (?P<name>[\w.]+) ran away(?: to (?P<value>[-+.\de]+)[^\n]*)?\.")
def _ran_away(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    began, ended = diag.stages[0].fit.guess[m["name"]], diag.fit.parameters[m["name"]].value
    if not abs(ended) >= 1e5 * abs(began):
        yield f"{m['name']} began at {began} and ended at {ended}"
    if m["value"] and not is_said(m["value"], ended, 1e-3):
        yield f"{m['name']} is {ended}"


@claim(r"Next: check signs, units and the sense of angles(?:, or hold a mass that you know)?\.")
def _check(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    if "No fit is to be believed" not in diag.summary:
        yield "its fit is one to be believed"


@claim(r"(?:The|Unmeasured) (?P<channel>[a-z ]+?) (?:was not measured: it )?could look like "
       r"(?P<effect>[^\n.]+?)\.")  # fmt: skip
def _unmeasured(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    channel = m["channel"].replace(" ", "_")
    if any(channel in run.log.inputs for run in diag.before.runs):
        yield f"{channel} is in the logs"
    at_once = diag.one_step
    if at_once and all(error_of(diag.judged, n)[0] <= 1.25 * size for n, size in at_once.items()):
        yield "whole runs err as little as one-step predictions"
    if not any(channel in why for why in diag.untestable.values()):
        yield f"untestable: {diag.untestable}"
    if not any(in_words(name) in m["effect"] for name in diag.added):
        yield f"added: {diag.added}"


@claim(r"Possibly also: (?P<list>[^\n]+?)\.")
def _possible(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    for words in re.split(r", | or ", m["list"]):
        if words not in map(in_words, diag.possible):
            yield f"possible: {[*diag.possible]}"


@claim(r"Copy: effects = (?P<list>\[[^\n]*\])")
def _copied_effects(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    names = tomllib.loads(m[0].removeprefix("Copy: "))["effects"]
    if [str(n).rpartition(":")[2] for n in names] != [
        e.name if ":" not in str(n) else type(e).__name__
        for n, e in zip(names, diag.fit.model.effects, strict=False)
    ] or len(names) != len(diag.fit.model.effects):
        yield f"the model has {[e.name for e in diag.fit.model.effects]}"


@claim(r"Copy: (?P<name>[\w.]+) = \{ fixed = false \}")
def _copied_name(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    if m["name"] not in diag.held:
        yield f"held: {[*diag.held]}"


@claim(r"Copy(?:: the lines under 'To copy into a spec file'| the lines below)\.")
def _copied_end(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    if "To copy into a spec file" not in diag.report():
        yield "there are none"


@claim(r"Copy(?: under (?P<table>\[[^\]]+\]))?: (?P<line>[^\n]+)")
def _copied_mend(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    line = f"{m['table']} {m['line']}" if m["table"] else m["line"]
    if not any(line.rstrip(".") in mend.reading.line for mend in diag.helpful_mends):
        yield f"mends: {[mend.reading.line for mend in diag.helpful_mends]}"


@claim(r"Next: (?P<what>make the test proposed below|repeat one run with the same inputs; what "
       r"recurs is physics)\.")  # fmt: skip
def _next(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    if diag.verdict != "undecided" or (m["what"].startswith("make") and diag.experiment is None):
        yield f"verdict {diag.verdict}, experiment {diag.experiment}"


@claim(r"A (?P<model>[a-zA-Z ]+?) errs less: diagnose that model, too\.")
def _other_model(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    other = next((o for o in diag.other_models if in_words(o.name) == m["model"]), None)
    here = last_fit(diag)
    if other is None:
        yield f"other models: {[o.name for o in diag.other_models]}"
    elif not (other.best.holdout or other.best.train).nrmse < (here.holdout or here.train).nrmse:
        yield "it errs no less"


@claim(r"(?:The logs|They) look sound\.")
def _sound(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    if not diag.stages[0].fit.doubts_sought:
        yield "nobody looked"
    if diag.doubts or diag.before.hints or any(odd.accused for odd in diag.odd_logs):
        yield f"doubts: {[(d.channel, d.kind) for d in diag.doubts]}, odd logs: {diag.odd_logs}"


@claim(r"More below\.")
def _more(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    return iter(())


# -- what is wrong with the logs, and with what was given ------------------------------------------


@claim(r"What is told below may come from this mistake\.")
def _as_they_are(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    if not (diag.helpful_mends or "No fit is to be believed" in diag.summary):
        yield "nothing mends them"


@claim(rf"First mend the logs, then diagnose again: with (?P<what>.+?) the "
       rf"(?:unseen|training) error falls by (?P<falls>{NUMBER}) %"
       rf"(?:, (?P<others>[^\n]+?): look which of them is true)?\.")  # fmt: skip
def _mend_first(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    mend = next((x for x in diag.helpful_mends if x.reading.words == m["what"]), None)
    if mend is None:
        yield f"mends: {[x.reading.words for x in diag.helpful_mends]}"
        return
    falls = {x.reading.words: 100.0 * (1.0 - x.after.nrmse / x.before.nrmse) for x in diag.mends}
    if not is_said(m["falls"], falls[m["what"]]):
        yield f"NRMSE goes from {mend.before.nrmse:.3g} to {mend.after.nrmse:.3g}"
    others = {reading.words for reading in mend.doubt.readings} - {m["what"]}
    others -= {x.reading.words for x in diag.mends if x.worth.high <= 0}
    told = dict(re.findall(r"with (.+?) it (.+?)(?:, (?=with )|$)", m["others"] or ""))
    named = {*told} or {*filter(None, re.split(r"or it is |, | or ", m["others"] or ""))}
    if named != others:
        yield f"other readings: {others}"
    for words, does in told.items():
        fall = falls.get(words)
        by = re.fullmatch(rf"falls by ({NUMBER}) %", does)
        if by and not (fall is not None and is_said(by[1], fall)):
            yield f"with {words} it falls by {fall}"
        if does == "was not tried" and fall is not None:
            yield f"{words} was tried"
        if does == "does not fall" and not (fall is not None and not fall > 0.5):
            yield f"with {words} it falls by {fall} %"


@claim(r"How to mend (?:either|them) stands below\.")
def _either_line(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    helpful = [mend.doubt for mend in diag.helpful_mends]
    contrary = [d for d in diag.doubts if d.kind in ("sign", "exchanged")]
    (doubt, *_) = helpful or contrary
    missing = [r.line.rstrip(".") for r in doubt.readings if r.line.rstrip(".") not in diag.details]
    if missing or not (helpful or not diag.sought):
        yield f"the details lack {missing}"


@claim(r"No effect was sought(?:: mend the logs, then diagnose again| in logs that are to be "
       r"mended first)?\.")  # fmt: skip
def _unsought(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    if diag.added or diag.ranking or diag.laws or diag.possible:
        yield f"tried: {[c.effect for c in diag.ranking]}"
    if not any(d.kind in ("sign", "exchanged") for d in diag.doubts):
        yield f"doubts: {[d.kind for d in diag.doubts]}"
    if page and page.hidden is not None and not page.mistaken:
        yield "the logs are sound"


@claim(r"The errors of the model as given say nothing: (?:its fit to these logs )?(?P<why>did not "
       r"converge|could not be simulated|depends on where it starts|these logs do not tell all its "
       r"parameters apart)\.")  # fmt: skip
def _unended(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    said = {
        "did not converge": "not_converged",
        "could not be simulated": "simulation_failed",
        "depends on where it starts": "starts_disagree",
        "these logs do not tell all its parameters apart": "not_identifiable",
    }
    if diag.sought or str(diag.fit.status) != said[m["why"]]:
        yield f"the fit ended as {diag.fit.status}"


@claim(r"First diagnose again with (?P<what>[^\n]+?)\.")
def _mend_short(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    doubt = diag.helpful_mends[0].doubt
    harmful = {x.reading.words for x in diag.mends if x.worth.high <= 0}
    words = {reading.words for reading in doubt.readings} - harmful
    if {*re.split(r", | or ", m["what"])} != words:
        yield f"readings: {words}"


@claim(r"Check the logs: (?P<what>[^\n]+?)\.")
def _check(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    if m["what"] == "a channel may not mean what its name says":
        wrong = not diag.before.hints
    else:
        wrong = not any(in_words(d.channel) in m["what"] or d.kind == "time_base"
                        for d in diag.doubts)  # fmt: skip
    if wrong:
        yield f"doubts: {[(d.channel, d.kind) for d in diag.doubts]}, hints: {diag.before.hints}"


@claim(r"(?:Logs? (?P<log>[^\n]+?)|A log|\w+ logs) deviates? from the others(?P<apart>, and (?:is|"
       r"are) left out of the verdict)?\.(?=\n|$)")  # fmt: skip
def _deviates(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    accused = [odd.log for odd in diag.odd_logs if odd.accused]
    if not accused or (m["log"] and any(log not in m["log"] for log in accused)):
        yield f"odd logs: {accused}"
    if bool(m["apart"]) and diag.apart is None:
        yield "no log is left out"


@claim(r"Caution: (?P<why>[^\n]+?)\.")
def _caution(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    steps = m["why"] == "the last fit needs finer integrator steps"
    status = last_fit(diag).status
    if steps and not diag.fit.coarse:
        yield "its steps are fine enough"
    elif not steps and status.ok:
        yield f"the fit has the status {status}"


@claim(r"(?P<name>[\w.]+) is at its bound(?: of (?P<bound>[^\n:]+))?: widen it\.")
def _bound(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    estimate = diag.fit.parameters.get(m["name"])
    if estimate is None or not estimate.at_bound:
        yield f"at bounds: {[n for n, e in diag.fit.parameters.items() if e.at_bound]}"
    elif m["bound"] and not is_said(m["bound"].split()[0], estimate.shown[0], 1e-3):
        yield f"it is at {estimate.shown[0]:.4g}"


@claim(rf"(?P<name>[\w.]+) is fixed(?: at (?P<value>{NUMBER}))?; these logs suggest (?:another "
       rf"value|(?P<wanted>{NUMBER})[^\n]*?)\.(?=\n|$)")  # fmt: skip
def _held(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    held = diag.held.get(m["name"])
    if held is None:
        yield f"held: {[*diag.held]}"
    elif m["value"] and not (is_said(m["value"], held.value) and is_said(m["wanted"], held.wanted)):
        yield f"{held.value:.4g}, and {held.wanted:.4g}"

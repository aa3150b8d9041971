"""Claims of how large errors are, how they change, and what that means."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import numpy as np
from reference import equations

from .page import Page
from .parsing import NUMBER, WORTH, claim, error_of, in_words, is_said, last_fit, worth_is

SIMULATED = 0.01
"""Share by which two integrations of the same model may differ in their error."""
AS_GOOD = 1.03
"""The training error may be so many times that of a plain least squares of several starts."""

_CHANGE = re.compile(
    rf"the (?P<channel>[a-zA-Z ]+?) error(?: on (?P<logs>unseen logs|the training logs))? "
    rf"(?:(?P<verb>falls|rises) from (?P<start>{NUMBER}) to (?P<end>{NUMBER})"
    rf"|stays at (?P<same>{NUMBER})) ?(?P<unit>[^()]*?) ?"
    rf"\(NRMSE (?P<first>{NUMBER}) to (?P<last>{NUMBER})\)"
)
LEVEL = re.compile(
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
        pairs = [error_of(c, channel) for c in (diag.before, diag.after)]
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


def levels(text: str, diag: Any, comparison: Any, page: Page | None) -> Iterator[str]:
    """That errors are so large, by the traces of a comparison and by a simulation written here."""
    found = [*LEVEL.finditer(text)]
    if not found:
        yield "no error is told"
    for m in found:
        channel = m["channel"].replace(" ", "_")
        rmse, nrmse = error_of(comparison, channel)
        per = comparison.errors.channels[channel].per
        if not is_said(m["size"], per * rmse, SIMULATED):
            yield f"{channel}: {m['size']} is {per * rmse:.4g}"
        if not is_said(m["nrmse"], nrmse, SIMULATED):
            yield f"{channel}: NRMSE {m['nrmse']} is {nrmse:.4g}"
        if page:
            yield from _simulated(page, diag.fit, channel, m["nrmse"])


@claim(r"The (?P<model>[^:.]+?) lacks something that none of the effects tried explains\.")
def _lacks_unknown(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    if diag.verdict != "unexplained" or diag.added:
        yield f"verdict {diag.verdict}, added {diag.added}"
    if page and page.hidden is not None and page.law is None:
        yield f"known effects explain it: {sorted(page.hidden)}" if page.hidden else "it lacks none"


def amplitudes(fit: Any) -> list[float]:
    """Of periodic forces, in each log."""
    return [
        fit.parameters[f"{name}.amplitude"].value
        * np.hypot(start[f"{name}.sine"], start[f"{name}.cosine"])
        for name in (e.name for e in fit.model.effects if "sine" in e.free_starts)
        for start in fit.initial
    ]


def currents(fit: Any) -> list[float]:
    """How fast the water moves in each log, where that differs from log to log."""
    names = [e.name for e in fit.model.effects if e.differs and "to_north" in e.by_log]
    return [
        float(np.hypot(start[f"{name}.to_north"], start[f"{name}.to_east"]))
        for name in names
        for start in fit.initial
    ]


@claim(r"The (?P<model>[^:.]+?) lacks (?P<what>[^:]+?): with (?:it|them) (?P<gain>the .+?)\.")
def _lacks(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    named = re.sub(r"; these logs cannot tell it from .*?\)", ")", m["what"])
    named = re.sub(r"\(these logs cannot tell it from .*?\)", "", named)
    if uneven := re.search(UNEVEN, named):
        named = named.replace(uneven[0], "")
        yield from uneven_thrusters(uneven, diag)
    if moving := re.search(rf"\({MOVING}\)", named):
        named = named.replace(moving[0], "")
        yield from moving_water(moving, diag)
    if sagging := re.search(SAGGING, named):
        named = named.replace(sagging[0], "")
        yield from sagging_drive(sagging, diag)
    if blowing := re.search(rf"\({BLOWING}\)", named):
        named = named.replace(blowing[0], "")
        yield from blowing_wind(blowing, diag)
    for name in diag.added:
        if in_words(name) not in named:
            yield f"{name} was added"
    estimates = [e for n, e in diag.fit.parameters.items() if n.rpartition(".")[0] in diag.added]
    values = [e.shown[0] for e in estimates] + amplitudes(diag.fit) + currents(diag.fit)
    for number in re.findall(rf"(?<![\w.^]){NUMBER}(?!\^)", named):
        if not any(is_said(number, value, 1e-9) for value in values):
            yield f"no added parameter is {number}"
    if page and page.hidden is not None:
        for name, group in zip(diag.added, diag.groups, strict=True):
            if not page.hidden & {name, *group}:
                yield f"nothing of {name} is hidden"
    yield from _changes(m["gain"], diag, page)


SAGGING = (
    rf"\(the drive at (?P<least>{NUMBER}) V is (?P<share>\d+) % of that at (?P<most>{NUMBER}) V\)"
)


def sagging_drive(m: re.Match, diag: Any) -> Iterator[str]:
    """The drive at two voltages of the logs, by the law of the effect."""
    share, nominal = (
        diag.fit.parameters[f"supply_voltage_sag.{n}"].value for n in ("share", "nominal")
    )
    ends = [float(m["least"]), float(m["most"])]
    low, high = (1.0 + share * (volts / nominal - 1.0) for volts in ends)
    if not is_said(m["share"], 100.0 * low / high, 1e-2):
        yield f"the drive at {ends[0]} V is {low / high:.3f} of that at {ends[1]} V"
    seen = np.concatenate([log.inputs["supply_voltage"] for log in diag.fit.logs])
    if not seen.min() - 0.05 <= ends[0] < ends[1] <= seen.max() + 0.05:
        yield f"the logs hold {seen.min():.3g} to {seen.max():.3g} V"


UNEVEN = r"\(the (?P<weak>left|right) thruster gives (?P<share>\d+) % of the \w+ one's force\)"


def uneven_thrusters(m: re.Match, diag: Any) -> Iterator[str]:
    """What is not so in the words on how uneven two thrusters are."""
    values = {n: e.value for n, e in diag.fit.parameters.items()}
    left, right = 1.0 + values["differential_gain.gain"], 1.0 - values["differential_gain.gain"]
    power = values["exponent"] if diag.fit.model.command == "effort" else 1.0
    share = (right / left if m["weak"] == "right" else left / right) ** power
    if not is_said(m["share"], 100.0 * share):
        yield f"the {m['weak']} thruster gives {share:.3f} of the other's force"


MOVING = rf"the water moves at (?P<water>{NUMBER}) m/s"


def moving_water(m: re.Match, diag: Any) -> Iterator[str]:
    """What is not so in the words on how fast the water moves."""
    parts = [diag.fit.parameters[f"water_current.{n}"].value for n in ("to_north", "to_east")]
    if not is_said(m["water"], float(np.linalg.norm(parts))):
        yield f"the water moves at {np.linalg.norm(parts):.4g} m/s"


BLOWING = (
    rf"a wind(?: from (?P<origin>\d+) deg)? pushes the vessel, taken as (?P<wind>{NUMBER}) m/s"
)


def blowing_wind(m: re.Match, diag: Any) -> Iterator[str]:
    """What is not so in the words on a wind that no log measures."""
    direction, speed = (diag.fit.parameters[f"wind.{n}"].value for n in ("direction", "speed"))
    if m["origin"] and np.cos(np.radians(float(m["origin"])) - direction) < np.cos(np.radians(0.6)):
        yield f"it blows from {direction:.4g} rad"
    if not is_said(m["wind"], speed):
        yield f"its speed is {speed:.4g} m/s"
    if "wind_speed" in recorded(diag.fit):
        yield "the logs measure it"
    if m["origin"] and "heading" not in recorded(diag.fit):
        yield "no log has a heading"


def recorded(fit: Any) -> set[str]:
    """The channels of the logs that the model reads or gives."""
    return {*fit.ranges, *fit.train.channels}


@claim(r"(?:The (?P<model>[^:.]+?) is adequate: (?:none of the (?P<count>\d+) effects that were "
       r"tried|no effect) (?:matters over whole runs|helps on these logs)\.)")  # fmt: skip
@claim(r"The model is good enough(?: for these logs: "
       r"(?:none of (?P<count>\d+) effects|no effect) helps)?\.")  # fmt: skip
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
@claim(r"Unknown whether something is missing: (?:these logs can test no effect|no effect was "
       r"tried)\.")  # fmt: skip
def _untried(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    if diag.ranking or diag.silent:
        yield "effects were tried"


@claim(r"These logs show no effect that .+? lacks, and yet it follows (?P<channels>.+?) no better "
       r"than a constant would: do they excite what drives it\?")  # fmt: skip
def _blind(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    for channel in diag.judged.errors.channels:
        bad = error_of(diag.judged, channel)[1] >= 1.0
        if bad != (in_words(channel) in m["channels"]):
            yield f"{channel}: NRMSE {error_of(diag.judged, channel)[1]:.3g}"


@claim(r"(?:Without what was learned t|T)he [a-zA-Z ]+? error on (?:[a-z ]+?) is .+?"
       r"\(NRMSE [^()]+\)"
       r"(?:(?:, | and )the [a-zA-Z ]+? error is .+?\(NRMSE [^()]+\))*\.")  # fmt: skip
def _level(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    yield from levels(m[0], diag, diag.after, page)


@claim(r"(?:Without what was learned t|T)he [a-zA-Z ]+? error on [a-z ]+? "
       r"(?:falls|rises|stays) .+?\(NRMSE [^()]+\)"
       r"(?:(?:, | and )the .+?(?:\(NRMSE [^()]+\)|to \d[\d.]*))*\.")  # fmt: skip
def _change(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    text = m[0][:-1].replace("Without what was learned ", "")
    yield from _changes(text[0].lower() + text[1:], diag, page)


@claim(r"Undecided as long as the doubts on the logs stand: mend them first\.")
def _undecided_yet(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    kinds = [doubt.kind for doubt in diag.doubts]
    if diag.verdict != "undecided" or not {"sign", "exchanged"} & {*kinds}:
        yield f"verdict {diag.verdict}, doubts {kinds}"


@claim(rf"Undecided: over whole runs of (?P<logs>[a-z ]+?) (?P<level>the [a-zA-Z ]+? error is "
       rf"{NUMBER} ?[^()]*?\(NRMSE {NUMBER}\)), far above that from one "
       rf"(?:sample|row) to the next; (?:these logs cannot tell a disturbance from missing physics|"
       rf"where logs repeat their inputs, (?P<recurs>{WORTH}) of its square recurs(?P<forces>: "
       r"most of it comes from random forces)?)\.")  # fmt: skip
def _undecided(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    if diag.verdict != "undecided":
        yield f"verdict {diag.verdict}"
    yield from levels(m["level"], diag, diag.judged, None if diag.apart else page)
    channel = LEVEL.search(m["level"])["channel"].replace(" ", "_")
    trained = diag.apart[0].errors if diag.apart else diag.fit.train
    multiple = trained.channels[channel].rmse / diag.one_step.get(channel, np.nan)
    if not multiple > 2.0:
        yield f"it is {multiple:.3g} times as large"
    yield from _recurs(m["recurs"], channel, diag)
    if m["forces"] and not diag.recurring[channel].high < 0.5:
        yield f"{diag.recurring[channel]} recurs: more than half may"
    if m["forces"] and page and page.quiet:
        yield "no random force is at work: the truth reaches the noise of the sensors"


def _recurs(text: str | None, channel: str, diag: Any) -> Iterator[str]:
    """A share that recurs, by the correlation of the errors of two runs with the same inputs."""
    share = diag.recurring.get(channel)
    if bool(text) != bool(share):
        yield f"recurring: {share}"
    elif text and not worth_is(text, share):
        yield f"{text} recurs: {share}"


@claim(r"To decide, record a run that repeats the inputs of one of these logs: errors that recur "
       r"are physics, the others are a disturbance\.")  # fmt: skip
@claim(r"These logs cannot tell a disturbance from missing physics\.")
def _to_decide(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    if diag.verdict != "undecided":
        yield f"verdict {diag.verdict}"


@claim(rf"From one sample to the next the (?P<channel>[a-zA-Z ]+?) is mostly predicted to within "
       rf"(?P<step>{NUMBER}) ?[^;]*?; over whole runs of the training logs it errs by "
       rf"(?P<run>{NUMBER}) ?[^:]*? \(RMS\): no signal of these logs surely explains the "
       r"difference\. It is a disturbance, a lasting error of a sensor, or physics that these logs "
       r"do not show\.")  # fmt: skip
def _growth(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    channel = m["channel"].replace(" ", "_")
    per = diag.judged.errors.channels[channel].per
    trained = diag.apart[0].errors if diag.apart else diag.fit.train
    run = trained.channels[channel].rmse
    if diag.laws or diag.verdict == "unexplained":
        yield f"{diag.verdict}, learned: {diag.laws}"
    for number, value in zip((m["step"], m["run"]), (diag.one_step[channel], run), strict=True):
        if not is_said(number, per * value, SIMULATED):
            yield f"{number} is {per * value:.3g}"


@claim(rf"An? (?P<model>[^:.]+?) errs less over whole runs of the same (?P<logs>unseen|training) "
       rf"logs: NRMSE (?P<other>{NUMBER}) against (?P<here>{NUMBER})(?P<found> with all that was "
       r"found)?\. Diagnose that model, too\.")  # fmt: skip
def _other_model(m: re.Match, diag: Any, page: Page | None) -> Iterator[str]:
    other = next((o for o in diag.other_models if in_words(o.name) in m["model"]), None)
    if other is None:
        yield f"other models: {[o.name for o in diag.other_models]}"
        return
    for effect in other.best.model.effects:
        if in_words(effect.name) not in m["model"]:
            yield f"it has {effect.name}, too"
    for number, fit in ((m["other"], other.best), (m["here"], last_fit(diag))):
        errors = fit.holdout if m["logs"] == "unseen" else fit.train
        if not is_said(number, errors.nrmse, SIMULATED):
            yield f"NRMSE {number} is {errors.nrmse:.4g}"
        if page and not diag.laws:
            try:
                reached = page.modelled(fit)["all"]
            except equations.Unwritten:
                continue
            if not is_said(number, reached, 2 * SIMULATED):
                yield f"NRMSE {number} is {reached:.4g} by an independent simulation"
    if not float(m["other"]) < float(m["here"]):
        yield "it errs no less"

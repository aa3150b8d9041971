"""The summary of a diagnosis: what is wrong with the logs, what is missing, what to do next.

In the order in which a tired engineer asks, one line each, within a budget of words and figures
(`budget`). All else is in the details.
"""

from __future__ import annotations

from diffthrust._support.words import counted, distinct_numbers, humanize, joined
from diffthrust.diagnosis._explained_share import sure_share, surely_removes
from diffthrust.diagnosis._findings import Findings
from diffthrust.diagnosis._missing import Remaining
from diffthrust.diagnosis._report.budget import Part, as_part, figures_in, within_budget
from diffthrust.diagnosis._report.details import changed_parameter
from diffthrust.diagnosis._report.doubts import doubtful, open_readings
from diffthrust.diagnosis._report.error_text import finite, grown_channel
from diffthrust.diagnosis._report.learned import law_wordings, place_of, reach_words, valid_words
from diffthrust.diagnosis._report.text import (
    adding_little,
    amount,
    an_effect,
    better_model,
    blind_channels,
    candidate_words,
    change_words,
    effect_words,
    errors_of,
    last_errors,
    leading,
    provisional,
    ran_away,
    rival_words,
    tried_count,
    unmeasured_rivals,
    with_unit,
)
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.estimation._origin import effects_line
from diffthrust.simulation._errors import Errors

TO_COPY = "To copy into a spec file"
"""Heading of the lines that make the model with all that was found."""
_KEPT_OUT = "logs kept out of the fit"
"""Unseen logs, for who reads the answer alone."""
_LEAST_TOLD = 0.1
"""Display: of a missing signal's variance, or of one-step errors. What depends on the rate of a
tanker's heading by 3 % stood in its answer as if that were the cause."""
_MOST = 0.5
"""Display: of a squared error. A T200's was 98 % that of a supply voltage that no other log had,
and its answer spoke of a drive that depends on speed."""


def summary(diag: Findings) -> str:
    """The answer, in at most sixty words and four figures."""
    findings = [
        _missing(diag),
        _unmeasured(diag),
        *_laws(diag),
        _error(diag),
        _raised(diag),
        _small(diag),
        _possible(diag),
        _left(diag),
        _other_model(diag),
    ]
    # of logs to be mended first it may be the same mistake: two thrusters of a BlueBoat steered
    # "with -6 % of the logged moment" below a turned yaw rate
    below = diag.helpful_mends or ran_away(diag) or not diag.sought
    return within_budget([*doubtful(diag), *([] if below else findings), _next(diag)])


# -- what is missing -------------------------------------------------------------------------------


def _missing(diag: Findings) -> Part:
    if diag.best:
        return _effects(diag)
    if diag.held or diag.laws:
        return ()
    if diag.verdict == "adequate":
        return _adequate(diag)
    if diag.verdict == "undecided":
        return as_part((12, "These logs cannot tell a disturbance from missing physics"))
    return as_part((7, _unknown_words(diag, "Missing")), (12, "Missing: something unknown"))


def _effects(diag: Findings) -> Part:
    """The added effects, the one that removes most first; fewer with their sizes in each wording.

    At first with what these logs cannot tell from them. Without those that add little beside the
    others, which follow behind the error.
    """
    small = adding_little(diag)
    names = [name for name in leading(diag) if name not in small]
    if not names:
        return ()
    lines, hedged, wordings = [], [], []
    rivals = rival_words(diag)
    shaky = provisional(diag)
    for name in names:
        worth = diag.worth.get(name)
        sure = worth is None or surely_removes(worth)
        label = "Found" if sure and not shaky else "Perhaps"
        lines.append(f"{label}: {effect_words(name, diag.fit)}")
        hedged.append(lines[-1] + (f", or it is {rivals[name]}" if name in rivals else ""))
    count = len(names)
    for k in range(count, 0, -1):
        also = [f"Also: {joined(map(humanize, names[k:]))}"] if k < count else []
        if hedged[:k] != lines[:k]:
            wordings.append((4, ".\n".join([*hedged[:k], *also])))
        wordings.append(((11, 11, 10)[k] if k < 3 else 7, ".\n".join([*lines[:k], *also])))
    label = "Perhaps" if shaky else "Found"
    return as_part(*wordings, (13, f"{label}: {counted(count, 'effect')}, see below"))


def _small(diag: Findings) -> Part:
    names = adding_little(diag)
    if not names:
        return ()
    words = joined(effect_words(name, diag.fit) for name in names)
    return as_part(
        (6, f"Adds little: {words}"), (8, f"Adds little: {joined(map(humanize, names))}")
    )


def _adequate(diag: Findings) -> Part:
    count = tried_count(diag)
    if not count:
        tested = "these logs can test no effect" if diag.untestable else "no effect was tried"
        return as_part((12, f"Unknown whether something is missing: {tested}"))
    if blind := blind_channels(diag):
        nothing, as_well = "Nothing found, and yet", "followed no better than by a constant"
        return as_part(
            (4, f"{nothing} {blind} is {as_well}: do the logs excite it?"),
            (12, f"{nothing} the logs are {as_well}"),
        )
    tried = f"none of {count} effects helps" if count > 1 else "no effect helps"
    good = "The model is good enough"
    return as_part((4, f"{good} for these logs: {tried}"), (12, good))


def _laws(diag: Findings) -> list[Part]:
    """Of each learned law where it acts, its form, its size, and where it is valid."""
    parts = []
    for law in diag.laws:
        label = "Perhaps" if provisional(diag) else "Found"
        label += f" {place_of(diag.model, law.curve.port)}"
        whole, lead, bare = (f"{label}: {words}" for words in law_wordings(law))
        size, valid = (f", {w}" if w else "" for w in (reach_words(law), valid_words(law)))
        parts.append(
            as_part(
                (1, whole + size + valid),
                (2, lead + size + valid),
                (6, lead + size),
                (7, lead),
                (12, bare),
            )
        )
    return parts


def _error(diag: Findings) -> Part:
    """By how much the error of the channel that counts falls, or how large errors are."""
    logs, first, last = _before_and_after(diag)
    logs = _KEPT_OUT if logs == "unseen logs" else logs
    if not (diag.best or diag.held or diag.laws):
        names = sorted(last.channels, key=lambda name: -finite(last.channels[name].nrmse))
        sizes = [f"{humanize(n)} {with_unit(*last.channels[n].shown)}" for n in names[:2]]
        words = f"Error on {logs}: "
        return as_part((5, words + ", ".join(sizes)), (8, words + sizes[0]))
    name = channel_that_counts(first, last)
    size, unit = first.channels[name].shown
    change = amount(change_words(size, last.channels[name].shown.value), unit)
    error = f"{humanize(name)} error"
    short = " on unseen logs" * (logs == _KEPT_OUT)
    return as_part((4, f"The {error} on {logs} {change}"), (9, f"The {error}{short} {change}"))


def _before_and_after(diag: Findings) -> tuple[str, Errors, Errors]:
    """As `errors_of`, the last errors with what was learned, if anything was."""
    logs, first, last = errors_of(diag)
    return logs, first, last_errors(diag) if diag.laws else last


def raised_channel(first: Errors, last: Errors) -> str:
    """The channel whose squared error rises most, each in units of its own spread.

    By a tenth of what it was, and of what the channel that counts has lost of its own.
    """
    counts = channel_that_counts(first, last)
    names = [n for n in first.channels if n in last.channels and n != counts]
    name = min(names, key=lambda n: _fall(n, first, last), default="")
    if not name:
        return ""
    before = finite(first.channels[name].nrmse) ** 2
    least = SETTINGS.whole_runs.one_channel_share * max(before, _fall(counts, first, last))
    return name if -_fall(name, first, last) > least else ""


def _fall(name: str, first: Errors, last: Errors) -> float:
    return finite(first.channels[name].nrmse) ** 2 - finite(last.channels[name].nrmse) ** 2


def _raised(diag: Findings) -> Part:
    """The channel that errs more with what was found.

    Of an Otter a friction took a quarter off the surge error, and the heading went from 43 to 68
    deg off: its answer told the first alone.
    """
    if not (diag.best or diag.held or diag.laws):
        return ()
    _, first, last = _before_and_after(diag)
    if not (name := raised_channel(first, last)):
        return ()
    rises = f"But the {humanize(name)} error rises"
    size = with_unit(*last.channels[name].shown)
    return as_part((6, f"{rises} to {size}"), (11, rises))


def channel_that_counts(first: Errors, last: Errors) -> str:
    """The channel whose squared error falls most, each in units of its own spread.

    Of those that are followed better than by a constant, if there are any: of a BlueBoat the sway
    led, from 1.8 to 1.2 of its spread, and not the yaw rate, from 0.64 to 0.42.
    """
    names = [n for n in first.channels if n in last.channels]
    followed = [n for n in names if last.channels[n].nrmse < 1.0]
    return max(followed or names, key=lambda name: _fall(name, first, last))


def _unmeasured(diag: Findings) -> Part:
    """Channels that no log has, and that could be what was found and adds more than a little."""
    small = adding_little(diag)
    rivals = [
        (channel, an_effect(name))
        for name, channel in unmeasured_rivals(diag).items()
        if name not in small
    ]
    if not rivals:
        return ()
    said = [f"The {name} was not measured: it could look like {effect}" for name, effect in rivals]
    short = "Unmeasured {} could look like {}".format(*rivals[0])
    return as_part((4, ". ".join(said)), (5, said[0]), (8, short))


def _possible(diag: Findings) -> Part:
    possible = [
        candidate_words(diag, name, humanize)
        for name, worth in diag.possible.items()
        if sure_share(worth)
    ]
    if not possible:
        return ()
    words = "Possibly also: "
    return as_part((3, words + joined(possible, "or")), (4, words + possible[0]))


# -- what is left, and what to do next -------------------------------------------------------------


def _left(diag: Findings) -> Part:
    """What is left besides what was found: structure, or errors that grow over whole runs."""
    if diag.verdict == "undecided" or not (diag.best or diag.held or diag.laws):
        return ()
    if far := next((odd for odd in diag.odd_logs if odd.beyond and odd.share > _MOST), None):
        words = f"Left: most of the {humanize(far.channel)} error, in log {far.log}"
        short = f"Left: mostly in log {far.log}"
        return as_part((6, f"{words} ({joined(far.beyond)})"), (7, words), (8, short))
    if changed := diag.changed:
        words, unit = f"Unexplained: {changed_parameter(changed)}", changed.after.shown[2]
        start, end = distinct_numbers(changed.before.shown[0], changed.after.shown[0])
        return as_part((5, f"{words}, {start} -> {end} {unit}".rstrip()), (6, words))
    if diag.verdict == "unexplained" and not diag.laws:
        words = ["Unexplained: something unknown", "Unexplained: something"]
        if remaining := diag.remaining:
            words = [f"{each} {place_of(diag.model, remaining.port)}" for each in words]
        long, short = words
        return as_part((5, _unknown_words(diag, "Unexplained")), (7, long), (8, short))
    last, then = last_errors(diag), "; repeat one run"
    name, _ = grown_channel(diag, last)
    if not name:
        return ()
    _, *errors = _before_and_after(diag)
    # the line of its error has its size
    if name in (channel_that_counts(*errors), raised_channel(*errors)):
        what = f"Unexplained: what is left of the {humanize(name)} error"
        return as_part((3, f"{what}{then}: what recurs is physics"), (5, f"{what}{then}"))
    what = f"Unexplained: {humanize(name)}"
    size = with_unit(*last.channels[name].shown)
    return as_part((7, f"{what} off by {size}{then}"), (8, f"{what}{then}"))


def _unknown_words(diag: Findings, label: str) -> str:
    """Something unknown, and what is known of it: on what it depends, and where it enters."""
    if remaining := diag.remaining:
        signal = remaining.signal
        on = f"how fast {humanize(signal.name)} changes" if signal.rate else str(signal)
        words = f"{label}: something unknown {place_of(diag.model, remaining.port)}"
        return f"{words} that depends on {on}" if _explains(diag, remaining) else words
    if diag.repeating:
        channels = joined(map(humanize, diag.repeating))
        return f"{label}: something unknown; the error of {channels} repeats from run to run"
    return f"{label}: something unknown"


def _explains(diag: Findings, remaining: Remaining) -> bool:
    """Whether what remains depends on its signal so much that the answer should say so."""
    missing = diag.left if diag.best else diag.missing
    shares = [m.share for m in missing if m.port == remaining.port and m.signal is not None]
    return max(remaining.share, *shares, 0.0) >= _LEAST_TOLD


def _other_model(diag: Findings) -> Part:
    if other := better_model(diag):
        return as_part((6, f"A {humanize(other.name)} errs less: diagnose that model, too"))
    return ()


def _next(diag: Findings) -> Part:
    """What to write, or which record to make."""
    if mends := diag.helpful_mends:
        if open_readings(diag, mends[0]):
            return as_part((10, "How to mend either stands below"))
        line = mends[0].reading.line.partition(", or ")[0].rstrip(".")
        table, _, key = line.partition("] ")  # "[channels.thrust] scale = -1"
        return as_part((10, f"Copy under {table}]: {key}" if key else f"Copy: {line}"))
    if not diag.sought:
        return as_part((10, "How to mend them stands below"))
    if ran_away(diag):
        words = "Next: check signs, units and the sense of angles"
        return as_part((9, f"{words}, or hold a mass that you know"), (10, words))
    if (diag.best or diag.laws) and provisional(diag):
        words = "Next: fit again, from more starts or with constants held that you know"
        return as_part((9, words), (10, "Next: fit again from more starts"))
    lines = (6, f"Copy: the lines under '{TO_COPY}'"), (10, "Copy the lines below")
    if diag.laws:
        return as_part(*lines)
    if diag.best:
        line = f"Copy: {effects_line(diag.fit.model.effects)}"
        # of numbers that stand below [parameters]
        several = figures_in(line) or diag.fit.model.per_log
        return as_part(*lines) if several else as_part((10, line))
    if diag.held:
        return as_part((9, f"Copy: {next(iter(diag.held))} = {{ fixed = false }}"))
    if diag.verdict == "undecided":
        if diag.experiment and diag.possible:
            return as_part((9, "Next: make the test proposed below"))
        return as_part((9, "Next: repeat one run with the same inputs; what recurs is physics"))
    return ()

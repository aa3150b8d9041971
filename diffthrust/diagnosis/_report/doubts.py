"""What is wrong with the logs, or with what was given.

Doubts and what undoing them does to the error, in sentences; and the first lines of a summary.
"""

from __future__ import annotations

from diffthrust._support.words import (
    capitalised,
    count_words,
    distinct_numbers,
    humanize,
    joined,
    percent,
)
from diffthrust.diagnosis._findings import Findings
from diffthrust.diagnosis._mended import MeasuredMend, best_mends, mends_of, unjudged
from diffthrust.diagnosis._report.budget import Part, as_part
from diffthrust.diagnosis._report.text import (
    UNFINISHED,
    amount,
    change_words,
    copied_fit,
    ran_away,
    stopped_parameters,
    vanished_words,
    with_unit,
)
from diffthrust.soundness._doubt import Doubt, Reading

_GRAVE = {
    "sign": "the sign of {} looks wrong",
    "exchanged": "{} looks exchanged with another channel",
    "unit": "the unit of {} looks wrong",
    "time_base": "the unit of the clock looks wrong",
    "lag": "{} arrives late",
    "stuck": "readings of {} are repeated",
    "saturated": "{} is saturated in places",
    "sentinel": "{} has samples that mark lost ones",
}
"""Kinds of doubts that the summary names, and what each comes to: what a channel means, and which
samples are readings."""
UNSOUGHT = "No effect was sought in logs that are to be mended first."
_NAMED = 2
"""Doubts that the details name; the report lists all."""
_FALLS = 0.005
"""Display: a smaller share of an error is none."""


# -- in sentences ----------------------------------------------------------------------------------


def leading_doubt_words(diag: Findings) -> list[str]:
    """What the details begin with: mends that help, and doubts that no refit can judge."""
    sentences = [
        f"First the logs: {mend.doubt.evidence} {mend_words(mend)} {_mend_line(diag, mend)}"
        for mend in diag.helpful_mends[:_NAMED]
    ]
    if not diag.sought:
        sentences.append(UNSOUGHT)
    elif sentences:
        sentences.append("What follows is said of the logs as they are: mend them first.")
    return [*sentences, *(_doubt_words(doubt) for doubt in grave_doubts(diag)[:_NAMED])]


def grave_doubts(diag: Findings) -> list[Doubt]:
    """The graver doubts of which a mistake is left that no fit to mended logs has judged.

    And those for which nothing was sought, that a mend may be right. None for which a mend helps,
    for that leads. Of a BlueBoat the sign of a yaw rate was judged, and helped for nothing certain,
    and the exchange of left and right, which it may be as well, was not.
    """
    stopping = [] if diag.sought else [mend.doubt for mend in diag.mends if mend.lowers]
    return [
        doubt
        for doubt in diag.doubts
        if doubt.kind in _GRAVE
        and not mends_of(doubt, diag.helpful_mends)
        and (unjudged(doubt, diag.mends) or not doubt.readings or doubt in stopping)
    ]


def mend_words(mend: MeasuredMend) -> str:
    """What the mend of a doubt does to the error over whole runs."""
    change = change_words(mend.before.nrmse, mend.after.nrmse)
    channels = joined(
        f"{humanize(name)} "
        f"{' to '.join(distinct_numbers(error.nrmse, mend.after.channels[name].nrmse))}"
        for name, error in mend.before.channels.items()
    )
    several = f": {channels}" if len(mend.before.channels) > 1 else ""
    runs = "whole unseen runs" if mend.unseen else "whole training runs"
    return (
        f"{capitalised(f'with {mend.reading.words}')} the error over {runs} {change} (NRMSE"
        f"{several}), fitted to the logs so mended; it removes {mend.worth} of its square."
    )


def _mend_line(diag: Findings, mend: MeasuredMend) -> str:
    """What to write, and for which logs; either line where another reading may be the true one."""
    where = f", for {joined(mend.doubt.logs)} alone" if mend.doubt.logs else ""
    others = open_readings(diag, mend)
    if not others:
        return f"Mend{where}: {mend.reading.line}"
    lines = "; or ".join(f"{each.words}, {each.line}" for each in (mend.reading, *others))
    return f"Look which of these is true, and mend that alone{where}: {lines}"


def open_readings(diag: Findings, mend: MeasuredMend) -> list[Reading]:
    """The other mistakes that a doubt may come from, but for those whose mend was seen to do harm.

    Of a BlueBoat whose left and right are exchanged a turned yaw rate errs least: these logs do not
    tell, and who turns the gyroscope of a boat with exchanged cables has two mistakes.
    """
    harmful = [m.reading.words for m in diag.mends if m.doubt is mend.doubt and m.worth.high <= 0]
    settled = mend.reading.words, *harmful
    return [reading for reading in mend.doubt.readings if reading.words not in settled]


def doubt_bullets(diag: Findings) -> list[str]:
    """Every doubt, with what each reading that undoes it does to the error."""
    best = {id(mend) for mend in best_mends(diag.mends)}
    bullets = []
    for doubt in diag.doubts:
        tried = sorted(diag.mends_of(doubt), key=lambda mend: id(mend) not in best)
        bullets.append(" ".join([_doubt_words(doubt), *map(mend_words, tried)]))
    return bullets


def _doubt_words(doubt: Doubt) -> str:
    return f"A doubt on {humanize(doubt.channel)}: {doubt.evidence} Mend: {doubt.mend}"


# -- as lines of a summary -------------------------------------------------------------------------


def doubtful(diag: Findings) -> list[Part]:
    """What comes first: whether the logs are sound, and what of the given to look at."""
    if not diag.sought:
        return [_logs(diag), _unsought(diag)]
    return [
        _sound(diag),
        _logs(diag),
        _ran_away(diag),
        _odd_logs(diag),
        _caution(diag),
        _bounds(diag),
        as_part(*((4, words.removesuffix(".")) for words in vanished_words(diag))),
        _held(diag),
        _as_they_are(diag),
    ]


def _sound(diag: Findings) -> Part:
    """That nothing looks wrong with the logs, where that was looked for; that tables have no time.

    Both are one line: in a summary of a map with two findings there was room for the first alone.
    """
    odd = any(log.accused for log in diag.odd_logs)
    sought = diag.stages[0].fit.doubts_sought
    sound = sought and not (odd or diag.doubts or diag.before.hints or ran_away(diag))
    if diag.before.tabular:
        words = "The logs are tables without time"
        return as_part((5, f"{words}. They look sound" if sound else words))
    return as_part((5, "The logs look sound")) if sound else ()


def _logs(diag: Findings) -> Part:
    """The mend that helps most, with what it does to the error; or the gravest doubt."""
    if diag.helpful_mends:
        return _mends(diag)
    doubts = [doubt for doubt in grave_doubts(diag) if not doubt.harmless]
    suspects = [
        _GRAVE[doubt.kind].format(humanize(doubt.channel) + " and others" * bool(doubt.also))
        for doubt in doubts
    ]
    if suspects:
        words = "Check the logs: "
        others = "".join(f", or {reading.words}" for reading in doubts[0].readings[1:])
        return as_part(
            (3, words + joined([suspects[0] + others, *suspects[1:]])),
            (4, words + suspects[0] + others),
            (11, words + suspects[0]),
        )
    if diag.before.hints:
        return as_part((11, "Check the logs: a channel may not mean what its name says"))
    return ()


def _unsought(diag: Findings) -> Part:
    """That nothing else was looked for; where a mend helps, its line says to diagnose again."""
    if diag.helpful_mends:
        return ()
    whole = "No effect was sought: mend the logs, then diagnose again"
    return as_part((9, whole), (11, "No effect was sought"))


def _mends(diag: Findings) -> Part:
    """The mend that helps most, and beside it each other mistake that its doubt may come from.

    Of a BlueBoat with exchanged sides a turned yaw rate errs least, and who read that line alone
    turned a sound gyroscope.
    """
    first = diag.helpful_mends[0]
    others = [reading.words for reading in open_readings(diag, first)]
    of_doubt = {mend.reading.words: mend for mend in diag.mends_of(first.doubt)}
    runs = "unseen" if first.unseen else "training"
    falls = (
        "First mend the logs, then diagnose again: "
        f"with {first.reading.words} the {runs} error {_falls(first)}"
    )
    wordings = [falls]
    if others:
        all_fall = ", ".join(f"with {words} it {_falls(of_doubt.get(words))}" for words in others)
        look = ": look which of them is true"
        wordings = [f"{falls}, {all_fall}{look}", f"{falls}, or it is {joined(others, 'or')}{look}"]
    mended = joined([first.reading.words, *others], "or")
    return as_part(*enumerate(wordings, 10), (13, f"First diagnose again with {mended}"))


def _falls(mend: MeasuredMend | None) -> str:
    """What the error over whole runs does with a mend."""
    if mend is None:
        return "was not tried"
    falls = 1.0 - mend.after.nrmse / mend.before.nrmse
    return f"falls by {percent(falls)}" if falls > _FALLS else "does not fall"


def _ran_away(diag: Findings) -> Part:
    """That no fit came to values that a vehicle can have: something given or logged is wrong."""
    if not (far := ran_away(diag)):
        return ()
    name, value = far
    words = f"No fit is to be believed: {name} ran away"
    size = with_unit(value, diag.fit.parameters[name].unit)
    return as_part((12, f"{words} to {size}"), (13, words))


def _as_they_are(diag: Findings) -> Part:
    """That what was found stands below: it may be the same mistake, and who mends both has it back.

    On the BlueBoat an exchange of the thrusters stood below a turned yaw rate.
    """
    if not ((diag.helpful_mends or ran_away(diag)) and (diag.best or diag.held or diag.laws)):
        return ()
    return as_part((10, "What is told below may come from this mistake"))


def _odd_logs(diag: Findings) -> Part:
    accused = [odd.log for odd in diag.odd_logs if odd.accused]
    if not accused:
        return ()
    several = len(accused) > 1
    are, deviate = ("are", "deviate") if several else ("is", "deviates")
    apart = f", and {are} left out of the verdict" if diag.apart else ""
    some = f"{count_words(len(accused)).capitalize()} logs" if several else "A log"
    return as_part(
        (3, f"Log{'s' * several} {joined(accused)} {deviate} from the others{apart}"),
        (5, f"{some} {deviate} from the others"),
    )


def _caution(diag: Findings) -> Part:
    """That the fit that is copied may not be what it should."""
    status = copied_fit(diag).status
    if not status.ok:
        return as_part((11, f"Caution: {UNFINISHED[status].format('the last fit')}"))
    if diag.laws or not diag.fit.coarse:  # a law is fitted with as fine steps as it needs
        return ()
    return as_part((11, "Caution: the last fit needs finer integrator steps"))


def _bounds(diag: Findings) -> Part:
    """Parameters at bounds that cost something.

    Not where a mend of the logs leads: these may be its doing.
    """
    stopped = [
        (name, bound)
        for full, (name, bound, _) in stopped_parameters(diag.fit).items()
        if full in diag.model.parameters and full not in diag.idle_bounds
    ]
    if not stopped or diag.helpful_mends:
        return ()
    name, bound = stopped[0]
    words = f"{name} is at its bound"
    every = f"{words} of {bound}: widen it"
    if len(stopped) > 1:
        every = f"{joined(name for name, _ in stopped)} are at their bounds: widen these"
    return as_part((3, every), (6, f"{words}: widen it"))


def _held(diag: Findings) -> Part:
    if not diag.held:
        return ()
    (name, held), *others = diag.held.items()
    fixed, wanted = distinct_numbers(held.value, held.wanted)
    words = f"{name} is fixed at {fixed}; these logs suggest {amount(wanted, held.unit)}"
    words = diag.fit.model.constant_words(name, held.value, held.wanted) or words
    too = f", and others of {joined(name for name, _ in others)}" if others else ""
    short = f"{name} is fixed; these logs suggest another value"
    return as_part((3, words + too), (7, words), (12, short))

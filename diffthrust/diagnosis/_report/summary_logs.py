"""The lines of a summary on what is wrong with the logs, or with what was given."""

from __future__ import annotations

from diffthrust._support.words import (
    count_words,
    distinct_numbers,
    humanize,
    joined,
    number,
    percent,
)
from diffthrust.diagnosis._findings import Findings
from diffthrust.diagnosis._mended import MeasuredMend
from diffthrust.diagnosis._report.budget import Part, as_part
from diffthrust.diagnosis._report.doubts import grave_doubts, open_readings
from diffthrust.diagnosis._report.text import (
    UNFINISHED,
    copied_fit,
    ran_away,
    stopped_parameters,
    vanished_words,
)

_SUSPECT = {
    "sign": "the sign of {} looks wrong",
    "exchanged": "{} looks exchanged with another channel",
    "unit": "the unit of {} looks wrong",
    "time_base": "the unit of the clock looks wrong",
    "lag": "{} arrives late",
    "stuck": "readings of {} are repeated",
    "saturated": "{} is saturated in places",
    "sentinel": "{} has samples that mark lost ones",
}
"""What a doubt comes to, by its kind."""
_FALLS = 0.005
"""Display: a smaller share of an error is none."""


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
        _vanished(diag),
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
        _SUSPECT[doubt.kind].format(humanize(doubt.channel) + " and others" * bool(doubt.also))
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
    falls = f"with {first.reading.words} the {runs} error {_falls(first)}"
    begin, look = "First mend the logs, then diagnose again", ": look which of them is true"
    if not others:
        wordings = [f"{begin}: {falls}"]
    else:
        all_fall = ", ".join(f"with {words} it {_falls(of_doubt.get(words))}" for words in others)
        wordings = [
            f"{begin}: {falls}, {all_fall}{look}",
            f"{begin}: {falls}, or it is {joined(others, 'or')}{look}",
        ]
    mended = joined([first.reading.words, *others], "or")
    parts = [(10 + k, words) for k, words in enumerate(wordings)]
    return as_part(*parts, (13, f"First diagnose again with {mended}"))


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
    unit = diag.fit.parameters[name].unit
    words = f"No fit is to be believed: {name} ran away"
    return as_part((12, f"{words} to {number(value, 2)} {unit}".rstrip()), (13, words))


def _as_they_are(diag: Findings) -> Part:
    """That what was found stands below: it may be the same mistake, and who mends both has it back.

    On the BlueBoat an exchange of the thrusters stood below a turned yaw rate.
    """
    found = diag.best or diag.held or diag.laws
    if not ((diag.helpful_mends or ran_away(diag)) and found):
        return ()
    return as_part((10, "What is told below may come from this mistake"))


def _odd_logs(diag: Findings) -> Part:
    accused = [odd for odd in diag.odd_logs if odd.accused]
    if not accused:
        return ()
    several = len(accused) > 1
    are, deviate = ("are", "deviate") if several else ("is", "deviates")
    apart = f", and {are} left out of the verdict" if diag.apart else ""
    names = joined(odd.log for odd in accused)
    some = f"{count_words(len(accused)).capitalize()} logs" if several else "A log"
    return as_part(
        (3, f"Log{'s' * several} {names} {deviate} from the others{apart}"),
        (5, f"{some} {deviate} from the others"),
    )


def _caution(diag: Findings) -> Part:
    """That the fit that is copied may not be what it should."""
    status = copied_fit(diag).status
    if not status.ok:
        whole = f"Caution: {UNFINISHED[status].format('the last fit')}"
        short = ": ".join(whole.split(": ")[:2])
        return as_part((6, whole), (11, short)) if short != whole else as_part((11, whole))
    if diag.laws or not diag.fit.coarse:  # a law is fitted with as fine steps as it needs
        return ()
    return as_part((11, "Caution: the last fit needs finer integrator steps"))


def _bounds(diag: Findings) -> Part:
    """Parameters at bounds that cost something.

    Not where a mend of the logs leads: these may be its doing.
    """
    if diag.helpful_mends:
        return ()
    stopped = [
        (name, amount)
        for full, (name, amount, _) in stopped_parameters(diag.fit).items()
        if full in diag.model.parameters and full not in diag.idle_bounds
    ]
    if not stopped:
        return ()
    name, amount = stopped[0]
    if len(stopped) > 1:
        words = f"{joined(name for name, _ in stopped)} are at their bounds: widen these"
        return as_part((3, words), (6, f"{name} is at its bound: widen it"))
    words = f"{name} is at its bound"
    return as_part((3, f"{words} of {amount}: widen it"), (6, f"{words}: widen it"))


def _vanished(diag: Findings) -> Part:
    """That the model does without a term with which it was given."""
    return as_part(*((4, words.removesuffix(".")) for words in vanished_words(diag)))


def _held(diag: Findings) -> Part:
    if not diag.held:
        return ()
    (name, held), *others = diag.held.items()
    fixed, wanted = distinct_numbers(held.value, held.wanted)
    words = f"{name} is fixed at {fixed}; these logs suggest {wanted} {held.unit}".rstrip()
    words = diag.fit.model.constant_words(name, held.value, held.wanted) or words
    short = f"{name} is fixed; these logs suggest another value"
    too = f", and others of {joined(name for name, _ in others)}" if others else ""
    return as_part((3, words + too), (7, words), (12, short))

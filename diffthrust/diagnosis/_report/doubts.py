"""Doubts on the logs in sentences: what they are, and what undoing them does to the error."""

from __future__ import annotations

from diffthrust._support.words import capitalised, distinct_numbers, humanize, joined
from diffthrust.diagnosis._findings import Findings
from diffthrust.diagnosis._mended import MeasuredMend, best_mends, unjudged
from diffthrust.soundness._doubt import Doubt, Reading

_GRAVE = ("sign", "exchanged", "unit", "time_base", "lag", "stuck", "saturated", "sentinel")
"""Kinds of doubts that the summary names: what a channel means, and which samples are readings."""
UNSOUGHT = "No effect was sought in logs that are to be mended first."
_NAMED = 2
"""Doubts that the summary names; the report lists all."""


def leading_doubt_words(diag: Findings) -> list[str]:
    """What a summary begins with: mends that help, and doubts that no refit can judge."""
    sentences = [
        f"First the logs: {mend.doubt.evidence} {mend_words(mend)} {mend_line(diag, mend)}"
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
    helped = {(mend.doubt.channel, mend.doubt.kind) for mend in diag.helpful_mends}
    return [
        doubt
        for doubt in diag.doubts
        if doubt.kind in _GRAVE
        and (doubt.channel, doubt.kind) not in helped
        and (unjudged(doubt, diag.mends) or not doubt.readings or doubt in stopping)
    ]


def mend_words(mend: MeasuredMend) -> str:
    """What the mend of a doubt does to the error over whole runs."""
    low, high = distinct_numbers(mend.before.nrmse, mend.after.nrmse)
    verb = "falls" if mend.after.nrmse < mend.before.nrmse else "rises"
    change = f"{verb} from {low} to {high}" if low != high else f"stays at {low}"
    channels = joined(
        f"{humanize(name)} {' to '.join(distinct_numbers(error.nrmse, updated.nrmse))}"
        for name, error in mend.before.channels.items()
        for updated in (mend.after.channels[name],)
    )
    several = f": {channels}" if len(mend.before.channels) > 1 else ""
    runs = "whole unseen runs" if mend.unseen else "whole training runs"
    return (
        f"{capitalised(f'with {mend.reading.words}')} the error over {runs} {change} (NRMSE"
        f"{several}), fitted to the logs so mended; it removes {mend.worth} of its square."
    )


def mend_line(diag: Findings, mend: MeasuredMend) -> str:
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
        tried = diag.mends_of(doubt)
        tried.sort(key=lambda mend: id(mend) not in best)
        words = " ".join(map(mend_words, tried))
        bullets.append(f"{_doubt_words(doubt)} {words}".rstrip())
    return bullets


def _doubt_words(doubt: Doubt) -> str:
    return f"A doubt on {humanize(doubt.channel)}: {doubt.evidence} Mend: {doubt.mend}"

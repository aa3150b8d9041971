"""What matters over whole runs, in plain sentences: worths, what is possible, what is left."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from diffthrust._support.tables import number
from diffthrust._support.words import an, joined, percent, spelt

if TYPE_CHECKING:
    from diffthrust.diagnosis._explained_share import Worth
    from diffthrust.diagnosis._findings import Findings
    from diffthrust.simulation._errors import Errors

_GROWN = 4.0
"""Errors over whole runs are told apart from one-step errors where they are so much larger."""


def errors_of(diag: Findings) -> tuple[str, Errors, Errors]:
    """Name of the logs that count, and the errors on them at the first and the last stage."""
    first, last = diag.stages[0], diag.stages[-1]
    if first.holdout is not None and last.holdout is not None:
        return "unseen logs", first.holdout, last.holdout
    return "the training logs", first.train, last.train


def judged_errors(diag: Findings) -> tuple[str, Errors]:
    """Name of the logs on which the verdict rests, and the errors of the last stage on them."""
    logs, _, after = errors_of(diag)
    if diag.apart is None:
        return logs, after
    return f"the other {logs.removeprefix('the ')}", diag.judged.errors


def share_words(worth: Worth) -> str:
    """A worth with its interval.

    Example:
        >>> share_words(Worth(0.72, 0.6, 0.8))
        '72 % (60 % to 80 %)'
    """
    return "{} ({})".format(*share_cells(worth))


def share_cells(worth: Worth) -> tuple[str, str]:
    """A worth and its interval, each in words."""
    share, low, high = (_signed(value) for value in (worth.share, worth.low, worth.high))
    return share, f"{low} to {high}"


def worth_words(diag: Findings) -> list[str]:
    """Of several effects what each is worth; and those that are certain and change nothing."""
    logs = errors_of(diag)[0]
    words, known = [], [name for name in leading(diag) if name in diag.worth]
    if len(known) > 1:
        parts = joined(f"{spelt(name)} {share_words(diag.worth[name])}" for name in known)
        words.append(f"Of the squared error over whole runs of {logs} each removes: {parts}.")
    if diag.detectable:
        several = len(diag.detectable) > 1
        groups = diag.detectable_groups or [(name,) for name in diag.detectable]
        sized = (
            " or ".join(map(an, map(spelt, g))) + _at_most(diag.worth.get(g[0])) for g in groups
        )
        words.append(
            f"These logs also show {joined(sized)}: from one sample to the next "
            f"{'they are' if several else 'it is'} certain, over whole runs "
            f"{'they change' if several else 'it changes'} nothing that surely matters."
        )
    return words


def leading(diag: Findings) -> tuple[str, ...]:
    """The added effects, what is worth most first."""
    worth = {name: diag.worth[name].share for name in diag.added if name in diag.worth}
    return tuple(sorted(diag.added, key=lambda name: -worth.get(name, math.inf)))


def undecided_words(diag: Findings) -> list[str]:
    """That it cannot be told whether physics or random forces make large errors that last."""
    logs, after = judged_errors(diag)
    name = next(iter(diag.far), next(iter(after.channels)))
    error = after.channels[name]
    times = number(error.rmse / diag.one_step.get(name, math.nan), 2)
    return [
        f"Undecided: over whole runs of {logs} the {spelt(name)} error is "
        f"{_sized(error.shown.value, error.shown.unit)} (NRMSE {number(error.nrmse, 2)}), "
        f"{times} times that from one sample to the next, and these logs let random forces explain "
        "it as well as physics.",
        *possible_words(diag),
        deciding_words(diag),
    ]


def possible_words(diag: Findings) -> list[str]:
    """The effects that whole runs alone speak for."""
    logs = errors_of(diag)[0]
    parts = [f"{an(spelt(name))} {share_words(worth)}" for name, worth in diag.possible.items()]
    if not parts:
        return []
    return [
        f"Possible, by whole runs alone: of their squared error on {logs} would remove "
        f"{joined(parts, 'or')}."
    ]


def deciding_words(diag: Findings) -> str:
    """Which record would decide."""
    if diag.experiment and diag.possible:
        return f"A record would decide: {diag.experiment.sentence}"
    return (
        "A record would decide in which the inputs of one of these logs are repeated: errors that "
        "come again are physics, the others are random forces."
    )


def forced_words(diag: Findings) -> list[str]:
    """How much of the error over whole runs is left, and to what."""
    logs, after = judged_errors(diag)
    grown = {n: e.rmse / diag.one_step[n] for n, e in after.channels.items() if n in diag.one_step}
    name = max(grown, key=lambda n: _rank(grown[n]), default="")
    if not name or not grown[name] > _GROWN:
        return []
    size, unit = after.channels[name].shown
    whole, step = _sized(size, unit), _sized(size / grown[name], unit)
    words = (
        f"From one sample to the next the {spelt(name)} is predicted to {step}, over whole runs of "
        f"{logs} to {whole}"
    )
    if diag.verdict == "undecided":
        return [f"{words}."]
    if diag.verdict == "unexplained":
        return [f"{words}: what is missing, and random forces, add up."]
    return [
        f"{words}: the rest the diagnosis leaves to random forces and lasting errors of sensors, "
        "which no signal of these logs surely explains."
    ]


def repeating_words(diag: Findings) -> str:
    """That large errors over whole runs repeat, as a flexible model shows."""
    room = diag.room.channels if diag.room else {}
    logs = judged_errors(diag)[0]
    parts = [
        f"{percent(room[name].share)} ({percent(max(room[name].low, 0.0))} to "
        f"{percent(room[name].high)}) of the squared {spelt(name)} error"
        for name in diag.repeating
    ]
    return (
        f"Structure remains that no known effect explains: over whole runs of {logs} a flexible "
        f"model of these signals explains {joined(parts)}, so that it repeats; where it enters is "
        "not clear."
    )


def _at_most(worth: Worth | None) -> str:
    return "" if worth is None else f" (it removes {share_words(worth)} of the squared error)"


def _sized(value: float, unit: str) -> str:
    return f"{number(value, 2)} {unit}".rstrip()


def _signed(share: float) -> str:
    if not math.isfinite(share):
        return "?"
    return f"-{percent(-share)}" if share < 0 else percent(share)


def _rank(value: float) -> float:
    return -math.inf if math.isnan(value) else value

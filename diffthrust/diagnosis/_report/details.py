"""The details of a diagnosis: all sentences, in the order in which they are read."""

from __future__ import annotations

from diffthrust._support.words import capitalised, humanize, joined
from diffthrust.diagnosis._findings import Findings
from diffthrust.diagnosis._report.doubts import grave_doubts, leading_doubt_words
from diffthrust.diagnosis._report.error_text import (
    gain_words,
    growth_words,
    level_words,
    worth_words,
)
from diffthrust.diagnosis._report.learned import learned_words
from diffthrust.diagnosis._report.remaining_text import (
    decisive_log_words,
    other_model_words,
    possible_words,
    remaining_words,
    undecided_words,
)
from diffthrust.diagnosis._report.text import (
    UNFINISHED,
    added_bound_words,
    held_words,
    judged_errors,
    leading,
    model_words,
    rival_words,
    sized_words,
    stopped_words,
    vanished_words,
)

_HINTS = 2
"""Hints of the comparison that the details repeat."""


def details(diag: Findings) -> str:
    """The outcome in a few sentences: what lacks, what it gains, what stays open.

    Example:
        >>> details(diag)
        'The basic thruster lacks a command dead band of ±0.40 V: with it the speed error on
        unseen logs falls from 5.6 to 0.30 rad/s (NRMSE 0.33 to 0.018).'
    """
    if not diag.sought:
        return " ".join([*leading_doubt_words(diag), _level_as_given(diag)])
    sentences = [
        *leading_doubt_words(diag),
        *hint_words(diag),
        *table_words(diag),
        *stopped_words(diag),
        *_verdict_sentences(diag),
        *other_model_words(diag),
        *held_words(diag),
        *vanished_words(diag),
        *added_bound_words(diag),
        *worth_words(diag),
    ]
    if diag.verdict == "unexplained":
        sentences += [remaining_words(diag), *learned_words(diag), *possible_words(diag)]
    if not diag.best and diag.verdict != "undecided":
        errors = gain_words(diag) if diag.held else level_words(diag)
        without = "without what was learned " if diag.laws else ""
        sentences.append(f"{capitalised(without + errors)}.")
    if diag.verdict != "undecided":
        sentences += growth_words(diag)
    sentences += decisive_log_words(diag)
    return " ".join(sentences)


def _level_as_given(diag: Findings) -> str:
    """The errors of the model as given, unless its fit is none that can be relied on.

    A Kingfisher's, with an inertia of 1e17 kg m^2, erred little where each unseen log began at a
    sway of its own, of up to 105 m/s; with one of 3e6 kg m^2, whose starts disagreed, up to 222.
    """
    if why := UNFINISHED.get(diag.fit.status):
        why = why.format("its fit to these logs")
        return f"The errors of the model as given say nothing: {why}."
    return f"{capitalised(level_words(diag))}."


def hint_words(diag: Findings) -> list[str]:
    """Channels that move against the model, where no doubt on the logs says so with a mend."""
    doubted = any(doubt.contrary for doubt in grave_doubts(diag))
    if diag.helpful_mends or doubted or not diag.before.hints:
        return []
    return ["A channel may not mean what its name says:", *diag.before.hints[:_HINTS]]


def table_words(diag: Findings) -> list[str]:
    """That static tables say nothing of what takes time."""
    if not diag.before.tabular:
        return []
    return ["These logs are tables without time: what takes time, as a lag does, was not tried."]


def _verdict_sentences(diag: Findings) -> list[str]:
    model = model_words(diag.model)
    if diag.best:
        them = "it" if len(diag.best) == 1 else "them"
        alike = rival_words(diag)
        unsure = {name: f"these logs cannot tell it from {alike[name]}" for name in alike}
        lacking = joined(
            sized_words(name, diag.fit, unsure.get(name, "")) for name in leading(diag)
        )
        return [f"The {model} lacks {lacking}: with {them} {gain_words(diag)}."]
    if diag.verdict == "undecided":
        return undecided_words(diag)
    if diag.verdict == "adequate":
        return [_adequate_words(diag, model)]
    if diag.held:  # `held_words` says it, and follows
        return []
    return [f"The {model} lacks something that none of the effects tried explains."]


def _adequate_words(diag: Findings, model: str) -> str:
    if not (diag.ranking or diag.silent):
        untried = (
            "These logs can test none of the effects" if diag.untestable else "No effect was tried"
        )
        return f"{untried}: these logs cannot show whether the {model} lacks an effect."
    errors = judged_errors(diag)[1].channels
    blind = [humanize(name) for name, e in errors.items() if e.nrmse >= 1.0]
    if blind:
        return (
            f"These logs show no effect that the {model} lacks, and yet it follows "
            f"{joined(blind)} no better than a constant would: do they excite what drives it?"
        )
    count = len({c.effect for c in diag.ranking} | {*diag.silent})
    tried = f"none of the {count} effects that were tried" if count > 1 else "no effect"
    helps = "matters over whole runs" if diag.detectable else "helps on these logs"
    return f"The {model} is adequate: {tried} {helps}."

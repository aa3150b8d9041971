"""The details of a diagnosis: all sentences, in the order in which they are read.

And the sentences on what is left or missing: structure, changes, disturbances, odd logs, signals.
"""

from __future__ import annotations

from diffthrust._support.words import (
    an,
    capitalised,
    distinct_numbers,
    humanize,
    joined,
    percent,
    probability,
)
from diffthrust.diagnosis._candidates import place_words
from diffthrust.diagnosis._changed_size import TIME, ChangedSize
from diffthrust.diagnosis._explained_share import sure_share
from diffthrust.diagnosis._findings import Findings, OddLog
from diffthrust.diagnosis._missing import Missing, Remaining
from diffthrust.diagnosis._report.doubts import UNSOUGHT, grave_doubts, leading_doubt_words
from diffthrust.diagnosis._report.error_text import (
    LEFT,
    error_size,
    gain_words,
    growth_words,
    judged_logs,
    levels,
    sample_word,
    squared_error,
    worth_words,
)
from diffthrust.diagnosis._report.learned import learned_words
from diffthrust.diagnosis._report.text import (
    UNFINISHED,
    added_bound_words,
    amount,
    an_effect,
    better_model,
    blind_channels,
    candidate_words,
    copied_fit,
    errors_of,
    held_words,
    judged_errors,
    leading,
    model_words,
    rival_words,
    sized_words,
    stopped_words,
    tried_count,
    vanished_words,
    with_unit,
)
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.models._base.model import Model

_HINTS = 2
"""Hints of the comparison that the details repeat."""
_HALF = 0.5
"""Display: where surely less recurs, most does not."""


def details(diag: Findings) -> str:
    """The outcome in a few sentences: what lacks, what it gains, what stays open."""
    if not diag.sought:
        return " ".join([*leading_doubt_words(diag), _level_as_given(diag)])
    sentences = [
        *leading_doubt_words(diag),
        *_hint_words(diag),
        *stopped_words(diag),
        *_verdict_sentences(diag),
        *_other_model_words(diag),
        *held_words(diag),
        *vanished_words(diag),
        *added_bound_words(diag),
        *worth_words(diag),
    ]
    if diag.verdict == "unexplained":
        sentences += [remaining_words(diag), *learned_words(diag), *_possible_words(diag)]
    if diag.verdict != "undecided":
        if not diag.best:
            errors = gain_words(diag) if diag.held else _last_levels(diag)
            without = "without what was learned " if diag.laws else ""
            sentences.append(f"{capitalised(without + errors)}.")
        sentences += growth_words(diag)
    return " ".join([*sentences, *_decisive_log_words(diag)])


def _last_levels(diag: Findings) -> str:
    """Of all logs: where a verdict rests on some alone, their fit is not the model as given."""
    logs, _, errors = errors_of(diag)
    return levels(logs, errors)


def _level_as_given(diag: Findings) -> str:
    """The errors of the model as given, unless its fit is none that can be relied on.

    A Kingfisher's, with an inertia of 1e17 kg m^2, erred little where each unseen log began at a
    sway of its own, of up to 105 m/s; with one of 3e6 kg m^2, whose starts disagreed, up to 222.
    """
    if why := UNFINISHED.get(diag.fit.status):
        why = why.format("its fit to these logs")
        return f"The errors of the model as given say nothing: {why}."
    return f"{capitalised(_last_levels(diag))}."


def _hint_words(diag: Findings) -> list[str]:
    """Channels that move against the model, where no doubt says so; what tables do not tell."""
    sentences = []
    doubted = diag.helpful_mends or any(doubt.contrary for doubt in grave_doubts(diag))
    if diag.before.hints and not doubted:
        hints = diag.before.hints[:_HINTS]
        sentences = ["A channel may not mean what its name says:", *hints]
    if diag.before.tabular:
        sentences.append(
            "These logs are tables without time: what takes time, as a lag does, was not tried."
        )
    return sentences


def _verdict_sentences(diag: Findings) -> list[str]:
    model = model_words(diag.model)
    if diag.best:
        them = "it" if len(diag.best) == 1 else "them"
        alike = rival_words(diag)
        unsure = {n: f"these logs cannot tell it from {words}" for n, words in alike.items()}
        lacking = joined(sized_words(n, diag.fit, unsure.get(n, "")) for n in leading(diag))
        return [f"The {model} lacks {lacking}: with {them} {gain_words(diag)}."]
    if diag.verdict == "undecided":
        return _undecided_words(diag)
    if diag.verdict == "adequate":
        return [_adequate_words(diag, model)]
    if diag.held:  # `held_words` says it, and follows
        return []
    return [f"The {model} lacks something that none of the effects tried explains."]


def _adequate_words(diag: Findings, model: str) -> str:
    count = tried_count(diag)
    if not count:
        untried = (
            "These logs can test none of the effects" if diag.untestable else "No effect was tried"
        )
        return f"{untried}: these logs cannot show whether the {model} lacks an effect."
    if blind := blind_channels(diag):
        return (
            f"These logs show no effect that the {model} lacks, and yet it follows {blind} no "
            "better than a constant would: do they excite what drives it?"
        )
    tried = f"none of the {count} effects that were tried" if count > 1 else "no effect"
    helps = "matters over whole runs" if diag.detectable else "helps on these logs"
    return f"The {model} is adequate: {tried} {helps}."


def _undecided_words(diag: Findings) -> list[str]:
    """That large, lasting errors may be a disturbance's or missing physics, and what would decide.

    Random forces are named only where runs that repeat their inputs show that errors do not recur.
    Nothing of the kind while a sign looks wrong: of a Kingfisher with its heading turned nothing
    was undecided that this mend did not decide.
    """
    if any(doubt.contrary for doubt in grave_doubts(diag)):
        return ["Undecided as long as the doubts on the logs stand: mend them first."]
    logs, errors = judged_errors(diag)
    name = next(iter(diag.far), next(iter(errors.channels)))
    cause = "these logs cannot tell a disturbance from missing physics"
    if recurring := diag.recurring.get(name):
        cause = f"where logs repeat their inputs, {recurring} of its square recurs"
        cause += ": most of it comes from random forces" * (recurring.high < _HALF)
    if diag.experiment and diag.possible:
        deciding = f"A further record would decide: {diag.experiment.sentence}"
    else:
        deciding = (
            "To decide, record a run that repeats the inputs of one of these logs: errors that "
            "recur are physics, the others are a disturbance."
        )
    return [
        f"Undecided: over whole runs of {logs} the {humanize(name)} error is "
        f"{error_size(errors.channels[name])}, far above that from one {sample_word(diag)} to the "
        f"next; {cause}.",
        *_possible_words(diag),
        deciding,
    ]


def _possible_words(diag: Findings) -> list[str]:
    """The candidates that whole runs support, and one-step errors do not."""
    shares = []
    for name, worth in diag.possible.items():
        if sure := sure_share(worth):
            of = f" of that of {humanize(sure.channel)}" if sure.channel else ""
            logs = f" on {judged_logs(diag, True)}" if sure.everywhere else ""
            shares.append(f"{candidate_words(diag, name)} {sure.worth}{of}{logs}")
    if not shares:
        return []
    beside = " beside what was learned" if diag.laws else ""
    return [
        f"Possible, judged by whole runs alone, with the share of the {squared_error(of=LEFT)} on "
        f"{errors_of(diag)[0]} that each would remove{beside}: {joined(shares, 'or')}."
    ]


def _other_model_words(diag: Findings) -> list[str]:
    """The model of the library that surely errs less on the same logs, if there is one."""
    other = better_model(diag)
    if other is None:
        return []
    reached = copied_fit(diag)
    low, high = distinct_numbers(
        *((fit.holdout or fit.train).nrmse for fit in (other.best, reached))
    )
    logs = errors_of(diag)[0].removeprefix("the ")
    everything = " with all that was found" if diag.best or diag.laws else ""
    model = capitalised(an(model_words(other.best.model)))
    return [
        f"{model} errs less over whole runs of the same {logs}: NRMSE {low} against {high}"
        f"{everything}. Diagnose that model, too."
    ]


# -- what remains ----------------------------------------------------------------------------------


def remaining_words(diag: Findings) -> str:
    """What none of the effects tried explains: where it enters and on what it depends."""
    remaining = diag.remaining
    if not diag.sought:
        return UNSOUGHT
    if diag.changed:
        return _changed_words(diag, diag.changed)
    if remaining is None:
        if diag.laws:
            return "Structure remains that none of the effects tried explains: whole runs show it."
        if diag.verdict == "unexplained":
            return (
                "Structure remains that none of the effects tried explains"
                f"{_repeating_words(diag) or '; its place is not clear'}."
            )
        if diag.verdict == "undecided":
            return "What remains is lasting, and cannot be told from a disturbance."
        return "What remains cannot be told from noise."
    enters = "it enters at" if remaining.manner == "adds" else "it scales what passes"
    still = "Structure still remains" if diag.best else "Structure remains"
    # on the maps of a T200 a drive that changes with speed, as is told here, changes nothing
    only = "" if diag.laws else "; no curve of it that was tried was worth keeping"
    return (
        f"{still} that none of the effects tried explains: from one {sample_word(diag)} to the "
        f"next {enters} {place_words(diag.model, remaining.port)} and depends on "
        f"{remaining.depends_on}{only}."
    )


def changed_parameter(changed: ChangedSize) -> str:
    """What changes in time, or at a level of a signal, in words."""
    effect, _, name = changed.parameter.rpartition(".")
    level = with_unit(changed.shown.value, changed.shown.unit)
    at = "at" if changed.signal == TIME else f"where the {humanize(changed.signal)} is"
    return f"the {humanize(name)} of {an_effect(effect)} changes {at} {level}"


def _changed_words(diag: Findings, changed: ChangedSize) -> str:
    """That an added effect changes: where, by how much, and what that removes."""
    unit = changed.after.shown[2]
    low, high = distinct_numbers(changed.before.shown[0], changed.after.shown[0])
    since, first, then = "", "below", "above"
    if changed.signal == TIME:
        since, first, then = " after the start of a log", "before", "after"
    return (
        f"{capitalised(changed_parameter(changed))}{since}: {low} {first}, {amount(high, unit)} "
        f"{then}. By the slopes of the fit that removes {changed.worth} of the "
        f"{squared_error(of=LEFT)} over whole runs of {errors_of(diag)[0]}."
    )


def _repeating_words(diag: Findings) -> str:
    """That large errors over whole runs repeat: a flexible model or repeated inputs show it."""
    channels = diag.room.channels if diag.room else {}
    reasons = []
    if shares := joined(
        "{2} ({3})".format(*channels[name].cells) + f" of the squared {humanize(name)} error"
        for name in diag.repeating
        if name in channels and channels[name].low > 0
    ):
        reasons.append(f"a flexible model of these signals explains {shares}")
    if shares := joined(
        f"{diag.recurring[name]} of the squared {humanize(name)} error"
        for name in diag.repeating
        if name in diag.recurring and diag.recurring[name].low > 0
    ):
        reasons.append(f"where logs repeat their inputs {shares} recurs")
    if not diag.repeating:
        return ""
    return (
        f": over whole runs of {judged_errors(diag)[0]} {joined(reasons)}, so it is repeatable; "
        "where it enters is not clear"
    )


# -- odd logs and missing signals ------------------------------------------------------------------


def _decisive_log_words(diag: Findings) -> list[str]:
    """The deviating logs that carry enough of the error to decide, and whether they do."""
    sentences = [odd_words(odd) for odd in diag.odd_logs if odd.much]
    if diag.apart:
        sentences.append(
            "The verdict rests on the other logs alone, with the model fitted to them: the "
            "deviating ones were recorded differently, or show what the others do not. So fitted, "
            f"{levels(*judged_errors(diag))}."
        )
    return sentences


def odd_words(odd: OddLog) -> str:
    """How a log deviates from the others, or goes where they do not."""
    carries = (
        f"{odd.evidence}. It carries {percent(odd.share)} of the squared {humanize(odd.channel)} "
        "error of all logs"
    )
    if odd.beyond:
        return (
            f"Log {odd.log} goes where at most half of the training logs do "
            f"({joined(odd.beyond)}), and what the model lacks there shows in it: {carries}."
        )
    # of six runs of steps, unseen by a fit to ramps, three were told to be checked
    advice = ". Check how it was recorded" * odd.accused
    return f"Log {odd.log} deviates from the others: {carries}{advice}."


def missing_words(missing: Missing, model: Model, remaining: Remaining | None = None) -> str:
    """The missing signal at a port of the model as given: its size, and on what it depends.

    What none of the effects tried explains may enter at this very port.
    """
    place = place_words(model, missing.port)
    by_errors = remaining.depends_on if remaining and remaining.port == missing.port else ""
    if not missing.shows:
        if by_errors:
            return (
                f"At {place} the missing signal is too small to be drawn over time; that something "
                f"enters there shows by the errors' dependence on {by_errors}."
            )
        return f"At {place} no missing signal is significant."
    chance = probability(missing.p_value)
    if missing.depends_on is not None:
        dependence = (
            f"it depends most on {missing.depends_on}, which explains {percent(missing.share)} of "
            f"its variance ({chance})"
        )
        # of a BlueBoat's surge one measure named the force of the right thruster, the other that
        # of the left, which moves with it: one sentence has both, so that they read as one
        if by_errors not in ("", missing.depends_on):
            dependence += f", while errors from one sample to the next depend on {by_errors}"
    elif missing.p_value < SETTINGS.structure.dependence_level:
        dependence = "no signal of the model on which it depends explains 1 % of it"
    else:
        dependence = f"it depends on none of the model's signals ({chance})"
    size = with_unit(missing.size, missing.unit)
    return f"At {place} a signal of {size} (RMS) is missing; {dependence}."

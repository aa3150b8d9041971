"""The sentences on what is left or missing: structure, changes, disturbances, odd logs, signals."""

from __future__ import annotations

from diffthrust._support.words import (
    an,
    capitalised,
    distinct_numbers,
    humanize,
    joined,
    number,
    percent,
    probability,
)
from diffthrust.diagnosis._candidates import place_words
from diffthrust.diagnosis._changed_size import TIME, ChangedSize
from diffthrust.diagnosis._explained_share import SureShare, sure_share
from diffthrust.diagnosis._findings import Findings, OddLog
from diffthrust.diagnosis._missing import Missing, Remaining
from diffthrust.diagnosis._other_models import errors_of as fit_errors
from diffthrust.diagnosis._report.doubts import UNSOUGHT, grave_doubts
from diffthrust.diagnosis._report.error_text import (
    LEFT,
    error_size,
    judged_logs,
    levels,
    sample_word,
    squared_error,
)
from diffthrust.diagnosis._report.text import (
    amount,
    an_effect,
    copied_fit,
    errors_of,
    judged_errors,
    model_words,
)
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.models._base.model import Model

_HALF = 0.5
"""Display: where surely less recurs, most does not."""


def undecided_words(diag: Findings) -> list[str]:
    """That large, lasting errors may be a disturbance's or missing physics, and what would decide.

    Random forces are named only where runs that repeat their inputs show that errors do not recur.
    Nothing of the kind while a sign looks wrong: of a Kingfisher with its heading turned nothing
    was undecided that this mend did not decide.
    """
    if any(doubt.contrary for doubt in grave_doubts(diag)):
        return ["Undecided as long as the doubts on the logs stand: mend them first."]
    logs, errors = judged_errors(diag)
    name = next(iter(diag.far), next(iter(errors.channels)))
    error = errors.channels[name]
    cause, recurring = "these logs cannot tell a disturbance from missing physics", None
    if recurring := diag.recurring.get(name):
        cause = f"where logs repeat their inputs, {recurring} of its square recurs"
    if recurring and recurring.high < _HALF:
        cause += ": most of it comes from random forces"
    if diag.experiment and diag.possible:
        deciding = f"A further record would decide: {diag.experiment.sentence}"
    else:
        deciding = (
            "To decide, record a run that repeats the inputs of one of these logs: errors that "
            "recur are physics, the others are a disturbance."
        )
    return [
        f"Undecided: over whole runs of {logs} the {humanize(name)} error is {error_size(error)}, "
        f"far above that from one {sample_word(diag)} to the next; {cause}.",
        *possible_words(diag),
        deciding,
    ]


def possible_words(diag: Findings) -> list[str]:
    """The effects that whole runs support, and one-step errors do not."""
    shares = joined(
        (
            f"{an_effect(name)} {sure.worth}" + _of_what(diag, sure)
            for name, worth in diag.possible.items()
            if (sure := sure_share(worth))
        ),
        "or",
    )
    if not shares:
        return []
    beside = " beside what was learned" if diag.laws else ""
    return [
        f"Possible, judged by whole runs alone, with the share of the {squared_error(of=LEFT)} "
        f"on {errors_of(diag)[0]} that each would remove{beside}: {shares}."
    ]


def _of_what(diag: Findings, sure: SureShare) -> str:
    """The channel and the logs of a share, where they are not all channels of the judged logs."""
    channel = f" of that of {humanize(sure.channel)}" if sure.channel else ""
    return channel + (f" on {judged_logs(diag, True)}" if sure.everywhere else "")


def other_model_words(diag: Findings) -> list[str]:
    """The model of the library that surely errs less on the same logs, if there is one."""
    other = next((other for other in diag.other_models if other.better), None)
    if other is None:
        return []
    reached = copied_fit(diag)
    low, high = distinct_numbers(fit_errors(other.best).nrmse, fit_errors(reached).nrmse)
    logs = errors_of(diag)[0].removeprefix("the ")
    found = " with all that was found" if diag.best or diag.laws else ""
    model = capitalised(an(model_words(other.best.model)))
    return [
        f"{model} errs less over whole runs of the same {logs}: NRMSE {low} against {high}{found}. "
        "Diagnose that model, too."
    ]


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
            if diag.repeating:
                return _repeating_words(diag)
            return (
                "Structure remains that none of the effects tried explains; its place is not clear."
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
    level = amount(number(changed.shown.value, 2), changed.shown.unit)
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
    explained, recurring = (
        [name for name in diag.repeating if name in shares and shares[name].low > 0]
        for shares in (channels, diag.recurring)
    )
    reasons = []
    if explained:
        shares = joined(
            "{2} ({3})".format(*channels[name].cells) + f" of the squared {humanize(name)} error"
            for name in explained
        )
        reasons.append(f"a flexible model of these signals explains {shares}")
    if recurring:
        shares = joined(
            f"{diag.recurring[name]} of the squared {humanize(name)} error" for name in recurring
        )
        reasons.append(f"where logs repeat their inputs {shares} recurs")
    return (
        f"Structure remains that none of the effects tried explains: over whole runs of "
        f"{judged_errors(diag)[0]} {joined(reasons)}, so it is repeatable; where it enters is not "
        "clear."
    )


def decisive_log_words(diag: Findings) -> list[str]:
    """The deviating logs that carry enough of the error to decide, and whether they do."""
    sentences = [_odd_log(odd) for odd in diag.odd_logs if odd.much]
    if diag.apart:
        sentences.append(
            "The verdict rests on the other logs alone, with the model fitted to them: the "
            "deviating ones were recorded differently, or show what the others do not. So fitted, "
            f"{levels(*judged_errors(diag))}."
        )
    return sentences


def odd_words(diag: Findings) -> list[str]:
    """Every log that deviates from the others, and how.

    Example:
        >>> odd_words(diag)
        ['Log 14V deviates from the others: its thrust error is 3.4 times that of the median log.
        ...']
    """
    return [_odd_log(odd) for odd in diag.odd_logs]


def _odd_log(odd: OddLog) -> str:
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
    """The missing signal at a port: its size, and on what it depends.

    Args:
        missing: the signal.
        model: the model as given.
        remaining: what none of the effects tried explains, which may enter at this very port.
    """
    place = place_words(model, missing.port)
    if not missing.shows:
        if remaining is not None and remaining.port == missing.port:
            return (
                f"At {place} the missing signal is too small to be drawn over time; that something "
                f"enters there shows by the errors' dependence on {remaining.depends_on}."
            )
        return f"At {place} no missing signal is significant."
    size = f"{number(missing.size, 2)} {missing.unit}".rstrip()
    chance = probability(missing.p_value)
    if missing.depends_on is not None:
        dependence = (
            f"it depends most on {missing.depends_on}, which explains {percent(missing.share)} of "
            f"its variance ({chance})"
        )
        dependence += _other_signal(missing, remaining)
    elif missing.p_value < SETTINGS.structure.dependence_level:
        dependence = "no signal of the model on which it depends explains 1 % of it"
    else:
        dependence = f"it depends on none of the model's signals ({chance})"
    return f"At {place} a signal of {size} (RMS) is missing; {dependence}."


def _other_signal(missing: Missing, remaining: Remaining | None) -> str:
    """That one-step errors name another signal at the same port, so that the two read as one.

    On the BlueBoat what is left of the surge depends on the force of the right thruster by one
    measure, and by the other on that of the left, which moves with it.
    """
    if remaining is None or remaining.port != missing.port:
        return ""
    if remaining.depends_on == missing.depends_on:
        return ""
    return f", while errors from one sample to the next depend on {remaining.depends_on}"

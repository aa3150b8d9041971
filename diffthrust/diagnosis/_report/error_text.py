"""The sentences on errors: how they fall, what each effect removes, how they grow."""

from __future__ import annotations

from collections.abc import Mapping

from diffthrust._support.words import capitalised, distinct_numbers, humanize, joined, number
from diffthrust.diagnosis._explained_share import (
    Worth,
    order_matters,
    share_words,
    sure_share,
    surely_removes,
)
from diffthrust.diagnosis._findings import Findings
from diffthrust.diagnosis._report.text import (
    an_effect,
    errors_of,
    leading,
    provisional,
    rank,
    with_unit,
)
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.simulation._errors import ChannelError, Errors

_NAMED = 2
"""Channels that the summary names; more are summed up by their mean."""


def gain_words(diag: Findings) -> str:
    """How the error of each channel changed from the first stage to the last."""
    logs, first, last = errors_of(diag)
    worst = sorted(first.channels, key=lambda name: -rank(first.channels[name].nrmse))[:_NAMED]
    phrases = []
    for name in (name for name in first.channels if name in worst):
        baseline, updated = first.channels[name], last.channels[name]
        start, end = distinct_numbers(baseline.shown.value, updated.shown.value)
        low, high = distinct_numbers(baseline.nrmse, updated.nrmse)
        verb = "falls" if updated.rmse < baseline.rmse else "rises"
        change = f"stays at {start}" if start == end else f"{verb} from {start} to {end}"
        where = "" if phrases else f" on {logs}"
        size = f"the {humanize(name)} error{where} {change} {baseline.shown.unit}".rstrip()
        phrases.append(f"{size} (NRMSE {low} to {high})")
    if len(first.channels) > _NAMED:
        low, high = distinct_numbers(first.nrmse, last.nrmse)
        phrases.append(
            f"the NRMSE over all {len(first.channels)} channels goes from {low} to {high}"
        )
    return joined(phrases)


def level_words(diag: Findings) -> str:
    """How large the error of each channel is at the last stage, of all logs.

    Also where a verdict rests on some logs alone: their fit is not the model as it was given.
    """
    logs, _, errors = errors_of(diag)
    return levels(logs, errors)


def levels(logs: str, errors: Errors) -> str:
    return joined(
        f"the {humanize(name)} error{'' if i else f' on {logs}'} is {error_size(e)}"
        for i, (name, e) in enumerate(errors.channels.items())
    )


def error_size(error: ChannelError) -> str:
    return f"{with_unit(*error.shown)} (NRMSE {number(error.nrmse, 2)})"


def worth_words(diag: Findings) -> list[str]:
    """The share that each effect removes, and the effects that change nothing over whole runs.

    Shares of one whole stand in one sentence. That of a single effect goes without saying, because
    the errors before and after it are said, unless it is told by channel; and what each removes
    beside all others, unless the order in which they were added matters.
    """
    parts = _parts(diag)
    sentences = [
        f"Of the {squared_error(channel)} over whole runs of {judged_logs(diag, everywhere)} "
        f"{_removed_words(shares, ', added in this order')}."
        for (channel, everywhere), shares in _by_whole(parts).items()
        if len(diag.added) > 1 or channel or everywhere
    ]
    worths = {name: diag.worth[name] for name in leading(diag) if name in diag.worth}
    beside = {humanize(name): w.beside_others for name, w in worths.items() if w.beside_others}
    if not any(map(order_matters, worths.values())):
        beside = {}
    sentences += [
        f"Beside all others, of the {squared_error(channel, WITHOUT)} over whole runs of "
        f"{judged_logs(diag, everywhere)} {_removed_words(shares)}."
        for (channel, everywhere), shares in _by_whole(beside).items()
    ]
    unsure = [words for words, worth in parts.items() if not surely_removes(worth)]
    if unsure:
        has = "has" if len(unsure) == 1 and "together" not in unsure[0] else "have"
        sentences.append(f"{capitalised(joined(unsure))} {has} no sure effect on whole runs.")
    if diag.detectable:
        groups = diag.detectable_groups or [(name,) for name in diag.detectable]
        listed = joined(_left_out(diag, *group) for group in groups)
        each, do = ("it", "it does") if len(groups) == 1 else ("each of them", "they do")
        runs = "whole runs are not, or not by enough to matter"
        if provisional(diag):
            runs = f"what {do} to whole runs this fit does not tell"
        sentences.append(
            f"Left out: {listed}. With {each} the next {sample_word(diag)} is predicted better, "
            f"and {runs}."
        )
    return sentences


def _parts(diag: Findings) -> dict[str, Worth]:
    """The shares of the added effects, by effect in words, or by effects that have one together.

    In the order in which they were added, for each removes of the given error what those before it
    had left: of an NGS thruster the load exponent 86 %, the dead band 2 % after it, and alone 86 %.
    """
    parts: dict[str, Worth] = {}
    for name in diag.added:
        if worth := diag.worth.get(name):
            together = worth.together or (name,)
            parts[" and ".join(map(humanize, together)) + " together" * bool(worth.together)] = (
                worth
            )
    return parts


def _by_whole(worths: Mapping[str, Worth]) -> dict[tuple[str, bool], list[tuple[str, Worth]]]:
    """The sure ones of some shares, by the channel and the logs of whose error they are shares."""
    wholes: dict[tuple[str, bool], list[tuple[str, Worth]]] = {}
    for words, worth in worths.items():
        if sure := sure_share(worth):
            wholes.setdefault((sure.channel, sure.everywhere), []).append((words, sure.worth))
    return wholes


def _removed_words(shares: list[tuple[str, Worth]], order: str = "") -> str:
    if len(shares) > 1:
        return f"each removes{order}: {joined(f'{words} {worth}' for words, worth in shares)}"
    ((words, worth),) = shares
    return f"{words} {'remove' if words.endswith(' together') else 'removes'} {worth}"


GIVEN, LEFT, WITHOUT = "as given", "that is left", "that is left without it"
"""Of which model an error is told: as it was given, with all that was added, without one of it."""


def squared_error(channel: str = "", of: str = GIVEN) -> str:
    """What a share is a share of; every share of a page is told of it in these words.

    Args:
        channel: of its error; of that of all channels where empty.
        of: `GIVEN`, `LEFT` or `WITHOUT`.
    """
    error = f"squared {humanize(channel)} error" if channel else "squared error of all channels"
    return f"{error} {of}"


def sample_word(diag: Findings) -> str:
    """What follows one another in these logs: samples, or the rows of a table."""
    return "row" if diag.before.tabular else "sample"


def _left_out(diag: Findings, name: str, *rivals: str) -> str:
    """An effect that is only detectable, what it does to whole runs, and what it may be as well."""
    alike = joined(map(an_effect, rivals), "or")
    words = [
        _detectable_share(diag, name),
        f"the next {sample_word(diag)} cannot tell it from {alike}" * bool(rivals),
    ]
    inside = "; ".join(filter(None, words))
    return an_effect(name) + f" ({inside})" * bool(inside)


def _detectable_share(diag: Findings, name: str) -> str:
    worth = diag.worth.get(name)
    # Of an Otter, whose fit did not converge, a delay "would remove 94 %": by itself it removes
    # 4 %, and 5 % more mass with no delay 84 %
    if worth is None or provisional(diag):
        return ""
    if sure := sure_share(worth):
        logs = " on " + judged_logs(diag, True) if sure.everywhere else ""
        of = squared_error(sure.channel, LEFT)
        return f"it would remove {sure.worth} of the {of}{logs}{_raised(worth, sure.everywhere)}"
    # not that they surely err more: a BlueBoat's exponent had -9 to -1 %, -2 to 1 % at its optimum
    return "no sure gain over whole runs"


def _raised(worth: Worth, everywhere: bool) -> str:
    """The channel whose error an effect surely raises most, for which it is left out."""
    whole = (worth.everywhere or worth) if everywhere else worth
    raised = {name: each for name, each in whole.channels.items() if each.high < 0.0}
    if not raised:
        return ""
    name = min(raised, key=lambda name: raised[name].share)
    return f", and raise the {squared_error(name, LEFT)} by {share_words(-raised[name].share)}"


def judged_logs(diag: Findings, everywhere: bool) -> str:
    return "training and unseen logs" if everywhere else errors_of(diag)[0]


def trained_errors(diag: Findings) -> Errors:
    """Of the last stage on the training logs on which the verdict rests."""
    return diag.apart[0].errors if diag.apart else diag.fit.train


def growth_of(diag: Findings, errors: Errors) -> dict[str, float]:
    """By channel how many times those from one sample to the next errors over whole runs are.

    Not of a channel whose next sample has no error: nothing could be predicted.
    """
    one_step = {n: error for n, error in diag.one_step.items() if error > 0}
    return {n: e.rmse / one_step[n] for n, e in errors.channels.items() if n in one_step}


def growth_words(diag: Findings) -> list[str]:
    """How much larger errors are over whole runs than from sample to sample, and why.

    Both on the training logs, of which the errors from sample to sample are. Nothing of static
    tables, in which nothing adds up, and nothing where structure remains: that says why, and the
    last reading often foretells the next as well.
    """
    if diag.before.tabular or diag.verdict == "unexplained":
        return []
    errors = trained_errors(diag)
    growth = growth_of(diag, errors)
    name = max(growth, key=lambda n: rank(growth[n]), default="")
    if not name or not growth[name] > SETTINGS.verdict.far_above_one_step:
        return []
    size, unit = errors.channels[name].shown
    return [
        f"From one sample to the next the {humanize(name)} is mostly predicted to within "
        f"{with_unit(size / growth[name], unit)}; over whole runs of the training logs it errs by "
        f"{with_unit(size, unit)} (RMS): no signal of these logs surely explains the difference. "
        "It is a disturbance, a lasting error of a sensor, or physics that these logs do not show."
    ]

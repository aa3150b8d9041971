"""The sentences on errors: how they fall, what each effect removes, how they grow."""

from __future__ import annotations

import math
from collections.abc import Mapping

from diffthrust._support.words import capitalised, distinct_numbers, humanize, joined, number
from diffthrust.diagnosis._explained_share import (
    SureShare,
    Worth,
    order_matters,
    share_words,
    sure_share,
    surely_removes,
)
from diffthrust.diagnosis._findings import Findings
from diffthrust.diagnosis._report.text import (
    amount,
    an_effect,
    candidate_words,
    change_words,
    errors_of,
    leading,
    provisional,
    with_unit,
)
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.simulation._errors import ChannelError, Errors

_NAMED = 2
"""Channels that the summary names; more are summed up by their mean."""
GIVEN, LEFT, WITHOUT = "as given", "that is left", "that is left without it"
"""Of which model an error is told: as it was given, with all that was added, without one of it."""


def gain_words(diag: Findings) -> str:
    """How the error of each channel changed from the first stage to the last."""
    logs, first, last = errors_of(diag)

    def rank(name: str) -> float:
        nrmse = first.channels[name].nrmse
        return -math.inf if math.isnan(nrmse) else nrmse

    worst = sorted(first.channels, key=rank, reverse=True)[:_NAMED]
    phrases = []
    for name in (name for name in first.channels if name in worst):
        baseline, updated = first.channels[name], last.channels[name]
        size, unit = baseline.shown
        change = amount(change_words(size, updated.shown.value), unit)
        where = "" if phrases else f" on {logs}"
        low, high = distinct_numbers(baseline.nrmse, updated.nrmse)
        phrases.append(f"the {humanize(name)} error{where} {change} (NRMSE {low} to {high})")
    if len(first.channels) > _NAMED:
        low, high = distinct_numbers(first.nrmse, last.nrmse)
        phrases.append(
            f"the NRMSE over all {len(first.channels)} channels goes from {low} to {high}"
        )
    return joined(phrases)


def levels(logs: str, errors: Errors) -> str:
    """How large the error of each channel is on these logs."""
    return joined(
        f"the {humanize(name)} error{'' if i else f' on {logs}'} is {error_size(e)}"
        for i, (name, e) in enumerate(errors.channels.items())
    )


def error_size(error: ChannelError) -> str:
    return f"{with_unit(*error.shown)} (NRMSE {number(error.nrmse, 2)})"


# -- shares of a squared error ---------------------------------------------------------------------


def squared_error(channel: str = "", of: str = GIVEN) -> str:
    """What a share is a share of, of one channel or of all: `GIVEN`, `LEFT` or `WITHOUT`.

    Every share of a page is told of it in these words.
    """
    error = f"squared {humanize(channel)} error" if channel else "squared error of all channels"
    return f"{error} {of}"


def judged_logs(diag: Findings, everywhere: bool) -> str:
    return "training and unseen logs" if everywhere else errors_of(diag)[0]


def whole_words(diag: Findings, share: SureShare, of: str) -> str:
    """The squared error of which a share is one, and over which runs."""
    logs = judged_logs(diag, share.everywhere)
    return f"{squared_error(share.channel, of)} over whole runs of {logs}"


def worth_words(diag: Findings) -> list[str]:
    """The share that each effect removes, and the effects that change nothing over whole runs.

    Shares of one whole stand in one sentence. That of a single effect goes without saying, because
    the errors before and after it are said, unless it is told by channel; and what each removes
    beside all others, unless the order in which they were added matters.
    """
    parts = _parts(diag)
    sentences = [
        f"Of the {whole} {_removed_words(shares, ', added in this order')}."
        for whole, shares in _by_whole(diag, parts, GIVEN).items()
        if len(diag.added) > 1 or shares[0][1].channel or shares[0][1].everywhere
    ]
    worths = {name: diag.worth[name] for name in leading(diag) if name in diag.worth}
    if any(map(order_matters, worths.values())):
        beside = {humanize(n): w.beside_others for n, w in worths.items() if w.beside_others}
        sentences += [
            f"Beside all others, of the {whole} {_removed_words(shares)}."
            for whole, shares in _by_whole(diag, beside, WITHOUT).items()
        ]
    unsure = [words for words, worth in parts.items() if not surely_removes(worth)]
    if unsure:
        has = "has" if len(unsure) == 1 and "together" not in unsure[0] else "have"
        sentences.append(f"{capitalised(joined(unsure))} {has} no sure effect on whole runs.")
    return [*sentences, *_detectable_words(diag)]


def _parts(diag: Findings) -> dict[str, Worth]:
    """The shares of the added effects, by effect in words, or by effects that have one together.

    In the order in which they were added, for each removes of the given error what those before it
    had left: of an NGS thruster the load exponent 86 %, the dead band 2 % after it, and alone 86 %.
    """
    parts = {}
    for name in diag.added:
        if worth := diag.worth.get(name):
            words = " and ".join(map(humanize, worth.together or (name,)))
            parts[words + " together" * bool(worth.together)] = worth
    return parts


def _by_whole(
    diag: Findings, worths: Mapping[str, Worth], of: str
) -> dict[str, list[tuple[str, SureShare]]]:
    """The sure ones of some shares, by the error of which they are shares."""
    wholes: dict[str, list[tuple[str, SureShare]]] = {}
    for words, worth in worths.items():
        if sure := sure_share(worth):
            wholes.setdefault(whole_words(diag, sure, of), []).append((words, sure))
    return wholes


def _removed_words(shares: list[tuple[str, SureShare]], order: str = "") -> str:
    if len(shares) > 1:
        return f"each removes{order}: {joined(f'{words} {sure.worth}' for words, sure in shares)}"
    ((words, sure),) = shares
    return f"{words} {'remove' if words.endswith(' together') else 'removes'} {sure.worth}"


def sample_word(diag: Findings) -> str:
    """What follows one another in these logs: samples, or the rows of a table."""
    return "row" if diag.before.tabular else "sample"


def _detectable_words(diag: Findings) -> list[str]:
    if not diag.detectable:
        return []
    groups = diag.detectable_groups or [(name,) for name in diag.detectable]
    each, do = ("it", "it does") if len(groups) == 1 else ("each of them", "they do")
    runs = "whole runs are not, or not by enough to matter"
    if provisional(diag):
        runs = f"what {do} to whole runs this fit does not tell"
    return [
        f"Left out: {joined(_left_out(diag, *group) for group in groups)}. With {each} the next "
        f"{sample_word(diag)} is predicted better, and {runs}."
    ]


def _left_out(diag: Findings, name: str, *rivals: str) -> str:
    """An effect that is only detectable, what it does to whole runs, and what it may be as well."""
    alike = joined([candidate_words(diag, rival) for rival in rivals], "or")
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
    sure = sure_share(worth)
    if sure is None:
        # not that they surely err more: a BlueBoat's exponent had -9 to -1 %, -2 to 1 % at its
        # optimum
        return "no sure gain over whole runs"
    logs = " on " + judged_logs(diag, True) if sure.everywhere else ""
    words = f"it would remove {sure.worth} of the {squared_error(sure.channel, LEFT)}{logs}"
    whole = (worth.everywhere or worth) if sure.everywhere else worth
    raised = {name: each.share for name, each in whole.channels.items() if each.high < 0.0}
    if not raised:
        return words
    most = min(raised, key=raised.__getitem__)  # for which it is left out
    return f"{words}, and raise the {squared_error(most, LEFT)} by {share_words(-raised[most])}"


# -- errors that grow over whole runs --------------------------------------------------------------


def finite(value: float) -> float:
    return value if math.isfinite(value) else 0.0


def grown_channel(diag: Findings, errors: Errors) -> tuple[str, float]:
    """The channel whose whole runs err most against one sample ahead, far more, and how many times.

    None of static tables, in which nothing adds up, nor a channel whose next sample has no error:
    nothing could be predicted.
    """
    growth = {
        name: finite(error.rmse / diag.one_step[name])
        for name, error in errors.channels.items()
        if diag.one_step.get(name, 0.0) > 0 and not diag.before.tabular
    }
    name = max(growth, key=growth.__getitem__, default="")
    far = name and growth[name] > SETTINGS.verdict.far_above_one_step
    return (name, growth[name]) if far else ("", 0.0)


def growth_words(diag: Findings) -> list[str]:
    """How much larger errors are over whole runs than from sample to sample, and why.

    Both on the training logs, of which the errors from sample to sample are. Nothing where
    structure remains: that says why, and the last reading often foretells the next as well.
    """
    errors = diag.apart[0].errors if diag.apart else diag.fit.train
    name, times = grown_channel(diag, errors)
    if not name or diag.verdict == "unexplained":
        return []
    size, unit = errors.channels[name].shown
    return [
        f"From one sample to the next the {humanize(name)} is mostly predicted to within "
        f"{with_unit(size / times, unit)}; over whole runs of the training logs it errs by "
        f"{with_unit(size, unit)} (RMS): no signal of these logs surely explains the difference. "
        "It is a disturbance, a lasting error of a sensor, or physics that these logs do not show."
    ]

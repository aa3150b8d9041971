"""The sentences of a diagnosis, each from its numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping

from diffthrust._support.words import (
    an,
    capitalised,
    distinct_numbers,
    humanize,
    joined,
    number,
    percent,
    with_error,
)
from diffthrust.diagnosis._candidates import place_words
from diffthrust.diagnosis._changed_size import TIME, ChangedSize
from diffthrust.diagnosis._explained_share import SureShare, Worth, sure_share
from diffthrust.diagnosis._findings import Findings, OddLog
from diffthrust.diagnosis._other_models import errors_of as fit_errors
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.estimation._result import Estimate, Fit
from diffthrust.models._base.effect import EFFECTS
from diffthrust.models._base.model import Model
from diffthrust.simulation._errors import ChannelError, Errors

_HALF = 0.5
"""Display: where surely less recurs, most does not."""
_NAMED = 2
"""Channels that the summary names; more are summed up by their mean."""


def verdict_words(diag: Findings) -> str:
    """The verdict as a person would say it."""
    if diag.verdict == "effects_found" and not diag.best:
        return "a fixed constant disagrees with these logs"
    if diag.verdict == "unexplained":
        return "something remains unexplained"
    return humanize(diag.verdict)


def model_words(model: Model) -> str:
    """The model in words: "basic thruster", "thruster with command dead band"."""
    effects = joined(humanize(effect.name) for effect in model.effects)
    return f"{humanize(model.name)} with {effects}" if effects else f"basic {humanize(model.name)}"


# -- effects ---------------------------------------------------------------------------------------


def an_effect(name: str) -> str:
    """An effect by its name in words, with its article.

    Example:
        >>> an_effect("command_deadband")
        'a command dead band'
    """
    return an(humanize(name))


def sized_words(name: str, fit: Fit) -> str:
    """An effect with the values that the fit found, and what they come to.

    Example:
        >>> sized_words("command_deadband", fit)
        'a command dead band of ±0.40 V'
    """
    estimates = {
        full.removeprefix(f"{name}."): e
        for full, e in fit.parameters.items()
        if full.startswith(f"{name}.") and not e.fixed
    }
    effect = next((effect for effect in fit.model.effects if effect.name == name), None)
    form = effect.form if effect else {}
    formed = "".join(f", {humanize(key)} {value:g}" for key, value in form.items())
    if effect and effect.free_starts:
        starts = [{n: log[f"{name}.{n}"] for n in effect.free_starts} for log in fit.initial]
        formed += f", {effect.size_words(starts)}"
    consequence = effect.consequence(fit.model) if effect else ""
    meaning = f" ({consequence})" if consequence else ""
    values = {key: measured(e) for key, e in estimates.items()}
    if set(values) == {"half_width"}:
        values["half_width"] = f"±{values['half_width']}"
    if len(values) == 1:
        return f"{an_effect(name)} of {next(iter(values.values()))}{formed}{meaning}"
    listed = ", ".join(f"{humanize(key)} {value}" for key, value in values.items())
    return f"{an_effect(name)} ({listed}{formed}){meaning}" if listed else an_effect(name)


def measured(estimate: Estimate) -> str:
    """A value to the digits that its standard error allows, two or three."""
    precise = estimate.std_error is not None and estimate.std_error < 0.003 * abs(estimate.value)
    value, _, unit = estimate.shown
    return _sized(value, unit, 3 if precise else 2)


def leading(diag: Findings) -> tuple[str, ...]:
    """The added effects, the one that removes most of the error first."""
    worth = {name: diag.worth[name].share for name in diag.added if name in diag.worth}
    return tuple(sorted(diag.added, key=lambda name: -worth.get(name, math.inf)))


def stage_words(diag: Findings, index: int) -> str:
    """What a stage added: "as given", "+ command dead band", "lever_arm freed"; "- ..." if lost."""
    if index == 0:
        return "as given"
    current, previous = diag.stages[index].effects, diag.stages[index - 1].effects
    added = [name for name in current if name not in previous]
    changes = [f"{name} freed" if name in diag.held else f"+ {humanize(name)}" for name in added]
    changes += [f"- {humanize(name)}" for name in previous if name not in current]
    return ", ".join(changes)


def rival_words(diag: Findings) -> dict[str, str]:
    """For each added effect that has rivals, what these logs cannot distinguish from it.

    Rivals that were added later are none: model and logs tell both apart.
    """
    rivals = {
        name: [an_effect(rival) for rival in group if rival not in diag.added]
        for name, group in zip(diag.added, diag.groups, strict=True)
    }
    return {name: joined(words, "or") for name, words in rivals.items() if words}


def unmeasured_rivals(diag: Findings) -> dict[str, str]:
    """For each added effect the first channel that no log has, and that could look like it.

    The channel that another effect at the same port needs: under an inflow that nobody measured a
    thruster seemed to push less in reverse. Not for an effect that remembers, such as a lag, and
    not where whole runs err as little as one-step predictions: on a bench in still water an
    asymmetry explains all there is, which a channel that nobody measures would not.
    """
    floor, errors = SETTINGS.unknown_term.noise_floor, judged_errors(diag)[1].channels
    if all(e.rmse <= floor * diag.one_step.get(name, 0.0) for name, e in errors.items()):
        return {}
    rivals = {}
    for effect in diag.best:
        untested = (EFFECTS[name] for name in diag.untestable if name in EFFECTS)
        needs = [n for other in untested if {*other.ports} & {*effect.ports} for n in other.needs]
        lacking = [n for n in needs if not any(n in run.log.inputs for run in diag.before.runs)]
        if lacking and not effect.states and not effect.memory:
            rivals[effect.name] = humanize(lacking[0])
    return rivals


# -- errors and what reduces them ------------------------------------------------------------------


def errors_of(diag: Findings) -> tuple[str, Errors, Errors]:
    """Name of the logs that count, and the errors on them at the first and the last stage."""
    first, last = diag.stages[0], diag.stages[-1]
    if first.holdout is not None and last.holdout is not None:
        return "unseen logs", first.holdout, last.holdout
    return "the training logs", first.train, last.train


def judged_errors(diag: Findings) -> tuple[str, Errors]:
    """Name of the logs on which the verdict rests, and the errors of the last stage on them."""
    logs, _, errors = errors_of(diag)
    if diag.apart is None:
        return logs, errors
    return f"the other {logs.removeprefix('the ')}", diag.judged.errors


def gain_words(diag: Findings) -> str:
    """How the error of each channel changed from the first stage to the last."""
    logs, first, last = errors_of(diag)
    worst = sorted(first.channels, key=lambda name: -_rank(first.channels[name].nrmse))[:_NAMED]
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
    return _levels(logs, errors)


def _levels(logs: str, errors: Errors) -> str:
    return joined(
        f"the {humanize(name)} error{'' if i else f' on {logs}'} is {_error_size(e)}"
        for i, (name, e) in enumerate(errors.channels.items())
    )


def _error_size(error: ChannelError) -> str:
    return f"{_sized(*error.shown)} (NRMSE {number(error.nrmse, 2)})"


def worth_words(diag: Findings) -> list[str]:
    """The share that each effect removes, and the effects that change nothing over whole runs.

    Shares of one whole stand in one sentence. That of a single effect goes without saying, because
    the errors before and after it are said, unless it is told by channel.
    """
    wholes: dict[tuple[str, bool], list[tuple[str, Worth]]] = {}
    unsure, parts = [], _parts(diag)
    for words, worth in parts.items():
        if sure := sure_share(worth):
            wholes.setdefault((sure.channel, sure.everywhere), []).append((words, sure.worth))
        else:
            unsure.append(words)
    sentences = [
        f"Of the squared {humanize(channel)}{' ' * bool(channel)}error over whole runs of "
        f"{_judged_logs(diag, everywhere)} {_removed_words(shares)}."
        for (channel, everywhere), shares in wholes.items()
        if len(diag.added) > 1 or channel or everywhere
    ]
    if unsure:
        has = "has" if len(unsure) == 1 and "together" not in unsure[0] else "have"
        sentences.append(f"{capitalised(joined(unsure))} {has} no sure effect on whole runs.")
    if diag.detectable:
        groups = diag.detectable_groups or [(name,) for name in diag.detectable]
        listed = joined(
            " or ".join(map(an_effect, group)) + _detectable_share(diag, group[0])
            for group in groups
        )
        sentences.append(
            f"These logs also show {listed}: certain from one sample to the next, but over whole "
            "runs without a change that surely matters."
        )
    return sentences


def _parts(diag: Findings) -> dict[str, Worth]:
    """The shares of the added effects, by effect in words, or by effects that have one together."""
    parts: dict[str, Worth] = {}
    for name in leading(diag):
        if worth := diag.worth.get(name):
            together = worth.together or (name,)
            parts[" and ".join(map(humanize, together)) + " together" * bool(worth.together)] = (
                worth
            )
    return parts


def _removed_words(shares: list[tuple[str, Worth]]) -> str:
    if len(shares) > 1:
        return f"each removes: {joined(f'{words} {worth}' for words, worth in shares)}"
    ((words, worth),) = shares
    return f"{words} {'remove' if words.endswith(' together') else 'removes'} {worth}"


def _detectable_share(diag: Findings, name: str) -> str:
    worth = diag.worth.get(name)
    if worth is None:
        return ""
    sure = f"it removes {worth} of the squared error"
    return f" ({sure if worth.above_zero else 'no sure effect on whole runs'})"


def _judged_logs(diag: Findings, everywhere: bool) -> str:
    return "training and unseen logs" if everywhere else errors_of(diag)[0]


def undecided_words(diag: Findings) -> list[str]:
    """That large, lasting errors may be a disturbance's or missing physics, and what would decide.

    Random forces are named only where runs that repeat their inputs show that errors do not recur.
    """
    logs, errors = judged_errors(diag)
    name = next(iter(diag.far), next(iter(errors.channels)))
    error = errors.channels[name]
    multiple = number(error.rmse / diag.one_step.get(name, math.nan), 2)
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
        f"Undecided: over whole runs of {logs} the {humanize(name)} error is {_error_size(error)}, "
        f"{multiple} times that from one sample to the next; {cause}.",
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
    return [
        "Possible, judged by whole runs alone, with the share of the squared error on "
        f"{errors_of(diag)[0]} that each would remove: {shares}."
    ]


def _of_what(diag: Findings, sure: SureShare) -> str:
    """The channel and the logs of a share, where they are not all channels of the judged logs."""
    channel = f" of that of {humanize(sure.channel)}" if sure.channel else ""
    return channel + (f" on {_judged_logs(diag, True)}" if sure.everywhere else "")


def growth_words(diag: Findings) -> list[str]:
    """How much larger errors are over whole runs than from sample to sample, and why.

    Over whole runs with what was learned: a law that removes 99 % of the error leaves next to
    nothing that could add up.
    """
    logs, errors = judged_errors(diag)
    learned = ""
    for law in diag.laws:
        logs, errors = errors_of(diag)[0], law.reported.holdout or law.reported.train
        learned = ", with what was learned,"
    growth = {
        n: e.rmse / diag.one_step[n] for n, e in errors.channels.items() if n in diag.one_step
    }
    name = max(growth, key=lambda n: _rank(growth[n]), default="")
    if not name or not growth[name] > SETTINGS.verdict.far_above_one_step:
        return []
    size, unit = errors.channels[name].shown
    words = (
        f"From one sample to the next the {humanize(name)} is predicted to within "
        f"{_sized(size / growth[name], unit)}, over whole runs of {logs}{learned} to "
        f"{_sized(size, unit)}"
    )
    if diag.verdict == "unexplained":
        return [f"{words}: missing physics adds up, and a disturbance may, too."]
    return [
        f"{words}: no signal of these logs surely explains the difference. It is a disturbance, a "
        "lasting error of a sensor, or physics that these logs do not show."
    ]


# -- other models of the same logs -----------------------------------------------------------------


def other_model_words(diag: Findings) -> list[str]:
    """The model of the library that surely errs less on the same logs, if there is one."""
    other = next((other for other in diag.other_models if other.better), None)
    if other is None:
        return []
    reached = diag.laws[-1].reported if diag.laws else diag.fit
    low, high = distinct_numbers(fit_errors(other.best).nrmse, fit_errors(reached).nrmse)
    logs = errors_of(diag)[0].removeprefix("the ")
    found = " with all that was found" if diag.best or diag.laws else ""
    model = capitalised(an(model_words(other.best.model)))
    return [
        f"{model} errs less over whole runs of the same {logs}: NRMSE {low} against {high}{found}. "
        "Diagnose that model, too."
    ]


# -- what remains ----------------------------------------------------------------------------------


def remaining_words(diag: Findings) -> str:
    """What no known effect explains: where it enters and on what it depends."""
    remaining = diag.remaining
    if diag.changed:
        return _changed_words(diag, diag.changed)
    if remaining is None:
        if diag.laws:
            return "Structure remains that no known effect explains: whole runs show it."
        if diag.verdict == "unexplained":
            if diag.repeating:
                return _repeating_words(diag)
            return "Structure remains that no known effect explains; its place is not clear."
        if diag.verdict == "undecided":
            return "What remains is lasting, and cannot be told from a disturbance."
        return "What remains cannot be told from noise."
    enters = "it enters at" if remaining.manner == "adds" else "it scales what passes"
    still = "Structure still remains" if diag.best else "Structure remains"
    return (
        f"{still} that no known effect explains: {enters} "
        f"{place_words(diag.model, remaining.port)} and depends on {remaining.depends_on}, which "
        f"explains {percent(remaining.share)} of the squared one-step errors there."
    )


def changed_parameter(changed: ChangedSize) -> str:
    """What changes in time, or at a level of a signal, in words."""
    effect, _, name = changed.parameter.rpartition(".")
    level = _amount(number(changed.shown.value, 2), changed.shown.unit)
    of = "" if changed.signal == TIME else f"{an(humanize(changed.signal))} of "
    return f"the {humanize(name)} of {an_effect(effect)} changes at {of}{level}"


def _changed_words(diag: Findings, changed: ChangedSize) -> str:
    """That an added effect changes: where, by how much, and what that removes."""
    unit = changed.after.shown[2]
    low, high = distinct_numbers(changed.before.shown[0], changed.after.shown[0])
    since, first, then = "", "below", "above"
    if changed.signal == TIME:
        since, first, then = " after the start of a log", "before", "after"
    return (
        f"{capitalised(changed_parameter(changed))}{since}: {low} {first}, {_amount(high, unit)} "
        f"{then}. By the slopes of the fit that removes {changed.worth} of the squared error over "
        f"whole runs of {errors_of(diag)[0]}."
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
        f"Structure remains that no known effect explains: over whole runs of "
        f"{judged_errors(diag)[0]} {joined(reasons)}, so it is repeatable; where it enters is not "
        "clear."
    )


# -- what was given: logs that deviate, fixed constants, narrow bounds -----------------------------


def decisive_log_words(diag: Findings) -> list[str]:
    """The deviating logs that carry enough of the error to decide, and whether they do."""
    sentences = [_odd_log(odd) for odd in diag.odd_logs if odd.much]
    if diag.apart:
        sentences.append(
            "The verdict rests on the other logs alone, with the model fitted to them: the "
            "deviating ones were recorded differently, or show what the others do not. So fitted, "
            f"{_levels(*judged_errors(diag))}."
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


def held_words(diag: Findings) -> list[str]:
    """Every fixed constant that the logs contradict.

    Example:
        >>> held_words(diag)
        ["lever_arm is fixed at 0.5 m; these logs suggest 0.399 ± 0.002 m. Measure it again, or
        ..."]
    """
    return [
        f"{name} is fixed at {_amount(f'{held.value:.4g}', held.unit)}; these logs suggest "
        f"{_amount(' ± '.join(with_error(held.wanted, held.std_error)), held.unit)}. Measure it "
        f"again, or free it: model.free('{name}')."
        for name, held in diag.held.items()
    ]


def stopped_words(diag: Findings) -> list[str]:
    """Every parameter of the model as given that a bound has stopped.

    Also those at a bound until effects were added, which may stand in for values beyond it.

    Example:
        >>> stopped_words(diag)
        ['alpha stopped at its bound of 0.2 1/s: these logs favour a higher value. ...']
    """
    first, last = stopped_parameters(diag.stages[0].fit), stopped_parameters(diag.fit)
    added = joined(map(an_effect, diag.added))
    sentences = []
    for full, (name, amount, way) in {**first, **last}.items():
        if full in diag.model.parameters and full in last:
            sentences.append(
                f"{name} stopped at its bound of {amount}: these logs favour a {way} value. What "
                "follows holds under that bound: widen it, if physically possible, and diagnose "
                "again."
            )
        elif full in diag.model.parameters and added:
            sentences.append(
                f"{name} was at its bound of {amount} without {added}, which may stand in for a "
                f"{way} {name}: widen the bound, if physically possible, and diagnose again."
            )
    return sentences


def added_bound_words(diag: Findings) -> list[str]:
    """Every parameter of an added effect that a bound has stopped."""
    return [
        f"{name} {beyond_bound(amount)}"
        for full, (name, amount, _) in stopped_parameters(diag.fit).items()
        if full not in diag.model.parameters
    ]


def beyond_bound(amount: str) -> str:
    """What a parameter at its bound means for its effect, and the mend."""
    return (
        f"stopped at its bound of {amount}: the effect may explain more beyond it. Widen the "
        "bound, if physically possible."
    )


def stopped_parameters(fit: Fit) -> Mapping[str, tuple[str, str, str]]:
    """Of each parameter that a bound stopped its name in words, the bound, and which way it went.

    Without those at the null of their effect, or at the zero of a logarithm: there the effect has
    vanished, which the notes say. And without shares that are whole, of which there is no more.
    """
    stopped = {}
    for full, p in fit.model.parameters.items():
        e, (low, high) = fit.parameters[full], p.limits
        above = abs(e.value - high) < abs(e.value - low)
        vanished = e.value == p.null or (p.transform == "log" and low <= 0 and not above)
        effect, _, name = full.rpartition(".")
        if e.at_bound and not vanished and not is_whole(effect, name, e.value):
            words = capitalised(f"{humanize(name)} of {an_effect(effect)}") if effect else name
            amount = _amount(f"{e.shown[0]:.4g}", e.shown[2])
            stopped[full] = words, amount, "higher" if above else "lower"
    return stopped


def is_whole(effect: str, name: str, value: float) -> bool:
    """Whether a number of a known effect is a share at its natural end: a full sag, a swap.

    Example:
        >>> is_whole("supply_voltage_sag", "share", 1.0), is_whole("load_exponent", "exponent", 4.0)
        (True, False)
    """
    declared = EFFECTS[effect].declared.get(name) if effect in EFFECTS else None
    ends = declared.bounds if declared and not declared.unit else ()
    return value in ends and value in (-1.0, 0.0, 1.0)


def _odd_log(odd: OddLog) -> str:
    carries = (
        f"{odd.evidence}. It carries {percent(odd.share)} of the squared {humanize(odd.channel)} "
        "error of all logs"
    )
    if odd.beyond:
        return (
            f"Log {odd.log} does what most of the others do not ({joined(odd.beyond)}), and what "
            f"the model lacks there shows in it: {carries}."
        )
    return f"Log {odd.log} deviates from the others: {carries}. Check how it was recorded."


def _amount(size: str, unit: str) -> str:
    return f"{size} {unit}".rstrip()


def _sized(value: float, unit: str, digits: int = 2) -> str:
    return f"{number(value, digits)} {unit}".rstrip()


def _rank(value: float) -> float:
    return -math.inf if math.isnan(value) else value

"""A diagnosis in plain sentences."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from diffthrust._support.tables import number
from diffthrust._support.words import an, apart, capitalised, joined, percent, probability, spelt
from diffthrust.diagnosis._given_words import (
    added_bound_words,
    held_words,
    much_words,
    odd_words,
    stopped_words,
)
from diffthrust.diagnosis._learned_words import effects_of, learned_words
from diffthrust.diagnosis._matter_words import (
    errors_of,
    forced_words,
    judged_errors,
    leading,
    possible_words,
    repeating_words,
    undecided_words,
    worth_words,
)
from diffthrust.diagnosis._ports import place_words
from diffthrust.estimation._origin import effects_line, form_lines, python_line
from diffthrust.models._base.effect import Effect
from diffthrust.models._base.model import Model

if TYPE_CHECKING:
    from diffthrust.comparison._compare import Comparison
    from diffthrust.diagnosis._findings import Findings, Missing
    from diffthrust.estimation._estimate import Estimate
    from diffthrust.estimation._result import Fit

_NAMED = 2
"""Channels that the summary names (more are told by their mean), and hints that it repeats."""


def summary(diag: Findings) -> str:
    """The outcome in a few sentences: what lacks, what it gains, what stays open.

    Example:
        >>> summary(diag)
        'The basic thruster lacks a command dead band of 0.40 V: with it the speed error on unseen
        logs falls from 5.6 to 0.30 rad/s (NRMSE 0.33 to 0.018).'
    """
    model = model_words(diag.model)
    if diag.best:
        them = "it" if len(diag.best) == 1 else "them"
        sentences = [f"The {model} lacks {joined(_lacking(diag))}: with {them} {gain_words(diag)}."]
    elif diag.verdict == "undecided":
        sentences = undecided_words(diag)
    elif diag.verdict == "adequate" and not (diag.ranking or diag.silent):
        none = (
            "These logs can test none of the effects" if diag.untestable else "No effect was tried"
        )
        sentences = [f"{none}: whether the {model} lacks an effect, these logs do not tell."]
    elif diag.verdict == "adequate":
        tried = len({c.effect for c in diag.ranking} | {*diag.silent})
        all_tried = f"none of the {tried} effects that were tried" if tried > 1 else "no effect"
        helps = "matters over whole runs" if diag.detectable else "helps on these logs"
        sentences = [f"The {model} is adequate: {all_tried} {helps}."]
        errors = judged_errors(diag)[1].channels
        blind = [spelt(name) for name, e in errors.items() if e.nrmse >= 1.0]
        if blind:
            sentences = [
                f"These logs tell of nothing that the {model} lacks, and yet it follows "
                f"{joined(blind)} no better than a constant would: do they move what drives it?"
            ]
    elif diag.held:
        sentences = []
    else:
        sentences = [f"The {model} lacks something that no known effect explains."]
    sentences += held_words(diag)
    sentences = [*stopped_words(diag), *sentences, *added_bound_words(diag)]
    sentences += worth_words(diag)
    if diag.verdict == "unexplained":
        sentences += [remaining_words(diag), *learned_words(diag), *possible_words(diag)]
    if not diag.best and diag.verdict != "undecided":
        told = gain_words if diag.held else level_words
        without = "without what was learned " if diag.laws else ""
        sentences.append(f"{capitalised(without + told(diag))}.")
    if diag.verdict != "undecided":
        sentences += forced_words(diag)
    sentences += much_words(diag)
    if diag.before.hints:
        sentences.append("A channel may not mean what its name says:")
        sentences += diag.before.hints[:_NAMED]
    return " ".join(sentences)


def verdict_words(diag: Findings) -> str:
    """The verdict as a person would say it."""
    if diag.verdict == "effects_found" and not diag.best:
        return "a constant is held elsewhere"
    return {
        "adequate": "adequate",
        "effects_found": "effects found",
        "unexplained": "something remains unexplained",
        "undecided": "undecided",
    }[diag.verdict]


def model_words(model: Model) -> str:
    """The model in words: "basic thruster", "thruster with command dead band"."""
    with_ = joined(spelt(effect.name) for effect in model.effects)
    return f"{spelt(model.name)} with {with_}" if with_ else f"basic {spelt(model.name)}"


def sized_words(name: str, fit: Fit) -> str:
    """An effect with the values that the fit found.

    Example:
        >>> sized_words("command_deadband", fit)
        'a command dead band of 0.40 V'
    """
    estimates = {
        full.removeprefix(f"{name}."): e
        for full, e in fit.parameters.items()
        if full.startswith(f"{name}.") and not e.fixed
    }
    form = next((effect.form for effect in fit.model.effects if effect.name == name), {})
    formed = "".join(f", {spelt(key)} {value:g}" for key, value in form.items())
    values = {key: _measured(e) for key, e in estimates.items()}
    if len(values) == 1:
        return f"{an(spelt(name))} of {next(iter(values.values()))}{formed}"
    listed = ", ".join(f"{spelt(key)} {value}" for key, value in values.items())
    return f"{an(spelt(name))} ({listed}{formed})" if listed else an(spelt(name))


def gain_words(diag: Findings) -> str:
    """How the error of each channel changed from the first stage to the last."""
    logs, before, after = errors_of(diag)
    worst = sorted(before.channels, key=lambda name: -_rank(before.channels[name].nrmse))[:_NAMED]
    names = [name for name in before.channels if name in worst]
    parts = []
    for i, name in enumerate(names):
        old, new = before.channels[name], after.channels[name]
        first, last = apart(old.shown.value, new.shown.value)
        low, high = apart(old.nrmse, new.nrmse)
        verb = "stays at" if first == last else "falls" if new.rmse < old.rmse else "rises"
        size = f"{verb} {first}" if first == last else f"{verb} from {first} to {last}"
        where = f" on {logs}" if i == 0 else ""
        parts.append(f"the {spelt(name)} error{where} {size} {old.shown.unit}".rstrip())
        parts[-1] += f" (NRMSE {low} to {high})"
    if len(before.channels) > _NAMED:
        low, high = apart(before.nrmse, after.nrmse)
        parts.append(
            f"the NRMSE over all {len(before.channels)} channels goes from {low} to {high}"
        )
    return joined(parts)


def level_words(diag: Findings) -> str:
    """How large the error of each channel is at the last stage."""
    logs, after = judged_errors(diag)
    parts = [
        f"the {spelt(name)} error{f' on {logs}' if i == 0 else ''} is "
        f"{number(e.shown.value, 2)} {e.shown.unit}".rstrip()
        + f" (NRMSE {number(e.nrmse, 2)})"
        for i, (name, e) in enumerate(after.channels.items())
    ]
    return joined(parts)


def refused_words(diag: Findings) -> list[str]:
    """Effects that were not added although they fit the training logs better, and why."""
    return [
        f"{capitalised(an(spelt(name)))} was not added: it {why}."
        for name, why in diag.refused.items()
    ]


def bound_words(diag: Findings) -> list[str]:
    """The parameters of promising effects that a bound has stopped, and the mend."""
    stopped = {
        (c.effect, name): e
        for c in diag.ranking
        if c.effect not in diag.added and (c.delta_bic < 0 or c.effect in diag.possible)
        for name, e in c.parameters.items()
        if e.at_bound
    }
    return [
        f"{capitalised(spelt(name))} of {an(spelt(effect))} stopped at its bound of "
        f"{_measured(e)}: the effect may explain more beyond it. Widen the bound, if nature allows."
        for (effect, name), e in stopped.items()
    ]


def silent_words(diag: Findings) -> str:
    """The effects that were tried in vain."""
    names = joined(an(spelt(name)) for name in diag.silent)
    return f"Tried in vain: {names}." if diag.silent else ""


def group_words(diag: Findings) -> list[str]:
    """For each added effect that has rivals: what these logs cannot tell it from."""
    return [
        f"These logs cannot tell {an(spelt(added))} from "
        f"{joined((an(spelt(name)) for name in group if name != added), 'or')}."
        for added, group in zip(diag.added, diag.groups, strict=True)
        if len(group) > 1
    ]


def missing_words(missing: Missing, model: Model) -> str:
    """The missing signal at a port: its size, and on what it depends."""
    here = place_words(model, missing.port)
    if not missing.shows:
        return f"At {here} nothing is missing that shows."
    size = f"{number(missing.size, 2)} {missing.unit}".rstrip()
    words = f"At {here} a signal of {size} (RMS) is missing; "
    if missing.depends_on is None and missing.p_value < 0.05:
        return f"{words}no signal of the model on which it depends explains a hundredth of it."
    if missing.depends_on is None:
        return f"{words}it depends on none of the model's signals ({probability(missing.p_value)})."
    return (
        f"{words}it depends most on {missing.depends_on}, which explains "
        f"{percent(missing.share)} of its variance ({probability(missing.p_value)})."
    )


def failure_words(comparison: Comparison) -> list[str]:
    """Where the error of a model sits, and whether what is left is noise."""
    return [
        *(regime.sentence for regime in comparison.regimes),
        *(capitalised(tests.sentence) for tests in comparison.tests.values()),
    ]


def remaining_words(diag: Findings) -> str:
    """What no known effect explains: where it enters and on what it depends."""
    left = diag.remaining
    if left is None:
        if diag.verdict == "unexplained":
            return (
                repeating_words(diag)
                if diag.repeating
                else "Structure remains that no known effect explains; its place is not clear."
            )
        if diag.verdict == "undecided":
            return "What remains lasts, and cannot be told from random forces."
        return "Nothing that can be told from noise remains."
    enters = "it enters at" if left.manner == "adds" else "it scales what passes"
    still = "Structure still remains" if diag.best else "Structure remains"
    return (
        f"{still} that no known effect explains: {enters} {place_words(diag.model, left.port)} "
        f"and depends on {left.depends_on}, which explains {percent(left.share)} of the "
        "squared one-step errors there."
    )


def dropped_words(diag: Findings) -> str:
    """The effects that were taken out again."""
    names = joined(an(spelt(name)) for name in diag.dropped)
    was = "was" if len(diag.dropped) == 1 else "were"
    return (
        f"{capitalised(names)} {was} added on the way and taken out again: a later effect made "
        f"{'it' if was == 'was' else 'them'} superfluous."
        if names
        else ""
    )


def caution_words(diag: Findings) -> list[str]:
    """What weakens the outcome: fits that may not claim what they print, and their notes."""
    words = [
        f"The fit of stage {i} ({stage_words(diag, i)}) has the status "
        f"'{stage.fit.status.value}': {stage.fit.message}"
        for i, stage in enumerate(diag.stages)
        if not stage.fit.status.ok
    ]
    if diag.stages[-1].holdout is None:
        words.append(
            "No log was kept unseen: the errors are those of the logs that the models were fitted "
            "to, which every effect lowers. Give holdout logs."
        )
    return [*words, *odd_words(diag), *diag.notes, *diag.fit.notes]


def closing_words(diag: Findings) -> list[str]:
    """The last lines: date, versions, hashes, and the model with what was found, to copy."""
    origin = diag.origin.sentences if diag.origin else ()
    freed, found = ", ".join(f'"{name}"' for name in diag.held), effects_of(diag)
    return [
        *origin,
        "To copy into a spec file, and into Python:",
        effects_line(diag.model, found),
        *form_lines((*diag.model.effects, *found)),
        *(f"[parameters] {_key(name)} = {{ fixed = false }}" for name in diag.held),
        python_line(diag.model, found),
        *[f"model = model.free({freed})"] * bool(freed),
    ]


def _key(name: str) -> str:
    """A parameter's name as a key of a spec file."""
    return f'"{name}"' if "." in name else name


def stage_words(diag: Findings, index: int) -> str:
    """What a stage added: "as given", "+ command dead band", "lever_arm freed"; "- ..." if lost."""
    if index == 0:
        return "as given"
    now, before = diag.stages[index].effects, diag.stages[index - 1].effects
    new = [name for name in now if name not in before]
    changes = [f"{name} freed" if name in diag.held else f"+ {spelt(name)}" for name in new]
    changes += [f"- {spelt(name)}" for name in before if name not in now]
    return ", ".join(changes)


def _lacking(diag: Findings) -> list[str]:
    """The added effects with their values, and what each cannot be told from."""
    words, groups = [], dict(zip(diag.added, diag.groups, strict=True))
    for name in leading(diag):
        group = groups[name]
        rivals = joined((an(spelt(other)) for other in group if other != name), "or")
        untold = f" (these logs cannot tell it from {rivals})" if rivals else ""
        words.append(sized_words(name, diag.fit) + untold)
    return words


def _measured(estimate: Estimate) -> str:
    """A value to the digits that its standard error allows, two or three."""
    known = estimate.std_error is not None and estimate.std_error < 0.003 * abs(estimate.value)
    value, _, unit = estimate.shown
    return f"{number(value, 3 if known else 2)} {unit}".rstrip()


def _rank(value: float) -> float:
    return -math.inf if math.isnan(value) else value


def effects_known(diag: Findings) -> dict[str, Effect | type[Effect]]:
    """Effects by name: the classes of the catalogue and what the models have."""
    from diffthrust.models._base.registry import catalogue

    return {
        **catalogue(),
        **{effect.name: effect for effect in (*diag.model.effects, *diag.best)},
    }


def first_line(name: str, known: Mapping[str, Effect | type[Effect]]) -> str:
    """The first line of an effect's docstring; "" where the effect is not known."""
    doc = (known[name].__doc__ or "").strip() if name in known else ""
    return doc.splitlines()[0] if doc else ""

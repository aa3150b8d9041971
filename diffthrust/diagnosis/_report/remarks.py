"""The sentences of a diagnosis beyond its summary, by the section that they stand in."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from diffthrust._support.words import (
    an,
    capitalised,
    humanize,
    joined,
    number,
    percent,
    probability,
)
from diffthrust.comparison._compare import Comparison
from diffthrust.diagnosis._findings import Findings, Missing
from diffthrust.diagnosis._ports import place_words
from diffthrust.diagnosis._report.learned import effects_of
from diffthrust.diagnosis._report.text import beyond_bound, measured, odd_words, stage_words
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.estimation._origin import effects_line, form_lines, python_line
from diffthrust.models._base.effect import Effect
from diffthrust.models._base.model import Model


def dropped_words(diag: Findings) -> str:
    """The effects that were removed again."""
    if not diag.dropped:
        return ""
    several = len(diag.dropped) > 1
    return (
        f"{capitalised(joined(an(humanize(name)) for name in diag.dropped))} "
        f"{'were' if several else 'was'} added and later removed: a later effect made "
        f"{'them' if several else 'it'} superfluous."
    )


def headroom_words(diag: Findings) -> list[str]:
    """Whether there is something to find, before the search and after it."""
    if diag.headroom is None:
        return []
    first, last = diag.headroom
    sentences = [first.summary]
    if len(diag.stages) > 1:
        sentences.append(f"At the last stage: {last.summary}")
    if diag.remaining is not None and not last.worth:
        sentences.append("One-step errors show structure nevertheless: see what remains.")
    return sentences


def failure_words(comparison: Comparison) -> list[str]:
    """Where the error of a model is large, and whether it is noise."""
    return [
        *(regime.sentence for regime in comparison.regimes),
        *(capitalised(tests.sentence) for tests in comparison.tests.values()),
    ]


def missing_words(missing: Missing, model: Model) -> str:
    """The missing signal at a port: its size, and on what it depends."""
    place = place_words(model, missing.port)
    if not missing.shows:
        return f"At {place} no missing signal is significant."
    size = f"{number(missing.size, 2)} {missing.unit}".rstrip()
    words = f"At {place} a signal of {size} (RMS) is missing; "
    chance = probability(missing.p_value)
    if missing.depends_on is None and missing.p_value < SETTINGS.structure.dependence_level:
        return f"{words}no signal of the model on which it depends explains 1 % of it."
    if missing.depends_on is None:
        return f"{words}it depends on none of the model's signals ({chance})."
    return (
        f"{words}it depends most on {missing.depends_on}, which explains {percent(missing.share)} "
        f"of its variance ({chance})."
    )


def missing_sentences(missing: Sequence[Missing], diag: Findings) -> list[str]:
    """One for each port, in the units in which the logs were written."""
    return [missing_words(m, diag.model) for m in diag.shown(missing)]


def refused_words(diag: Findings) -> list[str]:
    """Effects that were not added although they fit the training logs better, and why."""
    return [
        f"{capitalised(an(humanize(name)))} was not added: it {why}."
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
        f"{capitalised(humanize(name))} of {an(humanize(effect))} {beyond_bound(measured(e))}"
        for (effect, name), e in stopped.items()
    ]


def silent_words(diag: Findings) -> str:
    """The effects that were tried, and promised nothing."""
    names = joined(an(humanize(name)) for name in diag.silent)
    return f"No improvement: {names}." if names else ""


def group_words(diag: Findings) -> list[str]:
    """For each added effect that has rivals: what these logs cannot tell it from."""
    return [
        f"These logs cannot tell {an(humanize(added))} from "
        f"{joined((an(humanize(name)) for name in group if name != added), 'or')}."
        for added, group in zip(diag.added, diag.groups, strict=True)
        if len(group) > 1
    ]


def caution_words(diag: Findings) -> list[str]:
    """What weakens the outcome: fits that did not converge, and their notes."""
    sentences = [
        f"The fit of stage {i} ({stage_words(diag, i)}) has the status "
        f"'{stage.fit.status.value}': {stage.fit.message}"
        for i, stage in enumerate(diag.stages)
        if not stage.fit.status.ok
    ]
    if diag.stages[-1].holdout is None:
        sentences.append(
            "No log was kept unseen: the errors are those of the logs that the models were fitted "
            "to, which every effect lowers. Give holdout logs."
        )
    return [*sentences, *odd_words(diag), *diag.notes, *diag.fit.notes]


def closing_words(diag: Findings) -> list[str]:
    """The last lines: date, versions, hashes, and the model with all that was found, to copy."""
    origin = diag.origin.sentences if diag.origin else ()
    freed, effects = ", ".join(f'"{name}"' for name in diag.held), effects_of(diag)
    return [
        *origin,
        "To copy into a spec file, and into Python:",
        effects_line(diag.model, effects),
        *form_lines((*diag.model.effects, *effects)),
        *(f"[parameters] {_key(name)} = {{ fixed = false }}" for name in diag.held),
        python_line(diag.model, effects),
        *[f"model = model.free({freed})"] * bool(freed),
    ]


def _key(name: str) -> str:
    """A parameter's name as a key of a spec file."""
    return f'"{name}"' if "." in name else name


def effects_by_name(diag: Findings) -> dict[str, Effect | type[Effect]]:
    """The classes of the catalogue, and the effects that the models have."""
    from diffthrust.models._base.registry import catalogue

    return {
        **catalogue(),
        **{effect.name: effect for effect in (*diag.model.effects, *diag.best)},
    }


def first_line(name: str, effects: Mapping[str, Effect | type[Effect]]) -> str:
    """The first line of an effect's docstring; "" where the effect is not known."""
    doc = (effects[name].__doc__ or "").strip() if name in effects else ""
    return doc.splitlines()[0] if doc else ""

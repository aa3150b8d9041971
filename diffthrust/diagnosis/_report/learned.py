"""What was learned, in plain sentences."""

from __future__ import annotations

import ast
import math

from diffthrust._support.words import capitalised, humanize, joined, number
from diffthrust.diagnosis._candidates import place_words
from diffthrust.diagnosis._findings import Findings
from diffthrust.diagnosis._learned import LearnedLaw, TriedForm
from diffthrust.diagnosis._unknown_term.closed_forms import form_of, parameter_names
from diffthrust.diagnosis._unknown_term.terms import NUMBER
from diffthrust.effects._curve import Curve
from diffthrust.effects._formula import Formula
from diffthrust.effects._grammar import expression_of
from diffthrust.logs._units import product_unit
from diffthrust.models._base.made_effect import ARRIVING


def learned_words(diag: Findings) -> list[str]:
    """Of each learned law: where it acts, what it is worth, its form, and what it replaces."""
    sentences = _together_words(diag)
    for law in (law for law in diag.laws if not law.together):
        baseline, updated = diag.stages[0].fit, law.reported
        unseen = baseline.holdout is not None and updated.holdout is not None
        logs = "unseen logs" if unseen else "the training logs"
        first, last = (f.holdout if unseen and f.holdout else f.train for f in (baseline, updated))
        sentences.append(
            f"Learned: at {place_words(diag.model, law.curve.port)} {manner_words(law)}"
            f"{'' if law.form else ', for which no closed form was found'}. Of the squared error "
            f"over whole runs of {logs} it removes {law.worth}; with it the NRMSE "
            f"there is {number(last.nrmse, 2)}, as given {number(first.nrmse, 2)}."
            f"{_range_words(law)}"
        )
        if law.form:
            sentences.append(f"{capitalised(form_words(law, law.form))}.")
        sentences += [
            f"These logs cannot tell this from another form: {form_words(law, rival)}."
            for rival in law.alike
        ]
        if law.superfluous:
            names = joined(humanize(name) for name in law.superfluous)
            sentences.append(f"{capitalised(names)} only imitated it, or did nothing beside it.")
    return sentences


def _together_words(diag: Findings) -> list[str]:
    """Of terms that were fitted together: each with its numbers, and what all are worth."""
    laws = [law for law in diag.laws if law.together]
    if not laws:
        return []
    terms = "; ".join(
        f"at {place_words(diag.model, law.curve.port)} {form_words(law, law.form)}"
        for law in laws
        if law.form
    )
    baseline, updated = diag.stages[0].fit, laws[0].reported
    last, first = ((fit.holdout or fit.train) for fit in (updated, baseline))
    return [
        f"Learned from whole runs, of states that are not measured too: {terms}. Of the squared "
        f"error over whole runs of unseen logs they remove {laws[0].worth}; with them the NRMSE "
        f"there is {number(last.nrmse, 2)}, as given {number(first.nrmse, 2)}."
    ]


def _range_words(law: LearnedLaw) -> str:
    """Where these logs determine it; a wave continues beyond them."""
    if NUMBER in law.curve.given:
        return ""
    low, high = (number(law.shown.value * end, 2) for end in (law.curve.low, law.curve.high))
    ends = f"{low} to {high} {law.place_unit}".rstrip()
    return f" Valid from {ends}."


def manner_words(law: LearnedLaw) -> str:
    """What a curve does: "what passes is scaled by a curve of speed"."""
    curve, of = law.curve, signal_words(law)
    if curve.times == ARRIVING:
        return f"what passes is scaled by a curve of {of}"
    times = f" times {curve.times}" if curve.times else ""
    return f"a curve of {of}{times} is added"


def signal_words(law: LearnedLaw, effect: Curve | Formula | None = None) -> str:
    """What a law is a function of, "the last 2 s of command**2", as an effect estimates it."""
    estimated = effect or law.curve
    expression = expression_of(law.curve.signal)
    if NUMBER in expression.places:
        (name,) = (n for n in expression.places if n not in estimated.given)
        length = number(2 * math.pi / getattr(estimated, NUMBER), 2)
        unit = product_unit(("rad", 1), (estimated.given[NUMBER]["unit"], -1))
        return f"{name}, repeating every {length} {unit}".rstrip()
    if not expression.memories:
        return "what arrives" if law.curve.signal == ARRIVING else law.curve.signal
    (memory,) = expression.memories
    of = ast.unparse(memory.of).replace(ARRIVING, "what arrives")
    if memory.kind == "integral":
        return "the time since the log began" if of == "1" else f"the integral of {of}"
    assert memory.size is not None
    size = getattr(estimated, ast.unparse(memory.size))
    if memory.kind == "lag":
        return f"the last {number(size, 2)} s of {of}{', from none on' if memory.start else ''}"
    per, unit = law.shown
    limit = f"{number(per * size, 2)} {unit}".rstrip()
    return f"the travel of {of} since it last turned, at most {limit}"


def form_words(law: LearnedLaw, tried: TriedForm) -> str:
    """A closed form as a person would say it, with its sizes.

    Example:
        >>> form_words(law, law.form)  # doctest: +SKIP
        'it is a hump of speed about 21 rad/s, 4.6 rad/s to either side: ...'
    """
    form = form_of(tried.name, tried.companion)
    names = [name for name in tried.fit.parameters if name.startswith(f"{tried.formula.name}.")]
    amounts = [tried.fit.parameters[name].shown for name in names]
    sizes = [f"{number(value, 2)} {unit}".rstrip() for value, _, unit in amounts]
    by_parameter = dict(zip(parameter_names(form), sizes, strict=False))
    verb = form.described(signal_words(law, tried.formula), by_parameter)
    subject = "what is added" if law.manner == "scales" else "it"
    subject = "its factor" if tried.times == ARRIVING else subject
    times = f", times {tried.times}" if tried.times not in ("", ARRIVING) else ""
    play = " (a play or backlash)" if "play(" in law.curve.signal else ""
    listed = joined(
        f"{name.rpartition('.')[2]} = {size}" for name, size in zip(names, sizes, strict=True)
    )
    return f"{subject} {verb}{times}{play}: {tried.formula.expression}, with {listed}"

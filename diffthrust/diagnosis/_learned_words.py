"""What was learned, in plain sentences, and the lines that bring it into a model."""

from __future__ import annotations

import ast
import math
from typing import TYPE_CHECKING

from diffthrust._support.tables import number
from diffthrust._support.words import capitalised, joined, spelt
from diffthrust.diagnosis._matter_words import share_words
from diffthrust.diagnosis._ports import place_words
from diffthrust.diagnosis._unknown_term.closed_forms import FORMS
from diffthrust.diagnosis._unknown_term.terms import NUMBER
from diffthrust.effects._grammar import expression_of
from diffthrust.logs._units import product_unit
from diffthrust.models._base.made_effect import ARRIVING

if TYPE_CHECKING:
    from diffthrust.diagnosis._findings import Findings
    from diffthrust.diagnosis._learned import LearnedLaw, TriedForm
    from diffthrust.effects._curve import Curve
    from diffthrust.effects._formula import Formula
    from diffthrust.models._base.effect import Effect


def learned_words(diag: Findings) -> list[str]:
    """Of each learned law: where it acts, what it is worth, its form, and what it replaces."""
    words = []
    for law in diag.laws:
        before, after = diag.stages[0].fit, law.told
        unseen = before.holdout is not None and after.holdout is not None
        logs = "unseen logs" if unseen else "the training logs"
        old, new = (f.holdout if unseen and f.holdout else f.train for f in (before, after))
        words.append(
            f"Learned: at {place_words(diag.model, law.curve.port)} {manner_words(law)}"
            f"{'' if law.form else ', as yet without a name'}. Of the squared error over whole "
            f"runs of {logs} it removes {share_words(law.worth)}; with it the NRMSE there is "
            f"{number(new.nrmse, 2)}, as given {number(old.nrmse, 2)}.{_reach_words(law)}"
        )
        if law.form:
            words.append(f"{capitalised(form_words(law, law.form))}.")
        for one in law.alike:
            words.append(f"These logs cannot tell this from another form: {form_words(law, one)}.")
        if law.superfluous:
            names = joined(spelt(name) for name in law.superfluous)
            words.append(
                f"{capitalised(names)} only imitated it, or change"
                f"{'s' if len(law.superfluous) == 1 else ''} nothing beside it."
            )
    return words


def _reach_words(law: LearnedLaw) -> str:
    """How far these logs tell of it: a wave goes on as it is."""
    if NUMBER in law.curve.given:
        return ""
    low, high = (number(law.shown.value * end, 2) for end in (law.curve.low, law.curve.high))
    ends = f"{low} to {high} {law.place_unit}".rstrip()
    return f" These logs tell of it from {ends}, and no further."


def manner_words(law: LearnedLaw) -> str:
    """What a curve does: "what passes is scaled by a curve of speed"."""
    curve, of = law.curve, signal_words(law)
    if curve.times == ARRIVING:
        return f"what passes is scaled by a curve of {of}"
    times = f" times {curve.times}" if curve.times else ""
    return f"a curve of {of}{times} is added"


def signal_words(law: LearnedLaw, effect: Curve | Formula | None = None) -> str:
    """What a law is a function of, "the last 2 s of command**2", as an effect estimates it."""
    now = effect or law.curve
    expression = expression_of(law.curve.signal)
    if NUMBER in expression.places:
        (name,) = (n for n in expression.places if n not in now.given)
        length = number(2 * math.pi / getattr(now, NUMBER), 2)
        unit = product_unit(("rad", 1), (now.given[NUMBER]["unit"], -1))
        return f"waves of {name}, {length} {unit}".rstrip() + " long"
    if not expression.memories:
        return "what arrives" if law.curve.signal == ARRIVING else law.curve.signal
    (memory,) = expression.memories
    of = ast.unparse(memory.of).replace(ARRIVING, "what arrives")
    if memory.kind == "integral":
        return "the time since the log began" if of == "1" else f"the integral of {of}"
    assert memory.size is not None
    size = getattr(now, ast.unparse(memory.size))
    if memory.kind == "lag":
        return f"the last {number(size, 2)} s of {of}{', from none on' if memory.start else ''}"
    per, unit = law.shown
    most = f"{number(per * size, 2)} {unit}".rstrip()
    return f"how far {of} has gone since it turned, {most} at most"


def form_words(law: LearnedLaw, tried: TriedForm) -> str:
    """A closed form as a person would say it, with its sizes.

    Example:
        >>> form_words(law, law.form)  # doctest: +SKIP
        'it is a hump of speed about 21 rad/s, 4.6 rad/s to either side: ...'
    """
    form = next(one for one in FORMS if one.name == tried.name)
    told = [name for name in tried.fit.parameters if name.startswith(f"{tried.formula.name}.")]
    shown = [tried.fit.parameters[name].shown for name in told]
    sizes = [f"{number(value, 2)} {unit}".rstrip() for value, _, unit in shown]
    own = dict(zip(("a", *form.parameters), sizes, strict=False))
    goes = form.words.format(x=signal_words(law, tried.formula), **own)
    subject = "what is added" if law.manner == "scales" else "it"
    subject = "its factor" if tried.times == ARRIVING else subject
    times = f", times {tried.times}" if tried.times not in ("", ARRIVING) else ""
    back = " (a play or backlash)" if "play(" in law.curve.signal else ""
    names = (name.rpartition(".")[2] for name in told)
    return f"{subject} {goes}{times}{back}: {tried.formula.expression}, with " + joined(
        f"{name} = {size}" for name, size in zip(names, sizes, strict=True)
    )


def effects_of(diag: Findings) -> tuple[Effect, ...]:
    """What a model would have of all that was found: named effects, and what was learned."""
    return (*diag.best, *(law.form.formula if law.form else law.curve for law in diag.laws))

"""What was learned, in plain sentences."""

from __future__ import annotations

import ast
import math

import numpy as np

from diffthrust._support.words import capitalised, humanize, joined, number, percent
from diffthrust.diagnosis._candidates import place_words, words_and_unit
from diffthrust.diagnosis._explained_share import SureShare, sure_share
from diffthrust.diagnosis._findings import Findings
from diffthrust.diagnosis._learned import LearnedLaw, TriedForm
from diffthrust.diagnosis._missing import after_effects
from diffthrust.diagnosis._report.error_text import GIVEN, WITHOUT, judged_logs, squared_error
from diffthrust.diagnosis._report.text import copied_fit, leading, sized_words
from diffthrust.diagnosis._unknown_term.closed_forms import form_of, parameter_names
from diffthrust.diagnosis._unknown_term.terms import NUMBER
from diffthrust.effects._curve import Curve
from diffthrust.effects._formula import Formula
from diffthrust.effects._grammar import Expression, expression_of
from diffthrust.logs._units import product_unit
from diffthrust.models._base.made_effect import ARRIVING
from diffthrust.models._base.model import Model

_LONGEST_PLACE = 6
"""Display: words of the description of a port that are still read in a sentence; its name else."""

_TAKEN_BACK = 2.0
"""Display: a form that reaches so many times as far as its curve has no size of its own."""
_CHANGED = 0.1
"""Display: a number that changed by a smaller share of itself is not told anew."""


def place_of(model: Model, port: str) -> str:
    """Where something enters, in few words.

    Example:
        >>> place_of(dft.Thruster(), "propeller"), place_of(dft.Thruster(), "load")
        ('in the thrust of the propeller', 'in the load')
    """
    if port not in model.ports:
        return f"in {place_words(model, port).partition(' (')[0]}"
    description, _ = words_and_unit(model, port)
    short = len(description.split()) <= _LONGEST_PLACE
    return f"in the {description if short else humanize(port)}"


def learned_words(diag: Findings) -> list[str]:
    """Of each learned law: where it acts, what it is worth, its form, and what it replaces."""
    sentences = _together_words(diag)
    for law in (law for law in diag.laws if not law.together):
        baseline, updated = diag.stages[0].fit, law.reported
        unseen = baseline.holdout is not None and updated.holdout is not None
        logs = "unseen logs" if unseen else "the training logs"
        first, last = (f.holdout if unseen and f.holdout else f.train for f in (baseline, updated))
        share = sure_share(law.worth) or SureShare(law.worth)
        sentences.append(
            f"Learned: at {place_words(diag.model, law.curve.port)} "
            f"{manner_words(law, law.times)}"
            f"{'' if law.form else ' (no closed form was chosen)'}. Of the "
            f"{squared_error(share.channel, _left(diag))} over whole runs of "
            f"{judged_logs(diag, share.everywhere)} it removes {share.worth}; with it the NRMSE "
            f"on {logs} is {number(last.nrmse, 2)}, as given {number(first.nrmse, 2)}."
        )
        if valid := valid_words(law):
            sentences.append(f"{capitalised(valid)}.")
        if law.form:
            sentences.append(f"{capitalised(form_words(law, law.form))}.")
        sentences += [
            f"These logs cannot tell this from another form: {form_words(law, rival)}."
            for rival in law.alike
        ]
        if law.superfluous:
            names = joined(humanize(name) for name in law.superfluous)
            sentences.append(f"Superfluous beside it: {names}.")
    return [*sentences, *_changed_words(diag)]


def _changed_words(diag: Findings) -> list[str]:
    """The effects whose numbers are others beside what was learned.

    A delay of 0.0056 s, which stood in for the friction of an EMPS, is 0.0030 s beside its curve.
    """
    if not diag.laws:
        return []
    first, last = diag.fit.parameters, copied_fit(diag)
    changed = {
        full.rpartition(".")[0]
        for full, e in last.parameters.items()
        if full in first and abs(e.value - first[full].value) > _CHANGED * abs(first[full].value)
    }
    sizes = [sized_words(name, last) for name in leading(diag) if name in changed]
    return [f"Estimated anew beside what was learned: {joined(sizes)}."] if sizes else []


def _left(diag: Findings) -> str:
    """Of which model's error the share of a law is told."""
    return WITHOUT if len(diag.stages) > 1 else GIVEN


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
    left = "that is left without them" if _left(diag) == WITHOUT else GIVEN
    return [
        f"Learned from whole runs, of states that are not measured too: {terms}. Of the "
        f"{squared_error(of=left)} over whole runs of unseen logs they remove {laws[0].worth}; "
        f"with them the NRMSE there is {number(last.nrmse, 2)}, as given {number(first.nrmse, 2)}."
    ]


def valid_words(law: LearnedLaw) -> str:
    """From where to where these logs determine it; nothing of a wave, which continues."""
    if NUMBER in law.curve.given:
        return ""
    low, high = (number(law.shown.value * end, 2) for end in (law.curve.low, law.curve.high))
    return f"valid from {low} to {high} {law.place_unit}".rstrip()


def reach_words(law: LearnedLaw) -> str:
    """How much it does in these logs at most, in the form that is told: what it adds, or scales by.

    Up to the ends of the range in which it is valid: a stall that takes a third of the thrust at
    -40 rad/s took "up to 20 %" between the first and the last per cent of the samples. A factor is
    related to its median: what it is most of the time a parameter of the model has taken up.
    """
    if not law.samples.size or law.times not in ("", ARRIVING):
        return ""
    low, middle, high = _spread(_values_of(law))
    if law.times == "":
        most, level = max(abs(low), abs(high)), law.form is not None and law.form.name == "dry"
        size = f"{'' if level else 'up to '}{number(most, 2)} {law.port_unit}".rstrip()
        return "" if _shared(law, most) or _unsure(law, most) else size
    less, more = ((1.0 + end) / (1.0 + middle) - 1.0 for end in (low, high))
    if not -1.0 <= less <= more:
        return ""
    most = more if more > -less else less
    return f"up to {percent(abs(most))} {'more' if most > 0 else 'less'}"


def _values_of(law: LearnedLaw) -> np.ndarray:
    """A law over the samples of the logs, ``(N,)``: of its closed form where that is told."""
    if law.form is None or law.together:
        return np.asarray(law.curve.at_signal(law.samples))
    form = form_of(law.form.name, law.form.companion)
    start = f"{law.form.formula.name}."
    estimates = [e.value for n, e in law.form.fit.parameters.items() if n.startswith(start)]
    values = dict(zip(parameter_names(form), estimates, strict=False))
    return form.over(law.samples, {**values, "r": law.form.reference})


def _shared(law: LearnedLaw, most: float) -> bool:
    """Whether a form reaches so far only because parameters of the model take some of it back.

    The curve leaves to them what they can do: a dead zone of -16 kN s/m stood for 18 N of dry
    friction beside a viscous friction of as much more.
    """
    if law.form is None or law.together or law.form.times != law.curve.times:
        return False
    low, _, high = _spread(np.asarray(law.curve.at_signal(law.samples)))
    return most > _TAKEN_BACK * max(abs(low), abs(high))


def _unsure(law: LearnedLaw, most: float) -> bool:
    """Whether a curve may as well be half as large, because a parameter of the model takes it up.

    On the EMPS a curve of velocity "up to 26 N" stood beside a viscous friction of 4 100 N s/m;
    with another friction it was 53 or 68 N, at the same errors.
    """
    if law.form is not None:
        return False
    _, curve, errors = law.drawn()
    return 2.0 * float(errors[np.argmax(np.abs(curve))]) > most


def _spread(values: np.ndarray) -> tuple[float, float, float]:
    return float(np.min(values)), float(np.median(values)), float(np.max(values))


def manner_words(law: LearnedLaw, times: str) -> str:
    """What a law does with a factor: "what passes is scaled by a curve of speed"."""
    of = signal_words(law)
    if times == ARRIVING:
        return f"what passes is scaled by a curve of {of}"
    return f"a curve of {of}{f' times {times}' if times else ''} is added"


def signal_words(law: LearnedLaw, effect: Curve | Formula | None = None) -> str:
    """What a law is a function of, "the last 2 s of command**2", as an effect estimates it."""
    estimated = effect or law.curve
    expression = expression_of(law.curve.signal)
    others = (e for e in law.fit.model.effects if e.name != law.curve.name)
    after = after_effects(law.fit.model, others, expression.places)
    return f"{_signal_words(law, estimated, expression)}{after}"


def _signal_words(law: LearnedLaw, estimated: Curve | Formula, expression: Expression) -> str:
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
    subject = "what is added" if law.manner == "scales" else "it"
    subject = "its factor" if tried.times == ARRIVING else subject
    play = " (a play or backlash)" if "play(" in law.curve.signal else ""
    listed = joined(f"{name} = {size}" for name, size in _sizes_of(tried).items())
    verb = f"{_verb_words(law, tried)}{_times_words(tried)}"
    return f"{subject} {verb}{play}: {tried.formula.expression}, with {listed}"


def _sizes_of(tried: TriedForm) -> dict[str, str]:
    """The parameters of a form in the units of the logs, in the order of its expression."""
    start, sizes = f"{tried.formula.name}.", {}
    for name, estimate in tried.fit.parameters.items():
        if name.startswith(start):
            value, _, unit = estimate.shown
            sizes[name.removeprefix(start)] = f"{number(value, 2)} {unit}".rstrip()
    return sizes


def _verb_words(law: LearnedLaw, tried: TriedForm) -> str:
    """What a form does: a hump of speed about 21 rad/s, 4.6 rad/s to either side."""
    form = form_of(tried.name, tried.companion)
    if NUMBER in expression_of(law.curve.signal).places:  # in proportion to a sine of the signal
        form = form._replace(words="is a wave of {x}")
    sizes = dict(zip(parameter_names(form), _sizes_of(tried).values(), strict=False))
    if "k" in sizes:
        sizes["k"] = _period_words(tried, tuple(sizes).index("k"))
    return form.described(signal_words(law, tried.formula), sizes)


def _period_words(tried: TriedForm, at: int) -> str:
    """From one ripple to the next, of the parameter that is its wave number."""
    name = [n for n in tried.fit.parameters if n.startswith(f"{tried.formula.name}.")][at]
    value, _, unit = tried.fit.parameters[name].shown
    return f"{number(2 * math.pi / value, 2)} {product_unit(('rad', 1), (unit, -1))}".rstrip()


def _times_words(tried: TriedForm) -> str:
    return f", times {tried.times}" if tried.times not in ("", ARRIVING) else ""


def law_wordings(law: LearnedLaw) -> tuple[str, str, str]:
    """A law in one sentence: in full, by what leads, and by its signal alone.

    Example:
        >>> law_wordings(law)[1]  # doctest: +SKIP
        'a term that is a hump of speed about 21 rad/s'
    """
    signal = signal_words(law)
    if law.form is None:
        kind = "factor" if law.manner == "scales" else "term"
        words = f"a {kind} that is a curve of {signal}"
        return words, words, words
    kind = "factor" if law.form.times == ARRIVING else "term"
    verb, times = _verb_words(law, law.form), _times_words(law.form)
    whole, lead = f"a {kind} that {verb}{times}", f"a {kind} that {verb.partition(', ')[0]}{times}"
    return whole, lead, f"a {kind} that depends on {signal}"

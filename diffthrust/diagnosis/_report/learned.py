"""What was learned, in plain sentences; and an effect to write in place of what was not."""

from __future__ import annotations

import ast
import math
from collections.abc import Sequence

import numpy as np

from diffthrust._support.literals import ToCopy
from diffthrust._support.words import capitalised, humanize, joined, number, percent
from diffthrust.diagnosis._candidates import place_words, words_and_unit
from diffthrust.diagnosis._explained_share import SureShare, sure_share
from diffthrust.diagnosis._findings import Findings
from diffthrust.diagnosis._learned import LearnedLaw, TriedForm
from diffthrust.diagnosis._missing import Missing, Remaining, after_effects
from diffthrust.diagnosis._report.error_text import GIVEN, WITHOUT, squared_error, whole_words
from diffthrust.diagnosis._report.text import amount, copied_fit, leading, sized_words, with_unit
from diffthrust.diagnosis._unknown_term.closed_forms import form_of, parameter_names
from diffthrust.diagnosis._unknown_term.terms import NUMBER
from diffthrust.effects._class_text import class_name, effect_class_text
from diffthrust.effects._curve import Curve
from diffthrust.effects._formula import Formula
from diffthrust.effects._grammar import Expression, expression_of
from diffthrust.estimation._origin import effects_line
from diffthrust.logs._units import product_unit, same_unit
from diffthrust.models._base.made_effect import ARRIVING
from diffthrust.models._base.model import Model

_LONGEST_PLACE = 6
"""Display: words of the description of a port that are still read in a sentence; its name else."""
_TAKEN_BACK = 2.0
"""Display: a form that reaches so many times as far as its curve has no size of its own."""
_CHANGED = 0.1
"""Display: a number that changed by a smaller share of itself is not told anew."""
EFFECT_NAME = "my_effect"
_EFFECT_USE = """

# In Python:
#     fit = dft.fit(model + {cls}(), logs, holdout=unseen)
# In a spec file:
#     {line}
"""


def place_of(model: Model, port: str) -> str:
    """Where something enters, in few words: "in the thrust of the propeller"."""
    if port not in model.ports:
        return f"in {place_words(model, port).partition(' (')[0]}"
    description, _ = words_and_unit(model, port)
    short = len(description.split()) <= _LONGEST_PLACE
    return f"in the {description if short else humanize(port)}"


# -- in the details --------------------------------------------------------------------------------


def learned_words(diag: Findings) -> list[str]:
    """Of each learned law: where it acts, what it is worth, its form, and what it replaces."""
    if not diag.laws:
        return []
    without = WITHOUT if len(diag.stages) > 1 else GIVEN
    laws = [law for law in diag.laws if not law.together]
    sentences = [sentence for law in laws for sentence in _law_words(diag, law, without)]
    return [*_together_words(diag, without), *sentences, *_changed_words(diag)]


def _law_words(diag: Findings, law: LearnedLaw, without: str) -> list[str]:
    baseline, updated = diag.stages[0].fit, law.reported
    first, last, logs = baseline.train, updated.train, "the training logs"
    if baseline.holdout is not None and updated.holdout is not None:
        first, last, logs = baseline.holdout, updated.holdout, "unseen logs"
    share = sure_share(law.worth) or SureShare(law.worth)
    sentences = [
        f"Learned: at {place_words(diag.model, law.curve.port)} {manner_words(law, law.times)}"
        f"{'' if law.form else ' (no closed form was chosen)'}. Of the "
        f"{whole_words(diag, share, without)} it removes {share.worth}; with it the NRMSE "
        f"on {logs} is {number(last.nrmse, 2)}, as given {number(first.nrmse, 2)}."
    ]
    forms = [form_words(law, law.form)] if law.form else []
    sentences += [f"{capitalised(words)}." for words in (valid_words(law), *forms) if words]
    sentences += [
        f"These logs cannot tell this from another form: {form_words(law, rival)}."
        for rival in law.alike
    ]
    if law.superfluous:
        names = joined(humanize(name) for name in law.superfluous)
        sentences.append(f"Superfluous beside it: {names}.")
    return sentences


def _together_words(diag: Findings, without: str) -> list[str]:
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
    of = "that is left without them" if without == WITHOUT else without
    return [
        f"Learned from whole runs, of states that are not measured too: {terms}. Of the "
        f"{squared_error(of=of)} over whole runs of unseen logs they remove {laws[0].worth}; "
        f"with them the NRMSE there is {number(last.nrmse, 2)}, as given {number(first.nrmse, 2)}."
    ]


def _changed_words(diag: Findings) -> list[str]:
    """The effects whose numbers are others beside what was learned.

    A delay of 0.0056 s, which stood in for the friction of an EMPS, is 0.0030 s beside its curve.
    """
    first, last = diag.fit.parameters, copied_fit(diag)
    changed = {
        full.rpartition(".")[0]
        for full, e in last.parameters.items()
        if full in first and abs(e.value - first[full].value) > _CHANGED * abs(first[full].value)
    }
    sizes = [sized_words(name, last) for name in leading(diag) if name in changed]
    return [f"Estimated anew beside what was learned: {joined(sizes)}."] if sizes else []


# -- a law, its place and its size -----------------------------------------------------------------


def law_wordings(law: LearnedLaw) -> tuple[str, str, str]:
    """A law in one sentence: in full, by what leads, and by its signal alone.

    What leads is "a term that is a hump of speed about 21 rad/s".
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


def valid_words(law: LearnedLaw) -> str:
    """From where to where these logs determine it; nothing of a wave, which continues."""
    if NUMBER in law.curve.given:
        return ""
    low, high = (number(law.shown.value * end, 2) for end in (law.curve.low, law.curve.high))
    return f"valid from {low} to {amount(high, law.place_unit)}"


def reach_words(law: LearnedLaw) -> str:
    """How much it does in these logs at most, in the form that is told: what it adds, or scales by.

    Up to the ends of the range in which it is valid: a stall that takes a third of the thrust at
    -40 rad/s took "up to 20 %" between the first and the last per cent of the samples. A factor is
    related to its median: what it is most of the time a parameter of the model has taken up.
    """
    if not law.samples.size or law.times not in ("", ARRIVING):
        return ""
    curve = np.asarray(law.curve.at_signal(law.samples))
    form = None if law.together else law.form
    values = form_over(form, law.samples) if form else curve
    if law.times == "":
        most, level = float(np.max(np.abs(values))), law.form is not None and law.form.name == "dry"
        if (law.form is None and _is_unsure(law, most)) or (
            form and form.times == law.curve.times and _is_taken_back(curve, most)
        ):
            return ""
        return f"{'' if level else 'up to '}{with_unit(most, law.port_unit)}"
    middle = 1.0 + float(np.median(values))
    less, more = ((1.0 + float(end)) / middle - 1.0 for end in (np.min(values), np.max(values)))
    if not -1.0 <= less <= more:
        return ""
    most = more if more > -less else less
    return f"up to {percent(abs(most))} {'more' if most > 0 else 'less'}"


def form_over(tried: TriedForm, x: np.ndarray) -> np.ndarray:
    """A closed form over its signal, at its estimates: its formula has them to five digits."""
    form = form_of(tried.name, tried.companion)
    start = f"{tried.formula.name}."
    estimates = [e.value for n, e in tried.fit.parameters.items() if n.startswith(start)]
    values = dict(zip(parameter_names(form), estimates, strict=False))
    return form.over(x, {**values, "r": tried.reference})


def _is_taken_back(curve: np.ndarray, most: float) -> bool:
    """Whether a form reaches so far only because parameters of the model take some of it back.

    The curve leaves to them what they can do: a dead zone of -16 kN s/m stood for 18 N of dry
    friction beside a viscous friction of as much more.
    """
    return most > _TAKEN_BACK * float(np.max(np.abs(curve)))


def _is_unsure(law: LearnedLaw, most: float) -> bool:
    """Whether a curve may as well be half as large, because a parameter of the model takes it up.

    On the EMPS a curve of velocity "up to 26 N" stood beside a viscous friction of 4 100 N s/m;
    with another friction it was 53 or 68 N, at the same errors.
    """
    _, curve, errors = law.drawn()
    return 2.0 * float(errors[np.argmax(np.abs(curve))]) > most


# -- a law by its signal and its form --------------------------------------------------------------


def manner_words(law: LearnedLaw, times: str) -> str:
    """What a law does with a factor: "what passes is scaled by a curve of speed"."""
    of = signal_words(law)
    if times == ARRIVING:
        return f"what passes is scaled by a curve of {of}"
    return f"a curve of {of}{f' times {times}' if times else ''} is added"


def signal_words(law: LearnedLaw, effect: Curve | Formula | None = None) -> str:
    """What a law is a function of, "the last 2 s of command**2", as an effect estimates it."""
    expression = expression_of(law.curve.signal)
    others = (e for e in law.fit.model.effects if e.name != law.curve.name)
    after = after_effects(law.fit.model, others, expression.places)
    return f"{_signal_words(law, effect or law.curve, expression)}{after}"


def _signal_words(law: LearnedLaw, estimated: Curve | Formula, expression: Expression) -> str:
    if NUMBER in expression.places:
        (name,) = (n for n in expression.places if n not in estimated.given)
        length = 2 * math.pi / getattr(estimated, NUMBER)
        unit = product_unit(("rad", 1), (estimated.given[NUMBER]["unit"], -1))
        return f"{name}, repeating every {with_unit(length, unit)}"
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
    return f"the travel of {of} since it last turned, at most {with_unit(per * size, unit)}"


def form_words(law: LearnedLaw, tried: TriedForm) -> str:
    """A closed form with its sizes: "it is a hump of speed about 21 rad/s, ..."."""
    subject = "what is added" if law.manner == "scales" else "it"
    subject = "its factor" if tried.times == ARRIVING else subject
    play = " (a play or backlash)" if "play(" in law.curve.signal else ""
    listed = joined(f"{n} = {with_unit(*size)}" for n, size in _sizes_of(tried).items())
    verb = f"{_verb_words(law, tried)}{_times_words(tried)}"
    return f"{subject} {verb}{play}: {tried.formula.expression}, with {listed}"


def _sizes_of(tried: TriedForm) -> dict[str, tuple[float, str]]:
    """The parameters of a form in the units of the logs, in the order of its expression."""
    start = f"{tried.formula.name}."
    shown = {n: e.shown for n, e in tried.fit.parameters.items() if n.startswith(start)}
    return {n.removeprefix(start): (value, unit) for n, (value, _, unit) in shown.items()}


def _verb_words(law: LearnedLaw, tried: TriedForm) -> str:
    """What a form does: a hump of speed about 21 rad/s, 4.6 rad/s to either side."""
    form = form_of(tried.name, tried.companion)
    if NUMBER in expression_of(law.curve.signal).places:  # in proportion to a sine of the signal
        form = form._replace(words="is a wave of {x}")
    sizes = dict(zip(parameter_names(form), _sizes_of(tried).values(), strict=False))
    if "k" in sizes:  # a wave number is told as what lies from one ripple to the next
        value, unit = sizes["k"]
        sizes["k"] = 2 * math.pi / value, product_unit(("rad", 1), (unit, -1))
    words = {name: with_unit(*size) for name, size in sizes.items()}
    return form.described(signal_words(law, tried.formula), words)


def _times_words(tried: TriedForm) -> str:
    return f", times {tried.times}" if tried.times not in ("", ARRIVING) else ""


# -- what was not learned --------------------------------------------------------------------------


def own_effect(model: Model, remaining: Remaining, missing: Sequence[Missing]) -> str:
    """Python code of an effect for what is left of the last model, its port and signal filled in.

    It runs as it stands: a term in proportion to the signal, in place of which the user puts a law.
    The missing signals know the units of their ports.
    """
    adds, signal, port = remaining.manner == "adds", remaining.signal, remaining.port
    units = {**model.outputs, **model.optional_inputs, **model.inputs}
    units |= {m.port: m.unit for m in reversed(missing)}
    unit = (units[port] if port in units else words_and_unit(model, port)[1]) if adds else ""
    hint = "put your law in place of this line"
    # a rate or a past mean is no attribute of `s`: the user has to work it out first
    if signal.rate or signal.past is not None:
        hint = f"from which to work out: {signal}; {hint}"
    else:
        signals = {**model.inputs, **model.optional_inputs, **model.states, "time": "s"}
        if signals[signal.name]:
            unit = f"{_bracketed(unit or '1')}/{_bracketed(signals[signal.name])}"
    term = f"strength * {signal.name}"
    expression = term if adds else f"value * (1 + {term})"
    formula = Formula(port, expression, strength=unit if same_unit(unit, unit) else "")
    text = effect_class_text(formula, EFFECT_NAME, hint=hint)
    cls = class_name(EFFECT_NAME)
    line = effects_line([*model.effects, f"{EFFECT_NAME}.py:{cls}"])
    return ToCopy(text + _EFFECT_USE.format(cls=cls, line=line))


def _bracketed(unit: str) -> str:
    return f"({unit})" if set(unit) & {"/", " "} else unit

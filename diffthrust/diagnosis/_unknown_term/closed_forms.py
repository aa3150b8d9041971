"""Closed forms that a law may have, how likely one-step errors make each, and each as an effect.

A form is an expression of one signal ``x`` with an amplitude ``a``, and as far as it has them a
place ``b`` and a width ``c`` in the signal's unit, an exponent ``p``, and a wave number ``k``.
Beside it may stand a companion of amplitude ``d``: a constant, or the even part of an odd form.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Mapping, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np

from diffthrust.diagnosis._unknown_term.evidence import LinearizedEvidence
from diffthrust.diagnosis._unknown_term.terms import unit_following
from diffthrust.effects._curve import Curve
from diffthrust.effects._formula import Formula
from diffthrust.effects._grammar import expression_of
from diffthrust.logs._units import product_unit
from diffthrust.models._base.made_effect import ARRIVING

CONSTANT, EVEN_PART = "constant", "even part"
"""Companions of a form."""
_COMPANION_WORDS = {CONSTANT: "with an offset of {d}", EVEN_PART: "with an even part of {d}"}
_WITHOUT_CONSTANT = ("constant", "linear", "line")
"""Forms beside which a constant is nothing new: a line has one."""
_WITHOUT_EVEN_PART = ("dry", "saturating")
"""Odd forms of which the even part is a constant, or hardly anything else."""


class Form(NamedTuple):
    """A closed form.

    Args:
        name: in words.
        text: the expression, of ``x``, ``a`` and further parameters; ``r`` is a typical size of x.
        per: power of the signal's unit in the denominator of the amplitude's unit.
        words: description for a report; ``{a}``, ``{b}``, ``{c}``, ``{p}`` are given with units.
        plain: the forms of fewer parameters that are limits of this one.
        even: whether its place ``b`` stands for both signs of the signal.
        far: whether its place may lie far beyond the range of the signal.
        jump: whether it may be so narrow that its signal jumps over it between samples.
        companion: what stands beside it, of amplitude ``d``; "" for nothing.
    """

    name: str
    text: str
    per: int = 0
    words: str = ""
    plain: tuple[str, ...] = ()
    even: bool = False
    far: bool = False
    jump: bool = False
    companion: str = ""

    @property
    def parameters(self) -> tuple[str, ...]:
        """Its parameters besides the amplitudes."""
        return tuple(n for n in expression_of(self.text).places if n in ("b", "c", "p", "k"))

    @property
    def amplitudes(self) -> tuple[str, ...]:
        """What it is linear in: its own amplitude, and that of its companion."""
        return ("a", "d") if self.companion else ("a",)

    @property
    def is_odd(self) -> bool:
        """Whether it changes its sign with its signal."""
        x = np.linspace(0.1, 2.0, 20)
        values = {"a": 1.0, "b": 0.3, "c": 0.7, "p": 1.5, "k": 2.0, "r": 1.0}
        return bool(np.allclose(self.over(-x, values), -self.over(x, values)))

    @property
    def companions(self) -> tuple[Form, ...]:
        """The same form with each companion that makes it another one."""
        shape = self.text.removeprefix("a * ")
        texts = {}
        if self.name not in _WITHOUT_CONSTANT:
            texts[CONSTANT] = f"{self.text} + d"
        if self.is_odd and self.name not in _WITHOUT_EVEN_PART:
            texts[EVEN_PART] = f"{self.text} + d * abs({shape})"
        return tuple(self._replace(text=text, companion=name) for name, text in texts.items())

    def shapes(self, x: np.ndarray, values: Mapping[str, float]) -> np.ndarray:
        """The form, and its companion if it has one, at an amplitude of one; ``(1 or 2, N)``."""
        none = dict.fromkeys(self.amplitudes, 0.0)
        return np.array([self.over(x, {**none, **values, n: 1.0}) for n in self.amplitudes])

    def described(self, x: str, amounts: Mapping[str, str]) -> str:
        """The form in words, of a signal and with amounts of its parameters."""
        words = self.words.format(x=x, **amounts)
        if not self.companion:
            return words
        return f"{words}, {_COMPANION_WORDS[self.companion].format(**amounts)}"

    def over(self, x: np.ndarray, values: Mapping[str, float]) -> np.ndarray:
        """The form over a signal, ``(N,)``, at values of its parameters and of ``r``."""
        law = expression_of(self.text)
        with np.errstate(all="ignore"):
            shape = law({"x": x, **values}.__getitem__, np)
        return np.broadcast_to(np.asarray(shape, float), x.shape)


FORMS = (
    Form("constant", "a", 0, "does not change with {x}"),
    Form("linear", "a * x", 1, "goes in proportion to {x}"),
    Form(
        "line", "a * (x - b)", 1,
        "goes in proportion to {x}, from {b} on and below", ("linear",), far=True,
    ),
    Form("even square", "a * x**2", 2, "goes with the square of {x}"),
    Form("square with sign", "a * x * abs(x)", 2, "goes with {x} times its size"),
    Form("cubic", "a * x**3", 3, "goes with the cube of {x}"),
    Form(
        "power", "a * sign(x) * (abs(x) / r)**p", 0,
        "goes with {x}, to the power of {p}", ("linear",),
    ),
    Form(
        "even power", "a * (abs(x) / r)**p", 0,
        "goes with the size of {x}, to the power of {p}", ("even square",),
    ),
    Form(
        "dry", "a * tanh(x / (0.02 * r))", 0,
        "is of constant size, with the sign of {x} (as Coulomb friction)",
    ),
    Form(
        "saturating", "a * tanh(x / c)", 0,
        "goes with {x}, and saturates beyond {c}", ("linear", "dry"),
    ),
    Form(
        "dead zone", "a * sign(x) * max(abs(x) - b, 0)", 1,
        "goes in proportion to {x}, beyond {b}", ("linear",), even=True,
    ),
    Form("ramp above", "a * max(x - b, 0)", 1, "goes in proportion to {x}, above {b}", ("linear",)),
    Form("ramp below", "a * max(b - x, 0)", 1, "goes in proportion to {x}, below {b}", ("linear",)),
    Form(
        "square beyond", "a * max(abs(x) - b, 0)**2", 2,
        "goes by the square of {x}, beyond {b}", ("even square",), even=True,
    ),
    Form("square above", "a * max(x - b, 0)**2", 2, "goes by the square of {x}, above {b}"),
    Form("square below", "a * max(b - x, 0)**2", 2, "goes by the square of {x}, below {b}"),
    Form(
        "exponential", "a * (exp(x / c) - 1)", 0,
        "goes exponentially with {x}, over {c}", ("linear",),
    ),
    Form(
        "levelling", "a * (1 - exp(-x / c))", 0,
        "goes with {x}, and levels off over {c}", ("linear",),
    ),
    Form(
        "rise and fall", "a * (x / c) * exp((1 - (x / c)**2) / 2)", 0,
        "peaks at {c} of {x} to either side and fades beyond",
    ),
    Form("hump", "a * exp(-((x - b) / c)**2)", 0, "is a hump of {x} about {b}, {c} to either side"),
    Form(
        "hump of both signs", "a * exp(-((abs(x) - b) / c)**2)", 0,
        "is a hump of {x} about {b} and about its opposite, {c} to either side", even=True,
    ),
    Form(
        "odd humps", "a * (exp(-((x - b) / c)**2) - exp(-((x + b) / c)**2))", 0,
        "is a hump of {x} about {b}, and one of the other sign about its opposite, {c} to either "
        "side", ("rise and fall",), even=True,
    ),
    Form("ripple", "a * sin(k * (x - b))", 0, "repeats every {k} of {x}"),
    Form(
        "step", "a * (1 + tanh((x - b) / c)) / 2", 0,
        "is a step of {x} at {b}, {c} to either side", jump=True,
    ),
)  # fmt: skip


def form_of(name: str, companion: str = "") -> Form:
    """A form by its name, with a companion."""
    form = next(form for form in FORMS if form.name == name)
    return next(each for each in (form, *form.companions) if each.companion == companion)


# Grids on which a form is first placed, and limits of its parameters, over the signal's range.
_PLACES, _WIDTHS, _EXPONENTS = 17, (0.05, 0.1, 0.2, 0.4), (0.5, 1.5, 2.5, 3.5)
"""Numerics: grid of first guesses: places, widths over the range of the signal, and exponents."""
_LEAST_WIDTH, _LARGEST_WIDTH = 0.01, 2.0
"""Numerics: bounds of widths, over the range of the signal."""
_LEAST_JUMP = 3e-4
"""Numerics: the same of a jump where whole runs are fitted, which know it better than the splines
of one-step errors. Thrust that a battery loses below 14 V, of a range of 3 V, erred by 1.1 to 1.8
times its true structure at a hundredth, by 1.0 to 1.2 at 0.003, by 1.03 at most at 3e-4."""
_PLACE_MARGIN, _FAR_PLACE_MARGIN = 0.1, 4.0
"""Numerics: how far beyond the range of the signal a place may lie: that of a line may be its far
zero. A closer limit makes the starts of a later fit agree."""
_RESOLVED = 1e-3
"""Numerics: a companion that makes less of the gain is one of splines, which cannot turn as sharply
as dry friction."""
_MOST_WAVES = 9
"""Numerics: a ripple of more waves over the range is not looked for: as many pieces has a curve.
More are found by the periodogram (`wave_along`)."""


class Match(NamedTuple):
    """A form that one-step errors support.

    Args:
        form: the form.
        values: its parameters, the amplitudes among them.
        gain: the likelihood ratio that it promises.
        reference: the typical size of the signal, ``r``.
        largest_wave_number: that the readings of the signal resolve.
        times: its factor, as a curve's; "" for none.
    """

    form: Form
    values: Mapping[str, float]
    gain: float
    reference: float
    largest_wave_number: float
    times: str = ""


def ranked_matches(evidence: Mapping[str, LinearizedEvidence]) -> list[Match]:
    """Each form, by each factor of a law, where one-step errors are likeliest, in that order."""
    matches = [
        best_match(form, of_shapes)._replace(times=times)
        for times, of_shapes in evidence.items()
        for form in FORMS
    ]
    return sorted(matches, key=lambda match: -match.gain)


def best_match(form: Form, evidence: LinearizedEvidence) -> Match:
    """A form at the place, width, exponent that make one-step errors likeliest.

    Of no more readings than parameters, or of a wave between two readings, nothing is gained:
    tables of a T200 at 10, 12 and 16 V were explained by a ripple of 1.0 V.
    """
    from scipy.optimize import minimize  # slow to import

    x, names, resolved = evidence.x, form.parameters, evidence.largest_wave_number
    span = x[-1] - x[0]
    low, high, wave_number = x[0], x[-1], 2.0 * np.pi / span
    most = min(_MOST_WAVES * wave_number, resolved)
    unknown = len(names) + len(form.amplitudes)
    if unknown >= len(evidence.readings) or ("k" in names and most <= 2.0 * wave_number):
        nothing = dict.fromkeys((*form.amplitudes, *names), 0.0)
        return Match(form, nothing, 0.0, evidence.reference, resolved)
    if form.even:
        low, high = 0.0, max(abs(low), abs(high))
    elif form.far:
        low, high = low - _FAR_PLACE_MARGIN * span, high + _FAR_PLACE_MARGIN * span
    grids = {
        "b": np.linspace(low, high, _PLACES + 2)[1:-1], "c": span * np.array(_WIDTHS),
        "p": np.array(_EXPONENTS), "k": wave_number * np.arange(2.0, most / wave_number),
    }  # fmt: skip
    limits = {
        "b": (low, high), "c": (_LEAST_WIDTH * span, _LARGEST_WIDTH * span), "p": (0.2, 5.0),
        # at least one and a half waves: less of one is a flank, which other forms have
        "k": (1.5 * wave_number, most),
    }  # fmt: skip
    unit = {"b": span, "c": span, "p": 1.0, "k": 1.0 / span}

    def gain_at(values: Sequence[float]) -> tuple[float, np.ndarray]:
        parameters = dict(zip(names, values, strict=True))
        return evidence.gain_of(form.shapes(x, {**parameters, "r": evidence.reference}))

    def loss(scaled: np.ndarray) -> float:
        return -gain_at([v * unit[n] for n, v in zip(names, scaled, strict=True)])[0]

    best = max(product(*(grids[n] for n in names)), key=lambda values: gain_at(values)[0])
    if names:
        start = [v / unit[n] for n, v in zip(names, best, strict=True)]
        bounds = [(limits[n][0] / unit[n], limits[n][1] / unit[n]) for n in names]
        # Nelder-Mead: the gain has kinks where a place passes a point of the grid
        optimum = minimize(loss, start, method="Nelder-Mead", bounds=bounds,
                           options={"maxiter": 200})  # fmt: skip
        best = tuple(float(v) * unit[n] for n, v in zip(names, optimum.x, strict=True))
    gain, amplitudes = gain_at(best)
    values = dict(zip(form.amplitudes, map(float, amplitudes), strict=True))
    values |= dict(zip(names, best, strict=True))
    return Match(form, values, gain, evidence.reference, resolved)


def with_companion(
    match: Match, evidence: LinearizedEvidence, whole_runs: LinearizedEvidence | None, price: float
) -> Match:
    """A match with the companion that earns its price, by one-step errors or over whole runs.

    The force of a linear axis errs by a constant: EMPS has dry friction of 21 N and an offset of
    -3.3 N. Without the offset a fit of whole runs finds no dry friction, and no form fits.

    Args:
        match: the form alone.
        evidence: what one-step errors say of its shapes.
        whole_runs: what a curve says that was fitted to whole runs; ``None`` if there is none.
        price: what a further parameter costs.
    """
    if match.times == ARRIVING:  # a constant share of what arrives is the model's own
        return match

    def earned(form: Form, by: LinearizedEvidence) -> float:
        alone, both = (best_match(each, by).gain for each in (match.form, form))
        return both - alone - max(price, _RESOLVED * both)

    kinds = (evidence, whole_runs) if whole_runs else (evidence,)
    earnings = {form: max(earned(form, by) for by in kinds) for form in match.form.companions}
    best = max(earnings, key=lambda form: earnings[form], default=match.form)
    if earnings.get(best, 0.0) <= 0.0:
        return match
    return best_match(best, evidence)._replace(times=match.times)


def as_formula(match: Match, curve: Curve, unit: str, signal_unit: str, channel: str) -> Formula:
    """A form as an effect in the place of a curve, at its likeliest parameters.

    Args:
        match: the form.
        curve: the curve.
        unit: of what the form adds, or scales by.
        signal_unit: that of the curve's signal.
        channel: the channel of the model whose unit that is; "" for none.
    """
    form = match.form
    text = _substituted(form, curve.signal, match)
    law = f"{match.times} * ({text})" if match.times else text
    if match.times == ARRIVING:
        law = f"value * (1 + {text})"
    elif ARRIVING in expression_of(law).places:  # a formula that reads it replaces what arrives
        law = f"value + {law}"
    span = curve.high - curve.low
    reach = 2.0 * _FAR_PLACE_MARGIN * span if form.far else _PLACE_MARGIN * span
    lowest = 0.0 if form.even else curve.low - reach
    of_signal = unit_following(channel, signal_unit)
    narrowest = (_LEAST_JUMP if form.jump else _LEAST_WIDTH) * span
    per = {"a": form.per, "d": 0 if form.companion == CONSTANT else form.per}
    fastest = min(10.0 * _MOST_WAVES / span, match.largest_wave_number)
    fields = {
        **{n: {"unit": product_unit((unit, 1), (signal_unit, -per[n])), "value": match.values[n],
               "null": 0.0, "size": abs(match.values[n]) or 1.0} for n in form.amplitudes},
        "b": {"unit": of_signal, "bounds": _rounded(lowest, curve.high + reach)},
        "c": {"unit": of_signal, "bounds": _rounded(narrowest, _LARGEST_WIDTH * span)},
        "p": {"unit": "", "bounds": (0.1, 6.0)},
        "k": {"unit": product_unit(("rad", 1), (signal_unit, -1)),
              "bounds": _rounded(1.0 / span, fastest)},
    }  # fmt: skip
    parameters = {}
    for n, name in _names(form, curve.signal, match.times).items():
        # bounds are rounded: a value at an end of its range fell outside, and ended a diagnosis
        low, high = fields[n].get("bounds", (-np.inf, np.inf))
        parameters[name] = {**fields[n], "value": float(np.clip(match.values[n], low, high))}
    kept = [n for n in curve.given if n in expression_of(law).places]
    parameters |= {n: {**curve.given[n], "value": getattr(curve, n)} for n in kept}
    return Formula(curve.port, law, name=f"{curve.name}_form", **parameters)


def as_estimated(formula: Formula) -> Formula:
    """The same formula, starting at its present parameters, in numbers short enough to read."""
    parameters = {}
    for name, fields in formula.given.items():
        low, high = formula.declared[name].limits
        (value,) = _rounded(getattr(formula, name))
        parameters[name] = {**fields, "value": min(max(value, low), high)}
        if "size" in fields:
            parameters[name]["size"] = abs(value) or fields["size"]
    return Formula(formula.port, formula.expression, name=formula.name, **parameters)


def parameter_names(form: Form) -> tuple[str, ...]:
    """The parameters of a form, in the order in which its formula has them."""
    own, *companion = form.amplitudes
    return (own, *form.parameters, *companion)


def _rounded(*numbers: float) -> tuple[float, ...]:
    return tuple(float(f"{number:.5g}") for number in numbers)


def _names(form: Form, *expressions: str) -> dict[str, str]:
    """Names of a form's parameters that do not clash with the names in some expressions."""
    taken = {name for text in expressions if text for name in expression_of(text).places}
    return {n: n if n not in taken else f"{n}_form" for n in parameter_names(form)}


def _substituted(form: Form, signal: str, match: Match) -> str:
    """A form's expression with a signal in the place of ``x``, and a number in that of ``r``."""
    words = {
        "x": signal if signal.isidentifier() else f"({signal})",
        "r": f"{match.reference:.4g}",
        **_names(form, signal, match.times),
    }
    text = re.sub(r"\b[xrabcdpk]\b", lambda word: words[word[0]], form.text)
    return ast.unparse(ast.parse(text, mode="eval").body)

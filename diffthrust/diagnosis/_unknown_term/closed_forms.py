"""Closed forms that a law may have.

Each is an expression of one signal ``x`` with an amplitude ``a``, and as far as it has them a place
``b`` and a width ``c`` in the signal's unit, an exponent ``p``, and a wave number ``k``.

Closed forms of a learned law: how likely each is, and as an effect.
"""

from __future__ import annotations

import ast
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


class Form(NamedTuple):
    """A closed form.

    Args:
        name: in words.
        text: the expression, of ``x``, ``a`` and further parameters; ``r`` is a typical size of x.
        per: by which power of the signal's unit that of the amplitude is divided.
        words: how it goes, for people; ``{a}``, ``{b}``, ``{c}``, ``{p}`` are told with units.
        plain: the form of fewer parameters that it comes near to.
        even: whether its place ``b`` stands for both signs of the signal.
        far: whether that may lie beyond the range of the signal.
    """

    name: str
    text: str
    per: int = 0
    words: str = ""
    plain: str = ""
    even: bool = False
    far: bool = False

    @property
    def parameters(self) -> tuple[str, ...]:
        """Its parameters besides the amplitude."""
        return tuple(n for n in expression_of(self.text).places if n in ("b", "c", "p", "k"))

    def over(self, x: np.ndarray, values: Mapping[str, float]) -> np.ndarray:
        """The form over a signal, at values of its parameters and of ``r``; its shape is that."""
        law = expression_of(self.text)
        with np.errstate(all="ignore"):
            result = law({"x": x, **values}.__getitem__, np)
        return np.broadcast_to(np.asarray(result, float), x.shape)


FORMS = (
    Form("constant", "a", 0, "does not change with {x}"),
    Form("linear", "a * x", 1, "goes in proportion to {x}"),
    Form(
        "line", "a * (x - b)", 1,
        "goes in proportion to {x}, from {b} on and below", "linear", far=True,
    ),
    Form("even square", "a * x**2", 2, "goes with the square of {x}"),
    Form("square with sign", "a * x * abs(x)", 2, "goes with {x} times its size"),
    Form("cubic", "a * x**3", 3, "goes with the cube of {x}"),
    Form(
        "power", "a * sign(x) * (abs(x) / r)**p", 0,
        "goes with {x}, to the power of {p}", "linear",
    ),
    Form(
        "even power", "a * (abs(x) / r)**p", 0,
        "goes with the size of {x}, to the power of {p}", "even square",
    ),
    Form("dry", "a * tanh(x / (0.02 * r))", 0, "is of constant size, with the sign of {x}"),
    Form("saturating", "a * tanh(x / c)", 0, "goes with {x}, and saturates beyond {c}", "linear"),
    Form(
        "dead zone", "a * sign(x) * max(abs(x) - b, 0)", 1,
        "goes in proportion to {x}, beyond {b}", "linear", even=True,
    ),
    Form("ramp above", "a * max(x - b, 0)", 1, "goes in proportion to {x}, above {b}", "linear"),
    Form("ramp below", "a * max(b - x, 0)", 1, "goes in proportion to {x}, below {b}", "linear"),
    Form(
        "square beyond", "a * max(abs(x) - b, 0)**2", 2,
        "goes by the square of {x}, beyond {b}", "even square", even=True,
    ),
    Form("square above", "a * max(x - b, 0)**2", 2, "goes by the square of {x}, above {b}"),
    Form("square below", "a * max(b - x, 0)**2", 2, "goes by the square of {x}, below {b}"),
    Form(
        "exponential", "a * (exp(x / c) - 1)", 0,
        "goes exponentially with {x}, over {c}", "linear",
    ),
    Form(
        "levelling", "a * (1 - exp(-x / c))", 0,
        "goes with {x}, and levels off over {c}", "linear",
    ),
    Form("hump", "a * exp(-((x - b) / c)**2)", 0, "is a hump of {x} about {b}, {c} to either side"),
    Form(
        "hump of both signs", "a * exp(-((abs(x) - b) / c)**2)", 0,
        "is a hump of {x} about {b} and about its opposite, {c} to either side", even=True,
    ),
    Form(
        "odd humps", "a * (exp(-((x - b) / c)**2) - exp(-((x + b) / c)**2))", 0,
        "is a hump of {x} about {b}, and one of the other sign about its opposite, {c} to either "
        "side", even=True,
    ),
    Form("ripple", "a * sin(k * (x - b))", 0, "goes in waves along {x}, of {k}"),
    Form(
        "step", "a * (1 + tanh((x - b) / c)) / 2", 0,
        "is a step of {x} at {b}, {c} to either side",
    ),
)  # fmt: skip


_PLACES, _WIDTHS, _EXPONENTS = 17, (0.05, 0.1, 0.2, 0.4), (0.5, 1.5, 2.5, 3.5)
_LEAST_WIDTH, _LARGEST_WIDTH, _PLACE_MARGIN, _FAR_PLACE_MARGIN = 0.01, 2.0, 0.1, 4.0
"""Shares of the range of the signal: within which widths are, and how far beyond it places may lie:
as estimated, and of forms whose place may be far."""
_MOST_WAVES = 9
"""A ripple is looked for with fewer waves than this over the range of the signal."""


class Match(NamedTuple):
    """A form that one-step errors ask for.

    Args:
        form: the form.
        values: its parameters, ``a`` among them.
        gain: the likelihood ratio that it promises.
        reference: the typical size of the signal, ``r``.
        times: what it is multiplied by, as a curve; "" for nothing.
    """

    form: Form
    values: Mapping[str, float]
    gain: float
    reference: float
    times: str = ""


def ranked_matches(grounds: Mapping[str, LinearizedEvidence]) -> list[Match]:
    """The forms by how likely each makes one-step errors, where it is best; the likeliest first.

    Args:
        grounds: what one-step errors say of the law's shapes, by what these are multiplied by.
    """
    return sorted(
        (
            best_match(form, ground)._replace(times=times)
            for times, ground in grounds.items()
            for form in FORMS
        ),
        key=lambda match: -match.gain,
    )


def as_formula(match: Match, curve: Curve, unit: str, signal_unit: str, channel: str) -> Formula:
    """A form as an effect at the place of a curve, beginning where it is likeliest.

    Args:
        match: the form.
        curve: the curve.
        unit: of what the form adds, or scales by.
        signal_unit: that of the curve's signal,
        channel: which is that of a channel of the model; "" for none.
    """
    form = match.form
    text = _substituted(form, curve.signal, match)
    law = f"{match.times} * ({text})" if match.times else text
    if match.times == ARRIVING:
        law = f"value * (1 + {text})"
    elif ARRIVING in expression_of(law).places:  # else it would stand in the place of what arrives
        law = f"value + {law}"
    amplitude = product_unit((unit, 1), (signal_unit, -form.per))
    span = curve.high - curve.low
    reach = 2.0 * _FAR_PLACE_MARGIN * span if form.far else _PLACE_MARGIN * span
    lowest = 0.0 if form.even else curve.low - reach
    of_signal = unit_following(channel, signal_unit)
    fields = {
        "a": {"unit": amplitude, "value": match.values["a"], "null": 0.0,
              "size": abs(match.values["a"]) or 1.0},
        "b": {"unit": of_signal, "bounds": _short(lowest, curve.high + reach)},
        "c": {"unit": of_signal, "bounds": _short(_LEAST_WIDTH * span, _LARGEST_WIDTH * span)},
        "p": {"unit": "", "bounds": (0.1, 6.0)},
        "k": {"unit": product_unit(("rad", 1), (signal_unit, -1)),
              "bounds": _short(1.0 / span, 10.0 * _MOST_WAVES / span)},
    }  # fmt: skip
    names = _names(form, curve.signal, match.times)
    parameters = {}
    for n in names:  # bounds are rounded
        low, high = fields[n].get("bounds", (-np.inf, np.inf))
        parameters[names[n]] = {**fields[n], "value": float(np.clip(match.values[n], low, high))}
    kept = [n for n in curve.given if n in expression_of(law).places]
    parameters |= {n: {**curve.given[n], "value": getattr(curve, n)} for n in kept}
    return Formula(curve.port, law, name=f"{curve.name}_form", **parameters)


def as_estimated(formula: Formula) -> Formula:
    """The same formula, which begins where its parameters are now; in numbers that are read."""
    parameters = {}
    for name, fields in formula.given.items():
        low, high = formula.declared[name].limits
        (value,) = _short(getattr(formula, name))
        parameters[name] = {**fields, "value": min(max(value, low), high)}
        if "size" in fields:
            parameters[name]["size"] = abs(value) or fields["size"]
    return Formula(formula.port, formula.expression, name=formula.name, **parameters)


def _short(*numbers: float) -> tuple[float, ...]:
    return tuple(float(f"{number:.5g}") for number in numbers)


def form_values(form: Form, formula: Formula) -> dict[str, float]:
    """The parameters of a form, by its own names, in the formula that was made of it."""
    names = ("a", *form.parameters)
    return {
        n: getattr(formula, parameter) for n, parameter in zip(names, formula.given, strict=False)
    }


def _names(form: Form, *expressions: str) -> dict[str, str]:
    """What a form's parameters are called beside the names of some expressions."""
    taken = {name for text in expressions if text for name in expression_of(text).places}
    return {n: n if n not in taken else f"{n}_form" for n in ("a", *form.parameters)}


def _substituted(form: Form, signal: str, match: Match) -> str:
    """A form's expression of a signal, in place of ``x`` and ``r``."""
    import re

    words = {
        "x": signal if signal.isidentifier() else f"({signal})",
        "r": f"{match.reference:.4g}",
        **_names(form, signal, match.times),
    }
    spelt = re.sub(r"\b[xrabcpk]\b", lambda word: words[word[0]], form.text)
    return ast.unparse(ast.parse(spelt, mode="eval").body)


def best_match(form: Form, ground: LinearizedEvidence) -> Match:
    """A form at the place, width, exponent that make one-step errors likeliest."""
    from scipy.optimize import minimize  # slow to import

    x, names = ground.x, form.parameters
    span = x[-1] - x[0]
    waves, low, high = 2.0 * np.pi / span, x[0], x[-1]
    if form.even:
        low, high = 0.0, max(abs(low), abs(high))
    elif form.far:
        low, high = low - _FAR_PLACE_MARGIN * span, high + _FAR_PLACE_MARGIN * span
    grids = {
        "b": np.linspace(low, high, _PLACES + 2)[1:-1], "c": span * np.array(_WIDTHS),
        "p": np.array(_EXPONENTS), "k": waves * np.arange(2.0, _MOST_WAVES),
    }  # fmt: skip
    ends = {
        "b": (low, high), "c": (_LEAST_WIDTH * span, _LARGEST_WIDTH * span), "p": (0.2, 5.0),
        "k": (1.5 * waves, _MOST_WAVES * waves),
    }  # fmt: skip
    unit = {"b": span, "c": span, "p": 1.0, "k": 1.0 / span}

    def gained(values: Sequence[float]) -> tuple[float, float]:
        parameters = dict(zip(names, values, strict=True))
        shape = form.over(x, {"a": 1.0, **parameters, "r": ground.reference})
        return ground.gain(shape) if np.all(np.isfinite(shape)) else (0.0, 0.0)

    def of_units(values: np.ndarray) -> float:
        return -gained([v * unit[n] for n, v in zip(names, values, strict=True)])[0]

    best = max(product(*(grids[n] for n in names)), key=lambda values: gained(values)[0])
    if names:
        begin = [v / unit[n] for n, v in zip(names, best, strict=True)]
        bounds = [(ends[n][0] / unit[n], ends[n][1] / unit[n]) for n in names]
        ended = minimize(of_units, begin, method="Nelder-Mead", bounds=bounds,
                         options={"maxiter": 200})  # fmt: skip
        best = tuple(float(v) * unit[n] for n, v in zip(names, ended.x, strict=True))
    gain, amplitude = gained(best)
    values = {"a": amplitude, **dict(zip(names, best, strict=True))}
    return Match(form, values, gain, ground.reference)

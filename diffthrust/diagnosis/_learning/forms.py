"""Closed forms that a learned curve may have: a table, and how likely each is.

Each is a `Formula` of one signal with an amplitude ``a``, and as far as it has them a place ``b``,
a width ``c`` in the signal's unit, an exponent ``p``, and a wave number ``k``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np

from diffthrust.diagnosis._learning.ground import Ground
from diffthrust.effects._curve import Curve
from diffthrust.effects._formula import Formula
from diffthrust.effects._grammar import expression_of
from diffthrust.logs._units import product_unit
from diffthrust.models._base.made_effect import ARRIVING

_PLACES, _WIDTHS, _EXPONENTS = 17, (0.05, 0.1, 0.2, 0.4), (0.5, 1.5, 2.5, 3.5)
_LEAST_WIDTH = 0.01
_WAVES = 9
"""A ripple is looked for with fewer waves than this over the range of the signal."""


class Form(NamedTuple):
    """A closed form.

    Args:
        name: in words.
        text: the expression, of ``x``, ``a`` and further parameters; ``r`` is a typical size of x.
        per: by which power of the signal's unit that of the amplitude is divided.
        words: what it means, for people; ``{a}``, ``{b}``, ``{c}``, ``{p}`` are told with units.
    """

    name: str
    text: str
    per: int = 0
    words: str = ""

    @property
    def parameters(self) -> tuple[str, ...]:
        """Its parameters besides the amplitude."""
        return tuple(n for n in expression_of(self.text).places if n in ("b", "c", "p", "k"))

    def over(self, x: np.ndarray, values: Mapping[str, float]) -> np.ndarray:
        """The form over a signal, at values of its parameters and of ``r``; its shape is that."""
        law = expression_of(self.text)
        with np.errstate(all="ignore"):
            found = law({"x": x, **values}.__getitem__, np)
        return np.broadcast_to(np.asarray(found, float), x.shape)


FORMS = (
    Form("constant", "a", 0, "a constant"),
    Form("linear", "a * x", 1, "in proportion to {x}"),
    Form("even square", "a * x**2", 2, "with the square of {x}"),
    Form("square with sign", "a * x * abs(x)", 2, "with {x} times its size"),
    Form("cubic", "a * x**3", 3, "with the cube of {x}"),
    Form("power", "a * sign(x) * (abs(x) / r)**p", 0, "with {x} to the power of {p}"),
    Form("even power", "a * (abs(x) / r)**p", 0, "with the size of {x} to the power of {p}"),
    Form("dry", "a * tanh(x / (0.02 * r))", 0, "of constant size, with the sign of {x}"),
    Form("saturating", "a * tanh(x / c)", 0, "with {x}, and saturates beyond {c}"),
    Form("dead zone", "a * sign(x) * max(abs(x) - b, 0)", 1, "in proportion to {x} beyond {b}"),
    Form("ramp above", "a * max(x - b, 0)", 1, "in proportion to {x} above {b}"),
    Form("ramp below", "a * max(b - x, 0)", 1, "in proportion to {x} below {b}"),
    Form("square beyond", "a * max(abs(x) - b, 0)**2", 2, "by the square of {x} beyond {b}"),
    Form("square above", "a * max(x - b, 0)**2", 2, "by the square of {x} above {b}"),
    Form("exponential", "a * (exp(x / c) - 1)", 0, "exponentially with {x} over {c}"),
    Form("hump", "a * exp(-((x - b) / c)**2)", 0, "in a hump about {b}, {c} wide"),
    Form(
        "hump of both signs", "a * exp(-((abs(x) - b) / c)**2)", 0,
        "in a hump about {b} and its opposite, {c} wide",
    ),
    Form(
        "odd humps", "a * (exp(-((x - b) / c)**2) - exp(-((x + b) / c)**2))", 0,
        "in a hump about {b} and one of the other sign about its opposite, {c} wide",
    ),
    Form("ripple", "a * sin(k * (x - b))", 0, "in waves along {x}, {k} in angle"),
    Form("step", "a * (1 + tanh((x - b) / c)) / 2", 0, "in a step at {b}, {c} wide"),
)  # fmt: skip


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


def matches(grounds: Mapping[str, Ground]) -> list[Match]:
    """The forms by how likely each makes one-step errors, where it is best; the likeliest first.

    Args:
        grounds: what one-step errors say of the law's shapes, by what these are multiplied by.
    """
    return sorted(
        (
            _best(form, ground)._replace(times=times)
            for times, ground in grounds.items()
            for form in FORMS
        ),
        key=lambda one: -one.gain,
    )


def formula_of(match: Match, curve: Curve, unit: str, signal_unit: str) -> Formula:
    """A form as an effect at the place of a curve, beginning where it is likeliest."""
    form = match.form
    text = _spelt(form.text, curve.signal, match.reference)
    law = f"{match.times} * ({text})" if match.times else text
    if match.times == ARRIVING:
        law = f"value * (1 + {text})"
    elif ARRIVING in expression_of(law).places:  # else it would stand in the place of what arrives
        law = f"value + {law}"
    amplitude = product_unit((unit, 1), (signal_unit, -form.per))
    span = curve.high - curve.low
    told = {
        "a": {"unit": amplitude, "value": match.values["a"], "null": 0.0,
              "size": abs(match.values["a"]) or 1.0},
        "b": {"unit": signal_unit, "bounds": _short(curve.low - span, curve.high + span)},
        "c": {"unit": signal_unit, "bounds": _short(_LEAST_WIDTH * span, 10.0 * span)},
        "p": {"unit": "", "bounds": (0.1, 6.0)},
        "k": {"unit": product_unit(("rad", 1), (signal_unit, -1)),
              "bounds": _short(1.0 / span, 10.0 * _WAVES / span)},
    }  # fmt: skip
    own = {n: {**told[n], "value": match.values[n]} for n in ("a", *form.parameters)}
    kept = [n for n in curve.given if n in expression_of(law).places]
    own |= {n: {**curve.given[n], "value": getattr(curve, n)} for n in kept}
    return Formula(curve.port, law, name=f"{curve.name}_form", **own)


def as_estimated(formula: Formula) -> Formula:
    """The same formula, which begins where its parameters are now; in numbers that are read."""
    own = {}
    for name, told in formula.given.items():
        (value,) = _short(getattr(formula, name))
        own[name] = {**told, "value": value}
        if "size" in told:
            own[name]["size"] = abs(value) or told["size"]
    return Formula(formula.port, formula.expression, name=formula.name, **own)


def _short(*numbers: float) -> tuple[float, ...]:
    return tuple(float(f"{number:.5g}") for number in numbers)


def _spelt(text: str, signal: str, reference: float) -> str:
    """A form's expression of a signal, in place of ``x`` and ``r``."""
    import re

    words = {"x": signal if signal.isidentifier() else f"({signal})", "r": f"{reference:.4g}"}
    return re.sub(r"\b[xr]\b", lambda word: words[word[0]], text)


def _best(form: Form, ground: Ground) -> Match:
    """A form at the place, width, exponent that make one-step errors likeliest."""
    from scipy.optimize import minimize  # slow to import

    x, names = ground.x, form.parameters
    span = x[-1] - x[0]
    waves = 2.0 * np.pi / span
    grids = {
        "b": np.linspace(x[0], x[-1], _PLACES + 2)[1:-1], "c": span * np.array(_WIDTHS),
        "p": np.array(_EXPONENTS), "k": waves * np.arange(1.0, _WAVES),
    }  # fmt: skip
    ends = {
        "b": (x[0], x[-1]), "c": (_LEAST_WIDTH * span, 3.0 * span), "p": (0.2, 5.0),
        "k": (0.5 * waves, _WAVES * waves),
    }  # fmt: skip
    unit = {"b": span, "c": span, "p": 1.0, "k": 1.0 / span}

    def gained(values: Sequence[float]) -> tuple[float, float]:
        known = dict(zip(names, values, strict=True))
        shape = form.over(x, {"a": 1.0, **known, "r": ground.reference})
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

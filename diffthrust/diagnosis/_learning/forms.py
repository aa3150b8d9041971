"""Closed forms that a learned curve may have: a table, and how well each agrees with a curve.

Each is a `Formula` of one signal with an amplitude ``a``, and as far as it has them a place ``b``
and a width ``c`` in the signal's unit, and an exponent ``p``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from diffthrust.effects._curve import Curve
from diffthrust.effects._formula import Formula
from diffthrust.effects._grammar import expression_of
from diffthrust.models._base.made_effect import ARRIVING

_PLACES, _WIDTHS, _EXPONENTS = 17, (0.05, 0.1, 0.2, 0.4), (0.5, 1.5, 2.5, 3.5)
_LEAST_WIDTH = 0.01
_POINTS = 241
_BINS = 60
_FOLLOWS = 0.01
"""A factor follows from the signal where this share of its variance is left over the signal."""
_COMPLEX = 0.05
"""By so much more a form must agree for each further parameter."""
_FLOOR = 0.02
"""Where logs hold next to nothing, a curve still counts as much as so many times their mean."""


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
        return tuple(n for n in expression_of(self.text).places if n in ("b", "c", "p"))


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
    Form("step", "a * (1 + tanh((x - b) / c)) / 2", 0, "in a step at {b}, {c} wide"),
)  # fmt: skip


class Match(NamedTuple):
    """A form laid on a curve.

    Args:
        form: the form.
        values: its parameters, ``a`` among them.
        lost: share of the curve's square that it leaves.
        times: what the form is multiplied by; "" where it stands for the curve times that.
        reference: the typical size of the signal, ``r``.
    """

    form: Form
    values: Mapping[str, float]
    lost: float
    reference: float
    times: str = ""


def matches(
    curve: Curve, samples: Float[np.ndarray, " N"], factors: Float[np.ndarray, " N"] | None = None
) -> list[Match]:
    """The forms by how well they agree with a curve, the best first.

    Where the factor of a curve follows from its signal, so does their product: a form may be that
    of the product.

    Where logs have more samples a curve counts for more. What the model's own parameters do in the
    place of coefficients that were held, they may do beside a form as well.
    """
    x = np.linspace(curve.low, curve.high, _POINTS)
    edges = np.linspace(curve.low, curve.high, 25)
    counts = np.histogram(samples, edges)[0].astype(float)
    weights = np.interp(x, 0.5 * (edges[1:] + edges[:-1]), counts + _FLOOR * counts.mean())
    root = np.sqrt(weights / weights.sum())
    held = [i for i, name in enumerate(curve.coefficients) if name in curve.held]
    reference = float(np.sqrt(np.mean(np.asarray(samples) ** 2)))
    factor = None if factors is None else _following(x, samples, factors)
    found: list[Match] = []
    for times, scale in ((curve.times, None), ("", factor)):
        if times != curve.times and scale is None:
            continue
        each = np.ones_like(x) if scale is None else scale
        beside, wanted = each * curve.basis(x)[held], each * np.asarray(curve.at_signal(x))
        total = max(_left(root * wanted, root * beside)[0], 1e-300)
        laid = (_laid(form, x, wanted, beside, root, reference) for form in FORMS)
        found += [
            one._replace(lost=one.lost / total, times=times) for one in laid if one is not None
        ]
    return sorted(found, key=lambda one: one.lost * (1.0 + _COMPLEX * len(one.form.parameters)))


def _following(
    x: np.ndarray, samples: np.ndarray, factors: np.ndarray
) -> Float[np.ndarray, " K"] | None:
    """What a factor is as a function of the signal; ``None`` where it is none."""
    order = np.argsort(samples)
    over, along = samples[order], factors[order]
    width = max(1, over.size // _BINS)
    starts = np.arange(0, over.size, width)
    sizes = np.diff(np.append(starts, over.size))
    centres, means = (np.add.reduceat(series, starts) / sizes for series in (over, along))
    rest = along - np.interp(over, centres, means)
    return np.interp(x, centres, means) if np.var(rest) < _FOLLOWS * np.var(along) else None


def formula_of(match: Match, curve: Curve, unit: str, signal_unit: str, name: str) -> Formula:
    """A form as an effect at the place of a curve, beginning where the two agree best."""
    form = match.form
    text = _spelt(form.text, curve.signal, match.reference)
    law = f"{match.times} * ({text})" if match.times else text
    if match.times == ARRIVING:
        law = f"value * (1 + {text})"
    per = f"({signal_unit})^{form.per}" if form.per > 1 else f"({signal_unit})"
    amplitude = f"({unit or '1'})/{per}" if form.per and signal_unit else unit
    span = curve.high - curve.low
    told = {
        "a": {"unit": amplitude, "value": match.values["a"], "null": 0.0,
              "size": abs(match.values["a"]) or 1.0},
        "b": {"unit": signal_unit, "bounds": _short(curve.low - span, curve.high + span)},
        "c": {"unit": signal_unit, "bounds": _short(_LEAST_WIDTH * span, 10.0 * span)},
        "p": {"unit": "", "bounds": (0.1, 6.0)},
    }  # fmt: skip
    own = {n: {**told[n], "value": match.values[n]} for n in ("a", *form.parameters)}
    return Formula(curve.port, law, name=name, **own)


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


def _laid(
    form: Form,
    x: np.ndarray,
    wanted: np.ndarray,
    beside: np.ndarray,
    root: np.ndarray,
    reference: float,
) -> Match | None:
    from scipy.optimize import minimize  # slow to import

    span, names = x[-1] - x[0], form.parameters
    grids = {"b": np.linspace(x[0], x[-1], _PLACES + 2)[1:-1], "c": span * np.array(_WIDTHS),
             "p": np.array(_EXPONENTS)}  # fmt: skip
    ends = {"b": (x[0], x[-1]), "c": (_LEAST_WIDTH * span, 3.0 * span), "p": (0.2, 5.0)}
    unit = {"b": span, "c": span, "p": 1.0}

    def lost(values: Sequence[float]) -> tuple[float, float]:
        known = dict(zip(names, values, strict=True))
        shape = _shape(form, x, {**known, "r": reference})
        if not np.all(np.isfinite(shape)) or not np.any(root * shape):
            return np.inf, 0.0
        left, weights = _left(root * wanted, root * np.stack([shape, *beside]))
        return left, float(weights[0])

    def of_units(values: np.ndarray) -> float:
        return lost([v * unit[n] for n, v in zip(names, values, strict=True)])[0]

    best = min(product(*(grids[n] for n in names)), key=lambda values: lost(values)[0])
    if names:
        begin = [v / unit[n] for n, v in zip(names, best, strict=True)]
        bounds = [(ends[n][0] / unit[n], ends[n][1] / unit[n]) for n in names]
        ended = minimize(of_units, begin, method="Nelder-Mead", bounds=bounds,
                         options={"maxiter": 200})  # fmt: skip
        best = tuple(float(v) * unit[n] for n, v in zip(names, ended.x, strict=True))
    left, amplitude = lost(best)
    if not np.isfinite(left):
        return None
    return Match(form, {"a": amplitude, **dict(zip(names, best, strict=True))}, left, reference)


def _shape(form: Form, x: np.ndarray, values: Mapping[str, float]) -> np.ndarray:
    """A form of unit amplitude over a signal."""
    named = {"x": x, "a": 1.0, **values}
    with np.errstate(all="ignore"):
        return np.broadcast_to(
            np.asarray(expression_of(form.text)(named.__getitem__, np), float), x.shape
        )


def _left(wanted: np.ndarray, rows: np.ndarray) -> tuple[float, np.ndarray]:
    """What a combination of rows leaves of a series, squared, and its weights."""
    if not len(rows):
        return float(wanted @ wanted), np.empty(0)
    weights = np.linalg.lstsq(rows.T, wanted, rcond=1e-10)[0]
    rest = wanted - rows.T @ weights
    return float(rest @ rest), weights

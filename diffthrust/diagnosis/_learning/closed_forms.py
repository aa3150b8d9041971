"""Closed forms that a law may have.

Each is an expression of one signal ``x`` with an amplitude ``a``, and as far as it has them a place
``b`` and a width ``c`` in the signal's unit, an exponent ``p``, and a wave number ``k``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from diffthrust.effects._grammar import expression_of


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

"""A parsed expression: its syntax tree, and its value."""

from __future__ import annotations

import ast
import math
import operator
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import reduce
from itertools import pairwise
from typing import Any, NamedTuple

from diffthrust._support.errors import InputError
from diffthrust.effects._finite import exponential, logarithm, quotient, raised, square_root

STRANGE = re.compile(r"[^A-Za-z0-9_ .+\-*/(),<>=!]")
"""Characters that no expression contains."""
COMPARED: Mapping[type, Callable[[Any, Any], Any]] = {
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}
_ARITHMETIC = {ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul}
SHORT = {"min": "minimum", "max": "maximum"}
"""Short names of functions of NumPy."""
FINITE: Mapping[str, Callable[..., Any]] = {
    "sqrt": square_root,
    "exp": exponential,
    "log": logarithm,
}
"""Functions that differ from those of NumPy of the same name: finite where these are not."""
_WHOLE = 12
"""Integer exponents up to this keep the sign of their base."""


class Memory(NamedTuple):
    """A function with a memory of an expression: its value follows from a state.

    Args:
        state: the name of the state.
        kind: "lag", "play" or "integral".
        of: the expression that it follows.
        size: the time constant [s], or half the width of the play; ``None`` for an integral.
        start: the initial value of a lag; settled if ``None``.
    """

    state: str
    kind: str
    of: ast.expr
    size: ast.expr | None
    start: ast.expr | None = None


@dataclass(frozen=True)
class Expression:
    """A parsed expression.

    Args:
        text: as it was written.
        tree: its syntax tree, of allowed nodes only, with states in the place of memories.
        places: where each name stands first, functions, constants and states left out.
        exponents: names that stand in an exponent.
        sizes: names that are the time constant or the width of a memory.
        memories: the functions with a memory, in the order of the text.
    """

    text: str
    tree: ast.expr = field(repr=False, compare=False)
    places: Mapping[str, int] = field(repr=False, compare=False)
    exponents: frozenset[str]
    sizes: frozenset[str] = frozenset()
    memories: tuple[Memory, ...] = field(default=(), compare=False)

    def __call__(self, names: Callable[[str], Any], xp: Any) -> Any:
        """Its value.

        Args:
            names: the number, or the series, of each name and each state.
            xp: whose functions are used, `numpy` or `jax.numpy`.
        """
        return valued(self.tree, names, xp)


def with_mark(text: str, at: int, problem: str, mend: str) -> InputError:
    """An error of an expression with a mark below a place."""
    shown = STRANGE.sub(lambda match: match[0] if match[0].isprintable() else "?", text)
    begin = max(0, at - 50)
    return InputError(
        f"The expression, character {at + 1}: {problem}.\n"
        f"    {shown[begin : begin + 100]}\n    {' ' * (at - begin)}^",
        mend,
    )


def valued(node: ast.AST, names: Callable[[str], Any], xp: Any) -> Any:
    """The value of a node of an expression."""
    if isinstance(node, ast.Constant):
        return float(node.value)  # pyright: ignore[reportArgumentType]
    if isinstance(node, ast.Name):
        return math.pi if node.id == "pi" else names(node.id)
    if isinstance(node, ast.UnaryOp):
        inner = valued(node.operand, names, xp)
        return -inner if isinstance(node.op, ast.USub) else inner
    if isinstance(node, ast.BinOp):
        return _combined(node, names, xp)
    if isinstance(node, ast.Compare):
        parts = [valued(operand, names, xp) for operand in (node.left, *node.comparators)]
        held = [
            COMPARED[type(op)](*pair) for op, pair in zip(node.ops, pairwise(parts), strict=True)
        ]
        return xp.where(reduce(xp.logical_and, held), 1.0, 0.0)
    assert isinstance(node, ast.Call)
    assert isinstance(node.func, ast.Name)
    name = SHORT.get(node.func.id, node.func.id)
    arguments = [valued(operand, names, xp) for operand in node.args]
    if name == "where":
        return xp.where(xp.asarray(arguments[0]) != 0, *arguments[1:])
    return FINITE[name](*arguments, xp) if name in FINITE else getattr(xp, name)(*arguments)


def _combined(node: ast.BinOp, names: Callable[[str], Any], xp: Any) -> Any:
    first, second = valued(node.left, names, xp), valued(node.right, names, xp)
    if type(node.op) in _ARITHMETIC:
        return _ARITHMETIC[type(node.op)](first, second)
    if isinstance(node.op, ast.Div):
        return quotient(first, second, xp)
    if not keeps_sign(node.right):
        return raised(first, second, xp)
    # x**2 by multiplication keeps the sign and the slope at zero; x**2.0 takes a logarithm there
    return xp.asarray(first, float) ** int(second)


def keeps_sign(exponent: ast.AST) -> bool:
    """Whether an exponent is a small integer, which keeps the sign of its base."""
    value = exponent.value if isinstance(exponent, ast.Constant) else None
    return isinstance(value, int | float) and value == int(value) and 0 <= value <= _WHOLE

"""Expressions of one line: parsed against a list of what is allowed, evaluated without `eval`."""

from __future__ import annotations

import ast
import math
import warnings
from collections.abc import Mapping
from contextlib import suppress
from functools import lru_cache

from diffthrust._support.errors import InputError
from diffthrust._support.names import nearest
from diffthrust.effects._expression import (
    COMPARED,
    REMEMBERS,
    STRANGE,
    Expression,
    memory_rates,
    memory_starts,
    separated,
    with_mark,
)
from diffthrust.models._base.made_effect import MadeEffect
from diffthrust.models._base.signals import Rate, Signal, Signals

_LONGEST = 500
_DEEPEST = 40

_BINARY = (ast.Add, ast.Sub, ast.Mult, ast.Div, ast.Pow)
_ARGUMENTS: Mapping[str, int] = {
    **dict.fromkeys(("abs", "sign", "sqrt", "exp", "log", "tanh", "sin", "cos"), 1),
    **dict.fromkeys(("minimum", "maximum", "min", "max"), 2),
    "where": 3,
    **REMEMBERS,
}
ALLOWED = f"numbers, names, + - * / **, comparisons, pi, and {', '.join(_ARGUMENTS)}"


@lru_cache(maxsize=256)
def expression_of(text: str) -> Expression:
    """Read an expression.

    Raises:
        InputError: it is too long or too deep, or holds something that is not allowed; the message
            marks the place.

    Example:
        >>> sorted(expression_of("-a * speed * abs(speed)**p").places)
        ['a', 'p', 'speed']
    """
    if len(text) > _LONGEST:
        raise InputError(
            f"The expression {text[:40]!r}... has {len(text)} characters, allowed are {_LONGEST}.",
            "Write a class of an effect for what does not fit into one line.",
        )
    # characters first: quotes and brackets never reach the parser
    if strange := STRANGE.search(text):
        raise with_mark(
            text, strange.start(), f"the character {strange[0]!r} is not allowed", _mend()
        )
    if not text.strip():
        raise InputError("Expected an expression, found none.", "Write one: -a * speed.")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # for "1if", and a number that is called
            tree = _OfParts().visit(ast.parse(text.strip(), mode="eval").body)
    # deeply nested brackets exhaust Python's own parser: an expression from a spec file must not
    # end the process
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        at = (getattr(error, "offset", None) or 1) - 1 + len(text) - len(text.lstrip())
        raise with_mark(
            text, min(at, len(text)), "this cannot be read", _mend("Correct what stands there")
        ) from None
    shift = len(text) - len(text.lstrip())
    places: dict[str, int] = {}
    exponents: set[str] = set()
    _check(tree, text, shift, places, exponents, _DEEPEST, raised=False)
    reduced, memories = separated(tree)
    for taken in (memory.state for memory in memories if memory.state in places):
        raise with_mark(
            text, places[taken], f"'{taken}' is the state of what remembers here",
            "Give it another name.",
        )  # fmt: skip
    sizes = frozenset(memory.size.id for memory in memories if isinstance(memory.size, ast.Name))
    return Expression(text, reduced, places, frozenset(exponents), sizes, memories)


class _OfParts(ast.NodeTransformer):
    """Turns the name of a craft's part, a dot and a signal into one name: "port.command"."""

    def visit_Attribute(self, node: ast.Attribute) -> ast.expr:
        if not isinstance(node.value, ast.Name) or node.attr.startswith("_"):
            return node  # which is not allowed
        return ast.copy_location(ast.Name(f"{node.value.id}.{node.attr}"), node)


class ExpressionEffect(MadeEffect):
    """An effect whose argument ``main`` is an expression, which may remember."""

    @property
    def _law(self) -> Expression:
        return expression_of(getattr(self, self.main))

    def rates(self, value: Signal, s: Signals) -> Mapping[str, Rate]:
        return memory_rates(self._law, self._named(value, s))

    def initial(self, value: Signal, s: Signals) -> Mapping[str, Signal | float]:
        return memory_starts(self._law, self._named(value, s))


def _check(
    node: ast.AST,
    text: str,
    shift: int,
    places: dict[str, int],
    exponents: set[str],
    room: int,
    raised: bool,
) -> None:
    """Raise `InputError` for a node that is not allowed; collect the names on the way."""
    at = getattr(node, "col_offset", 0) + shift
    if room == 0:
        raise with_mark(text, at, f"this is nested more than {_DEEPEST} deep", "Write it simpler.")
    inner: list[tuple[ast.AST, bool]] = []
    if isinstance(node, ast.Constant):
        _check_number(node.value, text, at)
    elif isinstance(node, ast.Name):
        if node.id in _ARGUMENTS:
            raise with_mark(text, at, f"'{node.id}' is a function", _written(node.id))
        if node.id != "pi":
            places.setdefault(node.id, at)
            exponents.update([node.id] * raised)
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.UAdd):
        inner = [(node.operand, raised)]
    elif isinstance(node, ast.BinOp) and isinstance(node.op, _BINARY):
        inner = [(node.left, raised), (node.right, raised or isinstance(node.op, ast.Pow))]
    elif isinstance(node, ast.Compare) and all(type(op) in COMPARED for op in node.ops):
        inner = [(child, raised) for child in (node.left, *node.comparators)]
    elif isinstance(node, ast.Call):
        _check_call(node, text, at)
        inner = [(child, raised) for child in node.args]
    else:
        raise with_mark(text, at, "this is not allowed", _mend())
    for child, above in inner:
        _check(child, text, shift, places, exponents, room - 1, above)


def _check_number(value: object, text: str, at: int) -> None:
    with suppress(OverflowError):  # an integer of 400 digits is valid Python and no float
        if isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value):
            return
    raise with_mark(text, at, "expected a finite number", "Correct the number.")


def _check_call(node: ast.Call, text: str, at: int) -> None:
    name = node.func.id if isinstance(node.func, ast.Name) else ""
    if name not in _ARGUMENTS:
        near = nearest(name, _ARGUMENTS, "; ")
        what = f"the function {name!r} is not known{near}" if name else "this cannot be called"
        raise with_mark(text, at, what, _mend())
    count = _ARGUMENTS[name]
    actual = len(node.args) + len(node.keywords)
    if node.keywords or actual not in (count, count + (name == "lag")):
        problem = f"expected {count} in the brackets of '{name}', found {actual}"
        raise with_mark(text, at, problem, _written(name))
    if name in REMEMBERS and count > 1 and isinstance(node.args[1], ast.UnaryOp):
        raise with_mark(
            text, at, f"the time or width of '{name}' has a sign", "Write it without one."
        )


def _written(function: str) -> str:
    return f"Write {function}({', '.join('xyz'[: _ARGUMENTS[function]])})."


def _mend(first: str = "Write it otherwise") -> str:
    return f"{first}; allowed are {ALLOWED}."

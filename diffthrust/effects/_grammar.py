"""Expressions of one line: read by a list of what is allowed, and worked out without `eval`."""

from __future__ import annotations

import ast
import math
import re
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache, reduce
from itertools import pairwise
from typing import Any

from diffthrust._support.errors import InputError
from diffthrust._support.names import nearest
from diffthrust.effects._finite import exponential, logarithm, quotient, raised, square_root

_LONGEST = 500
_DEEPEST = 40
_STRANGE = re.compile(r"[^A-Za-z0-9_ .+\-*/(),<>=!]")

_WHOLE = 12
"""Whole exponents up to this keep the sign of what they raise."""
_BINARY: Mapping[type, str] = {
    ast.Add: "+",
    ast.Sub: "-",
    ast.Mult: "*",
    ast.Div: "/",
    ast.Pow: "**",
}
_COMPARED: Mapping[type, Callable[[Any, Any], Any]] = {
    ast.Lt: lambda a, b: a < b,
    ast.LtE: lambda a, b: a <= b,
    ast.Gt: lambda a, b: a > b,
    ast.GtE: lambda a, b: a >= b,
    ast.Eq: lambda a, b: a == b,
    ast.NotEq: lambda a, b: a != b,
}
SHORT = {"min": "minimum", "max": "maximum"}
"""Short names of functions of NumPy."""
_ARGUMENTS: Mapping[str, int] = {
    **dict.fromkeys(("abs", "sign", "sqrt", "exp", "log", "tanh", "sin", "cos"), 1),
    **dict.fromkeys(("minimum", "maximum", "min", "max"), 2),
    "where": 3,
}
FINITE: Mapping[str, Callable[..., Any]] = {
    "sqrt": square_root,
    "exp": exponential,
    "log": logarithm,
}
"""Functions that are not those of NumPy of the same name."""
ALLOWED = f"numbers, names, + - * / **, comparisons, pi, and {', '.join(_ARGUMENTS)}"


@dataclass(frozen=True)
class Expression:
    """An expression that has been read.

    Args:
        text: as it was written.
        tree: what it is made of, allowed parts only.
        places: where each name stands first, functions and constants left out.
        exponents: names that stand in an exponent.
    """

    text: str
    tree: ast.expr = field(repr=False, compare=False)
    places: Mapping[str, int] = field(repr=False, compare=False)
    exponents: frozenset[str]

    def __call__(self, names: Callable[[str], Any], xp: Any) -> Any:
        """Its value.

        Args:
            names: the number, or the series, that each name stands for.
            xp: whose functions are used, `numpy` or `jax.numpy`.
        """
        return _value(self.tree, names, xp)

    def refused(self, at: int, problem: str, mend: str) -> InputError:
        """An error with a mark below the place that is to blame."""
        return _refused(self.text, at, problem, mend)


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
    if strange := _STRANGE.search(text):
        raise _refused(
            text, strange.start(), f"the character {strange[0]!r} is not allowed", _mend()
        )
    if not text.strip():
        raise InputError("Expected an expression, found none.", "Write one: -a * speed.")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of "1if", of a number that is called
            tree = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        at = (getattr(error, "offset", None) or 1) - 1 + len(text) - len(text.lstrip())
        raise _refused(
            text, min(at, len(text)), "this cannot be read", _mend("Correct what stands there")
        ) from None
    shift = len(text) - len(text.lstrip())
    places: dict[str, int] = {}
    exponents: set[str] = set()
    _check(tree, text, shift, places, exponents, _DEEPEST, raised=False)
    return Expression(text, tree, places, frozenset(exponents))


def _check(
    node: ast.AST,
    text: str,
    shift: int,
    places: dict[str, int],
    exponents: set[str],
    room: int,
    raised: bool,
) -> None:
    """Raise `InputError` for a part that is not allowed; note the names on the way."""
    at = getattr(node, "col_offset", 0) + shift
    if room == 0:
        raise _refused(text, at, f"this is nested more than {_DEEPEST} deep", "Write it simpler.")
    inner: list[tuple[ast.AST, bool]] = []
    if isinstance(node, ast.Constant):
        _check_number(node.value, text, at)
    elif isinstance(node, ast.Name):
        if node.id in _ARGUMENTS:
            count = _ARGUMENTS[node.id]
            raise _refused(
                text, at, f"'{node.id}' is a function",
                f"Write {node.id}({', '.join('xyz'[:count])}).",
            )  # fmt: skip
        if node.id != "pi":
            places.setdefault(node.id, at)
            exponents.update([node.id] * raised)
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.UAdd):
        inner = [(node.operand, raised)]
    elif isinstance(node, ast.BinOp) and type(node.op) in _BINARY:
        inner = [(node.left, raised), (node.right, raised or isinstance(node.op, ast.Pow))]
    elif isinstance(node, ast.Compare) and all(type(op) in _COMPARED for op in node.ops):
        inner = [(part, raised) for part in (node.left, *node.comparators)]
    elif isinstance(node, ast.Call):
        _check_call(node, text, at)
        inner = [(part, raised) for part in node.args]
    else:
        raise _refused(text, at, "this is not allowed", _mend())
    for part, above in inner:
        _check(part, text, shift, places, exponents, room - 1, above)


def _check_number(value: object, text: str, at: int) -> None:
    try:
        number = isinstance(value, int | float) and not isinstance(value, bool)
        finite = number and math.isfinite(value)  # pyright: ignore[reportArgumentType]
    except OverflowError:
        finite = False
    if not finite:
        raise _refused(text, at, "expected a finite number", "Correct the number.")


def _check_call(node: ast.Call, text: str, at: int) -> None:
    name = node.func.id if isinstance(node.func, ast.Name) else ""
    if name not in _ARGUMENTS:
        near = nearest(name, _ARGUMENTS) if name else ""
        what = f"the function {name!r} is not known" if name else "this cannot be called"
        raise _refused(text, at, f"{what}{'; ' + near if near else ''}", _mend())
    count = _ARGUMENTS[name]
    if node.keywords or len(node.args) != count:
        found = len(node.args) + len(node.keywords)
        raise _refused(
            text, at, f"expected {count} in the brackets of '{name}', found {found}",
            f"Write {name}({', '.join('xyz'[:count])}).",
        )  # fmt: skip


def _refused(text: str, at: int, problem: str, mend: str) -> InputError:
    shown = _STRANGE.sub(lambda found: found[0] if found[0].isprintable() else "?", text)
    begin = max(0, at - 50)
    return InputError(
        f"The expression, character {at + 1}: {problem}.\n"
        f"    {shown[begin : begin + 100]}\n    {' ' * (at - begin)}^",
        mend,
    )


def _mend(first: str = "Write it otherwise") -> str:
    return f"{first}; allowed are {ALLOWED}."


def _value(node: ast.AST, names: Callable[[str], Any], xp: Any) -> Any:
    if isinstance(node, ast.Constant):
        return float(node.value)  # pyright: ignore[reportArgumentType]
    if isinstance(node, ast.Name):
        return math.pi if node.id == "pi" else names(node.id)
    if isinstance(node, ast.UnaryOp):
        inner = _value(node.operand, names, xp)
        return -inner if isinstance(node.op, ast.USub) else inner
    if isinstance(node, ast.BinOp):
        return _combined(node, names, xp)
    if isinstance(node, ast.Compare):
        parts = [_value(part, names, xp) for part in (node.left, *node.comparators)]
        held = [
            _COMPARED[type(op)](*pair) for op, pair in zip(node.ops, pairwise(parts), strict=True)
        ]
        return xp.where(reduce(xp.logical_and, held), 1.0, 0.0)
    assert isinstance(node, ast.Call)
    assert isinstance(node.func, ast.Name)
    name = SHORT.get(node.func.id, node.func.id)
    given = [_value(part, names, xp) for part in node.args]
    if name == "where":
        return xp.where(xp.asarray(given[0]) != 0, *given[1:])
    return FINITE[name](*given, xp) if name in FINITE else getattr(xp, name)(*given)


def _combined(node: ast.BinOp, names: Callable[[str], Any], xp: Any) -> Any:
    left, right = _value(node.left, names, xp), _value(node.right, names, xp)
    if isinstance(node.op, ast.Add):
        return left + right
    if isinstance(node.op, ast.Sub):
        return left - right
    if isinstance(node.op, ast.Mult):
        return left * right
    if isinstance(node.op, ast.Div):
        return quotient(left, right, xp)
    return (
        xp.asarray(left, float) ** int(right) if keeps_sign(node.right) else raised(left, right, xp)
    )


def keeps_sign(exponent: ast.AST) -> bool:
    """Whether an exponent is a whole number that keeps the sign of what it raises."""
    value = exponent.value if isinstance(exponent, ast.Constant) else None
    return isinstance(value, int | float) and value == int(value) and 0 <= value <= _WHOLE

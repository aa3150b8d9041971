"""Parsed expressions: syntax tree, value, and what of them remembers.

``lag(x, T)`` follows x with the time constant T [s] and begins settled; ``lag(x, T, 0)`` begins at
zero: so warms up what is cold when the log begins. ``play(x, b)`` stays where it is until x has
moved b away from it, and is then pushed along: the play, or backlash, of half the width b, of which
``x - play(x, b)`` is how far x has gone since it turned (the stop; Visintin 1994, chapter III). It
begins as it is when x has come from zero. ``integral(x)`` is the time integral since the log began.
"""

from __future__ import annotations

import ast
import math
import operator
import re
from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import dataclass, field
from functools import reduce
from itertools import pairwise
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from diffthrust._support.errors import InputError
from diffthrust._support.lag import lagged
from diffthrust.effects._finite import exponential, logarithm, quotient, raised, square_root
from diffthrust.models._base.signals import Rate, Relaxing, Signal

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


REMEMBERS: Mapping[str, int] = {"lag": 2, "play": 2, "integral": 1}
"""Functions that remember, and how many arguments they have; a lag may have one more."""
_QUICK = 1e4
"""The rate [1/s] at which what has been taken up of a play is followed."""


def separated(tree: ast.expr) -> tuple[ast.expr, tuple[Memory, ...]]:
    """An expression with states in place of what remembers, and what that is."""
    separation = _Apart()
    present = separation.visit(deepcopy(tree))
    return present, tuple(separation.memories)


class _Apart(ast.NodeTransformer):
    def __init__(self) -> None:
        self.memories: list[Memory] = []

    def visit_Call(self, node: ast.Call) -> ast.AST:
        assert isinstance(node.func, ast.Name)
        kind = node.func.id
        if kind not in REMEMBERS:
            return self.generic_visit(node)
        parts = [self.visit(argument) for argument in node.args]
        if len(parts) > 1 and not isinstance(parts[1], ast.Name | ast.Constant):
            # a computed width or time constant may be driven below zero by a fit; a parameter has
            # bounds for that
            parts[1] = ast.Call(ast.Name("maximum"), [parts[1], ast.Constant(0.0)], [])
        same_kind = [memory for memory in self.memories if memory.kind == kind]
        for memory in same_kind:
            # the same memory written twice is one state
            if list(map(_text, memory[2:])) == list(map(_text, [*parts, None, None][:3])):
                return _now(memory)
        memory = Memory(
            f"{kind}{len(same_kind) + 1}" if same_kind else kind, kind, *[*parts, None, None][:3]
        )
        self.memories.append(memory)
        return _now(memory)


def _text(node: ast.expr | None) -> str:
    return "" if node is None else ast.unparse(node)


def _now(memory: Memory) -> ast.expr:
    """What a memory gives, of its state: a play, which is pushed, is never further off than that.

    Without this, what leaves would be a sample behind.
    """
    state = ast.Name(memory.state)
    return _pushed(memory, state) if memory.kind == "play" else state


def _pushed(memory: Memory, state: ast.expr) -> ast.expr:
    """Where a play is now: in a form whose slope by the width is right also where that is zero."""
    of, width = memory.of, memory.size
    assert width is not None
    apart = ast.BinOp(of, ast.Sub(), state)
    behind = ast.Compare(apart, [ast.Gt()], [width])
    ahead = ast.Compare(apart, [ast.Lt()], [ast.UnaryOp(ast.USub(), width)])
    pulled = ast.Call(ast.Name("where"), [ahead, ast.BinOp(of, ast.Add(), width), state], [])
    return ast.Call(ast.Name("where"), [behind, ast.BinOp(of, ast.Sub(), width), pulled], [])


def rate_parts(memory: Memory) -> tuple[ast.expr, ast.expr | None]:
    """Where a memory's state goes, as expressions: the target and the rate of decay to it.

    Of an integral, its rate and ``None``.
    """
    if memory.kind == "integral":
        return memory.of, None
    if memory.kind == "play":
        return _pushed(memory, ast.Name(memory.state)), ast.Constant(_QUICK)
    assert memory.size is not None
    return memory.of, ast.BinOp(ast.Constant(1.0), ast.Div(), memory.size)


def memory_rates(law: Expression, names: Callable[[str], Any]) -> dict[str, Rate]:
    """The rates of the states of an expression."""
    out: dict[str, Rate] = {}
    for memory in law.memories:
        target, decay = rate_parts(memory)
        goal, state = valued(target, names, jnp), names(memory.state)
        if decay is None:
            # integral(1) is a plain number: the rate must have the shape of the state
            out[memory.state] = goal + 0.0 * state
        else:
            pull = valued(decay, names, jnp)
            out[memory.state] = Relaxing(pull * (goal - state), pull)
    return out


def memory_starts(law: Expression, names: Callable[[str], Any]) -> dict[str, Signal | float]:
    """The states at the start of a log."""
    out: dict[str, Signal | float] = {}
    for memory in law.memories:
        out[memory.state] = valued(begun_at(memory), _with(out, names), jnp)
    return out


def begun_at(memory: Memory) -> ast.expr:
    """Where a memory begins."""
    if memory.kind == "lag":
        return memory.of if memory.start is None else memory.start
    return _pushed(memory, ast.Constant(0.0)) if memory.kind == "play" else ast.Constant(0.0)


def values_along(
    law: Expression,
    names: Callable[[str], Any],
    ends: Callable[[str], Any],
    time: Float[np.ndarray, " T"],
) -> tuple[Float[np.ndarray, " T"], Float[np.ndarray, " T"]]:
    """The values of an expression along a log, whatever of it remembers.

    At the samples, and as the next ones come.

    Args:
        law: the expression.
        names: the series, or the number, that each name stands for.
        ends: the same as the next sample comes.
        time: of the samples [s].
    """
    states: dict[str, Any] = {}
    later: dict[str, Any] = {}
    signals = _with(states, names)
    for memory in law.memories:
        series = np.broadcast_to(np.asarray(valued(memory.of, signals, np), float), time.shape)
        size = None if memory.size is None else float(valued(memory.size, signals, np))
        first = float(np.broadcast_to(valued(begun_at(memory), signals, np), time.shape)[0])
        series_of_state = states[memory.state] = _ALONG[memory.kind](series, size, time, first)
        pushed = memory.kind == "play"  # where it is asked
        later[memory.state] = (
            series_of_state if pushed else np.append(series_of_state[1:], series_of_state[-1:])
        )
    now, end = (np.asarray(law(point, np), float) for point in (signals, _with(later, ends)))
    return np.broadcast_to(now, time.shape), np.broadcast_to(end, time.shape)


def _with(states: Mapping[str, Any], names: Callable[[str], Any]) -> Callable[[str], Any]:
    return lambda name: states[name] if name in states else names(name)


def _lagging(series: np.ndarray, size: float, time: np.ndarray, first: float) -> np.ndarray:
    kept = np.exp(-np.diff(time) / max(size, 1e-12))
    return lagged(np.array([first]), series[:-1, None], kept)[:, 0]


def _played(series: np.ndarray, size: float, time: np.ndarray, first: float) -> np.ndarray:
    out, at = [], first
    for value in series.tolist():
        at = min(max(at, value - size), value + size)
        out.append(at)
    return np.array(out)


def _integrated(series: np.ndarray, size: None, time: np.ndarray, first: float) -> np.ndarray:
    steps = 0.5 * (series[1:] + series[:-1]) * np.diff(time)
    return np.concatenate([[first], first + np.cumsum(steps)])


_ALONG: Mapping[str, Callable[..., np.ndarray]] = {
    "lag": _lagging,
    "play": _played,
    "integral": _integrated,
}

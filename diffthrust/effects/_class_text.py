"""The text of a class of an effect from a formula, and of its tests."""

from __future__ import annotations

import ast
import textwrap
from collections.abc import Mapping
from copy import deepcopy
from typing import Any

from diffthrust._support.literals import as_python
from diffthrust.effects._expression import FINITE, SHORT, begun_at, keeps_sign, rate_parts
from diffthrust.effects._formula import ARRIVING, Formula
from diffthrust.effects._grammar import expression_of
from diffthrust.models._base.made_effect import plain_description
from diffthrust.models._base.parameter import Parameter

_WIDTH = 80  # what a terminal shows unbroken

_CLASS = '''"""{title}"""

import jax.numpy as jnp

import diffthrust as dft


class {cls}(dft.Effect):
    """{doc}

{about}
    """

    name = "{name}"
    port = "{port}"
{needs}{states}{parameters}

    def __call__(self, value, s):
        """What leaves the port where `value` arrives, with the signals `s`."""
{hint}{law}
{memory}'''

_MEMORY = '''
    def rates(self, value, s):
        """The rate of each state: `Relaxing` to a goal, at a rate [1/s]."""
{lines}
        return {{
{rates}
        }}

    def initial(self, value, s):
        """The states at the start of a log."""
        return {{
{starts}
        }}
'''


_TEST = '''"""Tests of {name}.py."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from {name} import {cls}

import diffthrust as dft

POINTS = np.random.default_rng(0)
VALUE = jnp.asarray(POINTS.normal(size=100))
SIGNALS = dft.models.Signals(
    {{name: jnp.asarray(3.0 * POINTS.normal(size=100)) for name in {reads}}}
)
MOVED = {moved}


def same_law():
    formula = {formula}
    described = {{
        name: {{"unit": p.unit, "null": p.null, "value": MOVED.get(name, p.value)}}
        for name, p in {cls}.declared.items()
    }}
    return dft.effects.Formula(**formula, **described)


def test_at_its_null_it_changes_nothing():
    left = {cls}().at_null()(VALUE, SIGNALS)
    np.testing.assert_allclose(left, VALUE, rtol=1e-12, atol=1e-12)


def test_elsewhere_it_is_the_law():
    left = {cls}(**MOVED)(VALUE, SIGNALS)
    np.testing.assert_allclose(left, same_law()(VALUE, SIGNALS), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("size", [0.0, 1.0])
@pytest.mark.parametrize("effect", [{cls}().at_null(), {cls}(**MOVED)], ids=["null", "moved"])
def test_its_slopes_are_finite(effect, size):
    def left(effect, scale):
        signals = dft.models.Signals({{name: scale * SIGNALS[name] for name in SIGNALS}})
        return jnp.sum(effect(scale * VALUE, signals))

    slopes = jax.grad(left, argnums=(0, 1))(effect, size)
    assert np.all(np.isfinite(jax.tree_util.tree_leaves(slopes)))
'''

_MEMORY_TEST = """

def test_what_it_remembers_moves_and_begins_as_the_law_says():
    ours, law = {cls}(**MOVED), same_law()
    assert dict(ours.states) == dict(law.states)
    for way in ("rates", "initial"):
        found, expected = (getattr(one, way)(VALUE, SIGNALS) for one in (ours, law))
        for name in law.states:
            one, other = map(jax.tree_util.tree_leaves, (found[name], expected[name]))
            for ours_is, law_is in zip(one, other, strict=True):
                np.testing.assert_allclose(ours_is, law_is, rtol=1e-9, atol=1e-9)
"""


def class_name(name: str) -> str:
    """The name of the class of an effect: TipLoss for tip_loss."""
    return "".join(word.title() for word in name.split("_"))


def effect_class_text(
    formula: Formula, name: str, doc: str = "What happens there, in one line.", hint: str = ""
) -> str:
    """The source of a class that does what a formula does, to be edited by hand.

    A formula that was added to a model knows which channels a log must have. ``hint`` is a comment
    above the law.

    Example:
        >>> formula = dft.effects.Formula("shaft", "-rate * speed", rate="1/s")
        >>> "value - self.rate * s.speed" in effect_class_text(formula, "drag")
        True
    """
    nulls = [f"{n} = {p.null:g}" for n, p in formula.declared.items() if p.null is not None]
    acts = formula.expression if formula.adds else f"{ARRIVING} becomes {formula.expression}"
    about = f"Acts at the port '{formula.port}'{', adding' * formula.adds}: {acts}."
    about = textwrap.fill(f"{about} Null: {', '.join(nulls)}.", _WIDTH - 4)
    described = formula._parameters.items()
    law = expression_of(formula.expression).tree
    summary = doc.strip().replace("\\", "\\\\").replace('"""', "'''")
    return _CLASS.format(
        title=f"The effect {name}, of one's own.",
        cls=class_name(name),
        doc=textwrap.fill(summary, _WIDTH - 7).replace("\n", "\n    "),
        about=textwrap.indent(about, "    "),
        name=name,
        port=formula.port,
        needs=f"    needs = {as_python(formula.needs)}\n" if formula.needs else "",
        states=f"    states = {as_python(dict(formula.states))}\n" if formula.states else "",
        memory=_memory(formula),
        parameters="\n".join(f"    {n}: float = {_declaration(p)}" for n, p in described),
        law=_line("return ", _code_of(law, formula, leaves=True), "", 8),
        hint=f"        # {hint}\n" if hint else "",
    )


def _declaration(p: Parameter) -> str:
    """A parameter as code; an amplitude without a size gets the size one."""
    fields = plain_description("", p)
    assert isinstance(fields, dict)
    value, unit = fields.pop("value"), fields.pop("unit")
    # an amplitude that begins at its null of zero has no scale: the optimizer could not move it
    if p.null == p.value and "size" not in fields:
        fields["size"] = 1.0
    arguments = [f"{_rounded(value)!r}", f"unit={as_python(unit)}"]
    arguments += [f"{n}={_field(n, v)}" for n, v in fields.items()]
    line = f"dft.parameter({', '.join(arguments)})"
    if len(line) <= _WIDTH - 25:
        return line
    return "\n".join(
        ["dft.parameter(", *(f"        {argument}," for argument in arguments), "    )"]
    )


def _field(name: str, value: Any) -> str:
    if name == "prior":
        return f"dft.models.Normal(mean={value['mean']!r}, std={value['std']!r})"
    if name == "probes" and isinstance(value, dict):
        factors = ", ".join(map(repr, value["factors"]))
        return f'dft.models.relative_to("{value["signal"]}", {factors}, power={value["power"]!r})'
    return as_python(_rounded(value))


def _rounded(value: Any) -> Any:
    """Without the noise of the last digits."""
    if isinstance(value, tuple):
        return tuple(map(_rounded, value))
    return float(f"{value:.10g}") if isinstance(value, float) else value


def _memory(formula: Formula) -> str:
    """The methods of an effect with memories; empty if it has none."""
    lines, rates, starts = [], [], []
    settled: dict[str, ast.expr] = {}
    for memory in expression_of(formula.expression).memories:
        name = memory.state
        goal, pull = rate_parts(memory)
        if pull is None:
            rate = _code_of(goal, formula)
        else:
            for word, node in (("goal", goal), ("pull", pull)):
                lines.append(_line(f"{name}_{word} = ", _code_of(node, formula), "", 8))
            rate = f"dft.models.Relaxing({name}_pull * ({name}_goal - s.{name}), {name}_pull)"
        settled[name] = _AtStart(settled).of(begun_at(memory))
        rates.append(_line(f'"{name}": ', rate, ",", 12))
        starts.append(_line(f'"{name}": ', _code_of(settled[name], formula), ",", 12))
    if not rates:
        return ""
    sections = {"lines": lines, "rates": rates, "starts": starts}
    return _MEMORY.format(**{n: "\n".join(each) for n, each in sections.items()})


def _line(before: str, text: str, after: str, indent: int) -> str:
    """A line of code; where it is too long, the text in brackets and in as many as it needs."""
    margin = " " * indent
    line = f"{margin}{before}{text}{after}"
    if len(line) <= _WIDTH:
        return line
    room = _WIDTH - indent - 4
    rows = textwrap.wrap(text, room, break_long_words=False, break_on_hyphens=False)
    inner = textwrap.indent("\n".join(rows), f"{margin}    ")
    return f"{margin}{before}(\n{inner}\n{margin}){after}"


class _AtStart(ast.NodeTransformer):
    """Replaces the state of a memory that another one follows by its initial value."""

    def __init__(self, starts: Mapping[str, ast.expr]) -> None:
        self._known = starts

    def of(self, node: ast.expr) -> ast.expr:
        return self.visit(deepcopy(node))

    def visit_Name(self, node: ast.Name) -> ast.expr:
        return deepcopy(self._known.get(node.id, node))


def _code_of(node: ast.expr, formula: Formula, leaves: bool = False) -> str:
    """A node of an expression as the code of an effect, or what ``leaves`` the port by it."""
    body = _AsEffectCode(frozenset(formula.declared)).visit(deepcopy(node))
    if leaves and formula.adds:
        body = _sum(ast.Name(ARRIVING), body)
    return ast.unparse(ast.fix_missing_locations(body))


def _sum(augend: ast.expr, addend: ast.expr) -> ast.expr:
    """Their sum, as a difference if the second begins with a minus."""
    if isinstance(addend, ast.BinOp) and isinstance(addend.op, ast.Add | ast.Sub):
        return ast.BinOp(_sum(augend, addend.left), addend.op, addend.right)
    product = addend
    # "value + -a * b" reads as "value - a * b": the sign stands at the leftmost factor
    while isinstance(product, ast.BinOp) and isinstance(product.left, ast.BinOp):
        product = product.left
    first = product.left if isinstance(product, ast.BinOp) else product
    if not (isinstance(first, ast.UnaryOp) and isinstance(first.op, ast.USub)):
        return ast.BinOp(augend, ast.Add(), addend)
    if not isinstance(product, ast.BinOp):
        return ast.BinOp(augend, ast.Sub(), first.operand)
    product.left = first.operand
    return ast.BinOp(augend, ast.Sub(), addend)


class _AsEffectCode(ast.NodeTransformer):
    """Turns names into attributes, and functions into those that an effect calls."""

    def __init__(self, parameters: frozenset[str]) -> None:
        self._parameters = parameters

    def visit_Name(self, node: ast.Name) -> ast.expr:
        if node.id == ARRIVING:
            return node
        owner = "self" if node.id in self._parameters else "jnp" if node.id == "pi" else "s"
        if "." in node.id:  # of a part of a craft
            return ast.Subscript(ast.Name(owner), ast.Constant(node.id))
        return ast.Attribute(ast.Name(owner), node.id)

    def visit_Call(self, node: ast.Call) -> ast.expr:
        assert isinstance(node.func, ast.Name)
        name = SHORT.get(node.func.id, node.func.id)
        arguments = [self.visit(argument) for argument in node.args]
        if name == "where":
            arguments[0] = _condition(node.args[0], arguments[0])
        if name in FINITE:
            return _finite(FINITE[name].__name__, *arguments)
        return _jnp(name, *arguments)

    def visit_BinOp(self, node: ast.BinOp) -> ast.expr:
        first, second = self.visit(node.left), self.visit(node.right)
        # the class must give the numbers of the formula, which are finite where NumPy's are not
        if isinstance(node.op, ast.Div) and not isinstance(second, ast.Constant):
            return _finite("quotient", first, second)
        if isinstance(node.op, ast.Pow) and not keeps_sign(second):
            return _finite("raised", first, second)
        return ast.BinOp(first, node.op, second)

    def visit_Compare(self, node: ast.Compare) -> ast.expr:
        parts = [self.visit(operand) for operand in (node.left, *node.comparators)]
        pairs = [
            ast.Compare(first, [op], [second])
            for first, op, second in zip(parts[:-1], node.ops, parts[1:], strict=True)
        ]
        held: ast.expr = pairs[0]
        for pair in pairs[1:]:
            # a < b < c is `and` in Python, which traced arrays refuse
            held = ast.BinOp(held, ast.BitAnd(), pair)
        return _jnp("where", held, ast.Constant(1.0), ast.Constant(0.0))


def _condition(original: ast.expr, written: ast.expr) -> ast.expr:
    """The condition of a `where`: a comparison, or that a number is not zero."""
    if isinstance(original, ast.Compare) and isinstance(written, ast.Call):
        return written.args[0]
    return ast.Compare(written, [ast.NotEq()], [ast.Constant(0)])


def _jnp(name: str, *arguments: ast.expr) -> ast.expr:
    return ast.Call(ast.Attribute(ast.Name("jnp"), name), list(arguments), [])


def _finite(name: str, *arguments: ast.expr) -> ast.expr:
    finite = ast.Attribute(ast.Attribute(ast.Name("dft"), "effects"), "finite")
    return ast.Call(ast.Attribute(finite, name), list(arguments), [])


def effect_test_text(formula: Formula, name: str) -> str:
    """The tests of `effect_class_text`, which pass: its null, its law, its slopes."""
    arguments = {"port": formula.port, "expression": formula.expression}
    reads = (*formula.reads, *formula.states)
    return (_TEST + _MEMORY_TEST * bool(formula.states)).format(
        cls=class_name(name),
        name=name,
        reads=as_python(reads),
        formula=as_python(arguments),
        moved=as_python({n: _moved(p) for n, p in formula._parameters.items() if not p.fixed}),
    )


def _moved(p: Parameter) -> float:
    """Another value within the bounds."""
    low, high = p.limits
    tried = (p.value + 0.5, p.value - 0.5, 0.5 * (p.value + high), 0.5 * (p.value + low))
    return next(value for value in tried if low <= value <= high)

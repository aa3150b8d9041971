"""The text of the tests of a class of an effect that was made from a formula."""

from __future__ import annotations

from diffthrust._support.literals import as_python
from diffthrust.effects._class_text import class_name
from diffthrust.effects._formula import Formula
from diffthrust.models._base.parameter import Parameter

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

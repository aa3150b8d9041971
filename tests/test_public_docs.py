"""Every public object tells what it is, with an example; and every example does what it says.

All examples run in one process, so that they share what is compiled, and begin with the names of
`example_names`, each in a folder of its own.
"""

from __future__ import annotations

import ast
import doctest

import example_names
import matplotlib.pyplot as plt
import pytest
from public_objects import PublicObject, public_objects, shown_by_class

PARSER = doctest.DocTestParser()
FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
INNER = {
    # what the search for limit cycles asks of an element; nobody else calls it
    *(f"dft.cycles.ModelElement.{name}" for name in ("structure", "evaluate", "answer", "course")),
    *(f"dft.cycles.Nonlinearity.{name}" for name in ("amplitudes", "balanced", "courses")),
    "dft.cycles.Nonlinearity.quasi_linear",
    "dft.cycles.Backlash.passage",
    "dft.cycles.Relay.passage",
    # what models and files ask of effects and widths
    "dft.effects.Curve.read",
    "dft.effects.Formula.adds",
    "dft.logs.PWM.read",
}
"""Methods by which parts of the library speak to each other, and which no example shows."""


def with_example() -> list[PublicObject]:
    return [one for one in public_objects() if ">>>" in one.doc]


def test_every_public_object_has_a_docstring():
    assert not [one.name for one in public_objects() if not one.doc]


def test_every_public_function_and_class_has_an_example_of_its_own():
    assert not [o.name for o in public_objects() if not o.owner and ">>>" not in o.doc]


def test_every_method_is_shown_by_itself_or_by_its_class():
    bare = {o.name for o in public_objects() if o.owner and ">>>" not in o.doc}
    bare = {o.name for o in public_objects() if o.name in bare and not shown_by_class(o)}
    assert bare == INNER


def test_no_example_is_skipped():
    assert not [one.name for one in with_example() if "+SKIP" in one.doc]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    example_names.write_files(tmp_path)
    yield tmp_path
    plt.close("all")


@pytest.mark.parametrize("one", with_example(), ids=lambda one: one.name)
def test_the_example_does_what_it_says(one, folder):
    examples = PARSER.get_examples(one.doc)
    code = ast.parse("".join(example.source for example in examples))
    wanted = {node.id for node in ast.walk(code) if isinstance(node, ast.Name)}
    names = {**example_names.names(wanted), "__name__": "example"}
    test = doctest.DocTest(examples, names, one.name, None, 0, None)
    told: list[str] = []
    doctest.DocTestRunner(optionflags=FLAGS).run(test, out=told.append)
    assert not told, "".join(told)

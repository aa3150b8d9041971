"""Every public object tells what it is, with an example; and every example does what it says.

All examples run in one process, so that they share what is compiled, and begin with the names of
`example_names`, each in a folder of its own. Here, too, the JSON schemas of the reference are held
against what the results among these names write.
"""

from __future__ import annotations

import ast
import doctest
import inspect
import json
import re
import sys
from dataclasses import fields
from functools import cached_property
from pathlib import Path

import example_names
import matplotlib.pyplot as plt
import pytest
from jsonschema import Draft202012Validator
from places import ROOT
from public_objects import PublicObject, public_objects, shown_by_class

import diffthrust as dft

sys.path.append(str(ROOT / "docs" / "_ext"))
import reference_pages as reference

PARSER = doctest.DocTestParser()
SCHEMAS = ROOT / "docs" / "schemas"
FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
INNER = {
    # what the search for limit cycles asks of an element; nobody else calls it
    *(f"dft.cycles.ModelElement.{name}" for name in ("structure", "evaluate", "answer", "course")),
    *(f"dft.cycles.Nonlinearity.{name}" for name in ("amplitudes", "balanced", "courses")),
    "dft.cycles.Nonlinearity.quasi_linear",
    "dft.cycles.Backlash.passage",
    "dft.cycles.Relay.passage",
    # what models and files ask of effects and widths
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


def test_every_name_at_the_top_is_on_a_page():
    listed = (ROOT / "diffthrust" / "__init__.pyi").read_text(encoding="utf-8")
    names = set(re.findall(r"import \w+ as (\w+)", listed))
    folders = {folder for _, group in reference.AREAS.values() for folder in group}
    on_pages = {o.name for o in public_objects() if reference.folder_of(o) in folders | {""}}
    assert names == {name.partition(".")[2] for name in on_pages if name.count(".") == 1} | folders


@pytest.mark.parametrize(
    "cls", [dft.estimation.Fit, dft.comparison.Comparison, dft.diagnosis.Diagnosis]
)
def test_every_attribute_of_a_result_is_on_its_page(cls):
    page = reference.with_inherited_fields(cls, (inspect.getdoc(cls) or "").splitlines())
    listed = set(re.findall(r"^    (\w+): ", "\n".join(page), re.MULTILINE))
    members = {name: inspect.getattr_static(cls, name) for name in dir(cls) if name[0] != "_"}
    described = {
        name
        for name, member in members.items()
        if isinstance(member, property | cached_property) or inspect.isfunction(member)
        if inspect.getdoc(member)
    }
    assert not {f.name for f in fields(cls)} - listed
    assert not set(members) - listed - described


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
    doctest.DocTestRunner(verbose=False, optionflags=FLAGS).run(test, out=told.append)
    assert not told, "".join(told)


def schema(name):
    told = json.loads((SCHEMAS / f"{name}.schema.json").read_text(encoding="utf-8"))
    Draft202012Validator.check_schema(told)
    return Draft202012Validator(told)


def closed(part):
    """The schema with no further keys allowed, to see that every key is told."""
    if isinstance(part, list):
        return [closed(one) for one in part]
    if not isinstance(part, dict):
        return part
    kept = {key: closed(value) for key, value in part.items()}
    if "properties" in kept and isinstance(kept["properties"], dict) and "type" in kept:
        kept.setdefault("additionalProperties", False)
    return kept


def test_a_fit_and_a_comparison():
    fit = example_names.fit()
    schema("fit").validate(fit.to_json())
    schema("fit").validate(dft.fit(dft.Thruster(), example_names.log(), starts=1).to_json())
    schema("compare").validate(dft.compare(fit, example_names.unseen()).to_json())


def test_every_key_of_a_fit_is_told():
    told = json.loads((SCHEMAS / "fit.schema.json").read_text(encoding="utf-8"))
    Draft202012Validator(closed(told)).validate(example_names.fit().to_json())


def test_a_check(tmp_path):
    example_names.write_files(tmp_path)
    schema("check").validate(dft.checks.check(tmp_path, update=True).to_json())


def test_a_diagnosis():
    schema("diagnose").validate(example_names.diag().to_json())


@pytest.mark.parametrize("path", sorted(SCHEMAS.glob("*.json")), ids=lambda path: path.name)
def test_a_schema_is_one_and_says_what_it_is(path: Path):
    told = json.loads(path.read_text(encoding="utf-8"))
    Draft202012Validator.check_schema(told)
    assert told["title"]
    assert told["description"]

"""Numbers that decide a diagnosis stand in one file, each with its origin and both sides."""

import ast
import re
from dataclasses import fields
from itertools import pairwise

import pytest
from places import ROOT
from steps import SETTINGS

FOLDER = ROOT / "diffthrust" / "diagnosis"
SHOWING = re.compile(r"figures|tables|page|words|text|report")
ALL_FILES = [path for path in sorted(FOLDER.rglob("*.py")) if path.name != "_settings.py"]
FILES = [path for path in ALL_FILES if not SHOWING.search(str(path.relative_to(FOLDER)))]
EXACT = {0, 1, 2, 0.5}
"""Numbers in a comparison that are no threshold: signs, counts of two, halves."""
TOLERANCE = 1e-5
"""Smaller ones allow for rounding."""


def is_number(node):
    return isinstance(node, ast.Constant) and type(node.value) in (int, float)


def is_numeric(node):
    """Whether an expression is made of numbers alone."""
    named = {one.id for one in ast.walk(node) if isinstance(one, ast.Name)}
    return named <= {"np"} and any(map(is_number, ast.walk(node)))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_a_number_outside_the_settings_says_that_it_steers_an_algorithm(path):
    body = ast.parse(path.read_text(encoding="utf-8")).body
    silent = []
    for one, after in pairwise([*body, ast.Pass()]):
        if not isinstance(one, ast.Assign | ast.AnnAssign) or not one.value:
            continue
        if is_numeric(one.value):
            text = after.value if isinstance(after, ast.Expr) else None
            said = text.value if isinstance(text, ast.Constant) else ""
            if not str(said).startswith(("Numerics:", "Display:")):
                silent.append(ast.unparse(one))
    assert not silent, (
        f"{path.name}: {silent}. A number that decides belongs in _settings.py; one that steers an "
        'algorithm has a string below it, """Numerics: ...""" or """Display: ...""", that says why.'
    )


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_no_comparison_has_a_threshold_of_its_own(path):
    found = [
        f"{path.name}:{one.lineno}: {ast.unparse(one)}"
        for one in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(one, ast.Compare)
        for number in filter(is_number, ast.walk(one))
        if number.value not in EXACT and abs(number.value) > TOLERANCE
        if not any(isinstance(side, ast.Subscript) for side in ast.walk(one))
    ]
    assert not found


def evaluated_at_import(tree):
    """The expressions of a module that are evaluated once: not those in bodies of functions."""
    pending = list(ast.iter_child_nodes(tree))
    while pending:
        node = pending.pop()
        yield node
        if isinstance(node, ast.Lambda):
            pending += [node.args]
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            pending += [node.args, *node.decorator_list]
        else:
            pending += ast.iter_child_nodes(node)


@pytest.mark.parametrize("path", ALL_FILES, ids=lambda path: path.name)
def test_a_setting_is_read_where_it_is_used(path):
    """A value or group bound at import would hide from the sweep, which replaces `SETTINGS`."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    bound = [
        f"{path.name}:{node.lineno}"
        for node in evaluated_at_import(tree)
        if isinstance(node, ast.Name) and node.id == "SETTINGS"
    ]
    renamed = [
        f"{path.name}:{node.lineno}"
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and str(node.module).endswith("diagnosis._settings")
        for alias in node.names
        if alias.name != "SETTINGS" or alias.asname
    ]
    assert not bound + renamed, "read SETTINGS.step.field where it decides"


def described():
    """Each setting with the string below it."""
    source = (FOLDER / "_settings.py").read_text(encoding="utf-8")
    for group in ast.parse(source).body:
        if isinstance(group, ast.ClassDef) and group.name != "Settings":
            for one, after in pairwise([*group.body, ast.Pass()]):
                if isinstance(one, ast.AnnAssign):
                    said = after.value.value if isinstance(after, ast.Expr) else ""
                    yield f"{group.name}.{ast.unparse(one.target)}", said


def test_every_setting_says_what_it_decides_where_it_comes_from_and_what_breaks():
    texts = dict(described())
    assert len(texts) == sum(len(fields(getattr(SETTINGS, step.name))) for step in fields(SETTINGS))
    pattern = re.compile(r".{20,}\. Origin: .{5,}\. Lower: .{4,}\. Higher: .{4,}\.")
    poor = [name for name, text in texts.items() if not pattern.fullmatch(" ".join(text.split()))]
    assert not poor


def test_a_step_has_at_most_twelve_settings():
    sizes = {step.name: len(fields(getattr(SETTINGS, step.name))) for step in fields(SETTINGS)}
    assert max(sizes.values()) <= 12

"""The rules of the house that Import Linter's contracts do not tell: names, circles, the door."""

from __future__ import annotations

import ast
import importlib
from graphlib import TopologicalSorter
from pathlib import Path

import grimp
import pytest
from places import ROOT, TESTS

import diffthrust

PACKAGE = ROOT / "diffthrust"
FOLDERS = sorted(p.parent.name for p in PACKAGE.glob("[a-z]*/__init__.py"))


def sources() -> list[Path]:
    return [path for path in sorted(PACKAGE.rglob("*.py")) if path.name != "__init__.py"]


def test_at_most_thirty_names_stand_at_the_door_and_the_folders_are_namespaces():
    public = set(diffthrust.__all__)
    folders = set(FOLDERS) - {"cli"}
    assert folders <= public
    assert len(public - folders) <= 30


@pytest.mark.parametrize("folder", ["", *FOLDERS])
def test_every_name_of_a_stub_is_found_where_the_stub_says(folder):
    module = importlib.import_module(f"diffthrust.{folder}".rstrip("."))
    for name in getattr(module, "__all__", []):
        assert getattr(module, name) is not None


def test_no_file_imports_itself_by_way_of_others():
    graph = grimp.build_graph("diffthrust", exclude_type_checking_imports=False)
    modules = sorted(graph.modules)
    assert len(modules) > 200
    arrows = {name: graph.find_modules_directly_imported_by(name) for name in modules}
    TopologicalSorter(arrows).prepare()  # raises CycleError, which names the circle


def test_no_private_name_is_imported_from_another_file():
    private = []
    for path in [*sources(), *TESTS.rglob("*.py")]:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("diffthrust."):
                folder = PACKAGE.parent / node.module.replace(".", "/")
                private += [
                    f"{path.name}: {node.module}.{alias.name}"
                    for alias in node.names
                    if alias.name.startswith("_") and not (folder / f"{alias.name}.py").exists()
                ]
    assert not private


def test_a_private_import_of_a_test_gives_its_reason():
    bare = []
    for path in sorted(TESTS.rglob("test_*.py")):
        lines = path.read_text(encoding="utf-8").splitlines()
        for node in ast.walk(ast.parse("\n".join(lines))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("diffthrust."):
                private = any(part.startswith("_") for part in node.module.split("."))
                told = any("private:" in line for line in lines[node.lineno - 1 : node.end_lineno])
                if private and not told:
                    bare.append(f"{path.relative_to(TESTS)}:{node.lineno}: {node.module}")
    assert not bare


VAGUE = {
    "one", "ones", "known", "found", "told", "rest", "given", "own", "alike", "before", "there",
    "left", "other", "others", "whole", "part", "thing", "done", "gone", "seen", "said", "again",
    "once",
}  # fmt: skip
"""Words that name nothing: a local or an argument is a residual, a state, a limit."""


@pytest.mark.parametrize("folder", ["_support", *FOLDERS])
def test_names_of_locals_say_what_they_hold(folder):
    names, vague = 0, []
    for path in sorted((PACKAGE / folder).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef):
                arguments = node.args.args + node.args.kwonlyargs + node.args.posonlyargs
                stored = {
                    name.id
                    for statement in node.body
                    for name in ast.walk(statement)
                    if isinstance(name, ast.Name) and isinstance(name.ctx, ast.Store)
                }
                every = {argument.arg for argument in arguments} | stored
                names += len(every)
                vague += [
                    f"{path.name}:{node.lineno} {node.name}: {name}"
                    for name in sorted(every & VAGUE)
                ]
    assert len(vague) < 0.03 * max(names, 1), vague

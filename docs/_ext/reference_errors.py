"""The index of error messages with their mends, from the places where they are raised."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[2] / "diffthrust"
TITLES = {
    "logs": "Reading logs",
    "survey": "Looking at files",
    "soundness": "Doubts about logs",
    "specs": "Spec files and scripts",
    "models": "Models and parameters",
    "effects": "Effects",
    "actuators": "Actuators",
    "simulation": "Simulation",
    "estimation": "Fits",
    "uncertainty": "Intervals, posteriors, predictions",
    "comparison": "Comparison",
    "diagnosis": "Diagnosis",
    "experiments": "Suggested experiments",
    "plans": "Plans for a rig",
    "blackbox": "Linear models without physics",
    "describing": "Describing functions",
    "cycles": "Limit cycles",
    "control": "Control",
    "papers": "Methods of papers",
    "datasets": "Public logs",
    "many": "Many logs, campaigns, fleets",
    "checks": "Stored fits",
    "saved": "Results out of files",
    "export": "Export",
    "layouts": "Layouts of crafts",
    "workbench": "The workbench",
    "cli": "The command line",
    "_support": "Files and processes",
}


@dataclass(frozen=True)
class Message:
    """What an error says, with the parts that vary in «marks»."""

    problem: str
    mend: str
    file: str


def messages() -> dict[str, list[Message]]:
    """All of them by folder."""
    found: dict[str, dict[str, Message]] = defaultdict(dict)
    for path in sorted(PACKAGE.rglob("*.py")):
        folder = path.relative_to(PACKAGE).parts[0]
        for message in _of(path):
            if len(re.sub(r"«[^»]*»|\W", "", message.problem)) > 8:
                found[folder].setdefault(message.problem, message)
    return {k: sorted(v.values(), key=_order) for k, v in found.items()}


def _order(message: Message) -> str:
    return re.sub(r"«[^»]*»|\W+", " ", message.problem).strip().lower()


def _of(path: Path) -> Iterator[Message]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    fixed = {
        node.targets[0].id: node.value.value
        for node in tree.body
        if isinstance(node, ast.Assign)
        and isinstance(node.targets[0], ast.Name)
        and isinstance(node.value, ast.Constant)
    }
    for name in ast.walk(tree):  # constants of the file are shown as they are
        for field, value in ast.iter_fields(name):
            if isinstance(value, ast.Name) and value.id in fixed:
                setattr(name, field, ast.Constant(fixed[value.id]))
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        name = ast.unparse(node.func)
        if name == "InputError" and node.args:
            problem, mend = node.args[0], node.args[1] if len(node.args) > 1 else None
        elif name in ("InputError.at", "source.error") and len(node.args) > 1:
            problem, mend = node.args[1], node.args[2] if len(node.args) > 2 else None
        else:
            continue
        given = {k.arg: k.value for k in node.keywords}
        mend = mend if mend is not None else given.get("mend")
        file = path.relative_to(PACKAGE).as_posix()
        yield Message(_words(problem), _words(mend) if mend is not None else "", file)


def _words(node: ast.expr) -> str:
    """The text of an expression; what is only known when it happens stands in marks."""
    if isinstance(node, ast.Constant):
        return str(node.value)
    if isinstance(node, ast.JoinedStr):
        return "".join(_words(part) for part in node.values)
    if isinstance(node, ast.FormattedValue):
        return (
            _words(node.value)
            if _is_text(node.value) or _is_fixed(node.value)
            else f"«{_name(node.value)}»"
        )
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return _words(node.left) + _words(node.right)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult):
        return _words(node.left) if _is_text(node.left) else ""
    if isinstance(node, ast.IfExp):
        one, other = _words(node.body), _words(node.orelse)
        return one if len(one) >= len(other) else other
    return f"«{_name(node)}»"


def _is_fixed(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant)


def _is_text(node: ast.expr) -> bool:
    kinds = (ast.JoinedStr, ast.IfExp)
    return isinstance(node, kinds) or (
        isinstance(node, ast.Constant) and isinstance(node.value, str)
    )


def _name(node: ast.expr) -> str:
    """A word for what varies: the last name in its expression."""
    if isinstance(node, ast.Call):
        inner = node.args[0] if node.args else node.func
        return _name(inner)
    if isinstance(node, ast.Attribute):
        return node.attr.strip("_").replace("_", " ")
    if isinstance(node, ast.Name):
        return node.id.strip("_").replace("_", " ")
    if isinstance(node, ast.Subscript):
        return _name(node.value)
    if isinstance(node, ast.ListComp | ast.GeneratorExp):
        return _name(node.generators[0].iter)
    named = [n for n in ast.walk(node) if isinstance(n, ast.Name | ast.Attribute)]
    return _name(named[0]) if named else "..."


def error_pages() -> dict[str, str]:
    """A page for each folder, and one that lists them."""
    found = messages()
    order = [folder for folder in TITLES if folder in found]
    order += sorted({*found} - {*order})
    pages = {}
    rows = []
    for folder in order:
        title, file = TITLES.get(folder, folder), folder.strip("_")
        rows.append(f"- [{title}]({file}.md): {len(found[folder])}")
        pages[file] = _page(title, found[folder])
    total = sum(len(one) for one in found.values())
    files = "\n".join(folder.strip("_") for folder in order)
    pages["index"] = "\n\n".join(
        [
            "# Messages and their mends",
            "An error says what was expected, what was found and where, and on the next line the "
            f"mend. These are the {total} messages of the package, by the part that raises them; "
            "all are {py:class}`dft.InputError <diffthrust.InputError>`, and end a command with "
            "status 2. What varies stands in «marks».",
            "\n".join(rows),
            f"```{{toctree}}\n:hidden:\n:maxdepth: 1\n\n{files}\n```",
        ]
    )
    return pages


def _page(title: str, found: list[Message]) -> str:
    lines = [f"# {title}: messages"]
    for one in found:
        lines.append(f"{_shown(one.problem)}\n: {_mend(one.mend)}")
    return "\n\n".join(lines)


def _mend(text: str) -> str:
    if not text:
        return "The message says all there is."
    if not re.sub(r"«[^»]*»|\W", "", text):
        return "The mend depends on what was found, and is given there."
    return _shown(text)


def _shown(text: str) -> str:
    """As text in Markdown: nothing in a message is markup."""
    text = " ".join(text.split())
    return re.sub(r"([\\`*_{}\[\]<>#|$~])", r"\\\1", text)

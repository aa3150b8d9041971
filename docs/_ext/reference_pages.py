"""The reference: a page for each area, the command line, keys of spec files, JSON, and errors.

All of it is made from the package when the site is built. The pages of names are written for
autodoc, whose docstrings are in Google style; what these hold that reStructuredText would read as
its own (bars, stars, indented equations) is put right on the way.
"""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Sequence
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parents[1]), str(HERE.parents[1] / "tests")]

import example_names  # noqa: E402  (lies in tests)
from docstrings import as_rst  # noqa: E402  (lies beside)
from generated import table, write  # noqa: E402
from public_objects import PublicObject, public_objects  # noqa: E402
from reference_cli import command_line  # noqa: E402
from reference_errors import error_pages  # noqa: E402
from reference_json import json_page  # noqa: E402
from reference_spec import spec_page  # noqa: E402

from diffthrust._support.results import Brief  # noqa: E402

AREAS = {
    "logs": ("Logs", ("logs", "survey", "soundness", "datasets")),
    "models": ("Models and parameters", ("models", "bodies", "actuators", "sensors", "layouts")),
    "effects": ("Effects", ("effects",)),
    "simulation": ("Simulation", ("simulation",)),
    "estimation": ("Estimation", ("estimation", "saved", "specs")),
    "uncertainty": ("Uncertainty", ("uncertainty",)),
    "comparison": ("Comparison", ("comparison", "blackbox")),
    "diagnosis": ("Diagnosis and experiments", ("diagnosis", "experiments", "plans")),
    "describing": ("Describing functions", ("describing",)),
    "control": ("Control", ("control",)),
    "cycles": ("Limit cycles", ("cycles",)),
    "papers": ("Papers", ("papers",)),
    "many": ("Many logs, campaigns, fleets, checks", ("many", "checks")),
    "export": ("Export", ("export",)),
    "workbench": ("The workbench", ("workbench",)),
}
"""Pages, each with its title and the folders that it describes."""
FOLDER_TITLES = {
    "survey": "What is in a file",
    "soundness": "Is a log what it says",
    "datasets": "Public logs",
    "saved": "Results out of files",
    "specs": "Spec files",
    "blackbox": "Linear models without physics",
    "bodies": "Bodies of crafts",
    "actuators": "What pushes a craft",
    "sensors": "What a craft measures with",
    "layouts": "Ready layouts of crafts",
    "experiments": "Tests that separate rivals",
    "plans": "Plans for a rig",
    "checks": "Stored fits as regression tests",
}
HIDDEN = {"of_checked", "unread", "structure", "evaluate", "answer", "passage", "adds", "read"}
"""Methods by which parts of the library speak to each other."""


def folder_of(one: PublicObject) -> str:
    """The folder of the package that an object belongs to; of errors and warnings none."""
    raised = inspect.isclass(one.thing) and issubclass(one.thing, Exception)
    return "" if raised else one.thing.__module__.split(".")[1]


def import_path(one: PublicObject) -> str:
    """The name under which autodoc finds it."""
    return one.name.replace("dft", "diffthrust", 1)


def area_page(title: str, folders: tuple[str, ...]) -> str:
    """All names of some folders, by folder."""
    lines = [f"# {title}"]
    for folder in folders:
        named = [o for o in public_objects() if not o.owner and folder_of(o) == folder]
        if len(folders) > 1:
            lines.append(f"## {FOLDER_TITLES.get(folder, title.partition(' and ')[0])}")
        rows = [(f"{{py:obj}}`{o.name} <{import_path(o)}>`", _first(o)) for o in named]
        lines.append(table(("name", "what it is"), rows))
        lines += [_directive(one) for one in named]
    return "\n\n".join(lines)


def _first(one: PublicObject) -> str:
    first = " ".join(one.doc.split("\n\n")[0].split())
    return re.sub(r"(?<!`)`([^`]+)`(?!`)", r"`\1`", first)


def _directive(one: PublicObject) -> str:
    path = import_path(one)
    if not inspect.isclass(one.thing):
        return f"```{{eval-rst}}\n.. autofunction:: {path}\n```"
    lines = [f".. autoclass:: {path}", "   :members:", f"   :exclude-members: {_left_out(one)}", ""]
    lines += [f"   .. auto{kind}:: {path}.{name}" for name, kind in _from_private(one.thing)]
    return "```{eval-rst}\n" + "\n".join(lines) + "\n```"


def _left_out(one: PublicObject) -> str:
    inner = {name for name in vars(one.thing) if name in HIDDEN}
    return ", ".join(sorted({"library", "declared", *inner}))


def _from_private(cls: type) -> list[tuple[str, str]]:
    """What a class has from classes of the package that are not public themselves."""
    public = {o.thing for o in public_objects() if not o.owner}
    found: dict[str, str] = {}
    for base in cls.__mro__[1:]:
        if base in public or not base.__module__.startswith("diffthrust"):
            continue
        for name, raw in vars(base).items():
            inner = raw.fget if isinstance(raw, property) else getattr(raw, "__func__", raw)
            kind = "property" if isinstance(raw, property) else "method"
            documented = inspect.isfunction(inner) and inner.__doc__
            if documented and not name.startswith("_") and name not in {*vars(cls), *HIDDEN}:
                found.setdefault(name, kind)
    return sorted(found.items())


def errors_and_warnings() -> str:
    """What may be raised, and given out."""
    chosen = [o for o in public_objects() if not o.owner and not folder_of(o)]
    return "\n\n".join(["# Errors and warnings", *(_directive(one) for one in chosen)])


def names_page() -> str:
    """The names with which examples begin."""
    rows = [(f"`{name}`", inspect.getdoc(make) or "") for name, make in example_names.MADE.items()]
    libraries = ", ".join(f"`{name}`" for name in example_names.LIBRARIES)
    return "\n\n".join(
        [
            "# Names in the examples",
            "Every example of this reference is run by the tests. Examples find these names as if "
            f"they had made them, besides {libraries}. They begin in a folder that holds "
            "`run1.csv`, `run2.csv` and `fit.toml`, which are `log` and `unseen` as files. How "
            "each is made stands in `tests/example_names.py`.",
            table(("name", "what it is"), rows),
        ]
    )


def make(folder: Path) -> None:
    """Write all pages."""
    for file, (title, folders) in AREAS.items():
        write(folder / f"{file}.md", area_page(title, folders))
    write(folder / "errors.md", errors_and_warnings())
    write(folder / "names.md", names_page())
    write(folder / "command_line.md", command_line())
    write(folder / "spec_keys.md", spec_page())
    write(folder / "json.md", json_page())
    for name, text in error_pages().items():
        write(folder / "messages" / f"{name}.md", text)
    write(folder / "index.md", index())


def index() -> str:
    """The first page of the reference."""
    rows = []
    for file, (title, folders) in AREAS.items():
        count = sum(not o.owner and folder_of(o) in folders for o in public_objects())
        inside = ", ".join(f"`dft.{folder}`" for folder in folders)
        rows.append((f"[{title}]({file}.md)", inside, str(count)))
    other = [
        ("[Command line](command_line.md)", "every command with its options"),
        ("[Keys of spec files](spec_keys.md)", "each key, its type, default and meaning"),
        ("[JSON](json.md)", "what `--json` writes, as schemas"),
        ("[Messages and their mends](messages/index.md)", "every error by what went wrong"),
        ("[Errors and warnings](errors.md)", "the classes that may be caught"),
        ("[Names in the examples](names.md)", "what `log`, `fit` and the others are"),
    ]
    files = [*AREAS, "errors", "command_line", "spec_keys", "json", "messages/index", "names"]
    return "\n\n".join(
        [
            "# Reference",
            "`import diffthrust as dft`. Numbers are in SI unless a name says otherwise; arrays "
            "are of NumPy, and their shapes stand with them.",
            table(("names in Python", "folders", "names"), rows),
            table(("besides", "what it gives"), other),
            "```{toctree}\n:hidden:\n:maxdepth: 1\n\n" + "\n".join(files) + "\n```",
        ]
    )


def _when_built(app: Any) -> None:
    make(Path(app.srcdir) / "reference")


def _docstring(app: Any, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    lines[:] = as_rst(with_inherited_fields(thing, lines) if what == "class" else lines)


def with_inherited_fields(cls: type, lines: Sequence[str]) -> list[str]:
    """The docstring of a class with the fields of its bases that are on no page, last bases first.

    `Diagnosis` has its fields from private classes: without this no page would list them.
    """
    public = {o.thing for o in public_objects() if not o.owner}
    bases = [b for b in cls.__mro__[1:] if is_dataclass(b) and b not in public]
    inherited = [line for base in bases for line in _fields(inspect.getdoc(base) or "")]
    if not inherited:
        return list(lines)
    own = _fields("\n".join(lines))
    place = lines.index("Args:") + 1 + len(own) if own else _end_of_text(lines)
    head = [] if own else ["Args:"]
    tail = [""] if lines[place:] and lines[place] else []
    return [*lines[:place], *head, *inherited, *tail, *lines[place:]]


def _fields(doc: str) -> list[str]:
    """The lines of the section on arguments."""
    section = re.search(r"^Args:\n((?:    .*\n?|\n(?=    ))*)", doc, re.MULTILINE)
    return section[1].rstrip().splitlines() if section else []


def _end_of_text(lines: Sequence[str]) -> int:
    sections = (i for i, line in enumerate(lines) if re.match(r"(Example|Raises|Returns):", line))
    return next(sections, len(lines))


def _signature(
    app: Any, what: str, name: str, thing: Any, options: Any, signature: str, gives: str
) -> tuple[str, str] | None:
    """Results are made by the library: how is of no use to a reader."""
    return ("", gives) if what == "class" and issubclass(thing, Brief) else None


def setup(app: Any) -> dict[str, Any]:
    """Make the pages before Sphinx looks which there are; autodoc and napoleon come along."""
    for extension in ("sphinx.ext.autodoc", "sphinx.ext.napoleon"):
        app.setup_extension(extension)
    app.connect("builder-inited", _when_built)
    app.connect("autodoc-process-docstring", _docstring, priority=400)  # before napoleon
    app.connect("autodoc-process-signature", _signature)
    app.config.autodoc_typehints = "description"
    app.config.autodoc_typehints_description_target = "documented"
    app.config.autodoc_member_order = "bysource"
    app.config.autodoc_inherit_docstrings = True
    app.config.napoleon_numpy_docstring = False
    app.config.napoleon_use_rtype = False
    app.config.default_role = "py:obj"
    app.config.python_use_unqualified_type_names = True
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}


if __name__ == "__main__":
    make(Path(sys.argv[1]))

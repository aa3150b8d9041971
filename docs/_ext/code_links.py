"""Public names in the text lead to their page of the reference: `dft.fit(...)` to `dft.fit`."""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from sphinx.util.nodes import make_refnode

NAME = re.compile(r"^(?:diffthrust|dft)\.([A-Za-z_][\w.]*\w)")


def target(name: str, objects: Any) -> str | None:
    """The documented object of a name at the door or in a folder; None where there is none."""
    whole = f"diffthrust.{name}"
    if whole in objects:
        return whole
    same = [key for key in objects if key.endswith(f".{name}")]
    return same[0] if len(same) == 1 else None


def link(app: Any, tree: nodes.document, docname: str) -> None:
    """Wrap what stands in backticks and names a documented object."""
    objects = app.env.get_domain("py").objects
    for literal in list(tree.findall(nodes.literal)):
        found = NAME.match(literal.astext())
        inside = isinstance(literal.parent, nodes.reference | nodes.title)
        name = target(found[1], objects) if found and not inside else None
        if not name:
            continue
        entry = objects[name]
        reference = make_refnode(
            app.builder, docname, entry.docname, entry.node_id, literal.deepcopy(), name
        )
        literal.replace_self(reference)


def setup(app: Any) -> dict[str, Any]:
    """Connect the links, when all pages are known."""
    app.connect("doctree-resolved", link)
    return {"parallel_read_safe": True, "parallel_write_safe": True}

"""Files made from templates."""

from __future__ import annotations

import re
from importlib.resources import files
from typing import Any


def filled_in(template: str, **parts: Any) -> str:
    """The template of that name, filled in."""
    import jinja2

    def named(name: str) -> str:
        folder = files("diffthrust.export").joinpath("templates")
        return folder.joinpath(f"{name}.jinja").read_text(encoding="utf-8")

    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(named),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    text = environment.get_template(template).render(**parts)
    return re.sub(r"\n{4,}", "\n\n\n", text).rstrip() + "\n"

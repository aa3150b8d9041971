"""What an export gives."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any

from diffthrust._support.files import ending, write_whole


@dataclass(frozen=True)
class Exported:
    """A fit in the language of another program.

    Args:
        target: for which it was made.
        text: what goes into the file; ``str(exported)`` gives it too.
        notes: what the target cannot express, and what to mind.
        path: the file that was written, or ``None``.

    Example:
        >>> exported = dft.export.export_model(dft.Thruster(), "python")
        >>> exported.target, exported.notes, "def step" in exported.text
        ('python', (), True)
    """

    target: str
    text: str = field(repr=False)
    notes: tuple[str, ...] = ()
    path: Path | None = None

    def __str__(self) -> str:
        return self.text


ENDINGS = {
    "python": (".py",),
    "c": (".h",),
    "lut": (".csv", ".h"),
    "gz": (".sdf", ".xml"),
    "uuv": (".xacro", ".urdf", ".xml"),
    "stonefish": (".scn", ".xml"),
}
"""How the files of each target may end, the usual one first."""


def write_exported(path: Path, target: str, text: str) -> None:
    """Write a file for a target."""
    ending(path, *ENDINGS[target])
    write_whole(path, text.encode())


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

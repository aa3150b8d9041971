"""Figures that live on a page of HTML: Bokeh's, with its script within the page."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

_NAME = re.compile(r'(?<="id": ")[^"\\]+(?=")|(?<="root_id": ")[^"\\]+(?=")')
"""The name of a part, where a figure's JSON gives or uses it."""


@dataclass(frozen=True)
class Live:
    """A figure that lives.

    Args:
        layout: of Bokeh.
        shown: its source; what is chosen is told it as ``tags``, one index for each choice.
        choices: what can be chosen, by title.
        chosen: the index that is shown first, of each of these.
        remark: what a reader must know besides; mostly empty.
    """

    layout: Any
    shown: Any
    choices: Mapping[str, Sequence[str]]
    chosen: tuple[int, ...]
    remark: str = ""

    @property
    def item(self) -> str:
        """The figure as JSON that can stand within a script of HTML."""
        from bokeh.embed import json_item

        self.shown.name = "shown"
        # "</script>" in the name of a log would end the script
        return _renumbered(json.dumps(json_item(self.layout))).replace("<", "\\u003c")


def _renumbered(item: str) -> str:
    """A figure's JSON with names of its parts that follow from what it holds.

    Bokeh counts the parts of a process: the page of a diagnosis and of the same one, loaded again,
    differed. On one page no two figures may have a name in common.
    """
    numbers: dict[str, int] = {}
    counted = _NAME.sub(lambda name: str(numbers.setdefault(name[0], len(numbers))), item)
    figure = hashlib.sha256(counted.encode()).hexdigest()[:12]
    return _NAME.sub(lambda name: f"p{figure}-{name[0]}", counted)


def script() -> str:
    """Bokeh's own script, some 1.3 MB: without its widgets, tables and formulas."""
    from bokeh.resources import Resources

    return Resources(mode="inline", components=["bokeh"]).js_raw[0]

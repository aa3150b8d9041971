"""Figures that live on a page of HTML: Bokeh's, with its script within the page."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any


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
        item = _renumbered(json_item(self.layout))
        # "</script>" in the name of a log would end the script
        return json.dumps(item).replace("<", "\\u003c")


def _renumbered(item: Any) -> Any:
    """A figure with names of its parts that follow from what it holds.

    Bokeh counts the parts of a process: the page of a diagnosis and of the same one, loaded again,
    differed. On one page no two figures may have a name in common.
    """
    numbers: dict[str, int] = {}

    def renamed(part: Any, prefix: str) -> Any:
        if isinstance(part, list | tuple):
            return [renamed(each, prefix) for each in part]
        if not isinstance(part, dict):
            return part
        return {
            key: f"{prefix}{numbers.setdefault(value, len(numbers))}"
            if key in ("id", "root_id") and isinstance(value, str)
            else renamed(value, prefix)
            for key, value in part.items()
        }

    counted = json.dumps(renamed(item, "p"))
    return renamed(item, f"p{hashlib.sha256(counted.encode()).hexdigest()[:12]}-")


def script() -> str:
    """Bokeh's own script, some 1.3 MB: without its widgets, tables and formulas."""
    from bokeh.resources import Resources

    return Resources(mode="inline", components=["bokeh"]).js_raw[0]

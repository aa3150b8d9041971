"""Figures that live on a page of HTML: Bokeh's, with its script within the page."""

from __future__ import annotations

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
        # "</script>" in the name of a log would end the script
        return json.dumps(json_item(self.layout)).replace("<", "\\u003c")


def script() -> str:
    """Bokeh's own script, some 1.3 MB: without its widgets, tables and formulas."""
    from bokeh.resources import Resources

    return Resources(mode="inline", components=["bokeh"]).js_raw[0]

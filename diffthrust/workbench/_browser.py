"""What the browser does once, when the page is there."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from bokeh.models import CustomJS

_QUICKER = """
const visuals = Bokeh.require("core/visuals/visual").VisualProperties.prototype
if (visuals._get_css_value) visuals._get_css_value = () => ""
const sheets = Bokeh.require("core/dom").InlineStyleSheet.prototype
const {_update} = sheets
if (_update) sheets._update = function (css) { if (this.css != css) _update.call(this, css) }
"""
"""At each paint Bokeh writes the place of each axis and legend into a style sheet, although it has
not moved, and asks the sheets for the colour of each line and text, although none is there: the
browser lays the page out again for each. Without both, a move of a slider takes some 104 ms of its
processor instead of 155, and a frame of a pan 70 instead of 98 (Bokeh 3.9.2, no GPU). Neither name
is public: a Bokeh without them paints as it does."""
_TALLER = """
const taller = Math.min(Math.max(window.innerHeight / 720, 1), 1.6)
figures.forEach((figure, k) => { figure.height = Math.round(heights[k] * taller) })
"""
"""Display: plots are laid out for a window of 720 px, and grow with it."""


def once_ready(figures: Sequence[Any]) -> CustomJS:
    """Paint with less work, and let the plots fill the window."""
    args = {"figures": list(figures), "heights": [figure.height for figure in figures]}
    return CustomJS(args=args, code=_QUICKER + _TALLER)

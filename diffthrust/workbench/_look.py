"""How the page looks: colours, type, and texts of users as text, never as markup."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from html import escape
from typing import Any

from bokeh.events import SelectionGeometry
from bokeh.models import Button, CustomJS, Div

from diffthrust._support.errors import InputError

SELECTED, LEFT_OUT = "#56B4E9", "#999999"
FAILING = ("#E69F00", "#CC79A7", "#009E73")
"""Where a channel fails, a colour for each: of one colour, the band of one was taken for that of
the other."""
LEFT, RIGHT = 260, 340
"""Widths of the columns [px]: at 1 280 the plots get over half of the page."""
STRETCHED: dict[str, Any] = {"sizing_mode": "stretch_width"}
WRAPPED = {"flex-wrap": "wrap"}
WIDE: dict[str, Any] = {"width": LEFT - 20}
HALF: dict[str, Any] = {"width": LEFT // 2 - 14}
Edit = Callable[[Callable[[], None]], None]
"""Makes a change of the session."""

_TEXT = """
:host { font: 13px/1.4 system-ui, sans-serif; color: #222; }
h1 { font-size: 17px; margin: 0; overflow-wrap: anywhere; }
h2 { font-size: 13px; margin: 8px 0 0; color: #444; text-transform: none; }
p { margin: 2px 0; overflow-wrap: anywhere; }
p.quiet, td.quiet { color: #666; }
p.failing { font-size: 11.5px; border-left: 12px solid; padding-left: 6px; }
p.found { font-weight: 600; }
p.bad { color: #b00020; font-weight: 600; }
table { border-collapse: collapse; }
td, th { text-align: left; padding: 1px 16px 1px 0; font-weight: normal; }
td.number { text-align: right; font-variant-numeric: tabular-nums; }
pre { white-space: pre-wrap; font-size: 12px; background: #f4f4f4; padding: 6px; margin: 2px 0; }
img { max-width: 100%; }
.bar { height: 6px; background: #e4e4e4; border-radius: 3px; overflow: hidden; margin-top: 3px; }
.bar div { height: 6px; background: #0072B2; }
"""
_BUTTON = """
:host(:focus-within) .bk-btn { outline: 2px solid #0072B2; outline-offset: 1px; }
.bk-btn { white-space: normal; padding: 4px 8px; }
"""


def text(markup: str = "", **options: Any) -> Div:
    """A piece of the page; what users name must be `escape`-d in it."""
    return Div(text=markup, disable_math=True, stylesheets=[_TEXT], margin=(2, 4, 2, 4), **options)


def shaded(words: str, color: str) -> str:
    """A sentence beside the colour of what it speaks of."""
    return f'<p class="failing" style="border-color: {color}40">{escape(words)}</p>'


def heading(words: str) -> Div:
    """A heading within a column."""
    return text(f"<h2>{escape(words)}</h2>")


def paragraphs(words: str, kind: str = "") -> str:
    """Sentences as paragraphs, escaped."""
    lines = [line for line in words.splitlines() if line.strip()]
    return "".join(f'<p class="{kind}">{escape(line)}</p>' for line in lines)


def words_of(error: Exception) -> str:
    """What to say of an error."""
    return str(error) if isinstance(error, InputError) else repr(error)


def button(label: str, do: Any, kind: str = "default", **options: Any) -> Button:
    """A button that calls a function without arguments."""
    made = Button(label=label, button_type=kind, stylesheets=[_BUTTON], **options)  # pyright: ignore
    made.on_click(lambda _: do())
    return made


def box_of(event: SelectionGeometry) -> list[list[float]] | None:
    """The ends of a box along x and along y, once it is drawn."""
    geometry: Any = event.geometry
    if not event.final or geometry is None or geometry.get("type") != "rect":
        return None
    return [sorted(float(geometry.get(f"{axis}{k}") or 0.0) for k in (0, 1)) for axis in "xy"]


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


_BY_KEY = """
window.addEventListener("keydown", event => {
  const tab = event.composedPath()[0]
  if (tab.classList?.contains("bk-tab") && ["Enter", " "].includes(event.key)) {
    tab.click()
    event.preventDefault()
  }
})
"""
"""Tabs of Bokeh 3.9.2 take the focus and no key: without a mouse nobody saw the learned law."""


def once_ready(figures: Sequence[Any]) -> CustomJS:
    """Paint with less work, let the plots fill the window, and tabs be opened by key."""
    args = {"figures": list(figures), "heights": [figure.height for figure in figures]}
    return CustomJS(args=args, code=_QUICKER + _TALLER + _BY_KEY)

"""What figures share: their look, and how they reach the screen."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextvars import ContextVar
from functools import partial, wraps
from io import BytesIO
from typing import TYPE_CHECKING, Any, ParamSpec
from weakref import WeakSet

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Figure
else:  # for annotations: Matplotlib itself is loaded where a figure is made
    Figure = Any

_P = ParamSpec("_P")

BLUE, VERMILLION, GREY = "#0072B2", "#D55E00", "0.6"
COLOURS = (BLUE, VERMILLION, "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
"""Of Okabe & Ito 2008: distinct with every kind of colour vision."""
_POINTS = 4000
_SPARSE = 0.6
"""A channel with a smaller share of valid samples has a slower rate than its log."""
_MOST = 20
"""Figures that wait to be shown; with more, pyplot warns about memory."""
_OURS: WeakSet[Figure] = WeakSet()
_SEEN: ContextVar[bool] = ContextVar("seen", default=True)


def showing(draw: Callable[_P, Figure]) -> Callable[_P, Figure]:
    """Let the figures of a function show as pyplot's do.

    In a notebook each shows once, at the end of its cell at the latest; in a script they show by
    ``plt.show()``. Where nobody could see them (a backend that only writes files, another thread,
    `unseen`) pyplot does not learn of them, and they last as long as the caller keeps them.
    """

    @wraps(draw)
    def drawn(*args: _P.args, **kwargs: _P.kwargs) -> Figure:
        figure = draw(*args, **kwargs)
        # pyplot's state is not safe across threads, and GUI backends fail outside the main one.
        if _SEEN.get() and threading.current_thread() is threading.main_thread():
            _hand_over(figure)
        return figure

    return drawn


def unseen(draw: Callable[[], Figure]) -> Figure:
    """A figure that is written to a file and not shown."""
    token = _SEEN.set(False)
    try:
        return draw()
    finally:
        _SEEN.reset(token)


def png(figure: Figure) -> bytes:
    """A figure as a picture of 90 dots per inch; `Figure.savefig` works its layout out twice."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    out = BytesIO()
    figure.set_dpi(90)
    FigureCanvasAgg(figure).print_png(out)
    return out.getvalue()


def _hand_over(figure: Figure) -> None:
    """Give a figure to pyplot, if its backend can show it; the oldest gives way to the newest."""
    import matplotlib.pyplot as plt
    from matplotlib._pylab_helpers import Gcf
    from matplotlib.backends.registry import BackendFilter, backend_registry

    backend = plt.get_backend().lower()
    if backend in backend_registry.list_builtin(BackendFilter.NON_INTERACTIVE):
        return
    inline = backend.endswith("inline")
    waiting = [manager.canvas.figure for manager in Gcf.get_all_fig_managers()]
    # figures of the user's own are never closed
    while len(waiting) >= _MOST and (closable := [f for f in waiting if f in _OURS]):
        waiting.remove(closable[0])
        if inline:
            from IPython.display import display

            display(closable[0])
        plt.close(closable[0])
    _OURS.add(figure)
    if inline:
        # the inline backend shows open figures at the end of a cell: one that was the value of the
        # cell would show twice
        hook = partial(_displayed, figure)
        figure._repr_mimebundle_ = hook  # pyright: ignore[reportAttributeAccessIssue]
    # pyplot adopts only figures that it makes: it is given this one as if it had made it
    plt.figure(FigureClass=lambda **_: figure)  # pyright: ignore[reportArgumentType]


def _displayed(figure: Figure, **_: Any) -> dict[str, str]:
    """Called by a notebook just before it draws the figure, which must not show a second time."""
    import matplotlib.pyplot as plt

    plt.close(figure)
    return {}


def literal(name: str) -> str:
    """A name from a file, escaped: Matplotlib would read text between two $ as a formula."""
    return name.replace("$", r"\$")


def styled(axes: Axes, title: str, x: str, y: str) -> None:
    """Title and labels of one panel that is `unboxed`."""
    axes.set_title(title, loc="left", fontsize=9)
    axes.set_xlabel(x, fontsize=9)
    axes.set_ylabel(y, fontsize=9)
    unboxed(axes)


def unboxed(axes: Axes) -> None:
    """A light grid behind what is drawn, and no box around it."""
    axes.grid(True, color="0.9", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8)
    axes.margins(x=0.01)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def is_sparse(values: np.ndarray) -> bool:
    """Whether samples (not NaN) are too few for a line: held readings, a slower sensor."""
    return float(np.mean(np.isfinite(values))) < _SPARSE


def thinned(time: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """At most some thousand points that look the same: the extremes of every stretch."""
    values = np.where(np.isfinite(values), values, np.nan)
    if values.size <= _POINTS:
        return time, values
    # Two points per stretch, its minimum and maximum: plain decimation would hide single spikes.
    width = -(-values.size // (_POINTS // 2))
    count = -(-values.size // width)
    padded = np.full(count * width, np.nan)
    padded[: values.size] = values
    rows = padded.reshape(count, width)
    start = np.arange(count) * width
    low = np.argmin(np.where(np.isnan(rows), np.inf, rows), axis=1)
    high = np.argmax(np.where(np.isnan(rows), -np.inf, rows), axis=1)
    index = np.sort(np.stack([start + low, start + high], axis=1), axis=1).reshape(-1)
    return time[index], values[index]

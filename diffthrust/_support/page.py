"""What pages share: their style, and figures inside them."""

from __future__ import annotations

import base64
from collections.abc import Callable
from io import BytesIO
from typing import TYPE_CHECKING

from diffthrust._support.figures import unseen

if TYPE_CHECKING:
    from matplotlib.figure import Figure


STYLE = """\
body { font: 15px/1.5 system-ui, sans-serif; max-width: 75rem; margin: 2rem auto; padding: 0 1rem;
  color: #222; background: #fff; }
table { border-collapse: collapse; margin: .5rem 0 1.5rem; }
th, td { padding: .2rem .8rem; border-bottom: 1px solid #ddd; text-align: left; }
.n { text-align: right; font-variant-numeric: tabular-nums; }
.good { color: #00694d; } .bad { color: #b04a00; }
.origin { color: #555; font-size: .9rem; margin: .2rem 0; }
img { max-width: 100%; } pre { background: #f5f5f5; padding: .8rem; overflow-x: auto; }
@media print {
  body { margin: 0; max-width: none; font-size: 10pt; } h2, h3 { break-after: avoid; }
  img, table, pre { break-inside: avoid; } pre { white-space: pre-wrap; }
}
"""
"""The style of every page."""


def image(draw: Callable[[], Figure]) -> str:
    """A figure as a PNG in base64, for the page alone."""
    out = BytesIO()
    unseen(draw).savefig(out, format="png", dpi=90)
    return base64.b64encode(out.getvalue()).decode("ascii")

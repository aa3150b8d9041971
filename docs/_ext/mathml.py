"""Equations as MathML, made when the site is built: they show without a network or a script."""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from latex2mathml.converter import convert


def mathml(latex: str, display: str = "inline") -> str:
    """The equation, with bars as close as those of an absolute value are."""
    for side in ("lvert", "rvert"):
        latex = latex.replace(f"\\{side}", "|")
    return re.sub(
        r"<mo[^>]*>(\||&#x0007C;|&#x2223;)</mo>",
        '<mo stretchy="false" lspace="0.05em" rspace="0.05em">|</mo>',
        convert(latex, display=display),
    )


def inline(translator: Any, node: nodes.math) -> None:
    """An equation in a sentence."""
    translator.body.append(mathml(node.astext()))
    raise nodes.SkipNode


def display(translator: Any, node: nodes.math_block) -> None:
    """An equation on a line of its own."""
    translator.body.append(translator.starttag(node, "div", CLASS="math-block"))
    translator.body.append(mathml(node.astext(), "block"))
    translator.body.append("</div>\n")
    raise nodes.SkipNode


def setup(app: Any) -> dict[str, Any]:
    """Register the renderer; `conf.py` chooses it by its name."""
    app.add_html_math_renderer("mathml", (inline, None), (display, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}

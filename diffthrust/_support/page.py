"""Reports as HTML (Jinja2): in notebooks, and as a page that needs no library to be read."""

from __future__ import annotations

import base64
from collections.abc import Callable, Mapping
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from diffthrust._support.figures import png, unseen
from diffthrust._support.literals import ToCopy
from diffthrust._support.live import Live, script
from diffthrust._support.report import OnPage, Picture, Report, Rows, Section, Styled
from diffthrust._support.visible import visible

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def page(report: Report, title: str) -> str:
    """The page as text, under its heading; it refers to no other file and to no address."""
    return _rendered(
        "page.html", report=report, title=title, image=image, living=_living, script=script
    )


def notebook_html(report: Report) -> str:
    """The report as one block of HTML for a notebook, the folded sections last."""
    return _rendered("notebook.html", report=report)


def _rendered(template: str, **values: Any) -> str:
    import jinja2

    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.tests["kind"] = lambda part, name: type(part).__name__ == name
    environment.tests["copied"] = _copied
    environment.filters["visible"] = visible
    text = files("diffthrust._support").joinpath(template).read_text(encoding="utf-8")
    return environment.from_string(text).render(values)


def _living(picture: Picture) -> Live | None:
    """The figure that lives, where there is one and Bokeh is installed."""
    try:
        return picture.live()
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != "bokeh":
            raise
        return None


def image(draw: Callable[[], Figure]) -> str:
    """A figure as a PNG in base64, so that the page needs no other file."""
    return base64.b64encode(png(unseen(draw))).decode("ascii")


def glossary(terms: Mapping[str, str]) -> Section:
    """The words of a page, explained."""
    return Section(
        "Words", OnPage(Rows.of((), [(Styled(t, "strong"), w) for t, w in terms.items()]))
    )


def spec_section(text: str) -> Section:
    """The text of a spec file at the end of a page."""
    return Section("Spec", *([OnPage(ToCopy(text))] if text else []))


def _copied(text: Any) -> bool:
    return isinstance(text, ToCopy) and "\n" in text

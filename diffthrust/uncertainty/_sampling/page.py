"""The report of a posterior: one HTML page that needs nothing else."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from diffthrust._support.files import write_page
from diffthrust._support.page import STYLE, image
from diffthrust._support.words import percent
from diffthrust.uncertainty._sampling.figures import plot_corner, plot_trace
from diffthrust.uncertainty._sampling.summary import INTERVAL_LEVEL, Sampled
from diffthrust.uncertainty._sampling.tables import HEADINGS, draw_rows

_TEMPLATE = "page.html"
_MOST = 10
"""A corner of more parameters cannot be read: that many are shown."""


def write_report(found: Sampled, path: Path | str, *, title: str = "", spec: str = "") -> None:
    """Write a posterior as one page: intervals, convergence, predictions and figures.

    Args:
        found: the posterior, summarised.
        path: the file to write.
        title: heading of the page; by default it names the model.
        spec: text of a spec file, shown at the end.

    Raises:
        InputError: a file that does not end in ``.html``, or cannot be written.
    """
    import jinja2
    from markupsafe import Markup

    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    template = (
        files("diffthrust.uncertainty._sampling").joinpath(_TEMPLATE).read_text(encoding="utf-8")
    )
    own = [name for name in found.parameters if not name.startswith("noise.")]
    text = environment.from_string(template).render(
        style=Markup(STYLE),
        title=title or f"Posterior of the {found.fit.model}",
        model=str(found.fit.model),
        told=found.told,
        method=found.method,
        level=percent(INTERVAL_LEVEL),
        headings=[*HEADINGS, "Fit ± standard error"],
        numbers=(1, 2, 3, 5, 6, 7, 8),
        rows=draw_rows(found),
        fit=found.fit,
        intervals=found.intervals.report(),
        bars=image(found.intervals.plot()),
        predictions=[(p.sentence, p.notes, image(p.plot()), p.log) for p in found.predictions],
        left=own[_MOST:],
        corner=image(plot_corner(found.post, found.fit, names=own[:_MOST])),
        trace=image(plot_trace(found.post)),
        spec=spec,
    )
    write_page(Path(path), text)

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


def write_posterior_page(
    sampled: Sampled, path: Path | str, *, title: str = "", spec: str = ""
) -> None:
    """Write a posterior as one page: intervals, convergence, predictions and figures.

    Args:
        sampled: the posterior, summarised.
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
    shown = [name for name in sampled.parameters if not name.startswith("noise.")]
    text = environment.from_string(template).render(
        style=Markup(STYLE),
        title=title or f"Posterior of the {sampled.fit.model}",
        model=str(sampled.fit.model),
        convergence=sampled.convergence,
        method=sampled.method,
        level=percent(INTERVAL_LEVEL),
        headings=[*HEADINGS, "Fit ± standard error"],
        numbers=(1, 2, 3, 5, 6, 7, 8),
        rows=draw_rows(sampled),
        fit=sampled.fit,
        intervals=sampled.intervals.report(),
        bars=image(sampled.intervals.plot),
        predictions=[(p.sentence, p.notes, image(p.plot), p.log) for p in sampled.predictions],
        left=shown[_MOST:],
        corner=image(lambda: plot_corner(sampled.post, sampled.fit, names=shown[:_MOST])),
        trace=image(lambda: plot_trace(sampled.post)),
        closing=sampled.closing,
        spec=spec,
    )
    write_page(Path(path), text)

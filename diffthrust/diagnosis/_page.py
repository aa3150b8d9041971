"""The report of a diagnosis: one HTML page that a colleague reads without the library."""

from __future__ import annotations

from functools import partial
from importlib.resources import files
from typing import TYPE_CHECKING

from diffthrust._support.page import STYLE, image
from diffthrust._support.words import capitalised
from diffthrust.diagnosis._learned_words import learned_words
from diffthrust.diagnosis._skeleton import HOW, skeleton
from diffthrust.diagnosis._tables import (
    check_rows,
    closing_tables,
    form_rows,
    headroom_rows,
    headroom_words,
    log_rows,
    meaning_rows,
    ranking_rows,
    stage_rows,
    worth_rows,
)
from diffthrust.diagnosis._words import (
    bound_words,
    caution_words,
    closing_words,
    dropped_words,
    failure_words,
    group_words,
    missing_words,
    model_words,
    refused_words,
    remaining_words,
    silent_words,
    summary,
    verdict_words,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from diffthrust.diagnosis._findings import Findings
    from diffthrust.experiments._result import Experiment

_TEMPLATE = "page.html"


def page(diag: Findings, *, title: str = "", spec: str = "") -> str:
    """The page as text.

    Args:
        diag: the diagnosis.
        title: heading of the page; by default it names the model.
        spec: text of a spec file, shown at the end.
    """
    import jinja2
    from markupsafe import Markup

    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    template = files("diffthrust.diagnosis").joinpath(_TEMPLATE).read_text(encoding="utf-8")
    model, left = model_words(diag.model), diag.remaining
    return environment.from_string(template).render(
        style=Markup(STYLE),
        title=title or f"Diagnosis of the {model}",
        model=model,
        diag=diag,
        verdict=capitalised(verdict_words(diag)),
        summary=summary(diag),
        stages=stage_rows(diag),
        worth=worth_rows(diag),
        dropped=dropped_words(diag),
        room=headroom_rows(diag) if diag.headroom else None,
        findable=headroom_words(diag),
        logs=log_rows(diag),
        failures=failure_words(diag.before),
        still=failure_words(diag.after) if len(diag.stages) > 1 else [],
        missing=[missing_words(missing, diag.model) for missing in diag.shown(diag.missing)],
        ranking=ranking_rows(diag),
        refused=[*refused_words(diag), *bound_words(diag)],
        silent=silent_words(diag),
        left=[missing_words(missing, diag.model) for missing in diag.shown(diag.left[:1])],
        meanings=meaning_rows(diag),
        groups=group_words(diag),
        remaining=remaining_words(diag),
        how=HOW,
        skeleton=skeleton(diag.fit.model, left, diag.missing) if left and not diag.laws else "",
        learned=learned_words(diag),
        forms=form_rows(diag),
        closing=list(closing_tables(diag)),
        checks=check_rows(diag),
        notes=caution_words(diag),
        origin=closing_words(diag),
        figures=_figures(diag),
        spec=spec,
    )


def _figures(diag: Findings) -> dict[str, str]:
    """The figures that this diagnosis has, as PNG in base64."""
    from diffthrust.diagnosis._figures import missing_figure, ranking_figure, stages_figure
    from diffthrust.diagnosis._figures_learned import learned_figure

    drawn = {"stages": lambda: stages_figure(diag), "residuals": diag.before.plot_residuals}
    if any(missing.shows for missing in diag.missing):
        drawn["missing"] = lambda: missing_figure(diag)
    if diag.ranking:
        drawn["ranking"] = lambda: ranking_figure(diag)
    if diag.laws:
        drawn["learned"] = lambda: learned_figure(diag)
    if diag.experiment:
        drawn["experiment"] = partial(_untitled, diag.experiment)
    return {name: image(draw) for name, draw in drawn.items()}


def _untitled(experiment: Experiment) -> Figure:
    """The figure of a proposed test; the page says in its text what stands above it."""
    figure = experiment.plot()
    figure.suptitle("")
    return figure

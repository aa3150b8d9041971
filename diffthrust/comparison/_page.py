"""A report as one HTML page that needs nothing else."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from diffthrust._support.files import write_page
from diffthrust._support.page import STYLE, image
from diffthrust._support.tables import with_error
from diffthrust.comparison._compare import Comparison, compare
from diffthrust.estimation._origin import closing
from diffthrust.estimation._result import Fit
from diffthrust.estimation._status import Status
from diffthrust.estimation._tables import error_cell, error_cells
from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model
from diffthrust.simulation._errors import Errors

_PAGE = """<!doctype html>
<html lang="en">
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{{ title }}</title>
<style>
{{ style }}</style>
<h1>{{ title }}</h1>
<p>Model: <b>{{ model }}</b></p>
{% if fit %}
{% for doubt in fit.doubts %}
<p><b class="bad">Doubt: {{ doubt.channel }} ({{ doubt.kind }}).</b> {{ doubt.evidence }}
<br>Mend: {{ doubt.mend }}</p>
{% endfor %}
<p>Status: <b class="{{ 'good' if fit.status.ok else 'bad' }}">{{ fit.status.value }}</b>.
{{ fit.message }}</p>
<h2>Parameters</h2>
<table>
<tr><th>Parameter<th class="n">Value<th class="n">Standard error<th>Unit<th></tr>
{% for row in parameters %}
<tr><td>{{ row[0] }}<td class="n">{{ row[1] }}<td class="n">{{ row[2] }}<td>{{ row[3] }}
<td>{{ row[4] }}</tr>
{% endfor %}
</table>
{% endif %}
<h2>Errors</h2>
<table>
<tr><th>Logs<th>Channel<th class="n">RMSE<th>Unit<th class="n">NRMSE<th class="n">Fit %
<th class="n">Samples</tr>
{% for row in errors %}
<tr><td>{{ row[0] }}<td>{{ row[1] }}<td class="n">{{ row[2] }}<td>{{ row[3] }}
<td class="n">{{ row[4] }}<td class="n">{{ row[5] }}<td class="n">{{ row[6] }}</tr>
{% endfor %}
</table>
<p>NRMSE is the RMSE over the standard deviation of the measured channel. Fit % is 100 for a perfect
model and 0 for one no better than the mean.</p>
{% for note in notes %}<p>Note: {{ note }}</p>
{% endfor %}
{% for name, image in figures %}
<h2>{{ name }}</h2>
<img alt="Measured and modelled channels with residuals, {{ name }}"
  src="data:image/png;base64,{{ image }}">
{% endfor %}
{% if checks %}
<h2>Checks</h2>
<table>
{% for row in checks %}<tr><td>{{ row[0] }}<td class="n">{{ row[1] }}</tr>
{% endfor %}
</table>
{% endif %}
{% for line in closing %}<p class="origin">{{ line }}</p>
{% endfor %}
<h2>Spec</h2>
<pre>{{ spec }}</pre>
</html>
"""


def comparisons_of(
    fitted: Fit | Model, train: Sequence[Log], unseen: Sequence[Log]
) -> dict[str, Comparison]:
    """A fit, or a model as it stands, held against its training and unseen logs, by heading."""
    # where no simulation succeeded, there are no estimated initial states to begin at
    initial = None
    if isinstance(fitted, Fit) and fitted.status is not Status.SIMULATION_FAILED:
        initial = fitted.initial
    out = {"training logs": compare(fitted, train, initial=initial)}
    if unseen:
        out["unseen logs"] = compare(fitted, unseen)
    return out


def write_comparison_page(
    path: Path,
    *,
    title: str,
    spec: str,
    comparisons: Mapping[str, Comparison],
    fit: Fit | None = None,
) -> None:
    """Write a page with the parameters, the errors and a figure for each comparison.

    Args:
        path: the file to write.
        title: heading of the page.
        spec: text of the spec file, shown at the end.
        comparisons: what to show, by heading, such as "unseen logs".
        fit: the fit, where there was one.
    """
    import jinja2
    from markupsafe import Markup

    model = next(iter(comparisons.values())).model
    page = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined)
    text = page.from_string(_PAGE).render(
        style=Markup(STYLE),
        title=title,
        model=str(model),
        fit=fit,
        parameters=list(_parameters(fit)) if fit else [],
        errors=[
            row
            for name, comparison in comparisons.items()
            for row in _errors(name, comparison.errors)
        ],
        notes=fit.notes if fit else (),
        figures=[(name, image(c.plot)) for name, c in comparisons.items()],
        checks=_checks(fit) if fit and fit.status is not Status.SIMULATION_FAILED else [],
        closing=_closing(comparisons, fit),
        spec=spec,
    )
    write_page(path, text)


def _parameters(fit: Fit) -> Iterable[tuple[str, ...]]:
    for name, e in fit.parameters.items():
        remark = "fixed" if e.fixed else "at its bound" if e.at_bound else ""
        size, spread, unit = e.shown
        yield name, *with_error(size, spread), unit, remark


def _errors(logs: str, error: Errors) -> Iterable[tuple[str, ...]]:
    for name, e in error.channels.items():
        yield logs, name, *error_cells(e)
    if len(error.channels) > 1:
        yield logs, "all", "", "", error_cell(error.nrmse), "", ""


def _closing(comparisons: Mapping[str, Comparison], fit: Fit | None) -> tuple[str, ...]:
    """Where the page comes from: its fit, or where there was none the comparisons."""
    if fit:
        return closing(fit.origin, fit.model)
    return tuple(dict.fromkeys(line for c in comparisons.values() for line in c.closing))


def _checks(fit: Fit) -> list[tuple[str, str]]:
    c = fit.checks
    return [
        ("gradient at the end (0 at a stationary point)", f"{c.gradient:.1e}"),
        ("rank of the scaled Jacobian", f"{c.rank} of {c.free_parameters}"),
        ("its condition number", f"{c.condition:.3g}"),
        ("starts that ended in the best optimum", f"{c.starts_agreeing} of {c.starts}"),
    ]

"""The lower part of the page: the staircase, the error against any signal, and what was found."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from html import escape
from types import MappingProxyType
from typing import Any

import numpy as np
from bokeh.events import SelectionGeometry
from bokeh.layouts import column, row
from bokeh.models import (
    BoxSelectTool,
    ColumnDataSource,
    Label,
    PlainText,
    ResetTool,
    Select,
    Span,
    TabPanel,
    Tabs,
    UIElement,
)

from diffthrust._support.figures import BLUE, VERMILLION
from diffthrust._support.page import image
from diffthrust._support.plots import Staircase, plot, with_unit
from diffthrust._support.words import humanize
from diffthrust.comparison._derived_signals import derived_of
from diffthrust.diagnosis._result import Diagnosis
from diffthrust.models._base.model import Model
from diffthrust.simulation._runs import Run
from diffthrust.workbench._look import STRETCHED, WRAPPED, box_of, paragraphs, text
from diffthrust.workbench._session import Step

_POINTS = 4000
"""Display: points of the scatter; more would cover each other."""
_HEIGHT = 186
"""Display: of a tab [px]; more is below the edge of a window of 720 px."""


class Results:
    """Tabs below the plots; ``asking`` asks about a stretch, and the answer is below it."""

    def __init__(
        self,
        on_select: Callable[[np.ndarray], None],
        asking: Sequence[UIElement] = (),
        others: Mapping[str, UIElement] = MappingProxyType({}),
    ) -> None:
        self.on_select = on_select
        self.stairs = Staircase(_HEIGHT)
        self.now = Span(location=None, dimension="width", line_color=VERMILLION, line_dash="dashed")
        self.now_label: Any = Label(
            x=4, y=0, x_units="screen", text_color=VERMILLION, text_font_size="11px"
        )
        for mark in (self.now, self.now_label):
            self.stairs.figure.add_layout(mark)
        self.points = ColumnDataSource(data={"x": [], "y": [], "index": []})
        self.channel = Select(options=[], width=95, margin=(0, 4, 0, 4))
        self.signal = Select(options=[], width=125, margin=(0, 4, 0, 4))
        for select in (self.channel, self.signal):
            select.on_change("value", lambda attr, old, new: self._draw_points())
        self.scatter = self._scatter()
        self.stretch, self.learned, self.experiment = text(), text(), text()
        self.run: Run | None = None
        self.selected = np.zeros(0, bool)
        self.derived: dict[str, tuple[np.ndarray, str]] = {}
        self._signals = self.derived
        axes = (text("residual of"), self.channel, text("against"), self.signal)
        beside = column(
            row(*axes, styles=WRAPPED),
            self.scatter,
            styles={"flex": "1 1 290px", "min-width": "0"},
            **STRETCHED,
        )
        tabs = {
            "Error, step by step": row(self.stairs.figure, beside, styles=WRAPPED, **STRETCHED),
            "A stretch alone": column(*asking, self.stretch, **STRETCHED),
            "Learned law": self.learned,
            "Next experiment": self.experiment,
            **others,
        }
        self.layout = Tabs(
            tabs=[TabPanel(title=title, child=child) for title, child in tabs.items()],
            stylesheets=[".bk-headers-wrapper { flex-wrap: wrap; }"],
            **STRETCHED,
        )
        self.show_diagnosis(None)

    # -- the staircase ---------------------------------------------------------------------------

    def show_steps(
        self, steps: Sequence[Step], opened: float, now: float | None, *, unseen: bool
    ) -> None:
        """Show the staircase, and as a dashed line the error of values that sliders were moved to.

        The model as opened stands there with that error until it is fitted. The errors are of
        ``unseen`` logs or of training logs.
        """
        fitted = any(not step.added for step in steps)
        names = [f"+ {step.added}" if step.added else "as opened" for step in steps]
        errors = [step.unseen for step in steps]
        if not fitted:
            names, errors = ["as opened, not fitted", *names], [opened, *errors]
        logs = "logs kept out" if unseen else "fitted logs"
        self.stairs.show(names, errors, logs, now or 0.0, unfitted=int(not fitted))
        self.now.location = now
        self.now_label.update(y=now or 0.0, text="" if now is None else f"sliders: {now:.3g}")

    # -- the scatter -----------------------------------------------------------------------------

    def _scatter(self) -> Any:
        select = BoxSelectTool(description="Select samples")
        drawn = plot(
            "residual",
            "",
            height=_HEIGHT - 34,
            tools=[select, ResetTool()],
            active_drag=select,
            toolbar_location=None,
        )
        drawn.xaxis.axis_label = PlainText(text="")
        points = drawn.scatter("x", "y", source=self.points, size=3, color=BLUE, alpha=0.5)
        points.selection_glyph = points.glyph.clone(fill_color=VERMILLION, line_color=VERMILLION)
        points.nonselection_glyph = points.glyph.clone(fill_alpha=0.2, line_alpha=0.2)
        drawn.on_event(SelectionGeometry, self._on_geometry)
        return drawn

    def show_run(self, model: Model, run: Run) -> None:
        """Offer the residuals and signals of a run."""
        if self.selected.size != run.time.size:
            self.selected = np.zeros(run.time.size, bool)
        self.run, self.derived = run, derived_of(model, run)
        self._signals = dict(self.derived)
        for name in run.record.inputs:
            if name in self.derived:  # as in its plot: pulses of 1 100 us, not 400 below the stop
                values = run.shown.values(name, run.signals[name], run.units[name])
                self._signals[name] = values, self.derived[name][1]
        for select, names in ((self.channel, run.channels), (self.signal, self._signals)):
            if list(names) != select.options:
                select.options = list(names)
            if select.value not in names:
                select.value = next(iter(names), "")
        self._draw_points()

    def _draw_points(self) -> None:
        run = self.run
        if run is None or self.channel.value not in run.channels:
            return
        signal, unit = self._signals.get(self.signal.value, (np.zeros(run.time.size), ""))
        trace = run.shown_channels[self.channel.value]
        index = np.flatnonzero(np.isfinite(trace.residual) & np.isfinite(signal))
        index = index[:: max(1, -(-index.size // _POINTS))]
        self.points.selected.indices = []  # none of them beyond the points to come
        series = {"x": signal, "y": trace.residual}
        drawn = {axis: values[index].astype(np.float32) for axis, values in series.items()}
        self.points.data = {**drawn, "index": index}
        self.light_up(self.selected)
        # another text, not another label: for each new model Bokeh goes through the whole page
        self.scatter.yaxis[0].axis_label.text = with_unit("residual", trace.unit)
        self.scatter.xaxis[0].axis_label.text = with_unit(self.signal.value, unit)

    def _on_geometry(self, event: SelectionGeometry) -> None:
        if self.run is None or (box := box_of(event)) is None:
            return
        residual = self.run.shown_channels[self.channel.value].residual
        signal = self._signals[self.signal.value][0]
        self.selected = np.ones(signal.size, bool)
        for values, (low, high) in zip((signal, residual), box, strict=True):
            self.selected &= (values >= low) & (values <= high)
        self.on_select(self.selected)

    def light_up(self, selected: np.ndarray) -> None:
        """Mark samples of the log that were selected elsewhere."""
        self.selected = selected
        index = np.asarray(self.points.data["index"], int)
        self.points.selected.indices = np.flatnonzero(selected[index]).tolist()

    # -- what was found --------------------------------------------------------------------------

    def show_stretch(self, diagnosis: Diagnosis, where: str) -> None:
        """Rank what a diagnosis of one stretch alone has tried."""
        tried = [t for t in diagnosis.ranking if t.stage == 0][:8]
        rows = "".join(
            f'<tr><td class="number">{k}</td><td>{_named(t.effect, diagnosis.added)}</td>'
            f"<td>{_strength(-t.delta_bic)} ({-t.delta_bic:.1f})</td></tr>"
            for k, t in enumerate(tried, 1)
        )
        heads = "<td></td><td>effect</td><td>evidence for it alone (fall of the BIC)</td>"
        names = ", ".join(humanize(name) for name in diagnosis.added)
        model = humanize(str(diagnosis.model))
        remaining = diagnosis.remaining
        place = f" What remains acts at '{remaining.port}'." if remaining else ""
        self.stretch.text = (
            f"<p>Judged by {escape(where)} alone, {escape(model)} lacks "
            f"<b>{escape(names or 'nothing for sure')}</b>.{escape(place)}</p>"
            f"<table><tr>{heads}</tr>{rows}</table>"
        )
        self.layout.active = 1

    def show_diagnosis(self, diagnosis: Diagnosis | None) -> None:
        """Show the learned law and the next experiment of a diagnosis."""
        learned = "Diagnose first: what no known effect explains is learned as a curve."
        experiment = "Diagnose first: it proposes the command that would decide."
        if diagnosis is not None:
            learned = "No law was learned: the verdict on the left says why."
            experiment = "No experiment is needed to tell effects apart."
        self.learned.text = paragraphs(learned, "quiet")
        self.experiment.text = paragraphs(experiment, "quiet")
        if diagnosis is not None and diagnosis.laws:
            laws = (f"{law.effect.name} {law.worth}" for law in diagnosis.laws)
            words = (
                f"Of the squared error that is left without it a law removes: {'; '.join(laws)}."
            )
            self.learned.text = paragraphs(words) + _picture(diagnosis.plot_learned)
        if diagnosis is not None and (proposed := diagnosis.experiment) is not None:
            self.experiment.text = paragraphs(proposed.sentence) + _picture(proposed.plot)


def _named(effect: str, added: Collection[str]) -> str:
    words = escape(humanize(effect))
    return f"<b>{words}</b>" if effect in added else words


def _strength(evidence: float) -> str:
    """Evidence in the words of Kass & Raftery (1995, section 3.2)."""
    words = {10.0: "very strong", 6.0: "strong", 2.0: "some"}
    return next((word for least, word in words.items() if evidence > least), "little")


def _picture(draw: Callable[[], Any]) -> str:
    return f'<img alt="" src="data:image/png;base64,{image(draw)}">'

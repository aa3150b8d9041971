"""The page: what its parts show of a session, and what the session does when they are used."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from html import escape
from typing import Any

import numpy as np
from bokeh.document import Document
from bokeh.events import DocumentReady
from bokeh.layouts import column, row
from bokeh.models import RadioGroup, UIElement

from diffthrust._support.errors import InputError
from diffthrust._support.progress import Progress
from diffthrust._support.words import humanize
from diffthrust.comparison._compare import Comparison
from diffthrust.comparison._regimes import Regime
from diffthrust.diagnosis._result import Diagnosis
from diffthrust.estimation._result import Fit
from diffthrust.simulation._runs import Run, shown_of
from diffthrust.workbench._controls import Controls
from diffthrust.workbench._lane import Lane, Stopped
from diffthrust.workbench._look import (
    HALF,
    LEFT,
    STRETCHED,
    WIDE,
    button,
    heading,
    once_ready,
    paragraphs,
    shaded,
    text,
    words_of,
)
from diffthrust.workbench._plots import Plots
from diffthrust.workbench._results import Results
from diffthrust.workbench._session import Session, Setup, Stretch, Task
from diffthrust.workbench._tools import Tools

_FOUND = ("Found", "Perhaps", "Also", "Missing")
"""How lines of a summary begin that name what the model lacks."""
_FITTING, _DIAGNOSING = "fitting", "looking for what is missing"


class Page:
    """A session in a document of Bokeh, with its model held against its logs: a comparison.

    All methods run in the thread of the document, except the work given to the three lanes:
    ``quick`` follows sliders, ``long`` fits and diagnoses, ``saving`` writes files.
    """

    def __init__(self, document: Document, session: Session, comparison: Comparison) -> None:
        self.document, self.session, self.comparison = document, session, comparison
        self.quick = Lane(document.add_next_tick_callback)
        self.long = Lane(document.add_next_tick_callback, self._show_progress)
        # in the lane of fits a save stopped a diagnosis of minutes, and a tick before its turn took
        # its place
        self.saving = Lane(document.add_next_tick_callback)
        self.opened = self._error(comparison)
        self.shown = 0
        self.sliding: dict[str, float] = {}
        self.doing = ""
        self.next: tuple[str, Callable[[], None]] | None = None
        self.regimes: tuple[Regime, ...] | None = None  # not known yet
        self.stretch: tuple[float, float] | None = None
        self.plots = Plots(comparison.runs, self.select)
        self.controls = Controls(
            session,
            shown_of(comparison.runs),
            on_edit=self.edit,
            on_slide=self._slide,
            on_release=self._release,
        )
        self.tools = Tools(
            session,
            self.saving,
            on_edit=self.edit,
            on_select=self.select,
            on_diagnose=self.diagnose_stretch,
        )
        others = {"Clocks": self.tools.clocks}
        self.results = Results(self.plots.light_up, [self.tools.stretch], others)
        self._compared_by = session.setup.fitted_by
        self._left()
        self._lay_out()
        self._show_log(0)
        self.results.show_diagnosis(session.diagnosis)
        self._show_state()

    def _left(self) -> None:
        session, source = self.session, self.session.source
        names = [log.name for log in (*source.train, *source.unseen)]
        self.title, self.verdict, self.progress = text(), text(), text()
        self.logs = RadioGroup(labels=names, active=0, **WIDE)
        self.logs.on_change("active", lambda attr, old, new: self._show_log(new))
        fit = partial(self._in_turn, _FITTING, self._fit)
        diagnose = partial(self._in_turn, _DIAGNOSING, self._diagnose)
        self.diagnosing = button("Diagnose: what is missing?", diagnose, "primary", **WIDE)
        self.adding = button("Add what was found", self._add_found, "success", **WIDE)
        self.stopping = button("Stop", self._stop, **HALF)
        self.undoing = button("Undo", partial(self.edit, session.undo), **HALF)
        self.redoing = button("Redo", partial(self.edit, session.redo), **HALF)
        self.adding.visible, self.stopping.disabled = False, True
        self.left = column(
            self.title,
            heading("Logs, with the model's error (NRMSE)"),
            self.logs,
            text(paragraphs("0: perfect; 1: no better than the mean", "quiet")),
            self.diagnosing,
            self.progress,
            self.verdict,
            self.adding,
            row(button("Fit", fit, **HALF), self.stopping),
            row(self.undoing, self.redoing),
            *self.tools.parts,
            width=LEFT,
        )

    def _lay_out(self) -> None:
        self.fails = column(**STRETCHED)
        middle = column(
            self.plots.layout,
            self.fails,
            self.results.layout,
            styles={"min-width": "min(430px, 100%)", "flex": "1 1 430px"},
            **STRETCHED,
        )
        figures = [*self.plots.figures, self.results.stairs.figure, self.results.scatter]
        self.document.title = f"{self.session.source.name}: diffthrust"
        self.document.js_on_event(DocumentReady, once_ready(figures))
        # begun earlier, work costs the page seconds to load: Python runs one thread at a time
        self.document.on_event(DocumentReady, lambda _: self._begin())
        styles = {"flex-wrap": "wrap", "gap": "6px", "max-width": "100vw"}
        self.document.add_root(
            row(self.left, middle, self.controls.layout, styles=styles, **STRETCHED)
        )

    def _begin(self) -> None:
        """Once the page is there, also where it is loaded again."""
        self._ask_regimes()
        if not self.long.busy:
            self._fit_if_needed()

    @property
    def run(self) -> Run:
        """The log that is shown, with the model along it."""
        return self.comparison.runs[self.shown]

    def close(self) -> None:
        """End the threads."""
        for lane in (self.quick, self.long, self.saving):
            lane.close()

    # -- work ------------------------------------------------------------------------------------

    def _compare(self) -> None:
        """Hold the present model against all logs, in the background."""
        task, like = self.session.task, self._like(self.session.setup)
        self.quick.ask(lambda _: task.compare(like), partial(self._compared, task), self._complain)

    def _like(self, setup: Setup) -> Comparison | None:
        """The last comparison, if it has the same effects and logs."""
        return self.comparison if self._compared_by == setup.fitted_by else None

    def _compared(self, task: Task, comparison: Comparison) -> None:
        if task.setup.fitted_by != self.session.setup.fitted_by:
            return  # of a model that was left meanwhile
        old = [run.record.log.notes for run in self.comparison.runs]
        new = [run.record.log.notes for run in comparison.runs]
        self.comparison, self._compared_by = comparison, task.setup.fitted_by
        self.regimes = None  # until those of this model are there
        if new == old:
            self.plots.update(self.run)
            self.results.show_run(comparison.model, self.run)
            self._show_regimes()
        else:
            self._show_log(self.shown, *(self.stretch or ()))
        self._show_state()
        self._ask_regimes()

    def _ask_regimes(self) -> None:
        comparison = self.comparison
        self.quick.ask(lambda _: comparison.regimes, self._found_regimes, self._complain)

    def _fit(self) -> None:
        """Fit the present model in the background; what is being fitted already is stopped."""
        task = self.session.task
        self._ask(task.fit, partial(self._fitted, task), _FITTING)

    def _fit_if_needed(self) -> None:
        if self.session.fit is None:
            self._fit()

    def _fitted(self, task: Task, result: Fit) -> None:
        self.session.accept(task, result)
        self._refresh()

    def _diagnose(self) -> None:
        task, start = self.session.task, self.session.fit if self.session.fitted else None
        self._ask(partial(task.diagnose, start), partial(self._diagnosed, task), _DIAGNOSING)

    def _diagnosed(self, task: Task, diagnosis: Diagnosis) -> None:
        self.session.accept_diagnosis(task, diagnosis)
        self.results.show_diagnosis(diagnosis)
        self._refresh()

    def diagnose_stretch(self) -> None:
        """What is wrong on the selected stretch alone?"""
        if self.stretch is None:
            self._say("Select a stretch first.", "bad")
            return
        stretch = Stretch(self.run.record.name, *self.stretch)
        show = partial(self.results.show_stretch, where=str(stretch))
        doing = f"looking at {stretch}"

        def begin() -> None:
            self._ask(partial(self.session.task.diagnose_stretch, stretch), show, doing)

        self._in_turn(doing, begin)

    def _in_turn(self, doing: str, begin: Callable[[], None]) -> None:
        """Begin, but after other work that is being done: minutes of it would be lost."""
        if self.doing in ("", doing):
            begin()
        else:
            self.next = doing, begin
            self._show_progress(self.doing, 0.0)

    def _ask(
        self, work: Callable[[Progress], Any], then: Callable[[Any], None], doing: str
    ) -> None:
        def done(result: Any) -> None:
            self.doing = ""
            self._show_progress("", -1.0)
            then(result)
            following, self.next = self.next, None
            if following:
                following[1]()

        self.doing = doing  # what was stopped ends where it next reports, which takes seconds
        waiting = "waiting until the stopped work lets go"
        self._show_progress(waiting if self.long.busy else doing, 0.0)
        self.long.ask(work, done, self._failed, stop=True)

    def _stop(self) -> None:
        """Stop what is fitted or diagnosed; a program that is being compiled is finished first."""
        self.long.stop()
        self.doing, self.next = "", None
        self._say("stopping at the next step")

    def _failed(self, error: Exception) -> None:
        if isinstance(error, Stopped) and self.doing:
            self._show_progress(self.doing, 0.0)  # begins now
            return
        self.doing, self.next = "", None
        self._show_progress("", -1.0)
        if isinstance(error, Stopped):
            self._say("stopped")
        else:
            self._complain(error)

    # -- what the user does ----------------------------------------------------------------------

    def edit(self, change: Callable[[], None], *, refitted: bool = True) -> None:
        """Make a change of the session, and the fit that it asks for; or say why it is refused."""
        try:
            change()
        except InputError as error:
            self._complain(error)
            self._show_state()
            return
        self._refresh()
        if refitted and self.session.fit is None:
            self._in_turn(_FITTING, self._fit_if_needed)

    def _add_found(self) -> None:
        self.edit(partial(self.session.tick, *self.session.found))

    def _slide(self, name: str, value: float) -> None:
        self.sliding[name] = value
        setup, index = self.session.setup, self.shown
        moved = replace(setup, values={**setup.values, **self.sliding})
        task, like = replace(self.session.task, setup=moved), self._like(setup)
        if like is not None:
            answer = partial(self._followed, setup, index)
            self.quick.ask(lambda _: task.compare(like, index).runs[0], answer, self._complain)

    def _followed(self, setup: Setup, index: int, run: Run) -> None:
        if setup.fitted_by == self.session.setup.fitted_by and index == self.shown:
            self.plots.update(run, rescaled=False)

    def _release(self) -> None:
        values, self.sliding = self.sliding, {}
        if values:
            self.edit(partial(self.session.move, values), refitted=False)

    def select(self, start: float | None, stop: float = 0.0) -> None:
        """Select a stretch of the log that is shown; none where it has no start."""
        self.stretch = None if start is None else (start, stop)
        self.plots.brush(self.stretch)
        time = self.run.time - self.run.time[0]
        first = np.inf if start is None else start
        self.results.light_up((time >= first) & (time <= stop))
        self.plots.light_up(np.zeros(time.size, bool))
        self.tools.show_stretch(self.run.record.name, self.stretch)

    # -- what is shown ---------------------------------------------------------------------------

    def _show_log(self, index: int, start: float | None = None, stop: float = 0.0) -> None:
        """Show a log from end to end, with a stretch of it selected."""
        self.shown = index
        log = self.run.record.name
        left_out = [(s.start, s.stop) for s in self.session.setup.left_out if s.log == log]
        self.plots.show(self.run, left_out)
        self.results.show_run(self.comparison.model, self.run)
        self.select(start, stop)
        self._show_regimes()

    def _refresh(self) -> None:
        self._show_state()
        self._compare()

    def _show_state(self) -> None:
        """Bring everything but the plots up to the session."""
        session, diagnosis, setup = self.session, self.session.diagnosis, self.session.setup
        self.title.text = (
            f"<h1>{escape(session.source.name)}</h1>"
            f"<p>{escape(humanize(str(session.task.model)))}</p>{self._status()}"
        )
        count = len(session.source.train)
        self.logs.labels = [
            f"{run.record.name} ({'fitted' if i < count else 'kept out'}) {run.errors.nrmse:.3g}"
            for i, run in enumerate(self.comparison.runs)
        ]
        self.controls.show(awake=self._like(setup) is not None)
        now = self._error(self.comparison) if setup.moved else None
        unseen = bool(session.source.unseen)
        self.results.show_steps(session.staircase, self.opened, now, unseen=unseen)
        self.undoing.disabled = session.at == 0
        self.redoing.disabled = session.at == len(session.history) - 1
        self.adding.visible = not set(session.found) <= set(setup.effects)
        if diagnosis:
            lines = diagnosis.summary.splitlines()
            if session.found and not diagnosis.helpful_mends:  # what it says to copy is a button
                lines = [line for line in lines if not line.startswith("Copy: ")]
            of = humanize(str(diagnosis.model))
            self.verdict.text = f"<h2>Diagnosis of: {escape(of)}</h2>" + "".join(
                paragraphs(line, "found" if line.startswith(_FOUND) else "") for line in lines
            )
        self.tools.show()

    def _error(self, comparison: Comparison) -> float:
        """NRMSE over the unseen logs, or over all where there are none."""
        runs = comparison.runs
        unseen = [run.errors.nrmse for run in runs[len(self.session.source.train) :] or runs]
        return float(np.sqrt(np.mean(np.square(unseen))))

    def _status(self) -> str:
        fit = self.session.fit
        if fit is None:
            return "<p><b>not fitted yet: start values</b></p>"
        if not self.session.fitted:
            moved = self.session.setup.moved
            what = "sliders were moved since the fit" if moved else "not the values of the fit"
            return paragraphs(f'{what}: "Fit" goes back to it', "quiet")
        words = f"fit: {humanize(fit.status.value)}"
        return paragraphs(words, "quiet" if fit.status.ok else "bad")

    def _show_progress(self, message: str, share: float) -> None:
        working = (share >= 0.0 and self.long.busy) or bool(message)
        self.stopping.disabled = not working
        self.diagnosing.disabled = self.doing == _DIAGNOSING
        bar = f'<div class="bar"><div style="width:{100 * max(share, 0.02):.0f}%"></div></div>'
        after = paragraphs(f"Then: {self.next[0]}. Stop ends both." if self.next else "", "quiet")
        self.progress.text = f"<p>{escape(message)}</p>{bar}{after}" if working else ""

    def _say(self, words: str, kind: str = "quiet") -> None:
        self.progress.text = paragraphs(words, kind)

    def _complain(self, error: Exception) -> None:
        self._say(words_of(error), "bad")

    def _found_regimes(self, regimes: tuple[Regime, ...]) -> None:
        self.regimes = regimes
        self._show_regimes()

    def _show_regimes(self) -> None:
        """Shade where each channel fails, and say it, with a button that zooms there."""
        derived = self.results.derived
        lines: list[UIElement] = []
        failing: dict[str, list[tuple[float, float]]] = {}
        for regime in self.regimes or ():
            if not {interval.signal for interval in regime.where} <= derived.keys():
                continue  # this log lacks one
            marked = self.plots.marked(regime.holds(derived))
            failing.setdefault(regime.channel, []).extend(marked)
            if marked:
                widest = max(marked, key=lambda pair: pair[1] - pair[0])
                zoom = partial(self.plots.zoom, *widest)
                closer = button("Zoom in", zoom, width=70, margin=(0, 4, 0, 4))
                sentence = shaded(regime.sentence, self.plots.colors[regime.channel])
                lines.append(row(text(sentence, **STRETCHED), closer, **STRETCHED))
        if self.regimes == () and np.isfinite(self._error(self.comparison)):
            words = "No place is known where the error gathers."
            lines = [text(paragraphs(words, "quiet"))]
        self.plots.shade(failing)
        self.fails.children = lines

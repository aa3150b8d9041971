"""What is done to the logs, and how one leaves: a stretch left out, channels shifted, files."""

from __future__ import annotations

import copy
from collections.abc import Callable
from functools import partial
from html import escape
from pathlib import Path
from typing import Any

from bokeh.layouts import column, row
from bokeh.models import CheckboxGroup, CustomJS, Spinner, TextInput, UIElement

from diffthrust.workbench._lane import Lane
from diffthrust.workbench._leaving import save, script
from diffthrust.workbench._look import LEFT, button, heading, paragraphs, text, words_of
from diffthrust.workbench._session import Session, Setup, Stretch


class Tools:
    """The lower part of the left-hand side.

    Args:
        session: what is changed.
        saving: a lane of its own: in that of fits a save stopped a diagnosis of minutes, and a
            tick before its turn took its place.
        log_shown: gives the name of the log that is shown.
        on_edit: makes a change of the session that changes the logs.
        on_select: selects a stretch of the log that is shown.
        on_diagnose: diagnoses it alone.
    """

    def __init__(
        self,
        session: Session,
        saving: Lane,
        *,
        log_shown: Callable[[], str],
        on_edit: Callable[[Callable[[], None]], None],
        on_select: Callable[[float, float], None],
        on_diagnose: Callable[[], None],
    ) -> None:
        self.session, self.saving = session, saving
        self.log_shown, self.edit, self.select = log_shown, on_edit, on_select
        wide: dict[str, Any] = {"width": LEFT - 20}
        half: dict[str, Any] = {"width": LEFT // 2 - 14}
        self.start = Spinner(title="From [s]", low=0.0, step=0.5, value=0.0, **half)
        self.stop = Spinner(title="To [s]", low=0.0, step=0.5, value=0.0, **half)
        for spinner in (self.start, self.stop):
            spinner.on_change("value", lambda attr, old, new: self._typed())
        self.note = TextInput(
            title="Reason to leave it out", placeholder="weed in the propeller", **wide
        )
        self.left_out = column(**wide)
        channels = list(dict.fromkeys(n for log in session.task.logs for n in log.units))
        channels = [name for name in channels if name != "time"]
        self.names = channels
        self.channels = CheckboxGroup(labels=channels, active=[], inline=True, **wide)
        self.seconds = Spinner(title="Later by [s]", step=0.01, value=0.0, **half)
        self.shifts = text()
        source = session.source
        beside = source.spec.path.parent if source.spec and not source.drafted else None
        folder = str(beside / "explored") if beside else f"{source.name}_explored"
        self.folder = TextInput(title="Folder", value=folder, **wide)
        self.said, self.copied = text(), text(visible=False)
        copy = "navigator.clipboard.writeText(this.tags[0]).catch(() => {})"
        self.copied.js_on_change("tags", CustomJS(code=copy.replace("this", "cb_obj")))
        self.parts = (
            heading("Save"),
            self.folder,
            row(
                button("Save", self.save, "primary", **half),
                button("Copy as Python", self._copy, **half),
            ),
            self.said,
            self.copied,
            heading(
                "A stretch of this log: type it, or draw it with the dashed square of the plots"
            ),
            row(self.start, self.stop),
            button("What is wrong here?", on_diagnose, **wide),
            self.note,
            button("Leave it out", self._leave_out, **wide),
            self.left_out,
            heading("Clocks that disagree: move channels later (below 0: earlier)"),
            self.channels,
            row(self.seconds, button("Shift", self._shift, **half)),
            self.shifts,
        )
        self._setting = False
        self._listed: tuple[Stretch, ...] = ()

    def show_stretch(self, stretch: tuple[float, float] | None) -> None:
        """Show which stretch is selected."""
        self._setting = True
        self.start.value, self.stop.value = (round(x, 3) for x in stretch or (0.0, 0.0))
        self._setting = False

    def show_setup(self, setup: Setup) -> None:
        """Show what is left out and shifted."""
        if setup.left_out != self._listed:  # a click on a button that is made anew is lost
            self._listed, self.left_out.children = setup.left_out, self._rows(setup)
        shifts = (f"{name} comes {by:+g} s later" for name, by in setup.shifts.items())
        self.shifts.text = paragraphs("\n".join(shifts))

    def _rows(self, setup: Setup) -> list[UIElement]:
        rows: list[UIElement] = []
        for index, stretch in enumerate(setup.left_out):
            words = f"{stretch.log}, {stretch.start:.4g} to {stretch.stop:.4g} s"
            words += f": {stretch.note}" if stretch.note else ""
            take_in = partial(self.session.take_in, index)
            again = button("Take in", partial(self.edit, take_in), width=70)
            rows.append(row(text(paragraphs(f"Left out: {words}"), width=LEFT - 100), again))
        return rows

    def save(self) -> None:
        """Write spec, fit, report and script into the folder, in the background."""
        session, folder = copy.copy(self.session), Path(self.folder.value)
        self._say("saving")
        self.saving.ask(lambda _: save(session, folder), self._saved, self._not_saved)

    def _saved(self, paths: tuple[Path, ...]) -> None:
        names = ", ".join(path.name for path in paths)
        folder, here = paths[0].parent, Path.cwd()
        shown = folder.relative_to(here) if folder.is_relative_to(here) else folder
        self._say(f"Saved in {shown}: {names}.")

    def _not_saved(self, error: Exception) -> None:
        self._say(words_of(error), "bad")

    def _say(self, words: str, kind: str = "") -> None:
        self.said.text = paragraphs(words, kind)

    @property
    def _ends(self) -> tuple[float, float]:
        return float(self.start.value or 0.0), float(self.stop.value or 0.0)

    def _typed(self) -> None:
        start, stop = self._ends
        if not self._setting and start < stop:
            self.select(start, stop)

    def _leave_out(self) -> None:
        stretch = Stretch(self.log_shown(), *self._ends, self.note.value)
        self.edit(partial(self.session.leave_out, stretch))

    def _shift(self) -> None:
        session, channels = self.session, [self.names[i] for i in self.channels.active]
        self.edit(partial(session.shift, float(self.seconds.value or 0.0), *channels))

    def _copy(self) -> None:
        lines = script(self.session)
        self.said.text, self.copied.tags = f"<pre>{escape(lines)}</pre>", [lines]

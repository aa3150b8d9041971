"""What is done to the logs, and how one leaves: a stretch left out, channels shifted, files."""

from __future__ import annotations

import copy
import os
from collections.abc import Callable
from functools import partial
from html import escape
from pathlib import Path

from bokeh.layouts import column, row
from bokeh.models import CheckboxGroup, CustomJS, Spinner, TextInput, UIElement

from diffthrust.workbench._lane import Lane
from diffthrust.workbench._leaving import save, script
from diffthrust.workbench._look import (
    HALF,
    STRETCHED,
    WIDE,
    WRAPPED,
    Edit,
    button,
    heading,
    paragraphs,
    text,
    words_of,
)
from diffthrust.workbench._session import Session, Setup, Stretch


class Tools:
    """What saves, and the tabs of a stretch, which is diagnosed alone, and of clocks."""

    def __init__(
        self,
        session: Session,
        saving: Lane,
        *,
        on_edit: Edit,
        on_select: Callable[[float, float], None],
        on_diagnose: Callable[[], None],
    ) -> None:
        self.session, self.saving = session, saving
        self.edit, self.select = on_edit, on_select
        self.start = Spinner(title="From [s]", low=0.0, step=0.5, value=0.0, width=80)
        self.stop = Spinner(title="To [s]", low=0.0, step=0.5, value=0.0, width=80)
        for spinner in (self.start, self.stop):
            spinner.on_change("value", lambda attr, old, new: self._typed())
        self.note = TextInput(title="Reason to leave it out", placeholder="such as weed", width=150)
        self.left_out = column(**STRETCHED)
        names = dict.fromkeys(name for log in session.task.logs for name in log.units)
        self.names = [name for name in names if name != "time"]
        self.channels = CheckboxGroup(labels=self.names, active=[], inline=True, **STRETCHED)
        self.seconds = Spinner(title="Later by [s]", step=0.01, value=0.0, **HALF)
        self.shifts, self.said, self.copied = text(), text(), text(visible=False)
        source = session.source
        beside = source.spec.path.parent if source.spec and not source.drafted else None
        folder = str(beside / "explored") if beside else f"{source.name}_explored"
        self.folder = TextInput(title="Folder", value=folder, **WIDE)
        to_clipboard = "navigator.clipboard.writeText(cb_obj.tags[0]).catch(() => {})"
        self.copied.js_on_change("tags", CustomJS(code=to_clipboard))
        self.saver = button("Save", self.save, "primary", **HALF)
        self.folder.on_change("value", lambda attr, old, new: self._show_saved())
        self.parts = (
            heading("Save"),
            self.folder,
            row(self.saver, button("Copy as Python", self._copy, **HALF)),
            self.said,
            self.copied,
        )
        low = {"align": "end"}
        hint = "Type a stretch of this log, or draw it in the plots with the dashed square."
        self.stretch = column(
            text(paragraphs(hint, "quiet"), **STRETCHED),
            row(
                self.start,
                self.stop,
                button("What is wrong here?", on_diagnose, "primary", width=155, **low),
                self.note,
                button("Leave it out", self._leave_out, width=90, **low),
                styles=WRAPPED,
            ),
            self.left_out,
            **STRETCHED,
        )
        self.clocks = column(
            heading("Clocks that disagree: move channels later (below 0: earlier)"),
            self.channels,
            row(self.seconds, button("Shift", self._shift, **HALF, **low), styles=WRAPPED),
            self.shifts,
            **STRETCHED,
        )
        self._log, self._setting = "", False
        self._listed: tuple[Stretch, ...] = ()
        self._saved_as: tuple[str, Setup] | None = None

    def show_stretch(self, log: str, stretch: tuple[float, float] | None) -> None:
        """Show which stretch of which log is selected."""
        self._log, self._setting = log, True
        self.start.value, self.stop.value = (round(x, 3) for x in stretch or (0.0, 0.0))
        self._setting = False

    def show(self) -> None:
        """Show what is left out and shifted, and whether it is saved."""
        setup = self.session.setup
        if setup.left_out != self._listed:  # a click on a button that is made anew is lost
            self._listed = setup.left_out
            self.left_out.children = [self._row(*each) for each in enumerate(setup.left_out)]
        shifts = (f"{name} comes {by:+g} s later" for name, by in setup.shifts.items())
        self.shifts.text = paragraphs("\n".join(shifts))
        self._show_saved()

    def _show_saved(self) -> None:
        """Say where what is saved is no longer what is shown, and what a save would overwrite."""
        replaced = os.path.isfile(Path(self.folder.value) / "fit.json")
        kind = "default" if replaced else "primary"
        self.saver.update(label="Overwrite" if replaced else "Save", button_type=kind)
        if self._saved_as and self._saved_as[1] != self.session.setup:
            self._say(f"The model shown is not the one that was saved in {self._saved_as[0]}.")
            self._saved_as = None

    def _row(self, index: int, stretch: Stretch) -> UIElement:
        note = f": {stretch.note}" if stretch.note else ""
        take_in = partial(self.edit, partial(self.session.take_in, index))
        words = text(paragraphs(f"Left out: {stretch}{note}"), **STRETCHED)
        return row(words, button("Take in", take_in, width=70))

    def save(self) -> None:
        """Write spec, fit, report and script into the folder, in the background."""
        session, folder = copy.copy(self.session), Path(self.folder.value)
        self._say("saving")
        self.saving.ask(
            lambda _: save(session, folder),
            partial(self._saved, session.setup),
            lambda error: self._say(words_of(error), "bad"),
        )

    def _saved(self, setup: Setup, paths: tuple[Path, ...]) -> None:
        names = ", ".join(path.name for path in paths)
        folder, here = paths[0].parent, Path.cwd()
        shown = folder.relative_to(here) if folder.is_relative_to(here) else folder
        self._say(f"Saved in {shown}: {names}.")
        self._saved_as = str(shown), setup
        self._show_saved()

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
        stretch = Stretch(self._log, *self._ends, self.note.value)
        self.edit(partial(self.session.leave_out, stretch))

    def _shift(self) -> None:
        channels = [self.names[i] for i in self.channels.active]
        self.edit(partial(self.session.shift, float(self.seconds.value or 0.0), *channels))

    def _copy(self) -> None:
        lines = script(self.session)
        self.said.text, self.copied.tags = f"<pre>{escape(lines)}</pre>", [lines]

"""The state of a workbench, without a browser: what was opened, what was changed, what came out.

Everything that is worked out is a public call of the library, `fit`, `compare` or `diagnose`, made
by a `Task`, which is frozen: it may run in another thread while the session goes on.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

from diffthrust._support.errors import InputError
from diffthrust._support.progress import ProgressOption
from diffthrust.comparison._compare import Comparison, compare
from diffthrust.diagnosis._candidates import candidates_of
from diffthrust.diagnosis._diagnose import diagnose
from diffthrust.diagnosis._result import Diagnosis
from diffthrust.estimation._fit import fit
from diffthrust.estimation._result import Fit
from diffthrust.logs._log import Log
from diffthrust.models._base.effect import Effect
from diffthrust.models._base.model import Model
from diffthrust.models._base.parameter import Parameter
from diffthrust.simulation._commands import adopted
from diffthrust.simulation._record import bind
from diffthrust.workbench._source import Source


@dataclass(frozen=True)
class Stretch:
    """Part of a log: seconds after its first sample, and why it is left out."""

    log: str
    start: float
    stop: float
    note: str = ""

    def __str__(self) -> str:
        return f"{self.log}, {self.start:.4g} to {self.stop:.4g} s"


@dataclass(frozen=True)
class Setup:
    """What a user has chosen; undo and redo go from one to another."""

    effects: tuple[str, ...] = ()
    """Names of those in the model, and of constants that it held and that are estimated now.

    In the order in which they were added: the staircase goes by it, and fits are kept by it.
    """
    values: Mapping[str, float] = field(default_factory=dict)
    """Parameters that are not as they were opened, by full name, in the model's units."""
    moved: tuple[str, ...] = ()
    """Those of them that were moved last, since the last fit."""
    left_out: tuple[Stretch, ...] = ()
    shifts: Mapping[str, float] = field(default_factory=dict)
    """Seconds by which channels come later."""

    @property
    def fitted_by(self) -> tuple[object, ...]:
        """What a fit depends on besides where it begins."""
        return self.effects, self.left_out, tuple(sorted(self.shifts.items()))


class Step(NamedTuple):
    """A step of the staircase: the effect that it has more than the one before, and its fit.

    ``added`` is empty for the first.
    """

    added: str
    fit: Fit

    @property
    def unseen(self) -> float:
        """NRMSE over the unseen logs, or over the training logs where there are none."""
        return (self.fit.holdout or self.fit.train).nrmse


@dataclass(frozen=True)
class Task:
    """A setup with its model and logs: what fits, comparisons and diagnoses are made of."""

    source: Source
    setup: Setup
    laws: Mapping[str, Effect] = field(default_factory=dict)

    @cached_property
    def model(self) -> Model:
        """The model with the effects and values of the setup, commanded as the logs are."""
        model, effects = adopted(self.source.model, self.source.train), self.setup.effects
        model = model._copy(effects=tuple(e for e in model.effects if e.name in effects))
        present = [effect.name for effect in model.effects]
        for name in effects:
            if name in model.parameters:
                model = model.free(name)
            elif name not in present:
                model = model + self.laws.get(name, name)
        has = model.parameters
        return model.replace({n: v for n, v in self.setup.values.items() if n in has})

    @cached_property
    def train(self) -> tuple[Log, ...]:
        """The training logs, shifted, and without what is left out."""
        return tuple(map(self._edited, self.source.train))

    @cached_property
    def unseen(self) -> tuple[Log, ...]:
        """The unseen logs likewise."""
        return tuple(map(self._edited, self.source.unseen))

    @property
    def logs(self) -> tuple[Log, ...]:
        """All of them, the training logs first."""
        return (*self.train, *self.unseen)

    def edits(self, log: Log) -> list[tuple[str, tuple[Any, ...]]]:
        """What is done to a log: methods of it, with their arguments."""
        edits: list[tuple[str, tuple[Any, ...]]] = []
        for channel, seconds in self.setup.shifts.items():
            if channel in log.inputs or channel in log.measured:
                edits.append(("shifted", (seconds, channel)))
        for stretch in self.setup.left_out:
            if stretch.log == log.name:
                note = (stretch.note,) if stretch.note else ()
                edits.append(("leave_out", (stretch.start, stretch.stop, *note)))
        return edits

    def _edited(self, log: Log) -> Log:
        for method, arguments in self.edits(log):
            log = getattr(log, method)(*arguments)
        return log

    def fit(self, progress: ProgressOption = None) -> Fit:
        """The model fitted to the training logs, from the present values."""
        options = self.source.options
        return fit(self.model, self.train, holdout=self.unseen, progress=progress, **options)

    def compare(self, like: Comparison | None = None, only: int | None = None) -> Comparison:
        """The model held against all logs, or one alone: a slider asks for thirty a second.

        ``like`` has the same effects and logs: its integrator steps and initial states are taken.
        """
        part = slice(None) if only is None else slice(only, only + 1)
        if like is None:
            return compare(self.model, self.logs[part])
        runs = like.runs[part]
        starts = [{name: run.start[name] for name in run.estimated} for run in runs]
        steps = max(run.substeps for run in runs)
        return compare(self.model, self.logs[part], initial=starts, substeps=steps)

    def diagnose(self, start: Fit | None = None, progress: ProgressOption = None) -> Diagnosis:
        """What the model lacks, beginning from a fit of it where there is one."""
        return diagnose(
            start or self.model, self.train, holdout=self.unseen or None, progress=progress
        )

    def diagnose_stretch(self, stretch: Stretch, progress: ProgressOption = None) -> Diagnosis:
        """What the model lacks on one stretch of one log alone."""
        log = next(log for log in self.logs if log.name == stretch.log)
        inside = log.slice(stretch.start, stretch.stop)
        return diagnose(self.model, inside, experiment=False, progress=progress)


class Session:
    """A workbench: a source, the history of its setups, and the fits made so far.

    Example:
        >>> session = Session(opened(fit))
        >>> session.tick("command_deadband")
        >>> print(session.task.model)
        thruster + command_deadband
    """

    def __init__(self, source: Source) -> None:
        self.source = source
        self.opened: tuple[str, ...] = tuple(effect.name for effect in source.model.effects)
        self.history: tuple[Setup, ...] = (Setup(self.opened),)
        self.at: int = 0
        self.fits: dict[tuple[object, ...], Fit] = {}
        self.diagnosis: Diagnosis | None = None
        self.laws: dict[str, Effect] = {}
        self._task = Task(source, self.setup, self.laws)
        if source.fit is not None:
            self.accept(self.task, source.fit)
        if source.diagnosis is not None:
            self.accept_diagnosis(self.task, source.diagnosis)

    @property
    def setup(self) -> Setup:
        """What is chosen now: one of the history, in which undo and redo go back and forth."""
        return self.history[self.at]

    @property
    def task(self) -> Task:
        """The present setup, to be worked on."""
        if self._task.setup is not self.setup:
            self._task = Task(self.source, self.setup, self.laws)
        return self._task

    @cached_property
    def addable(self) -> tuple[tuple[Effect, ...], Mapping[str, str]]:
        """The effects that may be added, and those that these logs cannot test, with the reason.

        Of the logs as they were opened: it takes a second.
        """
        source = self.source
        model = adopted(source.model, source.train)
        bare = model._copy(effects=())
        tried, untestable = candidates_of(bare, bind(bare, (*source.train, *source.unseen)))
        catalogued = {effect.name for effect in tried}
        own = tuple(effect for effect in model.effects if effect.name not in catalogued)
        return (*own, *tried), untestable

    @property
    def effects(self) -> Mapping[str, Effect]:
        """By name the effects that may be added, with the laws that were learned."""
        return {effect.name: effect for effect in self.addable[0]} | self.laws

    @cached_property
    def constants(self) -> Mapping[str, Parameter]:
        """By name what the model as it was opened holds, and may estimate."""
        named = self.source.model.parameters.items()
        return {n: p for n, p in named if p.fixed and n.partition(".")[0] not in self.opened}

    @property
    def found(self) -> tuple[str, ...]:
        """Names of what the diagnosis has found: effects, constants and learned laws."""
        if self.diagnosis is None:
            return self.opened
        present = [effect.name for effect in self.diagnosis.improved.effects]
        names = dict.fromkeys((*self.diagnosis.stages[-1].effects, *present))
        kept = {*present, *self.diagnosis.held} & {*self.effects, *self.constants}
        return tuple(name for name in names if name in kept)

    @property
    def fit(self) -> Fit | None:
        """The fit of the present model to the present logs, if it was made."""
        return self.fits.get(self.setup.fitted_by)

    @property
    def fitted(self) -> bool:
        """Whether the present values are those of this fit: an undo may go back to older ones."""
        return self.fit is not None and self.setup.values == _values(self.fit)

    @property
    def staircase(self) -> tuple[Step, ...]:
        """The fits of the model with one effect after the other, as far as they were made.

        From the model as it was opened, where none of its effects was taken back.
        """
        effects, steps = self.setup.effects, []
        first = len(self.opened) if effects[: len(self.opened)] == self.opened else 0
        for count in range(first, len(effects) + 1):
            key = replace(self.setup, effects=effects[:count]).fitted_by
            if key in self.fits:
                added = effects[count - 1] if count > first else ""
                steps.append(Step(added, self.fits[key]))
        return tuple(steps)

    # -- changes, each of which can be undone ----------------------------------------------------

    def tick(self, *names: str) -> None:
        """Add effects, or estimate constants, as one change.

        Raises:
            InputError: one is not among those that can be added.
        """
        added = tuple(name for name in names if name not in self.setup.effects)
        for name in added:
            if name not in self.effects and name not in self.constants:
                why = self.addable[1].get(name, "the model has no port for it")
                raise InputError(f"The effect {name!r} cannot be added: {why}.", "Choose another.")
        self._change(replace(self.setup, effects=(*self.setup.effects, *added)))

    def untick(self, name: str) -> None:
        """Take an effect back, or hold a constant again where the model held it."""
        kept = tuple(effect for effect in self.setup.effects if effect != name)
        values = {n: v for n, v in self.setup.values.items() if n != name}
        self._change(replace(self.setup, effects=kept, values=values))

    def move(self, values: Mapping[str, float]) -> None:
        """Set parameters, by full name; moves of the same ones are undone together.

        A key that is held down moves a slider thirty times a second.

        Raises:
            InputError: a value outside its bounds, or a name that the model does not have.
        """
        _ = self.task.model.replace(dict(values))
        now = self.task.model.parameters
        if all(math.isclose(now[name].value, value) for name, value in values.items()):
            return
        names, setup = tuple(values), self.setup
        before = self.history[self.at - 1] if self.at else None
        last = self.at == len(self.history) - 1  # an undo has not come back to it
        if last and setup.moved == names and before and before.fitted_by == setup.fitted_by:
            self.at -= 1
        self._append(replace(setup, values={**setup.values, **values}, moved=names))

    def leave_out(self, stretch: Stretch) -> None:
        """Leave a stretch out of fits and comparisons.

        Raises:
            InputError: there is no such stretch, or nothing is left beside it.
        """
        self._change(replace(self.setup, left_out=(*self.setup.left_out, stretch)))

    def take_in(self, index: int) -> None:
        """Take a stretch in again that was left out, by its place in the list."""
        kept = tuple(s for i, s in enumerate(self.setup.left_out) if i != index)
        self._change(replace(self.setup, left_out=kept))

    def shift(self, seconds: float, *channels: str) -> None:
        """Move channels in time, together: to come later by so many seconds than recorded.

        Raises:
            InputError: no number, or no channel of the logs.
        """
        shifts = {**self.setup.shifts, **dict.fromkeys(channels, seconds)}
        shifts = {channel: by for channel, by in shifts.items() if by}
        for log in self.source.train:
            _ = log.shifted(seconds, *channels)
        self._change(replace(self.setup, shifts=shifts))

    def _change(self, setup: Setup) -> None:
        if setup == self.setup:
            return
        task = Task(self.source, setup, self.laws)
        _ = task.logs, task.model  # says what is wrong
        self._task = task
        result = self.fits.get(setup.fitted_by)
        # sliders stay where the user has moved them, unless it is another model
        if result and (not setup.moved or setup.effects != self.setup.effects):
            setup = replace(setup, values=_values(result), moved=())
        self._append(setup)

    def _append(self, setup: Setup) -> None:
        """Make it the last of the history: what was undone is not done again."""
        self.history = (*self.history[: self.at + 1], setup)
        self.at += 1

    def undo(self) -> None:
        """Go back by one change."""
        self.at = max(self.at - 1, 0)

    def redo(self) -> None:
        """Go forward again."""
        self.at = min(self.at + 1, len(self.history) - 1)

    # -- what was worked out ---------------------------------------------------------------------

    def accept(self, task: Task, result: Fit) -> None:
        """Keep a fit; its values are taken if the setup asks for them still."""
        self.fits[task.setup.fitted_by] = result
        if task.setup.fitted_by == self.setup.fitted_by and task.setup.values == self.setup.values:
            setup = replace(self.setup, values=_values(result), moved=())
            self.history = (*self.history[: self.at], setup, *self.history[self.at + 1 :])

    def accept_diagnosis(self, task: Task, diagnosis: Diagnosis) -> None:
        """Keep a diagnosis, and the fits of its stages and laws: steps of the staircase."""
        self.diagnosis = diagnosis
        laws = [law.reported for law in diagnosis.laws]
        effects = [effect for result in laws for effect in result.model.effects]
        self.laws |= {e.name: e for e in effects if e.name not in self.effects}
        given, addable = task.setup.effects, {*self.effects, *self.constants, *task.setup.effects}
        fits = {(*given, *stage.effects): stage.fit for stage in diagnosis.stages}
        last = diagnosis.stages[-1].effects
        for result in laws:
            present = [effect.name for effect in result.model.effects]
            names = dict.fromkeys((*given, *last, *present))
            fits[tuple(n for n in names if n in present or n in self.constants)] = result
        for names, result in fits.items():
            if set(names) <= addable:
                self.fits.setdefault(replace(task.setup, effects=names).fitted_by, result)


def _values(result: Fit) -> dict[str, float]:
    return {name: estimate.value for name, estimate in result.parameters.items()}

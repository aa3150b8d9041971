"""The optimum of a fit: a search over its horizons, with integrator steps that are fine enough."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from diffthrust._support.progress import Progress, subtask
from diffthrust.estimation._arguments import FitOptions
from diffthrust.estimation._arrange import build
from diffthrust.estimation._horizons import by_left_out, through
from diffthrust.estimation._insensitive import alive, without_silent
from diffthrust.estimation._multistart import AGREED, NOTICED, Search
from diffthrust.estimation._per_log import with_widths
from diffthrust.estimation._problem import Problem
from diffthrust.estimation._refine import polished, refined
from diffthrust.estimation._residuals import Likelihood
from diffthrust.estimation._solver import Solved
from diffthrust.models._base.model import Model
from diffthrust.simulation._record import Record
from diffthrust.simulation._runs import Run, runs_over, step_choice
from diffthrust.simulation._step_size import MOST_SUBSTEPS

_MORE = 4
"""Numerics: times as many integrator steps where most starts could not be simulated."""
_SET_ASIDE = (
    "An optimum of higher likelihood was set aside: only coarse integrator steps have it, and with "
    "finer ones it errs more than the one that is reported."
)


class Task(NamedTuple):
    """What is asked of a fit, whatever the values of the model and its steps."""

    records: tuple[Record, ...]
    likelihood: Likelihood
    horizons: tuple[float | None, ...]  # of the segments, in turn
    options: FitOptions
    rng: np.random.Generator  # draws the starts
    tell: Progress
    refit: bool = False  # one of many of a diagnosis, with good guesses
    checked: bool = True  # it is looked at whether the optimum needs finer steps


@dataclass(frozen=True)
class Optimum:
    """Where one pass ended."""

    search: Search
    silent: tuple[str, ...]  # parameters of which the logs say nothing, held
    model: Model
    states: tuple[Mapping[str, float], ...]  # initial ones, and parameters that differ, by log
    runs: tuple[Run, ...]
    needed: int  # integrator steps per sample that the model needs
    notes: tuple[str, ...]  # on the horizons

    @property
    def problem(self) -> Problem:
        """What was solved last."""
        return self.search.problem

    @property
    def substeps(self) -> int:
        """Integrator steps per sample that were used."""
        return self.problem.substeps

    @property
    def best(self) -> Solved:
        """The optimum itself."""
        return self.search.best

    @property
    def failed(self) -> bool:
        """Not one start could be simulated."""
        return not np.isfinite(self.best.cost)

    @property
    def forbidden(self) -> bool:
        """Most starts could not be simulated, and few agree: the steps may be too coarse."""
        few = self.search.agreeing < AGREED
        return few and 2 * self.search.failed > self.search.begun

    @property
    def released(self) -> Model:
        """The model with all parameters free that were so when the pass began."""
        return self.model.free(*self.silent) if self.silent else self.model

    @property
    def unmoved(self) -> str:
        """A sentence on what was not estimated."""
        names = ", ".join(self.silent)
        return f" Not estimated, but held as given: {names}; these logs do not tell." * bool(names)

    @property
    def caution(self) -> str:
        """A sentence beside a status that says nothing of the steps; empty where they do."""
        if not self.coarse:
            return ""
        return (
            f" But it is an optimum of too coarse a simulation, with {self.substeps} of "
            f"{self.needed} integrator steps per sample: look at the notes first."
        )

    @property
    def coarse(self) -> tuple[str, ...]:
        """A note on steps that are too long."""
        if self.needed <= self.substeps:
            return ()
        return (
            f"At the optimum the model needs {self.needed} integrator steps per sample, but "
            f"{self.substeps} were used: parameters and errors are off by more than the sensor "
            f"noise explains. Fit with substeps={self.needed}; hold or bound what runs away first.",
        )


def optimum_of(
    task: Task, model: Model, substeps: int | None, first: int = 1
) -> tuple[Optimum, tuple[str, ...]]:
    """Where a search from a model's values ends, and a note where coarse steps did not do.

    With as many integrator steps per sample as the optimum needs where ``substeps`` is None; of
    these ``first`` are tried first.
    """
    # the first guess may need more steps than the optimum does
    optimum = _searched(task, model, substeps or first, (0.0, 0.9))
    if substeps or optimum.needed <= optimum.substeps:
        return _polished(task, optimum), ()
    finer = _finer(task, optimum, optimum.needed)
    finer = finer or _searched_finer(task, optimum)
    if finer.needed > finer.substeps:
        finer = _run_on(task, finer)
    refitted = (
        f"The integration step was too coarse at the optimum: refitted with {finer.substeps} "
        "steps per sample.",
    )
    return _polished(task, finer), refitted * (finer.substeps > optimum.substeps)


def _polished(task: Task, optimum: Optimum) -> Optimum:
    """The optimum at its last digits: those of coarser steps and of other horizons need none.

    Nor do fits whose steps are not looked at, which are only compared with each other: closed forms
    in the place of a curve took half of their time for it on the BlueBoat.
    """
    search = polished(optimum.search) if task.checked else optimum.search
    if np.array_equal(search.best.z, optimum.best.z):
        return replace(optimum, search=search)
    return _ended(task, search, optimum.silent, optimum.notes)


def _searched_finer(task: Task, optimum: Optimum) -> Optimum:
    """The search made anew, with as many steps as its optimum needs.

    Where most starts could not be simulated, little is known of it, and a few times the steps are
    tried: from an Otter's start, which fails with one step a sample, its damping of sway ran to
    2e5 N s/m with 32, of which the logs tell nothing, and each of 2 700 passes took four times as
    long as with 8.
    """
    substeps, forbidden = optimum.needed, optimum.forbidden
    while True:
        substeps = min(_MORE * optimum.substeps, MOST_SUBSTEPS) if forbidden else substeps
        optimum = _searched(task, optimum.released, substeps, (0.9, 1.0))
        if not (forbidden and optimum.forbidden and substeps < MOST_SUBSTEPS):
            return optimum


def _searched(task: Task, model: Model, substeps: int, shares: tuple[float, float]) -> Optimum:
    """Search from a model's values, with so many integrator steps per sample.

    It is told as the progress from one of the ``shares`` to the other.
    """
    horizons, notes = task.horizons, ()
    tell = subtask(task.tell, *shares)
    tell("compiling", 0.0)
    model = alive(model)
    arrange = partial(_arranged, task, substeps)
    problem = arrange(model)
    if horizons != (None,) and not any(grid.restarted for grid in problem.layout.grids):
        horizons = (None,)
        notes = ("No state is measured as it is: whole runs are fitted, not segments.",)
    begin = horizons[0] is None
    problem, silent, first = without_silent(problem, arrange, task.rng, begin)
    hold, starts = task.options.initial == "auto", task.options.starts
    guesses = [problem.at(values) for values in task.options.guesses]
    search = through(problem, horizons, hold, starts, task.rng, tell, first, guesses)
    if task.options.horizon == "auto" and horizons != (None,):
        # a refit's guesses were begun with at every horizon, and know more than what is drawn
        drawn = 0 if task.refit else starts
        search, notes = by_left_out(search, drawn, task.rng)
    return _ended(task, with_widths(refined(search)), silent, notes)


def _arranged(task: Task, substeps: int, model: Model) -> Problem:
    problem = build(
        model,
        task.records,
        substeps=substeps,
        initial="measured" if task.options.initial == "measured" else "estimate",
        segmented=any(h is not None for h in task.horizons),
        likelihood=task.likelihood,
    )
    return replace(problem, quick_compile=task.refit, compared=not task.checked)


def _run_on(task: Task, optimum: Optimum) -> Optimum:
    """The optimum followed to finer and finer steps, as long as it moves on with them.

    Steps that are too coarse for larger values forbid these: on the bench of the NGS a fit ended
    with a loss by axial flow of 2.8 where 2 steps a sample end, of 5.7 with 4, 11 with 8, and 16
    with 16 as with 32 (+- 1.2). Where the likelihood gains nothing more, the logs do not tell such
    values; nor does it where finer steps uphold another optimum alone.
    """
    while optimum.substeps < MOST_SUBSTEPS:
        further = _finer(task, optimum, max(optimum.needed, 2 * optimum.substeps))
        if further is None:
            return optimum
        gained = optimum.best.cost - further.best.cost
        optimum = further
        if gained < NOTICED:
            return optimum
    return optimum


def _finer(task: Task, optimum: Optimum, substeps: int) -> Optimum | None:
    """The optimum followed to finer steps; none where it is another one there.

    Finer steps move an optimum, and raise no hills: a search that begins anew would do all the work
    again. But if the errors are larger with them, the coarse steps were what fitted, and the best
    of the optima that finer steps uphold is the one, if there is any. Where most starts could not
    be simulated, the coarse steps were what forbade them. The horizon stays. Nor are the caller's
    guesses begun with again: on the bench of the NGS they took a third of a refit.
    """
    if optimum.forbidden:
        return None
    problem = optimum.problem.stepped(substeps)
    search, notes = optimum.search.followed(problem, with_guesses=False), optimum.notes
    if optimum.search.improves_on(search):
        upheld = optimum.search.upheld(problem)
        if upheld is None or search.improves_on(upheld):
            return None
        search, notes = upheld, (*optimum.notes, _SET_ASIDE)
    return _ended(task, with_widths(refined(search)), optimum.silent, notes)


def _ended(task: Task, search: Search, silent: tuple[str, ...], notes: tuple[str, ...]) -> Optimum:
    """The optimum with its runs, and the steps that they need."""
    final = search.problem
    model, substeps = final.model_at(search.best.z), final.substeps
    states = tuple(final.numbers_by_log(search.best.z))
    failed = not np.isfinite(search.best.cost)
    runs = runs_over(model, task.records, initial=None if failed else states, substeps=substeps)
    needed = substeps
    if task.checked:
        k = _most_demanding(runs)
        choice = step_choice(model, runs[k])
        runs, needed = (*runs[:k], replace(runs[k], choice=choice), *runs[k + 1 :]), choice.substeps
    return Optimum(search, silent, model, states, runs, needed, notes)


def _most_demanding(runs: Sequence[Run]) -> int:
    """The run that tells how many integrator steps all of them need.

    That of the longest step, and among equal ones of the largest motion: loads are stiffer the
    faster it is.
    """
    peaks = [_peaks(run) for run in runs]
    largest = {name: max(p.get(name, 0.0) for p in peaks) for peak in peaks for name in peak}
    motion = [sum(p / (largest[name] or 1.0) for name, p in peak.items()) for peak in peaks]
    return max(range(len(runs)), key=lambda k: (runs[k].record.step, motion[k], runs[k].time.size))


def _peaks(run: Run) -> dict[str, float]:
    return {n: float(np.max(abs(np.nan_to_num(t.measured)))) for n, t in run.channels.items()}

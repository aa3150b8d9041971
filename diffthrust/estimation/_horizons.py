"""Horizons of a fit: from short segments, set to the measured state again, to whole runs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.progress import Progress, subtask
from diffthrust.estimation._arrange import rearranged, restarts
from diffthrust.estimation._multistart import Search, search
from diffthrust.estimation._problem import Problem
from diffthrust.estimation._solver import Solved, solve
from diffthrust.models._base.model import Model
from diffthrust.simulation._record import Record
from diffthrust.simulation._runs import Run, pooled_errors, runs_over

_HORIZON_MEND = "Give seconds, a list of seconds, or None for whole runs."
_FOLDS = 4
"""Logs are left out in so many groups."""
_BUDGET = 10
"""Steps of a fit to the rest, which begins near its end."""

Hidden = Mapping[int, tuple[float, float]]
"""By log, the time [s] from which to which its measurements are hidden."""


def folds(records: Sequence[Record]) -> tuple[Hidden, ...]:
    """What to hide in turn: groups of logs, or either half of a single log."""
    if len(records) > 1:
        count = min(_FOLDS, len(records))
        return tuple(
            dict.fromkeys(range(i, len(records), count), (-math.inf, math.inf))
            for i in range(count)
        )
    middle = 0.5 * float(records[0].time[0] + records[0].time[-1])
    return {0: (-math.inf, middle)}, {0: (middle, math.inf)}


def held_out_error(ended: Search) -> float:
    """The error (NRMSE) of whole runs over what was hidden from the fit; infinite where it fails.

    Hidden measurements become missing values in numbers of the same shape, so that nothing is
    compiled again, and each fit continues from the optimum over all logs.
    """
    runs: list[Run] = []
    for hidden in folds(ended.problem.records):
        remaining = without(ended.problem, hidden)
        if not np.all(remaining.numbers.counts > 0):  # only hidden logs measure some channel
            continue
        solved = solve(remaining, ended.best.z, budget=_BUDGET)
        if not np.isfinite(solved.cost):
            return math.inf
        runs += _runs(remaining, solved, hidden)
    return pooled_errors(runs).nrmse if runs else math.inf


def without(problem: Problem, hidden: Hidden) -> Problem:
    """The same problem with some measurements missing."""
    batches = []
    for batch, indices in zip(problem.numbers.batches, problem.order, strict=True):
        measured = np.array(batch.measured)
        for row, index in enumerate(indices):
            if index in hidden:
                first, last = hidden[index]
                measured[row, :, (batch.time[row] >= first) & (batch.time[row] <= last)] = np.nan
        batches.append(replace(batch, measured=measured))
    return rearranged(problem, batches)


def _runs(problem: Problem, solved: Solved, hidden: Hidden) -> tuple[Run, ...]:
    """The model of a fit over whole records, beside what was hidden from it."""
    model, substeps = problem.model_at(solved.z), problem.substeps
    held_out = []
    for index, (first, last) in hidden.items():
        record = problem.records[index]
        outside = (record.time < first) | (record.time > last)
        measured = {n: np.where(outside, np.nan, v) for n, v in record.measured.items()}
        if any(np.isfinite(values).any() for values in measured.values()):
            held_out.append(replace(record, measured=measured) if outside.any() else record)
    return runs_over(model, held_out, substeps=substeps) if held_out else ()


_GROWTH = 1.1
"""Errors accumulate where whole runs raise a channel's noise by more than this factor over that of
segments: then longer ones are tried as well, and it is told what was decided and why. Where they do
not, whole runs are taken, for they use the most of a log."""
_TIE = 0.01
"""Another horizon must be better by this share than the model's own where errors accumulate."""
_LONGER = 3.0
"""The longer segments are so many times as long as a model's own horizon."""
_FIRST = 0.6
"""Share of the work that the first of several horizons takes, with all its starts."""


def schedule(
    model: Model, records: Sequence[Record], horizon: float | Sequence[float | None] | str | None
) -> tuple[float | None, ...]:
    """The horizons [s] to go through, the last one to be judged by; ``None`` means whole runs.

    Raises:
        InputError: not a number of seconds, or one that is no longer than a step.
    """
    if isinstance(horizon, str):
        if horizon != "auto":
            raise InputError(
                f"horizon: expected seconds or 'auto', found {horizon!r}.", _HORIZON_MEND
            )
        longest = max(record.duration for record in records)
        restartable = all(record.measured_states for record in records)
        if model.horizon is None or longest <= 2 * model.horizon or not restartable:
            return (None,)
        # Whole runs at once stick in poor minima. Esso Osaka, basic vessel, runs of 120 to 150 s:
        # the NRMSE of surge, sway and yaw rate over unseen runs was 0.46, 1.11, 1.07 fitted over
        # whole runs, and 0.30, 0.78, 0.46 fitted on segments of 20 s.
        return (model.horizon / 10, model.horizon / 3, model.horizon)
    stages = horizon if isinstance(horizon, Sequence) else (horizon,)
    least = max(record.step for record in records)
    for seconds in stages or ((),):
        number = isinstance(seconds, int | float) and least < seconds < math.inf
        if seconds is not None and not number:
            raise InputError(
                f"horizon: expected a positive number of seconds above the step of {least:g} s, "
                f"found {seconds!r}.",
                _HORIZON_MEND,
            )
    return tuple(stages)


def to_whole_runs(horizons: Sequence[float | None]) -> tuple[float | None, ...]:
    """The same horizons, and whole runs at the end.

    A boat in a current, one thruster a fifth weaker, its positions measured: both effects, fitted
    to whole runs at once, even from their true values, ended at an NRMSE of 0.38, and through
    segments of 2, 7 and 20 s at 0.093.
    """
    return (*horizons, *([None] if horizons[-1] is not None else []))


def through(
    problem: Problem,
    horizons: Sequence[float | None],
    hold: bool,
    starts: int,
    rng: np.random.Generator,
    tell: Progress,
    first: Solved | None = None,
    guesses: Sequence[np.ndarray] = (),
) -> Search:
    """Search at the first horizon, then follow the optimum as the horizon grows.

    With ``hold``, segments begin at the measured state throughout. ``first`` is the first start at
    the first horizon where it was begun already. The ``guesses`` are begun with at every horizon:
    what they are known to be good for may be lost on the way through the segments.
    """
    stage = restarts(problem, horizons[0], hold=hold and horizons[0] is not None)
    share = 1.0 if len(horizons) == 1 else _FIRST
    say = subtask(tell, 0.0, share)
    ended = search(stage, starts, rng, say, first, guesses, passing=len(horizons) > 1)
    for horizon in horizons[1:]:
        stage = restarts(problem, horizon, hold=hold and horizon is not None)
        tell(f"segments of {horizon:g} s" if horizon else "whole runs", share)
        share += (1.0 - _FIRST) / len(horizons[1:])
        ended = ended.followed(stage, passing=horizon != horizons[-1])
    return ended


def by_left_out(
    ended: Search, starts: int, rng: np.random.Generator
) -> tuple[Search, tuple[str, ...]]:
    """Whole runs where errors do not accumulate; else the horizon that left-out logs choose.

    Where random forces act or an effect is missing, errors accumulate, and either may be better:
    over whole runs a fit bends the parameters to what it lacks, over segments it sees no drift.
    Then a note tells what was chosen and why.
    """
    if not np.isfinite(ended.best.cost):
        return ended, ()
    entire = _followed(ended, None)
    # where errors do not accumulate, no other valley is better
    entire = _begun_anew(entire, starts, rng) if _accumulate(ended, entire) else entire
    if not _accumulate(ended, entire):
        return entire, ()
    several = [ended, entire]
    longer = _LONGER * (ended.problem.horizon or 0.0)
    if max(r.duration for r in ended.problem.records) > 2 * longer:
        several.insert(1, _followed(ended, longer))
    errors = [held_out_error(candidate) for candidate in several]
    best = int(np.argmin([e * (1.0 + _TIE * (i > 0)) for i, e in enumerate(errors)]))
    ways = [_words(candidate.problem.horizon) for candidate in several]
    rivals = (f"{e:.3g} if fitted {way}" for way, e in zip(ways, errors, strict=True))
    note = (
        f"Fitted {ways[best]}, by what the fit says of logs that are left out "
        f"of it: whole runs of these err by {', '.join(rivals)} (NRMSE)."
    )
    return several[best], (note,)


def _accumulate(ended: Search, entire: Search) -> bool:
    growth = entire.best.quadratic.sigma / ended.best.quadratic.sigma
    return not np.all(growth <= _GROWTH)


def _followed(ended: Search, horizon: float | None) -> Search:
    """The search carried on to another horizon; segments begin as they did."""
    held = ended.problem.held and horizon is not None
    return ended.followed(restarts(ended.problem, horizon, hold=held))


def _begun_anew(entire: Search, starts: int, rng: np.random.Generator) -> Search:
    """The search over whole runs that came from segments, and begun there anew.

    Where much is missing, the way through segments may lead into another valley. BlueBoat with its
    forces exchanged, a basic vessel: from segments of 20 s to an NRMSE of 0.76 in training and 1.08
    on unseen runs, from whole runs at once to 0.68 and 0.76. On the Esso Osaka it is the other way.
    Starts are drawn once: none of the two dozen that are drawn of a made boat for lack of agreement
    came near the optimum that was known, and they took three quarters of all steps. With none to
    draw, what was followed stands.
    """
    if not starts:
        return entire
    anew = search(entire.problem, starts, rng, guesses=[entire.best.z], once=True)
    # of the same optimum the first search tells who agreed
    return anew if anew.improves_on(entire) else entire


def _words(horizon: float | None) -> str:
    return "over whole runs" if horizon is None else f"on segments of {horizon:g} s"

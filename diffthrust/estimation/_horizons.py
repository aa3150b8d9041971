"""Horizons of a fit: from short segments, set to the measured state again, to whole runs."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.progress import Progress, part
from diffthrust.estimation._arrange import restarts
from diffthrust.estimation._multistart import Search, search
from diffthrust.estimation._problem import Problem
from diffthrust.estimation._solver import Solved
from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model

_GROWTH = 1.1
"""Whole runs are fitted where they raise no channel's noise by more than this factor."""
_FIRST = 0.6
"""Share of the work that the first of several horizons takes, with all its starts."""


def schedule(
    model: Model, logs: Sequence[Log], horizon: float | Sequence[float | None] | str | None
) -> tuple[float | None, ...]:
    """The horizons [s] to go through, the last one to be judged by; ``None`` means whole runs.

    Raises:
        InputError: not a number of seconds, or one that is no longer than a step.
    """
    if isinstance(horizon, str):
        if horizon != "auto":
            raise InputError(f"horizon: expected seconds or 'auto', found {horizon!r}.", "")
        longest = max(log.duration for log in logs)
        restartable = all(any(n in log.measured for n in model.states) for log in logs)
        if model.horizon is None or longest <= 2 * model.horizon or not restartable:
            return (None,)
        return (model.horizon / 10, model.horizon / 3, model.horizon)
    stages = horizon if isinstance(horizon, Sequence) else (horizon,)
    least = max(log.step for log in logs)
    for seconds in stages or ("nothing",):
        number = isinstance(seconds, int | float) and math.isfinite(seconds)
        if seconds is not None and not (number and float(seconds) > least):
            raise InputError(
                f"horizon: expected a positive number of seconds above the step of {least:g} s, "
                f"found {seconds!r}.",
                "Give seconds, a list of seconds, or None for whole runs.",
            )
    return tuple(stages)


def through(
    problem: Problem,
    horizons: Sequence[float | None],
    hold: bool,
    starts: int,
    rng: np.random.Generator,
    tell: Progress,
    first: Solved | None = None,
    guesses: Sequence[np.ndarray] = (),
) -> tuple[Search, Problem]:
    """Search at the first horizon, then follow the optimum as the horizon grows.

    With ``hold``, segments begin at the measured state throughout. ``first`` is the first start at
    the first horizon where it was begun already. The ``guesses`` are begun with at every horizon:
    what they are known to be good for may be lost on the way through the segments.
    """
    stage = restarts(problem, horizons[0], hold=hold and horizons[0] is not None)
    share = 1.0 if len(horizons) == 1 else _FIRST
    ended = search(stage, starts, rng, part(tell, 0.0, share), first, guesses)
    for horizon in horizons[1:]:
        stage = restarts(problem, horizon, hold=hold and horizon is not None)
        tell(f"segments of {horizon:g} s" if horizon else "whole runs", share)
        share += (1.0 - _FIRST) / len(horizons[1:])
        ended = ended.followed(stage)
    return ended, stage


def whole_runs(
    ended: Search, stage: Problem, horizon: float | None
) -> tuple[Search, Problem, float | None, tuple[str, ...]]:
    """Go on to whole runs where the model holds over them as well as over segments.

    Where it does not, the error of whole runs is mostly what accumulates from a missing effect or
    from random forces, and fitting it would bend the parameters; a note says so.
    """
    if not np.isfinite(ended.best.quadratic.cost):
        return ended, stage, horizon, ()
    entire = restarts(stage, None)
    further = ended.followed(entire)
    growth = further.best.quadratic.sigma / ended.best.quadratic.sigma
    if np.isfinite(further.best.quadratic.cost) and np.all(growth <= _GROWTH):
        return further, entire, None, ()
    worst = int(np.argmax(np.nan_to_num(growth, nan=np.inf)))
    note = (
        f"Fitted on segments of {horizon:g} s: over whole runs the error of "
        f"'{stage.layout.channels[worst]}' is {growth[worst]:.1f} times as large, so something is "
        "missing from the model or random forces act."
    )
    return ended, stage, horizon, (note,)

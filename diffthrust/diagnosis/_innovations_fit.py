"""The model with some effects, fitted to the same logs again and again.

A program is compiled for the model with a few effects (`CandidateFitter.ready`), at their null
values, where they do nothing. Which parameters move is a matter of numbers
(`Problem.focus`), so that hundreds of trials share one compilation; and effects that have been
compiled together stay together, so that few are made. What a trial has come to, and under which
limit of errors, it carries itself.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from threading import RLock
from typing import NamedTuple, TypeVar

import numpy as np
from jaxtyping import Float

from diffthrust._support.errors import InputError
from diffthrust.diagnosis._held import of_effect
from diffthrust.diagnosis._linear_response import LinearResponse
from diffthrust.diagnosis._ports import places_of
from diffthrust.diagnosis._score_test import promised_gain
from diffthrust.estimation._arrange import build
from diffthrust.estimation._laws import StudentT
from diffthrust.estimation._likelihood import Quadratic
from diffthrust.estimation._observer import (
    CLIP,
    REAL,
    WIDE,
    guesses,
    is_memory,
    observer_of,
    uncorrected,
)
from diffthrust.estimation._one_step import Pass, cost, passes, with_clip
from diffthrust.estimation._problem import Problem
from diffthrust.estimation._registry import NOISE_MODELS
from diffthrust.estimation._residuals import Innovations
from diffthrust.estimation._solver import solve
from diffthrust.models._base.effect import Effect
from diffthrust.models._base.model import Model
from diffthrust.simulation._levels import port_readings
from diffthrust.simulation._record import Record, measured_outputs

Item = TypeVar("Item")
Answer = TypeVar("Answer")

_ENOUGH = 0.05
"""A trial ends where a full step would gain less log-likelihood than this."""
_LONG = 40
"""Steps that carry a trial to its end: a search that goes on creeps along a flat ridge."""
_TOGETHER = 8
"""So many effects are compiled together, if no more are tried at once: each program takes longer to
compile than all of its passes take."""
_MOST_PRESENT = 5
"""So many effects, of the most parameters, find room in a trial."""
_ROOM = 4
"""Parameters of effects that are estimated together with all of the model's and the observer's;
with more, the observer's memories are held at what they were, and then its gains."""


def side_by_side(work: Callable[[Item], Answer], items: Sequence[Item]) -> list[Answer]:
    """``work`` on each item, on all cores: compiled code runs without Python's lock.

    The first item goes alone, so that nothing is compiled twice at the same time.
    """
    first = [work(item) for item in items[:1]]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return first + list(pool.map(work, items[1:]))


@dataclass(frozen=True, eq=False)
class ResidualClip:
    """How large an error may be that corrects the states; larger ones correct them no further.

    Args:
        size: of a large error; infinite without a limit.
        reach: errors are limited at so many times that.
    """

    size: Float[np.ndarray, " channels"]
    reach: float = 1.0

    def on(self, problem: Problem) -> Problem:
        """A problem under this limit."""
        return with_clip(problem, self.size, self.reach)


@dataclass(frozen=True, eq=False)
class TrialFit:
    """The model with some effects, fitted in the innovations form.

    Args:
        effects: names of the effects that are present, and of held parameters that are freed.
        values: all parameters by full name, the observer's included.
        quadratic: the likelihood near the optimum, in the coordinates of ``names``.
        names: the parameters that were estimated.
        cost: negative log-likelihood, under ``limit``.
        promise: gain of log-likelihood that a full step within the bounds would still bring.
        begin: the initial states of the logs, one after the other.
        limit: how errors were limited.
        problem: the training logs.
        bare: makes the same problem with no other effects in its program.
    """

    effects: tuple[str, ...]
    values: Mapping[str, float]
    quadratic: Quadratic
    names: tuple[str, ...]
    cost: float
    promise: float
    begin: Float[np.ndarray, " starts"] | None
    limit: ResidualClip
    problem: Problem = field(repr=False)
    bare: Callable[[], Problem] = field(repr=False)

    @property
    def expected(self) -> float:
        """The cost that a full step promises."""
        return self.cost - self.promise

    def parameters_of(self, effect: str | None = None) -> list[str]:
        """The estimated parameters of one effect; of the last one if not said."""
        effect = effect or self.effects[-1]
        return [n for n in self.names if of_effect(n, effect)]

    @property
    def at_values(self) -> Problem:
        """The training logs at these values and under this limit."""
        return self._within(self.problem)

    def _within(self, problem: Problem) -> Problem:
        return self.limit.on(problem.focus(self.names, self.values, self.begin))

    @cached_property
    def passed(self) -> list[Pass]:
        """Its pass over each training log."""
        return passes(self.at_values)

    @cached_property
    def path(self) -> list[dict[str, np.ndarray]]:
        """For each training log the series of inputs and states, predicted one step ahead."""
        return [one.path for one in self.passed]

    @cached_property
    def response(self) -> LinearResponse:
        """What the errors answer to anything that is added to the model."""
        return LinearResponse(self._within(self.bare()))


class Compiled(NamedTuple):
    """What is compiled together: the effects, the training logs, and the unseen ones."""

    effects: frozenset[str]
    problem: Problem
    unseen: Problem | None


class CandidateFitter:
    """Fits of a model with any of the candidates, over the same logs.

    Args:
        model: the model with the effects that it has already.
        candidates: effects to try, at any values.
        records: training records.
        unseen: unseen records.
        substeps: integrator steps per sample.
        noise_model: with "ar1" no random forces act and no state is corrected, as in a fit with
            that noise.
        held: parameters that the model holds at a number and that are candidates by their names.
    """

    def __init__(
        self,
        model: Model,
        candidates: Sequence[Effect],
        records: Sequence[Record],
        unseen: Sequence[Record],
        substeps: int = 1,
        noise_model: str = "white",
        held: Sequence[str] = (),
    ) -> None:
        self.model = model
        self.records = tuple(records)
        self.channels = measured_outputs(model, records)
        self.places = places_of(model, records[0], self.channels)
        self.constants = tuple(held)
        self.candidates = {effect.name: effect for effect in candidates}
        self.free = tuple(n for n, p in model.parameters.items() if not p.fixed)
        remembering = {p for e in model.effects if e.memory for p in e.ports}
        lasts = NOISE_MODELS[noise_model].lasts
        observer = observer_of(model, records[0], self.channels, remembering, lasts)
        likelihood = Innovations(law=StudentT(), observer=observer)
        self._arranged = partial(build, substeps=substeps, likelihood=likelihood, compact=True)
        self._unseen, self._lock = tuple(unseen), RLock()
        first = self._arranged(model, self.records)
        self.nuisance = tuple(n for n, p in first.nuisance.items() if not p.fixed)
        self.width = len(self.free) + len(self.nuisance) + _ROOM
        self._programs = [self._program(())]
        counts = first.numbers.counts
        self.counts = dict(zip(self.channels, map(float, counts), strict=True))
        self.samples = float(np.sum(counts))
        if self.samples <= (numbers := len(self.free) + len(self.nuisance)):
            raise InputError(
                f"The training logs hold {self.samples:.0f} measurements, and {numbers} numbers of "
                f"'{model}' and of the noise are to be estimated.",
                "Give longer logs, or fix parameters.",
            )

    def _program(self, effects: Collection[str], least: int = 0) -> Compiled:
        """The model with these effects at their nulls; constants to try may be freed."""
        problem = self._problem(effects, self.records, least)
        unseen = self._problem(effects, self._unseen, least) if self._unseen else None
        return Compiled(frozenset((*effects, *self.constants)), problem, unseen)

    def _problem(
        self, effects: Collection[str], records: Sequence[Record], least: int = 0
    ) -> Problem:
        model, free = self.model.free(*self.constants), len(self.constants)
        for name in self.candidates:
            if name in effects:
                model = model + self.candidates[name].at_null()
                free += self._free(name)
        width = max(self.width - _ROOM + min(free, _ROOM), least)
        return self._arranged(model, records, width=width)

    def _free(self, name: str) -> int:
        """Parameters that are estimated of a candidate."""
        if name in self.constants:
            return 1
        return sum(not p.fixed for p in self.candidates[name]._parameters.values())

    def ready(self, effects: Collection[str], later: Sequence[str] = ()) -> Compiled:
        """What is compiled for trials of these effects; made where there is none yet.

        As far as there is a place for them, those come along that were compiled last, and then
        those that may be tried ``later``, the likeliest first.
        """
        with self._lock:
            for program in reversed(self._programs):
                if program.effects >= {*effects}:
                    return program
            last = sorted(self._programs[-1].effects)
            wanted = dict.fromkeys((*effects, *last, *later))
            wanted = [n for n in wanted if n in self.candidates][: max(_TOGETHER, len(effects))]
            # beside those that are there each must find room for all of its own
            most = sum(sorted(map(self._free, wanted))[-_MOST_PRESENT:])
            self._programs.append(self._program(wanted, len(self.free) + most))
            return self._programs[-1]

    @property
    def problem(self) -> Problem:
        """The training logs, with what was compiled last."""
        return self._programs[-1].problem

    @property
    def unseen(self) -> Problem | None:
        """The unseen logs, with what was compiled last."""
        return self._programs[-1].unseen

    def moved(self, effects: Sequence[str]) -> tuple[str, ...]:
        """The parameters that are estimated with some effects present."""
        named = self.ready(effects).problem.named
        theirs = [
            n
            for n in named
            if n not in self.free
            and any(of_effect(n, effect) for effect in effects)
            and not named[n].fixed
        ]
        free = max(0, self.width - len(self.free) - len(theirs))
        return (*self.free, *sorted(self.nuisance, key=is_memory)[:free], *theirs)  # gains first

    def solve(
        self,
        effects: Sequence[str],
        values: Mapping[str, float],
        begin: np.ndarray | None,
        limit: ResidualClip,
        budget: int = 40,
        still: Collection[str] = (),
    ) -> TrialFit:
        """Fit with some effects present, from given values and initial states.

        Parameters named in ``still`` stay where they are.
        """
        names = tuple(name for name in self.moved(effects) if name not in still)
        whole = self.ready(effects).problem
        problem = limit.on(whole.focus(names, values, begin))
        optimum = solve(problem, problem.start(), budget, _ENOUGH)
        q, z = optimum.quadratic, optimum.z
        known = (tuple(effects), problem.values(z), q, names)
        bare = partial(self._problem, effects, self.records)
        ended = partial(TrialFit, *known, limit=limit, problem=whole, bare=bare)
        if not np.isfinite(q.cost):
            return ended(cost=np.inf, promise=0.0, begin=begin)
        low, high = problem.limits()
        outward = ((z <= low + 1e-9) & (q.gradient >= 0)) | ((z >= high - 1e-9) & (q.gradient <= 0))
        return ended(
            cost=float(q.cost), promise=promised_gain(q, ~outward), begin=z[problem.shared :]
        )

    def further(self, trial: TrialFit, budget: int = 40) -> TrialFit:
        """A trial carried on."""
        return self.solve(trial.effects, trial.values, trial.begin, trial.limit, budget)

    def settled(
        self,
        effects: Sequence[str],
        values: Mapping[str, float],
        begin: np.ndarray | None,
        limit: ResidualClip,
    ) -> TrialFit:
        """Fit with some effects present to the end, from several guesses of the noise.

        An effect that explains much leaves little noise: the observer's gains may be far from what
        they were. Then large errors are limited to a few times what errors now are: the trial has
        a limit of its own.
        """

        def one(guess: Mapping[str, float]) -> TrialFit:
            return self.solve(effects, {**values, **guess}, begin, limit, budget=12)

        begun = side_by_side(one, guesses(self.nuisance))
        if not any(np.isfinite(trial.cost) for trial in begun):  # corrections carry it off
            begun.append(one({n: 0.0 for n in self.nuisance if not is_memory(n)}))
        trial = min(begun, key=lambda trial: trial.expected)
        if not np.isfinite(trial.cost):  # corrections ran away, by a spike before a gap
            trial = one(uncorrected(self.nuisance))
        for _ in range(2):
            trial = self.further(trial, budget=_LONG)
            trial = replace(trial, limit=ResidualClip(CLIP * trial.quadratic.sigma, limit.reach))
        return self.further(trial, budget=_LONG)

    def base(
        self, effects: Sequence[str] = (), values: Mapping[str, float] | None = None
    ) -> TrialFit:
        """The model as it is, or with some effects, from its own values or from given ones.

        Here it is seen at what size errors are limited.
        """
        known, named = values or {}, self.ready(effects).problem.named
        start = {n: known.get(n, p.value) for n, p in named.items()}
        limited = self.settled(
            effects, start, None, ResidualClip(np.full(len(self.channels), np.inf))
        )
        widened = replace(limited, limit=replace(limited.limit, reach=WIDE))
        wide = self.further(widened, budget=_LONG)
        return wide if wide.cost < limited.cost - REAL else limited

    def cost(
        self,
        effects: Sequence[str],
        values: Mapping[str, float],
        begin: np.ndarray | None,
        limit: ResidualClip,
    ) -> float:
        """Negative log-likelihood at given values: a tenth of the work of a derivative."""
        problem = self.ready(effects).problem
        return cost(limit.on(problem.focus(self.moved(effects), values, begin)))

    def absent(self, effect: str, values: Mapping[str, float]) -> dict[str, float]:
        """The values with one effect at its null, or one parameter where it is held."""
        if effect in self.constants:
            return {**values, effect: self.model.parameters[effect].value}
        null = self.candidates[effect].at_null()
        return {**values, **{f"{effect}.{n}": p.value for n, p in null._parameters.items()}}

    def readings(self, trial: TrialFit) -> list[dict[str, np.ndarray]]:
        """What passes each port of the model as it was given, log by log."""
        return [port_readings(self.model, path) for path in trial.path]


def with_values(model: Model, values: Mapping[str, float]) -> Model:
    """A model at the values of a trial."""
    return model.replace({n: values[n] for n in model.parameters if n in values})

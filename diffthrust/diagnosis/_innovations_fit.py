"""Fits of the model with any of the candidate effects to the same logs, in the innovations form.

A program is compiled for the model with several effects (`CandidateFitter.ready`), which do nothing
at their null values. The choice of estimated parameters is data, not code (`Problem.focus`): one
compilation serves hundreds of trials. Over short logs one program has all candidates, and serves a
whole search. Over long ones, where they would cost more at each pass than they save, later programs
include the effects of earlier ones, so that few are needed. A trial holds its values, the clip of
its errors, and its program.
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
from diffthrust.diagnosis._candidates import of_effect, places_of
from diffthrust.diagnosis._linear_response import LinearResponse, promised_gain
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.estimation._arguments import NOISE_MODELS
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
from diffthrust.estimation._residuals import Innovations
from diffthrust.estimation._solver import solve
from diffthrust.models._base.effect import Effect
from diffthrust.models._base.model import Model
from diffthrust.simulation._levels import port_readings
from diffthrust.simulation._record import Record, measured_outputs

Item = TypeVar("Item")
Answer = TypeVar("Answer")

_ENOUGH = 0.05
"""Numerics: a fit ends when a full step would gain less log-likelihood than this."""
_LONG = 40
"""Numerics: the largest number of steps of a complete fit: a search that needs more creeps along a
flat ridge."""
_SHORT = 5000
"""Numerics: with so many measurements at most, all candidates are compiled together: on the maps of
a T200 (1 600) a program with all takes as long to compile as one with eight, and replaces ten. On
the logs of a bench (9 000) it saves a seventh of a first diagnosis, and every later one takes a
quarter longer; a boat (14 400, eleven candidates) takes longer in any case."""
_TOGETHER = 8
"""Numerics: number of effects compiled together over longer logs, unless more are tried at once:
compiling a program takes longer than all of its passes."""
_ADDED = 2
"""Numerics: a program has room for so many of the effects that are tried, beside those present."""
_MOST_PRESENT = 5
"""Numerics: a program has room for the parameters of this many of its largest effects at once; one
with all candidates for those of as many as a search may add."""
_ROOM = 4
"""Numerics: parameters of effects that are estimated together with all of the model's and the
observer's. With more, first the observer's memories are fixed at their values, then its gains."""


def side_by_side(work: Callable[[Item], Answer], items: Sequence[Item]) -> list[Answer]:
    """Apply ``work`` to each item in threads on all cores: compiled code releases Python's lock.

    The first item is finished before the others start, so that nothing is compiled twice.
    """
    first = [work(item) for item in items[:1]]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return first + list(pool.map(work, items[1:]))


@dataclass(frozen=True, eq=False)
class ResidualClip:
    """The clip of the errors that correct the states.

    Args:
        size: size of a large error, by channel; infinite without a clip.
        reach: errors are clipped at this multiple of ``size``.
    """

    size: Float[np.ndarray, " channels"]
    reach: float = 1.0

    def on(self, problem: Problem) -> Problem:
        """A problem with its errors clipped."""
        return with_clip(problem, self.size, self.reach)


class Compiled(NamedTuple):
    """A compiled program: its effects, and its problems on the training and the unseen logs."""

    effects: frozenset[str]
    problem: Problem
    unseen: Problem | None


@dataclass(frozen=True, eq=False)
class TrialFit:
    """The model with some effects, fitted in the innovations form.

    Args:
        effects: names of the effects that are present, and of fixed parameters that are freed.
        values: all parameters by full name, the observer's included.
        quadratic: the likelihood near the optimum, in the coordinates of ``names``.
        names: the parameters that were estimated.
        cost: negative log-likelihood, under ``clip``.
        predicted_gain: gain of log-likelihood by a further full step within the bounds.
        initial_states: the initial states of the logs, concatenated.
        clip: the clip of its errors.
        program: the compiled program.
        response_problem: builds the problem by whose linear response additions are judged.
    """

    effects: tuple[str, ...]
    values: Mapping[str, float]
    quadratic: Quadratic
    names: tuple[str, ...]
    cost: float
    predicted_gain: float
    initial_states: Float[np.ndarray, " starts"] | None
    clip: ResidualClip
    program: Compiled = field(repr=False)
    response_problem: Callable[[], Problem] = field(repr=False)

    @property
    def expected(self) -> float:
        """The predicted cost after a full step."""
        return self.cost - self.predicted_gain

    def parameters_of(self, effect: str | None = None) -> list[str]:
        """The estimated parameters of an effect, by default the last one."""
        effect = effect or self.effects[-1]
        return [n for n in self.names if of_effect(n, effect)]

    @property
    def problem(self) -> Problem:
        """The training logs, as they were compiled."""
        return self.program.problem

    @property
    def at_values(self) -> Problem:
        """The training logs at these values, from these initial states."""
        return self._focused(self.problem)

    @property
    def unseen(self) -> Problem | None:
        """The unseen logs at these values, if there are any."""
        unseen = self.program.unseen
        return None if unseen is None else self.clip.on(unseen.focus(self.names, self.values))

    def _focused(self, problem: Problem) -> Problem:
        return self.clip.on(problem.focus(self.names, self.values, self.initial_states))

    @cached_property
    def passed(self) -> list[Pass]:
        """Its pass over each training log."""
        return passes(self.at_values)

    @cached_property
    def path(self) -> list[dict[str, np.ndarray]]:
        """For each training log the series of inputs and states, predicted one step ahead."""
        return [log.path for log in self.passed]

    @cached_property
    def response(self) -> LinearResponse:
        """The linear response of the errors to additions to the model."""
        return LinearResponse(self._focused(self.response_problem()))


class Programs:
    """The compiled problems of a model with any of the candidates, over the same logs.

    The programs compiled so far are kept, guarded by a lock; nothing else changes.

    Args:
        model: the model, including its effects.
        candidates: effects to try, at any values.
        records: training records.
        unseen: unseen records.
        substeps: integrator steps per sample.
        noise_model: with "ar1" there are no random forces and no corrections of the states, as in a
            fit with that noise.
        constants: names of fixed parameters of the model that are candidates.
        simulating: nothing is corrected and no sensor's error lasts: whole simulated runs.
    """

    def __init__(
        self,
        model: Model,
        candidates: Sequence[Effect],
        records: Sequence[Record],
        unseen: Sequence[Record],
        substeps: int = 1,
        noise_model: str = "white",
        constants: Sequence[str] = (),
        *,
        simulating: bool = False,
    ) -> None:
        self.substeps, self.noise_model = substeps, noise_model
        self.model, self.records, self.unseen = model, tuple(records), tuple(unseen)
        self.channels = measured_outputs(model, records)
        self.places = places_of(model, records[0], self.channels)
        self.constants = tuple(constants)
        self.candidates = {effect.name: effect for effect in candidates}
        self.free = tuple(n for n, p in model.parameters.items() if not p.fixed)
        remembering = {p for e in model.effects if e.memory for p in e.ports}
        lasts = NOISE_MODELS[noise_model].lasts
        observer = observer_of(model, records[0], self.channels, remembering, lasts)
        observer = observer.simulation if simulating else observer
        likelihood = Innovations(law=StudentT(), observer=observer)
        self._arranged = partial(build, substeps=substeps, likelihood=likelihood, compact=True)
        first = self._arranged(model, self.records)
        self.nuisance = tuple(n for n, p in first.nuisance.items() if not p.fixed)
        self.uncorrected = {n: 0.0 for n in first.nuisance if not is_memory(n)}
        self.width = len(self.free) + len(self.nuisance) + _ROOM
        self.counts = dict(zip(self.channels, map(float, first.numbers.counts), strict=True))
        self.samples = float(np.sum(first.numbers.counts))
        if self.samples <= (numbers := len(self.free) + len(self.nuisance)):
            raise InputError(
                f"The training logs hold {self.samples:.0f} measurements, and {numbers} numbers of "
                f"'{model}' and of the noise are to be estimated.",
                "Give longer logs, or fix parameters.",
            )
        self._lock = RLock()
        self.joint = self.samples <= _SHORT
        self._compiled = [self._program(self.candidates if self.joint else ())]

    @cached_property
    def simulation(self) -> Programs:
        """The programs of whole simulated runs.

        They have no gains and memories: of a vessel with five channels 32, whose derivatives took
        most of the time of a trial.
        """
        return Programs(
            self.model,
            list(self.candidates.values()),
            self.records,
            self.unseen,
            self.substeps,
            self.noise_model,
            self.constants,
            simulating=True,
        )

    def ready(
        self, effects: Collection[str], tried: Sequence[str] = (), later: Sequence[str] = ()
    ) -> Compiled:
        """The program for trials of some effects, compiled if there is none yet.

        As far as there is room, it also includes the effects of the last program, and then those
        that may be tried later.

        Args:
            effects: that are present in all trials.
            tried: of which one or two are present besides.
            later: that may be tried in their turn, the most likely first.
        """
        with self._lock:
            names = {*effects, *tried}
            needed = self._size(*effects) + self._size(*tried, most=_ADDED)
            for program in reversed(self._compiled):
                wide = program.problem.layout.shared >= len(self.free) + needed
                if wide and program.effects >= names:
                    return program
            last = sorted(self._compiled[-1].effects)
            wanted = dict.fromkeys((*effects, *tried, *last, *later))
            wanted = [n for n in wanted if n in self.candidates]
            if self.joint:  # it had no room: there will be more effects yet
                needed += self._size(*wanted, most=_MOST_PRESENT)
            else:
                wanted = wanted[: max(_TOGETHER, len(names))]
            self._compiled.append(self._program(wanted, needed))
            return self._compiled[-1]

    def problem(
        self, effects: Collection[str], records: Sequence[Record], least: int = 0
    ) -> Problem:
        """The problem of the model with some effects at their nulls, with all constants freed.

        Args:
            effects: names of the effects.
            records: the logs.
            least: the least number of coordinates that can be estimated together.
        """
        model, free = self.model.free(*self.constants), len(self.constants)
        for name in self.candidates:
            if name in effects:
                model = model + self.candidates[name].at_null()
                free += self._size(name)
        width = max(self.width - _ROOM + min(free, _ROOM), least)
        return self._arranged(model, records, width=width)

    def response_problem(
        self, program: Compiled, effects: Collection[str], numbers: int
    ) -> Problem:
        """The problem of a program; over long logs one without the effects that are absent."""
        return program.problem if self.joint else self.problem(effects, self.records, numbers)

    def _program(self, effects: Collection[str], needed: int = 0) -> Compiled:
        # any of these effects may be tried, with all its parameters, beside those of a trial
        present = SETTINGS.admission.most_effects if self.joint else _MOST_PRESENT
        least = len(self.free) + max(needed, self._size(*effects, most=present))
        problem = self.problem(effects, self.records, least)
        unseen = self.problem(effects, self.unseen, least) if self.unseen else None
        return Compiled(frozenset((*effects, *self.constants)), problem, unseen)

    def _size(self, *names: str, most: int | None = None) -> int:
        """The number of estimated parameters of candidates, or of the largest few of them."""
        sizes = [
            1
            if name in self.constants
            else sum(not p.fixed for p in self.candidates[name]._parameters.values())
            for name in names
        ]
        return sum(sorted(sizes, reverse=True)[:most])


class CandidateFitter:
    """Fits of a model with any of the candidates, over the same logs.

    Args:
        programs: the compiled problems.
    """

    def __init__(self, programs: Programs) -> None:
        self.programs, self.nuisance = programs, programs.nuisance
        self.model, self.records, self.channels = (
            programs.model,
            programs.records,
            programs.channels,
        )
        self.candidates, self.constants = programs.candidates, programs.constants
        self.free, self.counts, self.samples = programs.free, programs.counts, programs.samples
        self.places, self.ready = programs.places, programs.ready

    def moved(self, effects: Sequence[str]) -> tuple[str, ...]:
        """The parameters that are estimated with some effects present."""
        named = self.ready(effects).problem.named
        added = [
            n
            for n in named
            if n not in self.free
            and any(of_effect(n, effect) for effect in effects)
            and not named[n].fixed
        ]
        room = max(0, self.programs.width - len(self.free) - len(added))
        return (*self.free, *sorted(self.nuisance, key=is_memory)[:room], *added)  # gains first

    def solve(
        self,
        effects: Sequence[str],
        values: Mapping[str, float],
        initial_states: np.ndarray | None,
        clip: ResidualClip,
        budget: int = 40,
        still: Collection[str] = (),
    ) -> TrialFit:
        """Fit with some effects present, from given values and initial states.

        Parameters named in ``still`` keep their values.
        """
        names = tuple(name for name in self.moved(effects) if name not in still)
        program = self.ready(effects)
        problem = clip.on(program.problem.focus(names, values, initial_states))
        optimum = solve(problem, problem.start(), budget, _ENOUGH)
        q, z = optimum.quadratic, optimum.z
        response_problem = partial(self.programs.response_problem, program, effects, len(names))
        fitted = partial(
            TrialFit, tuple(effects), problem.values(z), q, names, clip=clip, program=program,
            response_problem=response_problem,
        )  # fmt: skip
        if not np.isfinite(q.cost):
            return fitted(cost=np.inf, predicted_gain=0.0, initial_states=initial_states)
        low, high = problem.limits()
        outward = ((z <= low + 1e-9) & (q.gradient >= 0)) | ((z >= high - 1e-9) & (q.gradient <= 0))
        return fitted(
            cost=float(q.cost),
            predicted_gain=promised_gain(q, ~outward),
            initial_states=z[problem.shared :],
        )

    def further(self, trial: TrialFit, budget: int = 40) -> TrialFit:
        """Continue the fit of a trial."""
        return self.solve(trial.effects, trial.values, trial.initial_states, trial.clip, budget)

    def settled(
        self,
        effects: Sequence[str],
        values: Mapping[str, float],
        initial_states: np.ndarray | None,
        clip: ResidualClip,
    ) -> TrialFit:
        """A complete fit with some effects present, from several guesses of the noise.

        An effect that explains much leaves little noise: the best gains of the observer may be far
        from the current ones. The clip is then adjusted to a few times the errors of this trial.
        """

        def started(guess: Mapping[str, float]) -> TrialFit:
            return self.solve(effects, {**values, **guess}, initial_states, clip, budget=12)

        trial = min(side_by_side(started, guesses(self.nuisance)), key=lambda t: t.expected)
        if not np.isfinite(trial.cost):
            # a spike before a gap can make corrected runs diverge; uncorrected ones are finite
            trial = started(uncorrected(self.nuisance))
        for _ in range(2):
            trial = self.further(trial, budget=_LONG)
            trial = replace(trial, clip=ResidualClip(CLIP * trial.quadratic.sigma, clip.reach))
        return self.further(trial, budget=_LONG)

    def base(
        self, effects: Sequence[str] = (), values: Mapping[str, float] | None = None
    ) -> TrialFit:
        """Fit the model as it is, or with some effects, from its own values or from given ones.

        This also determines the clip of the errors.
        """
        initial, named = values or {}, self.ready(effects).problem.named
        start = {n: initial.get(n, p.value) for n, p in named.items()}
        clipped = self.settled(
            effects, start, None, ResidualClip(np.full(len(self.channels), np.inf))
        )
        widened = replace(clipped, clip=replace(clipped.clip, reach=WIDE))
        wide = self.further(widened, budget=_LONG)
        return wide if wide.cost < clipped.cost - REAL else clipped

    def cost(
        self,
        effects: Sequence[str],
        values: Mapping[str, float],
        initial_states: np.ndarray | None,
        clip: ResidualClip,
    ) -> float:
        """Negative log-likelihood at given values, at a tenth of the cost of its derivatives."""
        problem = self.ready(effects).problem
        return cost(clip.on(problem.focus(self.moved(effects), values, initial_states)))

    def absent(self, effect: str, values: Mapping[str, float]) -> dict[str, float]:
        """The values with one effect at its null, or one freed parameter at its fixed value."""
        if effect in self.constants:
            return {**values, effect: self.model.parameters[effect].value}
        null = self.candidates[effect].at_null()
        return {**values, **{f"{effect}.{n}": p.value for n, p in null._parameters.items()}}

    def readings(self, trial: TrialFit) -> list[dict[str, np.ndarray]]:
        """The signals at the ports of the given model, log by log."""
        return [port_readings(self.model, path) for path in trial.path]


def with_values(model: Model, values: Mapping[str, float]) -> Model:
    """A model with the values of a trial."""
    return model.replace({n: values[n] for n in model.parameters if n in values})

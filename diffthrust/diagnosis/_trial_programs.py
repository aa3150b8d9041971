"""The compiled problems of a diagnosis's trials: a model with candidates that may all be absent.

A program is compiled for the model with several effects (`Programs.ready`), which do nothing at
their null values. The choice of estimated parameters is data, not code (`Problem.focus`): one
compilation serves hundreds of trials. Over short logs one program has all candidates, and serves a
whole search. Over long ones, where they would cost more at each pass than they save, later programs
include the effects of earlier ones, so that few are needed.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import replace
from functools import partial
from threading import RLock
from typing import NamedTuple, Self

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust.diagnosis._candidates import places_of
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.estimation._arguments import NOISE_MODELS
from diffthrust.estimation._arrange import build
from diffthrust.estimation._laws import StudentT
from diffthrust.estimation._observer import is_memory, observer_of
from diffthrust.estimation._problem import Problem
from diffthrust.estimation._residuals import Innovations
from diffthrust.models._base.effect import Effect
from diffthrust.models._base.model import Model
from diffthrust.simulation._record import Record, measured_outputs

_SHORT = 5000
"""Numerics: with so many measurements at most, all candidates are compiled together: on the maps of
a T200 (1 600) a program with all takes as long to compile as one with eight, and replaces ten. On
the logs of a bench (9 000) it saves a seventh of a first diagnosis, and every later one takes a
quarter longer; a boat (14 400, eleven candidates) takes longer in any case."""
_FEW = 40
"""Numerics: and only if there are no more of them. Eight thrusters have 62 candidates: of 4 800
measurements a first diagnosis took 288 s of processor time and 1.4 GB with eight together, 434 s
and 1.9 GB with all."""
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


class Compiled(NamedTuple):
    """A compiled program: its effects, and its problems on the training and the unseen logs."""

    effects: frozenset[str]
    problem: Problem
    unseen: Problem | None


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
        within: no sensor's error lasts, and measured states follow their readings within so many
            seconds; without an end, whole simulated runs.
        together: candidates that are compiled together at first, over long logs.
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
        within: float | None = None,
        together: Collection[str] = (),
    ) -> None:
        self.substeps, self.noise_model, self.within = substeps, noise_model, within
        self.model, self.records = model, tuple(records)
        self.channels = measured_outputs(model, records)
        self.unseen = tuple(_with_channels(record, self.channels) for record in unseen)
        self.places = places_of(model, records[0], self.channels)
        self.constants = tuple(constants)
        self.candidates = {effect.name: effect for effect in candidates}
        # part of every program: what each log has of its own has then the same place in all
        self.by_log = tuple(
            e.name for e in candidates if any(p.per_log for p in e._parameters.values())
        )
        self.free = tuple(n for n, p in model.parameters.items() if not p.fixed)
        remembering = {p for e in model.effects if e.memory for p in e.ports}
        lasts = NOISE_MODELS[noise_model].lasts
        observer = observer_of(model, records[0], self.channels, remembering, lasts)
        if within is not None:
            whole = math.isinf(within)
            observer = observer.simulation if whole else observer.forgetting(within)
        likelihood = Innovations(law=StudentT(), observer=observer)
        self._arranged = partial(build, substeps=substeps, likelihood=likelihood, compact=True)
        first = self._arranged(model, self.records)
        self.nuisance = tuple(n for n, p in first.nuisance.items() if not p.fixed)
        self._gains = {n: p.value for n, p in first.nuisance.items() if not is_memory(n)}
        self.uncorrected = dict.fromkeys(self._gains, 0.0)
        self.width = len(self.free) + len(self.nuisance) + _ROOM
        self.counts = dict(zip(self.channels, map(float, first.numbers.counts), strict=True))
        self.samples = float(np.sum(first.numbers.counts))
        if self.samples <= (numbers := len(self.free) + len(self.nuisance)):
            raise InputError(
                f"The training logs hold {self.samples:.0f} measurements, and {numbers} numbers of "
                f"'{model}' and of the noise are to be estimated.",
                "Give longer logs, or fix parameters.",
            )
        self._lock, self._simulating = RLock(), dict[float, Self]()
        self.joint = self.samples <= _SHORT and len(self.candidates) <= _FEW
        self._compiled = [self._program(self.candidates if self.joint else together)]

    def simulating(self, within: float = math.inf) -> Self:
        """The same for whole simulated runs, or for runs that forget their errors in time.

        They have no gains and memories to estimate: of a vessel with five channels 32, whose
        derivatives took most of the time of a trial. The effects that were tried one step ahead
        are compiled together, and serve the admission of each: of the bench's first diagnosis that
        saves a sixth, two programs of 4 s each among it.
        """
        if within not in self._simulating:
            self._simulating[within] = type(self)(
                self.model,
                list(self.candidates.values()),
                self.records,
                self.unseen,
                self.substeps,
                self.noise_model,
                self.constants,
                within=within,
                together=self._compiled[-1].effects & {*self.candidates},
            )
        return self._simulating[within]

    def gains(self, seconds: float | None) -> dict[str, float]:
        """The gains of runs that forget in another time than ``within``; none of whole runs."""
        share = 1.0 if seconds is None or self.within is None else self.within / seconds
        return {name: min(1.0, share * gain) for name, gain in self._gains.items()}

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

        At ``least`` so many coordinates can be estimated together.
        """
        model, free = self.model.free(*self.constants), len(self.constants)
        for name in self.candidates:
            if name in effects or name in self.by_log:
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
        effects = {*effects, *self.by_log}
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


def _with_channels(record: Record, channels: Sequence[str]) -> Record:
    """An unseen record, without a reading of what only the training logs measure."""
    nothing = np.full(record.time.size, np.nan)
    measured = {**dict.fromkeys(channels, nothing), **record.measured}
    return replace(record, measured=measured, noise={**dict.fromkeys(channels), **record.noise})

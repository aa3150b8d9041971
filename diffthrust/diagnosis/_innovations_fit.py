"""Fits of the model with any of the candidate effects to the same logs, in the innovations form.

A trial holds its values, the clip of its errors, and its program.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import TypeVar

import numpy as np
from jaxtyping import Float

from diffthrust.diagnosis._candidates import of_effect
from diffthrust.diagnosis._linear_response import LinearResponse, promised_gain
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.diagnosis._trial_programs import Compiled, Programs
from diffthrust.estimation._likelihood import Quadratic
from diffthrust.estimation._observer import CLIP, REAL, WIDE, guesses, is_memory, uncorrected
from diffthrust.estimation._one_step import (
    Pass,
    cost,
    passes,
    settled_start,
    with_clip,
    with_own_values,
)
from diffthrust.estimation._problem import Problem
from diffthrust.estimation._solver import solve
from diffthrust.models._base.model import Model
from diffthrust.simulation._levels import port_readings

Item = TypeVar("Item")
Answer = TypeVar("Answer")

_ENOUGH = 0.05
"""Numerics: a fit ends when a full step would gain less log-likelihood than this."""
_LONG = 40
"""Numerics: the largest number of steps of a complete fit: a search that needs more creeps along a
flat ridge."""
_CLIPS = 3
"""Numerics: fits of a trial, each with the clip that follows from the errors of the last."""


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

    def count(self, names: Collection[str]) -> int:
        """How many numbers some of its parameters are: one for each log where they differ by log.

        Their mean is one more, and as their spread about it is sought as well, no number more.
        """
        differing = {name for name, _ in self.problem.layout.per_log}
        return sum(len(self.problem.records) if name in differing else 1 for name in names)

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
        """The unseen logs at these values, if there are any; what differs by log is their own."""
        unseen = self.program.unseen
        if unseen is None:
            return None
        return with_own_values(self.clip.on(unseen.focus(self.names, self.values)))

    def _focused(self, problem: Problem) -> Problem:
        return self.clip.on(problem.focus(self.names, self.values, self.initial_states))

    @cached_property
    def unseen_cost(self) -> float:
        """Negative log-likelihood of the unseen logs, from their best initial states.

        NaN without unseen logs, infinite where the simulation fails on them.
        """
        if self.unseen is None:
            return float("nan")
        value = cost(settled_start(self.unseen))
        return value if np.isfinite(value) else float("inf")

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

    def scores(
        self,
        port: str,
        sets: Sequence[Sequence[np.ndarray]],
        ends: Sequence[Sequence[np.ndarray]] | None = None,
    ) -> tuple[int, list[tuple[np.ndarray, np.ndarray]]]:
        """What each of several sets of series at a port would do, as `LinearResponse.scores`.

        Args:
            port: where they are added.
            sets: for each set and log ``(K, T)``; all go through the logs together.
            ends: the series as the next sample comes; their next values where ``None``.

        Returns:
            How many coordinates of the model come first; information and scores of each set.
        """
        response = self.response

        def together(parts: Sequence[Sequence[np.ndarray]]) -> list[np.ndarray]:
            return response.batched([np.concatenate(rows) for rows in zip(*parts, strict=True)])

        changes = response.to(port, together(sets), None if ends is None else together(ends))
        # the observer's gains are left out: white errors say nothing of them that they say of a
        # mean
        nuisance = self.problem.nuisance
        estimated = [i for i, name in enumerate(self.names) if name not in nuisance]
        edges = np.cumsum([len(series[0]) for series in sets])[:-1]
        by_set = zip(*(np.split(batch, edges, axis=1) for batch in changes), strict=True)
        return len(estimated), [response.scores(estimated, own) for own in by_set]


class CandidateFitter(Programs):
    """Fits of a model with any of the candidates, over the same logs."""

    @property
    def least_gain(self) -> float:
        """By how much an effect must lower the criterion to be added.

        More where many are tried, of which the best has gained the most by chance.
        """
        many = (len(self.candidates) + len(self.constants)) / SETTINGS.admission.priced_candidates
        return SETTINGS.admission.least_bic_gain + 2.0 * math.log(max(1.0, many))

    @property
    def unclipped(self) -> ResidualClip:
        """No clip of the errors."""
        return ResidualClip(np.full(len(self.channels), np.inf))

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
        room = max(0, self.width - len(self.free) - len(added))
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
        response_problem = partial(self.response_problem, program, effects, len(names))
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
            predicted_gain=promised_gain(q, ~outward & ~optimum.kinked),
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
        still = uncorrected(self.nuisance)
        if not trial.cost <= self.cost(effects, {**values, **still}, initial_states, clip):
            # corrections make runs diverge, after a spike before a gap or where they were those of
            # a much poorer model; without them runs are as finite as the model's own
            trial = started(still)
        settled = trial
        for _ in range(_CLIPS):
            further = self.further(trial, budget=_LONG)
            if not np.isfinite(further.cost):  # larger corrections than before are let in
                break
            settled = further
            trial = replace(further, clip=ResidualClip(CLIP * further.quadratic.sigma, clip.reach))
        return settled

    def base(
        self, effects: Sequence[str] = (), values: Mapping[str, float] | None = None
    ) -> TrialFit:
        """Fit the model as it is, or with some effects, from its own values or from given ones.

        This also determines the clip of the errors.
        """
        initial, named = values or {}, self.ready(effects).problem.named
        start = {n: initial.get(n, p.value) for n, p in named.items()}
        clipped = self.settled(effects, start, None, self.unclipped)
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

    def settled_without(self, trial: TrialFit, names: Collection[str]) -> TrialFit:
        """A complete fit of a trial without some of its effects."""
        kept = tuple(n for n in trial.effects if n not in names)
        values = self.absent(names, trial.values)
        return self.settled(kept, values, trial.initial_states, trial.clip)

    def absent(self, names: Collection[str], values: Mapping[str, float]) -> dict[str, float]:
        """The values with some effects at their nulls, or freed parameters as they were fixed."""
        absent = dict(values)
        for name in names:
            if name in self.constants:
                absent[name] = self.model.parameters[name].value
            else:
                null = self.candidates[name].at_null()._parameters
                absent |= {f"{name}.{n}": p.value for n, p in null.items()}
        return absent

    def sizes(self, trial: TrialFit) -> dict[str, float]:
        """Standard deviations of the one-step errors of a trial, by channel."""
        return dict(zip(self.channels, map(float, trial.quadratic.sigma), strict=True))

    def readings(self, trial: TrialFit) -> list[dict[str, np.ndarray]]:
        """The signals at the ports of the given model, log by log."""
        return [port_readings(self.model, path) for path in trial.path]


def with_values(model: Model, values: Mapping[str, float]) -> Model:
    """A model with the values of a trial."""
    return model.replace({n: values[n] for n in model.parameters if n in values})

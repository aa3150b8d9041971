"""All effects that logs can test, in one compiled problem, each of them on request.

The model under test carries every candidate at its null value, where it does nothing, and at each
place a signal of unknown form. Which parameters move is a matter of numbers (`Problem.focus`), so
that hundreds of trials share one compilation.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust.diagnosis._ports import KNOTS, places_of, readings, unknown_at
from diffthrust.diagnosis._score_test import promise
from diffthrust.estimation._arrange import build
from diffthrust.estimation._laws import StudentT
from diffthrust.estimation._likelihood import Quadratic
from diffthrust.estimation._observer import CLIP, REAL, WIDE, guesses, is_memory, observer_of
from diffthrust.estimation._one_step import cost, nrmse, passes, settled_start, with_clip
from diffthrust.estimation._problem import Problem
from diffthrust.estimation._registry import NOISE_MODELS
from diffthrust.estimation._residuals import Innovations
from diffthrust.estimation._solver import solve
from diffthrust.logs._log import Log
from diffthrust.models._base.effect import Effect
from diffthrust.models._base.model import Model
from diffthrust.simulation._inputs import measured_outputs

Item = TypeVar("Item")
Found = TypeVar("Found")

SAME = 1e-6
"""An effect is redundant that keeps less than this of its information beside the others."""
ENOUGH = 2e-3
"""A trial ends where a full step would gain less log-likelihood than this."""
IDLE = 1e-6
"""An effect does nothing that is nearer to its null than this, in units of its scale."""
LONG = 60
"""Steps that carry a trial to its end: a search that goes on creeps along a flat ridge."""
ROOM = 4
"""Parameters of effects that are estimated together with all of the model's and the observer's;
with more, the observer's memories are held at what they were, and then its gains."""


def side_by_side(work: Callable[[Item], Found], items: Sequence[Item]) -> list[Found]:
    """``work`` on each item, on all cores: compiled code runs without Python's lock.

    The first item goes alone, so that nothing is compiled twice at the same time.
    """
    first = [work(item) for item in items[:1]]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return first + list(pool.map(work, items[1:]))


@dataclass(frozen=True)
class Trial:
    """The model with some effects, fitted in the innovations form.

    Args:
        effects: names of the effects that are present.
        values: all parameters by full name, the observer's included.
        quadratic: the likelihood near the optimum, in the coordinates of ``names``.
        names: the parameters that were estimated.
        cost: negative log-likelihood.
        promise: gain of log-likelihood that a full step within the bounds would still bring.
        begin: the initial states of the logs.
    """

    effects: tuple[str, ...]
    values: Mapping[str, float]
    quadratic: Quadratic
    names: tuple[str, ...]
    cost: float
    promise: float
    begin: np.ndarray | None

    @property
    def expected(self) -> float:
        """The cost that a full step promises."""
        return self.cost - self.promise


class Trials:
    """Fits of a model with any of the candidates, over the same logs.

    Args:
        model: the model with the effects that it has already.
        candidates: effects to try, at any values.
        logs: training logs.
        unseen: unseen logs.
        substeps: integrator steps per sample.
        noise_model: with "ar1" no random forces act and no state is corrected, as in a fit with
            that noise.
    """

    def __init__(
        self,
        model: Model,
        candidates: Sequence[Effect],
        logs: Sequence[Log],
        unseen: Sequence[Log],
        substeps: int = 1,
        noise_model: str = "white",
    ) -> None:
        self.model = model
        self.logs = tuple(logs)
        channels = measured_outputs(model, logs)
        self.places = places_of(model, logs[0], channels)
        self.unknowns = {place.port: unknown_at(place.port)() for place in self.places}
        everything = model
        for effect in (*candidates, *self.unknowns.values()):
            everything = everything + effect.at_null()
        self.candidates = {effect.name: effect for effect in candidates}
        self.own = tuple(n for n, p in model.parameters.items() if not p.fixed)
        remembering = {p for e in model.effects if e.memory for p in e.ports}
        observer = observer_of(
            model, logs[0], channels, remembering, NOISE_MODELS[noise_model].lasts
        )
        likelihood = Innovations(law=StudentT(), observer=observer)
        arrange = partial(build, everything, substeps=substeps, likelihood=likelihood)
        first = arrange(self._with_series(logs))
        self.nuisance = tuple(n for n, p in first.nuisance.items() if not p.fixed)
        width = len(self.own) + max(len(self.nuisance), KNOTS) + ROOM
        self.problem = replace(first, layout=replace(first.layout, width=width))
        self.unseen = arrange(self._with_series(unseen), width=width) if unseen else None
        self.samples = float(np.sum(first.numbers.counts))
        if self.samples <= (numbers := len(self.own) + len(self.nuisance)):
            raise InputError(
                f"The training logs hold {self.samples:.0f} measurements, and {numbers} numbers of "
                f"'{model}' and of the noise are to be estimated.",
                "Give longer logs, or fix parameters.",
            )

    def _with_series(self, logs: Sequence[Log]) -> list[Log]:
        """The logs with room for the series of the unknown signals, zero at first."""
        names = [name for effect in self.unknowns.values() for name in effect.needs]
        return [
            log.replaced(
                inputs={**log.inputs, **dict.fromkeys(names, np.zeros(len(log)))},
                units={**log.units, **dict.fromkeys(names, "")},
                hold={**log.hold, **dict.fromkeys(names, "linear")},
            )
            for log in logs
        ]

    # -- fits --------------------------------------------------------------------------------------

    @property
    def room(self) -> int:
        """Parameters of effects for which there is room beside all of the model's own and noise."""
        return (self.problem.layout.width or 0) - len(self.own) - len(self.nuisance)

    def moved(self, effects: Sequence[str]) -> tuple[str, ...]:
        """The parameters that are estimated with some effects present."""
        named = self.problem.named
        theirs = [n for n in named if n.rpartition(".")[0] in effects and not named[n].fixed]
        gains = [n for n in self.nuisance if not is_memory(n)]
        memories = [n for n in self.nuisance if n not in gains]
        free = max(0, (self.problem.layout.width or 0) - len(self.own) - len(theirs))
        return (*self.own, *(*gains, *memories)[:free], *theirs)

    def solve(
        self,
        effects: Sequence[str],
        values: Mapping[str, float],
        begin: np.ndarray | None = None,
        budget: int = 40,
        still: Collection[str] = (),
    ) -> Trial:
        """Fit with some effects present, from given values and initial states.

        Parameters named in ``still`` stay where they are.
        """
        names = tuple(name for name in self.moved(effects) if name not in still)
        problem = self.problem.focus(names, values, begin)
        found = solve(problem, problem.start(), budget, ENOUGH)
        q, z = found.quadratic, found.z
        given = (problem.values(z), q, names)
        if not np.isfinite(q.cost):
            return Trial(tuple(effects), *given, cost=np.inf, promise=0.0, begin=begin)
        low, high = problem.limits()
        outward = ((z <= low + 1e-9) & (q.gradient >= 0)) | ((z >= high - 1e-9) & (q.gradient <= 0))
        return Trial(
            tuple(effects),
            *given,
            cost=float(q.cost),
            promise=promise(q, ~outward),
            begin=z[problem.shared :],
        )

    def further(self, trial: Trial, budget: int = 40) -> Trial:
        """A trial carried on."""
        return self.solve(trial.effects, trial.values, trial.begin, budget)

    def values_of(self, model: Model) -> dict[str, float]:
        """Values of a model's parameters, by full name."""
        return {n: p.value for n, p in model.parameters.items()}

    def with_values(self, model: Model, values: Mapping[str, float]) -> Model:
        """A model at the values of a trial."""
        return model.replace({n: values[n] for n in model.parameters if n in values})

    def absent(self, effect: str, values: Mapping[str, float]) -> dict[str, float]:
        """The values with one effect at its null."""
        null = self.candidates[effect].at_null()
        own = {f"{effect}.{n}": p.value for n, p in null._parameters.items()}
        return {**values, **own}

    def base(self, values: Mapping[str, float]) -> Trial:
        """The model as it is, from given values of its parameters.

        Here it is seen at what size errors are limited.
        """
        start = {n: p.value for n, p in self.problem.named.items()} | dict(values)
        self._compile(start)
        limited, before = self.settled((), start), self.problem
        self.problem = with_clip(before, before.numbers.clip, reach=WIDE)
        wide = self.further(limited, budget=LONG)
        if wide.cost < limited.cost - REAL:
            return wide
        self.problem = before
        return limited

    def _compile(self, values: Mapping[str, float]) -> None:
        """Compile what all trials need side by side, not one after the other as it is called."""
        problem = self.problem.focus(self.moved(()), values)
        work = [partial(solve, problem, problem.start(), 1), partial(cost, problem)]
        if self.unseen is not None:
            work.append(partial(cost, self.unseen.focus(self.moved(()), values)))
        with ThreadPoolExecutor(len(work)) as pool:
            for done in [pool.submit(one) for one in work]:
                done.result()

    def settled(
        self,
        effects: Sequence[str],
        values: Mapping[str, float],
        begin: np.ndarray | None = None,
    ) -> Trial:
        """Fit with some effects present to the end, from several guesses of the noise.

        An effect that explains much leaves little noise: the observer's gains may be far from what
        they were. Then large errors are limited to a few times what errors now are.
        """

        def one(guess: Mapping[str, float]) -> Trial:
            return self.solve(effects, {**values, **guess}, begin, budget=12)

        begun = side_by_side(one, guesses(self.nuisance))
        trial = min(begun, key=lambda trial: trial.expected)
        reach = self.problem.numbers.reach
        for _ in range(2):
            trial = self.further(trial, budget=LONG)
            self.problem = with_clip(self.problem, CLIP * trial.quadratic.sigma, reach)
        return self.further(trial, budget=LONG)

    def cost(
        self, effects: Sequence[str], values: Mapping[str, float], begin: np.ndarray | None
    ) -> float:
        """Negative log-likelihood at given values: a tenth of the work of a derivative."""
        return cost(self.problem.focus(self.moved(effects), values, begin))

    def idle(self, trial: Trial) -> bool:
        """Whether the last effect of a trial has gone back to its null."""
        effect = self.candidates[trial.effects[-1]]
        return all(
            abs(trial.values[f"{effect.name}.{name}"] - p.null) < IDLE * p.scale
            for name, p in effect._parameters.items()
            if p.null is not None
        )

    def redundant(self, trial: Trial) -> bool:
        """Whether the last effect of a trial does nothing that the other parameters cannot."""
        q, effect = trial.quadratic, trial.effects[-1]
        live = np.diagonal(q.information) > 0
        own = np.zeros(live.size, bool)
        own[: len(trial.names)] = [n.rpartition(".")[0] == effect for n in trial.names]
        length = np.sqrt(np.diagonal(q.information)[live])
        scaled = q.information[np.ix_(live, live)] / np.outer(length, length)
        own = own[live]
        if not own.any():
            return True
        cross, rest = scaled[np.ix_(own, ~own)], scaled[np.ix_(~own, ~own)]
        left = scaled[np.ix_(own, own)] - cross @ np.linalg.pinv(rest, 1e-12, True) @ cross.T
        return bool(np.diagonal(left).max() < SAME)

    def levels(self, trial: Trial) -> dict[str, float]:
        """The 90th percentile of the absolute value of every signal, and the longest duration."""
        paths = self.path(trial)
        series = [{**path, **own} for path, own in zip(paths, self.readings(paths), strict=True)]
        found = {
            name: float(np.quantile(np.abs(np.concatenate([one[name] for one in series])), 0.9))
            for name in series[0]
            if all(name in one for one in series)
        }
        return {**found, "duration": max(log.duration for log in self.logs)}

    # -- what the innovations say ------------------------------------------------------------------

    def path(self, trial: Trial) -> list[dict[str, np.ndarray]]:
        """For each training log the series of inputs and states, predicted one step ahead."""
        return [one.path for one in passes(self._at(self.problem, trial))]

    def readings(self, paths: Sequence[Mapping[str, np.ndarray]]) -> list[dict[str, np.ndarray]]:
        """What passes each port of the model as it was given, log by log."""
        bound = self.model
        return [readings(bound, path) for path in paths]

    def unseen_gain(self, before: Trial, after: Trial) -> float:
        """Gain of log-likelihood on the unseen logs; NaN without any.

        The noise levels are those of the unseen logs, and initial states their best: a model that
        halves the errors of both is better, although on other manoeuvres more may remain.
        Taken with the observer of either trial, whichever is better: an effect that explains much
        leaves an observer that corrects little, and a single event that it misses would count most.
        """
        noise = {name: before.values[name] for name in self.nuisance}
        louder = replace(after, values={**after.values, **noise})
        one, *others = (self.unseen_cost(trial) for trial in (before, after, louder))
        return one - min(others)

    def unseen_cost(self, trial: Trial) -> float:
        """Negative log-likelihood of the unseen logs, from their best initial states.

        NaN without unseen logs, infinite where the trial cannot be carried over them.
        """
        if self.unseen is None:
            return float("nan")
        unseen = with_clip(self.unseen, self.problem.numbers.clip, self.problem.numbers.reach)
        found = cost(settled_start(self._at(unseen, trial)))
        return found if np.isfinite(found) else float("inf")

    def simulation_errors(self, trial: Trial) -> tuple[float, float | None]:
        """NRMSE of the simulation, without correction, on training and unseen logs."""
        still = {n: 0.0 for n in self.problem.nuisance if not is_memory(n)}
        pure = replace(trial, values={**trial.values, **still})
        train = nrmse(self._at(self.problem, pure))
        return train, None if self.unseen is None else nrmse(self._at(self.unseen, pure))

    def _at(self, problem: Problem, trial: Trial) -> Problem:
        begin = trial.begin if problem is self.problem else None
        return problem.focus(trial.names, trial.values, begin)

"""What a search for missing effects works with, what it knows, and how it begins."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from diffthrust._support.errors import InputError
from diffthrust._support.progress import Progress, part
from diffthrust.diagnosis._candidates import Candidates, candidates_of, constants_of
from diffthrust.diagnosis._criteria import criterion
from diffthrust.diagnosis._explained_share import Worth
from diffthrust.diagnosis._findings import Refusal, Remaining, Stage, TriedEffect
from diffthrust.diagnosis._innovations_fit import CandidateFitter, TrialFit
from diffthrust.diagnosis._residual_structure import remaining_structure
from diffthrust.effects import EFFECTS
from diffthrust.estimation._arguments import FitOptions
from diffthrust.estimation._fit import fit_records
from diffthrust.estimation._result import Fit
from diffthrust.estimation._status import Status
from diffthrust.models._base.effect import Effect
from diffthrust.models._base.model import Model
from diffthrust.simulation._levels import levels_when_asked
from diffthrust.simulation._record import Record
from diffthrust.simulation._runs import pooled_errors, runs_over
from diffthrust.simulation._step_size import CoarseStepWarning

PLAIN = 200.0
"""No doubt is left where the criterion falls, or the log-likelihood is lost, by so much."""
FITTED = 0.1
"""Share of a diagnosis after which the model as given is fitted;"""
_COMPILED = 0.15
"""the trials can begin;"""
SOUGHT = 0.85
"""and no further effect is looked for;"""
LEARNING = 0.9
"""what they do not explain is learned."""
_LEFT = 0.6
"""A stage leaves this part of what was left."""
_STARTS = 4, 2
"""Starts of a fit, and of a refit, which has a trial and an earlier stage to begin from besides."""
_SUBSTEPS = 2
"""Integrator steps per sample of the trials: over one sample ahead, errors do not build up;"""
_ALIKE = 0.02
"""more of them where whole runs would err by another share than this."""


class Clock:
    """How long each part of the work took, in all."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def __call__(self, part: str) -> Iterator[None]:
        begun = time.perf_counter()
        yield
        self.seconds[part] = self.seconds.get(part, 0.0) + time.perf_counter() - begun


@dataclass(frozen=True)
class SearchContext:
    """What a search works with.

    Args:
        given: the model that is diagnosed.
        fitter: fits it with any candidate.
        unseen: unseen records.
        refit: fits a model to whole runs, with the first fit's options; given values are starts,
            given ``records``, training and unseen ones, take the place of all; with ``segments``
            its model may go through these first where the first fit had no need of them; with
            ``substeps`` nobody looks whether finer ones are needed.
        guess: values from which the first fit began.
        say: told how far the work is.
        clock: times its parts.
    """

    given: Model
    fitter: CandidateFitter
    unseen: tuple[Record, ...]
    refit: Callable[..., Fit]
    guess: Mapping[str, float]
    say: Progress
    clock: Clock


@dataclass(frozen=True, eq=False)
class CurrentModel:
    """The model so far, with what is asked of it more than once."""

    fitter: CandidateFitter
    trial: TrialFit
    _without: dict[str, TrialFit] = field(default_factory=dict, init=False, repr=False)

    @cached_property
    def criterion(self) -> float:
        """Its information criterion."""
        return criterion(self.fitter, self.trial)

    @cached_property
    def remaining(self) -> Remaining | None:
        """What it leaves unexplained."""
        return remaining_structure(self.fitter, self.trial)

    def without(self, name: str) -> TrialFit:
        """The model, fitted without one of its effects.

        Not to the end where a few steps show that much is lost.
        """
        if name not in self._without:
            trial, trials = self.trial, self.fitter
            rest = tuple(n for n in trial.effects if n != name)
            values = trials.absent(name, trial.values)
            fewer = trials.solve(rest, values, trial.begin, trial.limit, budget=12)
            if fewer.promise > 0 and fewer.expected < trial.cost + PLAIN:
                fewer = trials.further(fewer)
            self._without[name] = fewer
        return self._without[name]


@dataclass(frozen=True)
class SearchState:
    """What a search knows after so many stages.

    Args:
        current: the model so far.
        stages: the model as given, then with one effect after the other.
        untestable: effects that the logs cannot test, with the reason.
        ranking: the effects tried at each stage.
        dropped: effects that later ones made superfluous.
        refused: effects that were not added at the last stage, with the reason.
        turned_down: every refusal so far, with the effects that were present.
        silent: effects that promised nothing at some stage.
        detectable: effects of the present model that matter for no stage: they change nothing over
            whole runs, and are kept lest their evidence is taken for that of others.
        worth: of the effects that were added or are detectable.
        possible: effects that whole runs alone speak for, with their worth there.
        exhausted: the last step added nothing: the search is over.
    """

    current: CurrentModel
    stages: tuple[Stage, ...]
    untestable: Mapping[str, str]
    ranking: tuple[TriedEffect, ...] = ()
    dropped: tuple[str, ...] = ()
    refused: Mapping[str, Refusal] = field(default_factory=dict)
    turned_down: Mapping[str, tuple[Refusal, tuple[str, ...]]] = field(default_factory=dict)
    silent: frozenset[str] = frozenset()
    detectable: tuple[str, ...] = ()
    worth: Mapping[str, Worth] = field(default_factory=dict)
    possible: Mapping[str, Worth] = field(default_factory=dict)
    exhausted: bool = False

    @property
    def number(self) -> int:
        """Of the last stage."""
        return len(self.stages) - 1

    @property
    def accepted(self) -> tuple[int, tuple[str, ...]]:
        """How far the search has come: a round that leaves it as it was ends the search."""
        return self.number, self.detectable

    def share(self, done: float) -> float:
        """The share of the whole search, where so much of the next stage is done.

        Nobody knows how many stages will come: each takes a part of what is left.
        """
        left = _LEFT ** (self.number + done)
        return SOUGHT - (SOUGHT - _COMPILED) * left


def start_search(
    fit: Fit | Model,
    train: Sequence[Record],
    unseen: Sequence[Record],
    wanted: Candidates | None,
    seed: int,
    say: Progress,
) -> tuple[SearchContext, SearchState]:
    """Fit the model as it is, and compile the trials."""
    say("fitting the model as it is", 0.0)
    clock, options = Clock(), fit.options if isinstance(fit, Fit) else {}
    begun_with: dict[str, Any] = {}

    def refit(
        model: Model,
        guesses: Sequence[Mapping[str, float]] = (),
        tell: Progress | None = None,
        starts: int = 0,
        records: tuple[Sequence[Record], Sequence[Record]] = (train, unseen),
        segments: bool = False,
        substeps: int = 0,
    ) -> Fit:
        starts = starts or _STARTS[bool(guesses)]
        told = {"starts": starts, "seed": seed, "guesses": guesses, **options}
        with clock("refit"), warnings.catch_warnings(record=True) as seen:  # its notes say the same
            warnings.simplefilter("always", CoarseStepWarning)
            if begun_with:
                alike = {n: v for n, v in begun_with.items() if not segments or n != "horizon"}
                alike |= {"substeps": substeps} if substeps else {}
                fitted = fit_records(model, *records, FitOptions(**told, **alike), tell).fit
                if substeps or not any(issubclass(w.category, CoarseStepWarning) for w in seen):
                    return fitted
                if math.isfinite(fitted.train.nrmse):  # finer steps end near where coarse ones do
                    model, told = fitted.model, {**told, "starts": 1, "guesses": ()}
            return fit_records(model, *records, FitOptions(**told), tell).fit

    tell = part(say, 0.0, FITTED)
    first = fit if isinstance(fit, Fit) else refit(fit, tell=tell)
    guess = first.guess
    if first is fit and not _is_of_these_logs(first, train, unseen):
        first = refit(first.model, tell=tell)
    begun_with["substeps"] = first.substeps  # what the first fit took needs no second look
    if first.horizon is None:
        begun_with["horizon"] = None
    effects, untestable = candidates_of(first.model, (*train, *unseen), wanted)
    levels = levels_when_asked(first.model, train)
    effects = [effect.scaled(levels) for effect in effects]
    say("compiling the trials", FITTED)
    with clock("compile"):
        trials, trial = compiled_fitter(
            first, effects, constants_of(first.model, wanted), train, unseen
        )
    tools = SearchContext(first.model, trials, tuple(unseen), refit, guess, say, clock)
    return tools, SearchState(CurrentModel(trials, trial), (Stage((), first),), untestable)


def _is_of_these_logs(fit: Fit, train: Sequence[Record], unseen: Sequence[Record]) -> bool:
    """Whether a fit's errors are those of the logs of this diagnosis."""
    if len(fit.initial) != len(train) or (fit.holdout is None) == bool(unseen):
        return False
    runs = runs_over(fit.model, train, initial=fit.initial, substeps=fit.substeps)
    pairs = [(fit.train, pooled_errors(runs))]
    if fit.holdout:
        runs = runs_over(fit.model, unseen, substeps=fit.substeps)
        pairs.append((fit.holdout, pooled_errors(runs)))
    return all(math.isclose(a.nrmse, b.nrmse, rel_tol=1e-6) for a, b in pairs)


def compiled_fitter(
    fit: Fit,
    effects: Sequence[Effect],
    held: Sequence[str],
    train: Sequence[Record],
    unseen: Sequence[Record],
    present: TrialFit | None = None,
) -> tuple[CandidateFitter, TrialFit]:
    """The trials, and the first: the model as it is, or with what is ``present`` in another."""
    for substeps in dict.fromkeys((few_substeps(fit, train), fit.substeps)):
        trials = CandidateFitter(fit.model, effects, train, unseen, substeps, fit.noise_model, held)
        first = trials.base(present.effects, present.values) if present else trials.base()
        if math.isfinite(first.cost):
            return trials, first
    raise _not_finite(fit, effects, train)


def few_substeps(fit: Fit, train: Sequence[Record]) -> int:
    """The fewest integrator steps per sample with which whole runs err as with those of a fit."""
    substeps = min(_SUBSTEPS, fit.substeps)
    while substeps < fit.substeps:
        runs = runs_over(fit.model, train, initial=fit.initial, substeps=substeps)
        if math.isclose(pooled_errors(runs).nrmse, fit.train.nrmse, rel_tol=_ALIKE):
            break
        substeps *= 2
    return substeps


def _not_finite(fit: Fit, effects: Sequence[Effect], train: Sequence[Record]) -> InputError:
    """What to say where no trial can be begun: the effects of the user's own that are why."""
    for effect in effects:
        if type(effect) is EFFECTS.get(effect.name):
            continue
        alone = CandidateFitter(fit.model, [effect], train, [], fit.substeps)
        if not math.isfinite(alone.base().cost):
            return InputError(
                f"The effect '{effect.name}' cannot be tried: at its null value the errors or "
                "their derivatives are not finite.",
                "Write it so that its derivative at the null is finite (no root or logarithm "
                "of zero), or leave it out.",
            )
    return InputError(
        f"The '{fit.model}' cannot be carried over these logs at the parameters of its fit "
        f"({fit.status.value}): expected finite one-step errors, found none."
        + (f" {fit.message}" if fit.status is Status.SIMULATION_FAILED else ""),
        "Give bounds that keep its time constants longer than a fifth of a sample, and look "
        "whether the units of the logs are right.",
    )

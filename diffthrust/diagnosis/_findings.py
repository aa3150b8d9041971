"""What a diagnosis has found, as data; `Diagnosis` reports it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property
from typing import TYPE_CHECKING, Any

from diffthrust._support.results import Brief
from diffthrust.comparison._compare import Comparison
from diffthrust.diagnosis._changed_size import ChangedSize
from diffthrust.diagnosis._explained_share import Worth
from diffthrust.diagnosis._headroom import Headroom, headroom_between
from diffthrust.diagnosis._learned import LearnedLaw
from diffthrust.diagnosis._mended import MeasuredMend, best_mends, mends_of
from diffthrust.diagnosis._missing import Missing, Remaining
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.diagnosis._verdict import Verdict, VerdictEvidence
from diffthrust.effects._curve import Curve
from diffthrust.effects._formula import Formula
from diffthrust.estimation._estimate import Estimate
from diffthrust.estimation._origin import Origin
from diffthrust.estimation._result import Fit
from diffthrust.logs._written import ShownUnits
from diffthrust.models._base.effect import Effect
from diffthrust.models._base.model import Model
from diffthrust.simulation._errors import Errors
from diffthrust.soundness._doubt import Doubt

if TYPE_CHECKING:
    from diffthrust.experiments._result import Experiment


class Refusal(StrEnum):
    """Why an effect was not added although it fits the training logs better; "it ..."."""

    SMALL_PART = (
        "explains, from one sample to the next, a small part of what a signal of unknown form does"
    )
    TAKES_UP = "takes up what is missing elsewhere: with it structure remains"
    UNSEEN_LOGS = "costs the unseen logs what it gains on the training logs"
    FAILS = "predicts the next sample better, and cannot be carried over whole runs"
    UNSEEN_RUNS = "predicts the next sample better, and whole unseen runs worse"
    ALL_RUNS = (
        "predicts the next sample better, and whole runs worse, unseen and training ones together"
    )
    TRAINING_RUNS = (
        "predicts the next sample better, and whole training runs worse in every channel: its fit "
        "has not come to its optimum"
    )
    IDLE = "predicts the next sample better, and does nothing in whole runs beside a later effect"
    EXCHANGED = "errs more over whole runs than the effect that came in its place"
    NO_BETTER_RUNS = "predicts the next sample better, and whole runs no better at that value"

    @property
    def by_whole_runs(self) -> bool:
        """Whether simulations over whole runs have spoken."""
        return self not in (Refusal.SMALL_PART, Refusal.TAKES_UP, Refusal.UNSEEN_LOGS)


@dataclass(frozen=True, repr=False)
class TriedEffect(Brief):
    """One effect tried at one stage.

    Args:
        stage: the number of the stage to which it would be added, from 0.
        effect: its name.
        likelihood_ratio: twice the gain of log-likelihood of the innovations by adding it.
        delta_bic: its Bayesian information criterion less that of the stage: negative is better.
        p_value: of the likelihood ratio, for this effect alone.
        holdout_gain: gain of log-likelihood of the innovations on the unseen logs; NaN without any.
        train_nrmse: simulation error on the training logs, at the parameters that predict each
            sample best from all before it (those of a stage are fitted to whole runs).
        holdout_nrmse: the same on the unseen logs.
        parameters: its estimated parameters, without standard errors.
    """

    stage: int
    effect: str
    likelihood_ratio: float
    delta_bic: float
    p_value: float
    holdout_gain: float
    train_nrmse: float | None
    holdout_nrmse: float | None
    parameters: Mapping[str, Estimate]


@dataclass(frozen=True, repr=False)
class Stage(Brief):
    """One round: the effects in the model, and its fit."""

    effects: tuple[str, ...]
    fit: Fit

    @property
    def train(self) -> Errors:
        """Simulation errors on the training logs."""
        return self.fit.train

    @property
    def holdout(self) -> Errors | None:
        """Simulation errors on the unseen logs."""
        return self.fit.holdout


@dataclass(frozen=True)
class OddLog:
    """A log that disagrees with the others.

    Args:
        log: its name.
        channel: the measured channel in which it shows most.
        evidence: a sentence that says how it differs.
        share: its share of the channel's squared whole-run error, over all logs.
        beyond: where it goes and most of the other logs do not, in words: what the model lacks may
            show there alone, and the log is as sound as they are.
    """

    log: str
    channel: str
    evidence: str
    share: float = float("nan")
    beyond: tuple[str, ...] = ()

    @property
    def much(self) -> bool:
        """Whether it carries over a third of the squared error, and belongs to the summary."""
        return self.share > SETTINGS.outlier_logs.decisive_share

    @property
    def accused(self) -> bool:
        """Whether it carries so much of the error without doing what the others do not."""
        return self.much and not self.beyond


@dataclass(frozen=True)
class HeldValue:
    """A fixed parameter that these logs want at another value.

    Args:
        value: at which the model fixes it.
        wanted: its estimate from these logs.
        std_error: standard error of the estimate.
        unit: unit of all three.
    """

    value: float
    wanted: float
    std_error: float
    unit: str = ""


@dataclass(frozen=True, repr=False)
class OtherModel(Brief):
    """A model of the library that the same channels feed, fitted to the same logs.

    Args:
        plain: the model as it is, with those effects of the diagnosed one that act in it.
        extended: with the effects of a short search of its own; ``None`` where that found nothing,
            or none was made.
        worth: share that it removes of the squared whole-run error of the diagnosed model with all
            that was found; below 0 it errs more.
    """

    plain: Fit
    extended: Fit | None
    worth: Worth

    @property
    def name(self) -> str:
        """Of the model."""
        return self.plain.model.name

    @property
    def best(self) -> Fit:
        """The last fit of the model."""
        return self.extended or self.plain

    @property
    def better(self) -> bool:
        """Whether it surely errs less, and clearly, than the diagnosed model with all its terms."""
        return self.worth.low > 0 and self.worth.share > SETTINGS.rival_models.clear_share

    def to_json(self) -> dict[str, Any]:
        """Both fits' effects and errors as plain data."""

        def data(fit: Fit) -> dict[str, Any]:
            effects = [effect.name for effect in fit.model.effects]
            holdout = fit.holdout and fit.holdout.to_json()
            return {"effects": effects, "train": fit.train.to_json(), "holdout": holdout}

        fits = {"plain": data(self.plain), "extended": self.extended and data(self.extended)}
        worth = self.worth.to_json()
        return {"model": self.name, **fits, "worth": worth, "better": self.better}


@dataclass(frozen=True, repr=False, kw_only=True)
class Selection(Brief):
    """Which effects a search has selected, and what became of the other candidates.

    Args:
        best: the effects that were added, at their estimated parameters: ``model + diag.best``.
        groups: for each added effect, all effects that these logs cannot tell from it.
        stages: the model as given, then with one effect after the other.
        ranking: the effects tried at each stage, the best first.
        untestable: effects that these logs cannot test, with the reason.
        dropped: effects that a later one made superfluous.
        exchanged: effects in whose place a rival came that whole runs prove better, with the rival.
        refused: effects that improved the fit of the training logs and were not added, with the
            reason.
        silent: effects whose trials gained nothing, and those that the linear screening left out.
        worth: of each added or detectable effect, what it removes of the squared whole-run error of
            unseen logs.
        detectable: effects that are certain and change nothing that matters over whole runs.
        detectable_groups: for each of these, all effects that these logs cannot tell from it.
        held: fixed parameters that these logs want elsewhere.
    """

    best: tuple[Effect, ...]
    groups: tuple[tuple[str, ...], ...]
    stages: tuple[Stage, ...]
    ranking: tuple[TriedEffect, ...]
    untestable: Mapping[str, str]
    dropped: tuple[str, ...]
    exchanged: Mapping[str, str] = field(default_factory=dict)
    refused: Mapping[str, Refusal] = field(default_factory=dict)
    silent: tuple[str, ...] = ()
    worth: Mapping[str, Worth] = field(default_factory=dict)
    detectable: tuple[str, ...] = ()
    detectable_groups: tuple[tuple[str, ...], ...] = ()
    held: Mapping[str, HeldValue] = field(default_factory=dict)

    @property
    def added(self) -> tuple[str, ...]:
        """Names of the added effects."""
        return tuple(effect.name for effect in self.best)

    @property
    def fit(self) -> Fit:
        """The fit of the last stage."""
        return self.stages[-1].fit


@dataclass(frozen=True, repr=False, kw_only=True)
class Assessment(Brief):
    """The model as given and the last stage against the logs: what the verdict rests on.

    Args:
        before: the model as given, held against the logs (unseen ones, if any): where it fails.
        after: the last stage, held against the same.
        trained: the model as given and the last stage, held against the training logs.
        one_step: scale of the last stage's one-step errors, by channel, of which a few that are
            large count no more than others: most lie within.
        remaining: structure that none of the effects tried explains.
        odd_logs: logs that disagree with the others.
        apart: where something is open and odd logs carry much of the error, the last stage without
            these, on which the verdict, ``remaining`` and ``one_step`` then rest: held against the
            other training logs, and the other logs that count.
        changed: where nothing else is left, a size of an added effect that changes in time or at a
            level of a signal.
        room: how much any flexible model could explain of the errors on which the verdict rests;
            worked out where whole runs err far above the noise and nothing in ``remaining`` says
            why.
        recurring: worked out where ``room`` may be, of runs that repeat their inputs: by channel
            the share of the squared error that recurs.
        idle_bounds: parameters of the model as given that a bound has stopped, beyond which whole
            runs do not surely err less, or not as little as with what was found.
    """

    before: Comparison
    after: Comparison
    trained: tuple[Comparison, Comparison] | None = field(default=None, repr=False)
    one_step: Mapping[str, float] = field(default_factory=dict)
    remaining: Remaining | None
    odd_logs: tuple[OddLog, ...] = ()
    apart: tuple[Comparison, Comparison] | None = field(default=None, repr=False)
    changed: ChangedSize | None = None
    room: Headroom | None = field(default=None, repr=False)
    recurring: Mapping[str, Worth] = field(default_factory=dict)
    idle_bounds: tuple[str, ...] = ()

    @property
    def judged(self) -> Comparison:
        """The last stage held against the logs on which the verdict rests."""
        return self.apart[1] if self.apart else self.after


@dataclass(frozen=True, repr=False, kw_only=True)
class Findings(Selection, Assessment):
    """What is missing from a model; besides, the fields of `Selection` and `Assessment`.

    Args:
        verdict: "adequate", "effects_found", "unexplained" (structure remains; effects may
            still have been added), or "undecided" (errors over whole runs are large and last, and
            these logs cannot tell a disturbance from missing physics).
        model: the model that was diagnosed, as it was given.
        missing: the missing signals of the model as given, the one that explains most first.
        left: those of the last stage, where structure remains beside the effects that were added.
        laws: what no known effect expresses, learned as curves, or as terms of states that are
            not measured.
        possible: where the verdict is "undecided" or "unexplained", effects and constants that
            would lower the errors over whole runs although one-step errors do not ask for them,
            with their worth.
        experiment: the test that would best separate the first group of several, or else show a
            possible effect, if there is one.
        seconds: time spent, by part of the work.
        mends: what undoing each doubt on the logs does to the error, measured by fits.
        other_models: where whole runs still err far above the noise, the other models of the
            library that the same channels feed, the one that errs least first.
        unused: channels of the logs that neither the model nor a known effect reads in it, with the
            effects and models that do.
        sought: whether effects were sought: none are in logs that are to be mended first.
        notes: what the user should know besides.
        origin: when and with which versions it was made, and of which logs.
    """

    verdict: Verdict
    model: Model
    missing: tuple[Missing, ...] = ()
    left: tuple[Missing, ...] = ()
    laws: tuple[LearnedLaw, ...] = ()
    possible: Mapping[str, Worth] = field(default_factory=dict)
    experiment: Experiment | None = None
    seconds: Mapping[str, float]
    mends: tuple[MeasuredMend, ...] = ()
    other_models: tuple[OtherModel, ...] = ()
    unused: Mapping[str, str] = field(default_factory=dict)
    sought: bool = True
    notes: tuple[str, ...] = ()
    origin: Origin | None = field(default=None, repr=False)

    @property
    def learned(self) -> tuple[Curve | Formula, ...]:
        """The learned laws as effects, as curves where no closed form was fitted in their place."""
        return tuple(law.effect for law in self.laws)

    @property
    def improved(self) -> Model:
        """The model with all that was found, at its estimates: effects, freed constants and laws.

        A law is in its closed form where one names it, and what it made superfluous is gone. It is
        the model of the lines to copy.
        """
        return (self.laws[-1].reported if self.laws else self.fit).model

    @property
    def doubts(self) -> tuple[Doubt, ...]:
        """What in the logs is probably not what its name, unit or clock says."""
        return tuple(self.stages[0].fit.doubts)

    @property
    def helpful_mends(self) -> tuple[MeasuredMend, ...]:
        """The mends of these doubts with which the error over whole runs surely falls."""
        return tuple(mend for mend in best_mends(self.mends) if mend.helps)

    def mends_of(self, doubt: Doubt) -> list[MeasuredMend]:
        """The mends of one doubt that were measured."""
        return mends_of(doubt, self.mends)

    @property
    def far(self) -> tuple[str, ...]:
        """The channels whose errors over whole runs are large and last, the worst first."""
        return verdict_evidence(self, self).far

    @property
    def repeating(self) -> tuple[str, ...]:
        """Those of them whose errors surely repeat, as a flexible model shows."""
        return verdict_evidence(self, self).repeating

    def shown(self, missing: Sequence[Missing]) -> tuple[Missing, ...]:
        """Missing signals in the units in which the logs were written."""
        units = ShownUnits((self.fit.written,))
        return tuple(signal.shown(self.fit.model, units) for signal in missing)

    @cached_property
    def headroom(self) -> tuple[Headroom, Headroom] | None:
        """How much any flexible model could explain, of the model as given and of the last stage.

        Worked out when it is first asked for; ``None`` where training and unseen logs have no
        channel in common.
        """
        if self.trained is None:
            return None
        unseen = self.stages[0].holdout is not None
        last = None if self.apart else self.room
        last = last or headroom_between(self.trained[1], self.after if unseen else None)
        if last is None or len(self.stages) == 1:
            return last and (last, last)
        first = headroom_between(self.trained[0], self.before if unseen else None)
        return first and (first, last)


def verdict_evidence(selection: Selection, assessment: Assessment) -> VerdictEvidence:
    """The numbers from which the verdict follows, on the logs on which it rests."""
    last, judged = selection.stages[-1], assessment.judged
    noise = dict(assessment.one_step)
    for run in judged.runs:
        for name, trace in run.channels.items():
            stated = run.log.noise_in(name, trace.unit)
            noise[name] = min(stated or math.inf, noise.get(name, math.inf))
    channels = assessment.room.channels if assessment.room else {}
    recurring = assessment.recurring
    return VerdictEvidence(
        errors=judged.errors if assessment.apart else last.holdout or last.train,
        noise=noise,
        repeated={
            name: max(share.low for share in (channels.get(name), recurring.get(name)) if share)
            for name in {*channels, *recurring}
        },
        structure=assessment.remaining is not None or assessment.changed is not None,
        contradicted=bool(judged.hints),
        added=bool(selection.best),
        freed=bool(selection.held),
    )

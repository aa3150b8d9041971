"""The stages of a diagnosis: screen the candidates, add the best, drop what became superfluous."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from diffthrust._support.errors import InputError
from diffthrust.comparison._compare import compare
from diffthrust.diagnosis._candidates import candidates_of
from diffthrust.diagnosis._criteria import criterion
from diffthrust.diagnosis._ports import KNOTS
from diffthrust.diagnosis._result import Candidate, Remaining, Stage
from diffthrust.diagnosis._screen import screened
from diffthrust.diagnosis._structure import gain_of, remaining_structure
from diffthrust.diagnosis._trials import Trial, Trials, side_by_side
from diffthrust.diagnosis._whole_runs import missed, no_better
from diffthrust.effects import EFFECTS
from diffthrust.estimation._fit import fit as fit_model
from diffthrust.estimation._result import Fit
from diffthrust.logs._log import Log
from diffthrust.models._base.effect import Effect
from diffthrust.models._base.model import Model
from diffthrust.simulation._step_size import CoarseStepWarning

MOST_SUBSTEPS = 2
"""Integrator steps per sample of the trials: over one sample ahead, errors do not build up."""
MARGIN = 4.0
"""An effect is added where it lowers the information criterion by more than this, so that one of
some thirty candidates passes by chance in about one diagnosis of a hundred."""
SCREENS = 3
"""Most screens for one stage: a better noise may come to light again and again on flat ridges."""
CARRIED = 6
"""So many of the effects tried at a stage are fitted to the end."""
ALONE = 0.05
"""An effect is worth a closer look where its likelihood ratio alone would come so rarely."""
CLEAR = 20.0
"""Where the criterion falls by more than this, no noise that it makes superfluous matters."""
PLAIN = 200.0
"""No doubt is left where the criterion falls, or the log-likelihood is lost, by so much."""
WORSE = 3.0
"""A noise that costs the unseen logs more log-likelihood than this (odds of 20 to 1) is no better
one. An effect is refused whose gain is no longer worth its price when that cost is taken from it:
of training and unseen logs neither speaks louder than its likelihood."""
GONE = 1e-2
"""A positive parameter below this share of what simulations say is as good as zero."""
POOR = 0.5
"""With a larger error of whole training runs (NRMSE) the fit may have gone astray."""
PART = 0.3
"""An effect that explains less than this part of what an unknown signal does is not it."""
OWN = 0.5
"""It is something else, and missing as well, if it keeps so much of its gain beside that signal."""


Progress = Callable[[str, float], None]


@dataclass
class Stages:
    """The stages of one diagnosis."""

    train: Sequence[Log]
    unseen: Sequence[Log]
    seed: int
    say: Progress
    stages: list[Stage] = field(default_factory=list)
    ranking: list[Candidate] = field(default_factory=list)
    dropped: list[str] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=dict)
    options: dict[str, Any] = field(default_factory=dict)
    refused: dict[str, str] = field(default_factory=dict)
    barred: set[str] = field(default_factory=set)
    silent: set[str] = field(default_factory=set)
    guess: Mapping[str, float] = field(default_factory=dict)
    _criterion: tuple[Trial, float] | None = None
    _spared: dict[str, tuple[Trial, Trial]] = field(default_factory=dict)
    _structure: tuple[Trial, Remaining | None] | None = None

    def timed(self, what: str, work: Callable[..., Any], *args: Any, **options: Any) -> Any:
        begun = time.perf_counter()
        done = work(*args, **options)
        self.seconds[what] = self.seconds.get(what, 0.0) + time.perf_counter() - begun
        return done

    def begin(self, fit: Fit | Model, wanted: Any) -> None:
        """Fit the model as it is, and compile the trials."""
        self.say("fitting the model as it is", 0.0)
        if isinstance(fit, Fit):
            self.options = fit.options
        given = fit
        fit = self.fitted(given) if isinstance(given, Model) else given
        self.guess = fit.guess
        if fit is given and not self._is_of_these_logs(fit):
            fit = self.fitted(fit.model)
        self.given = fit.model
        effects, self.untestable = candidates_of(fit.model, (*self.train, *self.unseen), wanted)
        self.stages.append(Stage((), fit))
        self.say("compiling the trials", 0.1)
        for substeps in dict.fromkeys((min(fit.substeps, MOST_SUBSTEPS), fit.substeps)):
            noise = fit.noise_model
            self.trials = Trials(fit.model, effects, self.train, self.unseen, substeps, noise)
            self.present = self.timed("compile", self.trials.base, self.trials.values_of(fit.model))
            if math.isfinite(self.present.cost):
                break
        else:
            raise self._not_finite(fit, effects)
        self.first = self.present

    def _not_finite(self, fit: Fit, effects: Sequence[Effect]) -> InputError:
        """What to say where no trial can be begun: the effects of the user's own that are why."""
        for effect in effects:
            if type(effect) is EFFECTS.get(effect.name):
                continue
            alone = Trials(fit.model, [effect], self.train, [], fit.substeps)
            if not math.isfinite(alone.base(alone.values_of(fit.model)).cost):
                return InputError(
                    f"The effect '{effect.name}' cannot be tried: at its null value the errors or "
                    "their derivatives are not finite.",
                    "Write it so that its derivative at the null is finite (no root or logarithm "
                    "of zero), or leave it out.",
                )
        return InputError(
            f"The '{fit.model}' cannot be carried over these logs at the parameters of its fit "
            f"({fit.status.value}): expected finite one-step errors, found none.",
            "Give bounds that keep its time constants longer than a fifth of a sample.",
        )

    def _is_of_these_logs(self, fit: Fit) -> bool:
        """Whether a fit's errors are those of the logs of this diagnosis."""
        if len(fit.initial) != len(self.train) or (fit.holdout is None) == bool(self.unseen):
            return False
        told = [(fit.train, compare(fit, self.train, initial=fit.initial, substeps=fit.substeps))]
        if fit.holdout:
            told.append((fit.holdout, compare(fit, self.unseen, substeps=fit.substeps)))
        return all(math.isclose(a.nrmse, b.errors.nrmse, rel_tol=1e-6) for a, b in told)

    def advance(self) -> bool:
        """Add the best effect, if any is worth it; drop what it made superfluous.

        On its way a better noise may be found; then the candidates are screened anew beside it.
        """
        for again in reversed(range(SCREENS)):
            before = self.present
            if self._added(again > 0):
                return True
            if self.present is before:
                break
        return False

    def _added(self, again: bool) -> bool:
        number = len(self.stages) - 1
        tried = self.timed("screen", self._screen, number)
        rated = sorted(tried, key=lambda pair: pair[0].delta_bic)
        for place, (candidate, trial) in enumerate(rated):
            doubtful = (place == 0 and candidate.delta_bic > -PLAIN) or self.trials.idle(trial)
            worth = again and doubtful and candidate.delta_bic < -MARGIN
            if worth and self._better_noise(candidate, trial):
                return False
        self.refused, self.barred = {}, set()  # what was refused earlier has been tried anew
        earlier = [candidate for candidate in self.ranking if candidate.stage < number]
        self.ranking = earlier + [candidate for candidate, _ in rated]
        for place, (candidate, trial) in enumerate(rated):
            if place and candidate.p_value < ALONE:  # beside the first its noise was not priced
                candidate = self._rated(number, trial, math.inf)
            if candidate.delta_bic > -MARGIN:
                continue
            why = self._refusal(candidate, trial)
            if why is None:
                return len(self.stages) - 1 > number
            self.refused[candidate.effect] = why
        return False

    def _refusal(self, candidate: Candidate, trial: Trial) -> str | None:
        """Add an effect, with a stage of its own, or say why not.

        Without a stage nor a reason the effect has turned out superfluous.
        """
        if not self._comparable(candidate, trial):
            return "explains a small part of what a signal of unknown form explains"
        before, dropped, clipped = self.present, list(self.dropped), self.trials.problem
        settled = self.timed(
            "screen", self.trials.settled, trial.effects, trial.values, trial.begin
        )
        unseen = self.trials.unseen_gain(before, settled)
        if candidate.delta_bic - 2 * min(unseen, 0.0) > -MARGIN:
            self.trials.problem = clipped
            return "costs the unseen logs what it gains on the training logs"
        self.present = settled
        self._drop()
        if set(self.present.effects) != set(before.effects):
            number = len(self.stages) - 1
            self.say(f"refitting with {candidate.effect}", 0.3 + 0.1 * number)
            stage = self.timed("refit", self._stage)
            swapped = self.dropped != dropped and candidate.effect in self.present.effects
            if swapped and missed(self.stages[-1], stage):
                self.present, self.dropped = settled, dropped
                stage = self.timed("refit", self._stage)
            if (why := no_better(self.stages[-1], stage)) is not None:
                self.present, self.dropped, self.trials.problem = before, dropped, clipped
                self.barred.add(candidate.effect)
                return f"predicts the next sample better, and {why}"
            self.stages.append(stage)
        return None

    def _comparable(self, candidate: Candidate, trial: Trial) -> bool:
        """Whether an effect explains what is missing, not a small part that it happens to touch.

        A function of one signal that no known effect is like may explain far more. What an effect
        explains is its own where that function explains as much beside it as it did alone.
        """
        left = self.timed("remaining", self.structure)
        if left is None:
            return True
        unknown = left.gain - KNOTS * math.log(self.trials.samples)
        if -candidate.delta_bic > PART * unknown:
            return True
        beside = self.timed("remaining", gain_of, self.trials, trial, left)
        kept = candidate.likelihood_ratio - (left.gain - beside)
        return kept > max(OWN * candidate.likelihood_ratio, self.price(trial) + MARGIN)

    def structure(self) -> Remaining | None:
        """What the present model leaves unexplained."""
        if self._structure is None or self._structure[0] is not self.present:
            self._structure = (self.present, remaining_structure(self.trials, self.present))
        return self._structure[1]

    def _better_noise(self, candidate: Candidate, trial: Trial) -> bool:
        """Whether a trial, its effect taken out, explains the logs better than the present one.

        Its gain was then not the effect's: on its way the fit has found a better noise.
        """
        clipped = self.trials.problem
        values = self.trials.absent(candidate.effect, trial.values)
        without = self.trials.settled(self.present.effects, values, trial.begin)
        better = without.cost < self.present.cost - 0.5 * MARGIN
        if better and not self._worse_unseen(without):
            self.present = without
            return True
        self.trials.problem = clipped
        return False

    def _worse_unseen(self, trial: Trial) -> bool:
        """Whether a trial with its own noise predicts unseen logs worse than the present one."""
        return self.trials.unseen_cost(trial) > self.trials.unseen_cost(self.present) + WORSE

    def _screen(self, number: int) -> list[tuple[Candidate, Trial]]:
        names = [n for n in self.trials.candidates if n not in self.present.effects]

        def say(name: str) -> None:
            share = 0.2 + 0.1 * number + 0.1 * names.index(name) / len(names)
            self.say(f"stage {number + 1}: trying {name}", share)

        found = []
        levels = self.trials.levels(self.present)
        screen = screened(self.trials, names, self.present, levels, say, self._other_values())
        for name, trial in screen.items():
            # what gains so much, the other parameters cannot do from where they are
            gains = self.present.cost - trial.cost > PLAIN
            if not gains and self.trials.redundant(trial):
                self.untestable.setdefault(name, "other parameters do the same to what is measured")
            else:
                found.append((name, trial))
        self.silent.update({*names} - {name for name, _ in found})
        found.sort(key=lambda pair: pair[1].expected)
        ended = side_by_side(self.trials.further, [trial for _, trial in found[:CARRIED]])
        ended += [trial for _, trial in found[CARRIED:]]
        self._present_criterion()  # before any of several threads asks
        leading = min((self.price(trial) + 2 * trial.cost for trial in ended), default=0.0)

        def rated(trial: Trial) -> Candidate:
            return self._rated(number, trial, leading)

        return list(zip(side_by_side(rated, ended), ended, strict=True))

    def _other_values(self) -> Mapping[str, float] | None:
        """Values to try effects with besides the present ones, which may have gone astray.

        Where whole runs fail the search's own; where the observer explains all by random forces,
        and the model is left with nothing to do, those of the simulation.
        """
        stage = self.stages[-1]
        if self.guess and stage.train.nrmse > POOR:
            return self.guess
        fitted = {n: p.value for n, p in stage.fit.model.parameters.items() if not p.fixed}
        logs = [n for n in self.trials.own if self.trials.problem.named[n].transform == "log"]
        gone = any(self.present.values[n] < GONE * fitted[n] for n in logs if n in fitted)
        return fitted if gone else None

    def _rated(self, number: int, trial: Trial, leading: float) -> Candidate:
        """What is told of a trial; its noises are priced where that may make it the best."""
        from scipy.special import chdtrc  # slow to import

        name = trial.effects[-1]
        own = self._own(name, trial)
        ratio = max(0.0, 2 * (self.present.cost - trial.cost))
        p_value = float(chdtrc(len(own), ratio))
        delta = self.price(trial) - ratio
        behind = self.price(trial) + 2 * trial.cost - leading
        if delta > -CLEAR and p_value < ALONE and behind < CLEAR:
            delta = criterion(self.trials, trial) - self._present_criterion()
        errors = self.trials.simulation_errors(trial)
        named = self.trials.problem.named
        return Candidate(
            stage=number,
            effect=name,
            likelihood_ratio=ratio,
            delta_bic=delta,
            p_value=p_value,
            holdout_gain=self.trials.unseen_gain(self.present, trial),
            train_nrmse=errors[0],
            holdout_nrmse=errors[1],
            parameters={n.partition(".")[2]: (trial.values[n], named[n].unit) for n in own},
        )

    def _present_criterion(self) -> float:
        if self._criterion is None or self._criterion[0] is not self.present:
            self._criterion = (self.present, criterion(self.trials, self.present))
        return self._criterion[1]

    def _drop(self) -> None:
        """Take out every effect without which the criterion is no worse.

        The last one too: on its way to the optimum the fit may have found a better noise.
        """
        newest = self.present.effects[-1]
        for name in self.present.effects:
            without = self.without(name)
            loss = 2 * (without.cost - self.present.cost) - self.price(self.present, name)
            if loss < CLEAR:
                loss = criterion(self.trials, without) - self._present_criterion()
            if loss < MARGIN:
                if name != newest:
                    self.dropped.append(name)
                self.present = without

    def without(self, name: str) -> Trial:
        """The present model, fitted without one of its effects.

        Not to the end where a few steps show that much is lost.
        """
        present = self.present
        if name in self._spared and self._spared[name][0] is present:
            return self._spared[name][1]
        rest = tuple(n for n in present.effects if n != name)
        values = self.trials.absent(name, present.values)
        found = self.trials.solve(rest, values, present.begin, budget=12)
        if found.promise > 0 and found.expected < present.cost + PLAIN:
            found = self.trials.further(found)
        self._spared[name] = (present, found)
        return found

    @staticmethod
    def _own(name: str, trial: Trial) -> list[str]:
        """The estimated parameters of one effect."""
        return [n for n in trial.names if n.rpartition(".")[0] == name]

    def price(self, trial: Trial, name: str | None = None) -> float:
        """What the criterion charges for an effect of a trial; the last one if not said."""
        return len(self._own(name or trial.effects[-1], trial)) * math.log(self.trials.samples)

    def _stage(self) -> Stage:
        effects = [self.trials.candidates[n] for n in self.present.effects]
        model = self.trials.with_values(self.given + effects, self.present.values)
        return Stage(self.present.effects, self.fitted(model))

    def fitted(self, model: Model) -> Fit:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", CoarseStepWarning)  # a note of the fit says the same
            return self.timed(
                "refit",
                fit_model,
                model,
                self.train,
                holdout=self.unseen or None,
                starts=4,
                seed=self.seed,
                **self.options,
            )

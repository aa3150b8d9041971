"""The words of a diagnosis: its model, its effects, their sizes, and what stopped at a bound."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from diffthrust._support.words import (
    an,
    capitalised,
    distinct_numbers,
    humanize,
    joined,
    number,
    percent,
    with_error,
)
from diffthrust.diagnosis._bounds import stopped_by_bound, vanished_parameters
from diffthrust.diagnosis._explained_share import adds_little, share_words, surely_removes
from diffthrust.diagnosis._findings import Findings, OtherModel
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.estimation._estimate import Estimate
from diffthrust.estimation._result import Fit
from diffthrust.estimation._status import Status
from diffthrust.estimation._unexplained import farthest_runaway
from diffthrust.models._base.effect import EFFECTS, Effect
from diffthrust.models._base.model import Model
from diffthrust.simulation._errors import Errors

UNFINISHED = {
    Status.NOT_IDENTIFIABLE: "these logs do not tell all its parameters apart",
    Status.STARTS_DISAGREE: "{} depends on where it starts",
    Status.NOT_CONVERGED: "{} did not converge",
    Status.SIMULATION_FAILED: "{} could not be simulated",
}
"""Why a fit is none that can be relied on; "{}" is the fit."""


def amount(size: str, unit: str) -> str:
    return f"{size} {unit}".rstrip()


def with_unit(value: float, unit: str, digits: int = 2) -> str:
    return amount(number(value, digits), unit)


def measured(estimate: Estimate) -> str:
    """A value to the digits that its standard error allows, two or three."""
    precise = estimate.std_error is not None and estimate.std_error < 0.003 * abs(estimate.value)
    value, _, unit = estimate.shown
    return with_unit(value, unit, 3 if precise else 2)


def change_words(first: float, last: float) -> str:
    """What an error does: "falls from 5.6 to 0.30"; neither where one of the two is no number."""
    start, end = distinct_numbers(first, last)
    if start == end:
        return f"stays at {start}"
    verb = "falls" if last < first else "rises" if last > first else "goes"
    return f"{verb} from {start} to {end}"


def verdict_words(diag: Findings) -> str:
    """The verdict as a person would say it."""
    if diag.verdict == "effects_found" and not diag.best:
        return "a fixed constant disagrees with these logs"
    if diag.verdict == "unexplained":
        return "something remains unexplained"
    return humanize(diag.verdict)


def model_words(model: Model) -> str:
    """The model in words: "basic thruster", "thruster with command dead band"."""
    effects = joined(humanize(effect.name) for effect in model.effects)
    return f"{humanize(model.name)} with {effects}" if effects else f"basic {humanize(model.name)}"


def an_effect(name: str) -> str:
    """An effect by its name: "a command dead band"; one of one word without article: "wind"."""
    return an(humanize(name)) if "_" in name else humanize(name)


def candidate_words(diag: Findings, name: str, called: Callable[[str], str] = an_effect) -> str:
    """An effect as it is called, or a fixed constant: "another value of lever_arm"."""
    return f"another value of {name}" if name in diag.fit.model.parameters else called(name)


def sized_words(name: str, fit: Fit, *more: str) -> str:
    """An effect with its values and what they come to: "a command dead band of ±0.40 V"."""
    called, *within = _sized(name, fit)
    within = [words for words in (*within, *more) if words]
    return f"{called} ({'; '.join(within)})" if within else called


def _sized(name: str, fit: Fit) -> tuple[str, ...]:
    """An effect with its one value, and what stands in its brackets."""
    effect = _effect_of(name, fit)
    called = an_effect(name)
    if effect is None:
        return (called,)
    if of_logs := effect.over_logs(fit.ranges):
        return called, of_logs
    if by_log := _by_log_words(effect, fit):
        return (f"{called} of {by_log}",)
    values = {
        full.removeprefix(f"{name}."): measured(e)
        for full, e in fit.parameters.items()
        if full.startswith(f"{name}.") and not e.fixed
    }
    formed = "".join(f", {humanize(key)} {value:g}" for key, value in effect.form.items())
    if effect.free_starts:
        formed += f", {effect.size_words(_numbers_by_log(name, effect.free_starts, fit))}"
    consequence = effect.consequence(fit.model, _recorded(fit))
    if set(values) == {"half_width"}:
        values["half_width"] = f"±{values['half_width']}"
    if len(values) == 1:
        return f"{called} of {next(iter(values.values()))}{formed}", consequence
    listed = ", ".join(f"{humanize(key)} {value}" for key, value in values.items())
    return (called, f"{listed}{formed}", consequence) if listed else (called,)


def effect_words(name: str, fit: Fit) -> str:
    """An effect as a person would say it: "commands within ±0.40 V do nothing"."""
    effect = _effect_of(name, fit)
    called = an_effect(name)
    if effect is None:
        return called
    if by_log := _by_log_words(effect, fit):
        return f"{called} of {by_log}"
    if consequence := effect.consequence(fit.model, _recorded(fit)):
        return consequence
    estimates = {n: fit.parameters[f"{name}.{n}"] for n in effect.declared}
    if effect.in_words:
        return effect.in_words.format(**{n: _Amount(e) for n, e in estimates.items()})
    free = [e for e in estimates.values() if not e.fixed]
    return f"{called} of {measured(free[0])}" if len(free) == 1 else called


@dataclass(frozen=True)
class _Amount:
    """An estimate in a sentence: a size in its unit, ``:%`` a share, ``:more`` a change of one."""

    estimate: Estimate

    def __format__(self, form: str) -> str:
        """The estimate as `Effect.in_words` asks for it."""
        value = self.estimate.value
        if form == "%":
            return share_words(value)
        if form == "more":
            return f"{percent(abs(value))} {'more' if value > 0 else 'less'}"
        return measured(self.estimate)


def _effect_of(name: str, fit: Fit) -> Effect | None:
    return next((effect for effect in fit.model.effects if effect.name == name), None)


def _by_log_words(effect: Effect, fit: Fit) -> str:
    """The size of an effect in the logs, where its parameters differ by log; "" where none does."""
    differing = [n for n, p in effect._parameters.items() if p.per_log]
    starts = _numbers_by_log(effect.name, differing, fit)
    return effect.size_words(starts) if differing else ""


def _numbers_by_log(name: str, own: Iterable[str], fit: Fit) -> list[dict[str, float]]:
    """Log by log the numbers of an effect that are the log's own."""
    return [{n: log[f"{name}.{n}"] for n in own} for log in fit.initial]


def _recorded(fit: Fit) -> set[str]:
    """The channels of the training logs that the fitted model reads or gives."""
    return {*fit.ranges, *fit.train.channels}


# -- which effects, which fit, which errors --------------------------------------------------------


def leading(diag: Findings) -> tuple[str, ...]:
    """The added effects, the one that removes most of the error first."""
    worth = {name: diag.worth[name].share for name in diag.added if name in diag.worth}
    return tuple(sorted(diag.added, key=lambda name: -worth.get(name, math.inf)))


def adding_little(diag: Findings) -> tuple[str, ...]:
    """The effects that surely remove something, and no tenth of the squared error.

    Beside the first, or beside what was learned: an EMPS had "the thrust is reported 0.0056 s late"
    (2 %) above a friction that removes 98 %.
    """
    return tuple(
        name
        for name in leading(diag)[0 if diag.laws else 1 :]
        if (worth := diag.worth.get(name)) and surely_removes(worth) and adds_little(worth)
    )


def copied_fit(diag: Findings) -> Fit:
    """The fit whose numbers are copied: with what was learned, if anything was."""
    return diag.laws[-1].reported if diag.laws else diag.fit


def last_errors(diag: Findings) -> Errors:
    """With all that was found, over whole runs of the logs that count."""
    if diag.laws:
        return copied_fit(diag).holdout or copied_fit(diag).train
    return judged_errors(diag)[1]


def provisional(diag: Findings) -> bool:
    """Whether what was found rests on a fit that did not end, or that follows no channel at all.

    An Otter's thruster had its "zero off by -493 rpm" by a fit that did not converge; least squares
    put it at -37.
    """
    # those with a law are of all logs, the odd ones among them
    errors = last_errors(diag) if diag.apart is None else judged_errors(diag)[1]
    blind = all(not e.nrmse < 1.0 for e in errors.channels.values())
    return blind or copied_fit(diag).status in (Status.NOT_CONVERGED, Status.SIMULATION_FAILED)


def errors_of(diag: Findings) -> tuple[str, Errors, Errors]:
    """Name of the logs that count, and the errors on them at the first and the last stage."""
    first, last = diag.stages[0], diag.stages[-1]
    if first.holdout is not None and last.holdout is not None:
        return "unseen logs", first.holdout, last.holdout
    return "the training logs", first.train, last.train


def judged_errors(diag: Findings) -> tuple[str, Errors]:
    """Name of the logs on which the verdict rests, and the errors of the last stage on them."""
    logs, _, errors = errors_of(diag)
    if diag.apart is None:
        return logs, errors
    return f"the other {logs.removeprefix('the ')}", diag.judged.errors


def tried_count(diag: Findings) -> int:
    """How many effects were tried."""
    return len({c.effect for c in diag.ranking} | {*diag.silent})


def blind_channels(diag: Findings) -> str:
    """The channels that the last model follows no better than a constant would, in words."""
    errors = judged_errors(diag)[1].channels
    return joined(humanize(name) for name, e in errors.items() if e.nrmse >= 1.0)


def better_model(diag: Findings) -> OtherModel | None:
    """The model of the library that surely errs less on the same logs, if there is one."""
    return next((other for other in diag.other_models if other.better), None)


def stage_words(diag: Findings, index: int) -> str:
    """What a stage added: "as given", "+ command dead band", "lever_arm freed"; "- ..." if lost."""
    if index == 0:
        return "as given"
    current, previous = diag.stages[index].effects, diag.stages[index - 1].effects
    added = [name for name in current if name not in previous]
    changes = [f"{name} freed" if name in diag.held else f"+ {humanize(name)}" for name in added]
    changes += [f"- {humanize(name)}" for name in previous if name not in current]
    return ", ".join(changes)


def rival_words(diag: Findings) -> dict[str, str]:
    """For each added effect that has rivals, what these logs cannot distinguish from it.

    Rivals that were added later are none: model and logs tell both apart.
    """
    rivals = {
        name: [candidate_words(diag, rival) for rival in group if rival not in diag.added]
        for name, group in zip(diag.added, diag.groups, strict=True)
    }
    return {name: joined(words, "or") for name, words in rivals.items() if words}


def unmeasured_rivals(diag: Findings) -> dict[str, str]:
    """For each added effect the first channel that no log has, and that could look like it.

    The channel that another effect at the same port needs: under an inflow that nobody measured a
    thruster seemed to push less in reverse. Not for an effect that remembers, such as a lag, and
    not where whole runs err as little as one-step predictions: on a bench in still water an
    asymmetry explains all there is, which a channel that nobody measures would not.
    """
    floor, errors = SETTINGS.unknown_term.noise_floor, judged_errors(diag)[1].channels
    if all(e.rmse <= floor * diag.one_step.get(name, 0.0) for name, e in errors.items()):
        return {}
    rivals = {}
    for effect in diag.best:
        untested = (EFFECTS[name] for name in diag.untestable if name in EFFECTS)
        needs = [n for other in untested if {*other.ports} & {*effect.ports} for n in other.needs]
        lacking = [n for n in needs if not any(n in run.log.inputs for run in diag.before.runs)]
        if lacking and not effect.states and not effect.memory:
            rivals[effect.name] = humanize(lacking[0])
    return rivals


# -- constants, bounds and terms that vanished -----------------------------------------------------


def held_words(diag: Findings) -> list[str]:
    """Every fixed constant that the logs contradict."""
    sentences = []
    for name, held in diag.held.items():
        words = diag.fit.model.constant_words(name, held.value, held.wanted)
        wanted = amount(" ± ".join(with_error(held.wanted, held.std_error)), held.unit)
        sentences.append(
            f"{name} is fixed at {amount(f'{held.value:.4g}', held.unit)}; these logs suggest "
            f"{wanted}{f' ({words})' if words else ''}. Measure it again, or free it: "
            f"model.free('{name}')."
        )
    return sentences


def ran_away(diag: Findings) -> tuple[str, float] | None:
    """The parameter of the model as given that ran away beyond all belief, and its value.

    None of an effect: the water in a duct may have any mass where no sensor reads its speed.
    """
    return farthest_runaway(diag.fit, diag.stages[0].fit.guess)


def stopped_words(diag: Findings) -> list[str]:
    """Every parameter of the model as given that a bound has stopped.

    Also those at a bound until effects were added, which may stand in for values beyond it.
    """
    first, last = stopped_parameters(diag.stages[0].fit), stopped_parameters(diag.fit)
    added = joined(map(an_effect, diag.added))
    sentences = []
    for full, (name, bound, way) in {**first, **last}.items():
        if full not in diag.model.parameters:
            continue
        idle = full in diag.idle_bounds
        if full in last:
            meaning = (
                "beyond it whole runs do not surely err less."
                if idle
                else f"these logs favour a {way} value. What follows holds under that bound: widen "
                "it, if physically possible, and diagnose again."
            )
            sentences.append(f"{name} stopped at its bound of {bound}: {meaning}")
        elif added and not idle:
            sentences.append(
                f"{name} was at its bound of {bound} without {added}, which may stand in for a "
                f"{way} {name}: widen the bound, if physically possible, and diagnose again."
            )
    return sentences


def added_bound_words(diag: Findings) -> list[str]:
    """Every parameter of an added effect that a bound has stopped."""
    return [
        f"{name} {beyond_bound(bound)}"
        for full, (name, bound, _) in stopped_parameters(diag.fit).items()
        if full not in diag.model.parameters
    ]


def beyond_bound(bound: str) -> str:
    """What a parameter at its bound means for its effect, and the mend."""
    return (
        f"stopped at its bound of {bound}: the effect may explain more beyond it. Widen the "
        "bound, if physically possible."
    )


def stopped_parameters(fit: Fit) -> Mapping[str, tuple[str, str, str]]:
    """Of parameters that a bound stopped name, bound, and which way they went, in words."""
    stopped = {}
    for full in stopped_by_bound(fit):
        effect, _, name = full.rpartition(".")
        e, (low, high) = fit.parameters[full], fit.model.parameters[full].limits
        above = abs(e.value - high) < abs(e.value - low)
        bound = amount(f"{e.shown[0]:.4g}", e.shown[2])
        stopped[full] = parameter_words(name, effect), bound, "higher" if above else "lower"
    return stopped


def parameter_words(name: str, effect: str) -> str:
    """A parameter of an effect; by its name alone where the effect is a constant of that name."""
    if not effect:
        return name
    if name == effect:  # "lever arm of a lever arm"
        return capitalised(humanize(name))
    return capitalised(f"{humanize(name)} of {an_effect(effect)}")


def vanished_words(diag: Findings) -> list[str]:
    """The parameters of the model as given that effects have brought to zero, and their terms."""
    first, last = ({*vanished_parameters(s.fit)} for s in (diag.stages[0], diag.stages[-1]))
    names = [n for n in diag.model.parameters if n in last - first]
    if not names:
        return []
    go, terms = ("goes", "its term") if len(names) == 1 else ("go", "their terms")
    return [
        f"Beside {joined(map(an_effect, diag.added))} {joined(names)} {go} to zero: the model does "
        f"as well without {terms}."
    ]

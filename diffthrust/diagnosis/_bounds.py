"""Parameters that a bound has stopped, and those of them that gain nothing beyond it."""

from __future__ import annotations

import math
from collections.abc import Sequence

from diffthrust.diagnosis._explained_share import matters, surely_less
from diffthrust.diagnosis._search_state import SOUGHT, FittedStage, SearchContext
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.diagnosis._stage_fit import worth_between
from diffthrust.effects import EFFECTS
from diffthrust.estimation._result import Fit


def stopped_by_bound(fit: Fit) -> tuple[str, ...]:
    """The parameters that a bound has stopped.

    Without those at the null of their effect, or at the zero of a logarithm: there the effect has
    vanished, which the notes say. Without shares that are whole, of which there is no more, and
    without logarithms that ran to where numbers end.
    """
    stopped = []
    for full, p in fit.model.parameters.items():
        e, (effect, _, name) = fit.parameters[full], full.rpartition(".")
        vanished = e.value == p.null or _is_zero(fit, full)
        ran_away = not math.isfinite(p.limits[_is_high(fit, full)])
        if e.at_bound and not (vanished or ran_away or is_whole(effect, name, e.value)):
            stopped.append(full)
    return tuple(stopped)


def idle_bounds(context: SearchContext, first: FittedStage, last: FittedStage) -> tuple[str, ...]:
    """The parameters of the model as given that gain nothing beyond the bounds that stopped them.

    The last stage is fitted from where it is, without its bounds, and must surely err less over
    whole runs to speak for wider ones: "m22 is at its bound of 15 kg: widen it" was said of a
    BlueBoat, whose sway no mass explains. Without all of them at once: masses, inertia and dampings
    share one scale, and none gains alone while a bound holds another. Bounds that stopped the model
    as given alone must bring it nearly to where the effects do, or these do not stand in for them.
    """
    given = context.given.parameters
    now = [n for n in stopped_by_bound(last.fit) if n in given]
    before = [n for n in stopped_by_bound(first.fit) if n in given and n not in now]
    idle = now if now and _gains(context, last, now) is False else []
    if before and first is not last and _falls_short(context, first, last, before):
        idle = [*idle, *before]
    return tuple(idle)


def _gains(context: SearchContext, last: FittedStage, names: Sequence[str]) -> bool | None:
    """Whether whole runs surely err less without these bounds; ``None`` where a fit cannot tell."""
    freed = _without(context, last, names)
    if not (freed.fit.status.ok and math.isfinite(freed.train.nrmse)):
        return None
    worth = worth_between(last, freed)
    return matters(worth) or surely_less(worth.of_all)


def _falls_short(
    context: SearchContext, first: FittedStage, last: FittedStage, names: Sequence[str]
) -> bool:
    """Whether the model as given, without these bounds, errs more than with all that was found."""
    freed = _without(context, first, names)
    errors, present = (stage.holdout or stage.train for stage in (freed, last))
    most = SETTINGS.whole_runs.equivalent_error * present.nrmse
    return freed.fit.status.ok and errors.nrmse > most


def _without(context: SearchContext, stage: FittedStage, names: Sequence[str]) -> FittedStage:
    """A stage without some bounds, fitted from where it is."""
    values = {n: p.value for n, p in stage.fit.model.parameters.items() if not p.fixed}
    context.say(f"fitting without the bounds of {', '.join(names)}", SOUGHT)
    bounds = {name: {"bounds": _opened(stage.fit, name)} for name in names}
    model = stage.fit.model.replace(bounds)
    refitted = context.refit(model, [values], starts=1, like=stage.fit)
    return FittedStage(stage.effects, *refitted)


def _opened(fit: Fit, name: str) -> tuple[float | None, float | None]:
    """The bounds of a parameter without the one at which it stands."""
    parameter = fit.model.parameters[name]
    low, high = parameter.bounds
    if _is_high(fit, name):
        return low, None
    return 0.0 if parameter.transform == "log" else None, high


def vanished_parameters(fit: Fit) -> tuple[str, ...]:
    """The parameters at the zero of a logarithm, where their terms are absent."""
    return tuple(n for n, e in fit.parameters.items() if e.at_bound and _is_zero(fit, n))


def _is_zero(fit: Fit, name: str) -> bool:
    """Whether a parameter at a bound is at the zero of a logarithm."""
    parameter = fit.model.parameters[name]
    return parameter.transform == "log" and parameter.limits[0] <= 0 and not _is_high(fit, name)


def _is_high(fit: Fit, name: str) -> bool:
    """Whether a parameter at a bound is at the upper one, or fifteen decades above its start."""
    value, (low, high) = fit.parameters[name].value, fit.model.parameters[name].limits
    if math.isfinite(high):
        return bool(abs(value - high) < abs(value - low))
    return bool(value > fit.guess.get(name, value))


def is_whole(effect: str, name: str, value: float) -> bool:
    """Whether a number of a known effect is a share at its natural end: a full sag, a swap."""
    described = EFFECTS.get(effect.rpartition(".")[2])  # on a craft behind the actuator's name
    declared = described.declared.get(name) if described else None
    ends = declared.bounds if declared and not declared.unit else ()
    return value in ends and value in (-1.0, 0.0, 1.0)

"""Parameters that a bound has stopped, and those of them that gain nothing beyond it."""

from __future__ import annotations

import math
from collections.abc import Sequence

from diffthrust.diagnosis._admission import worths_between
from diffthrust.diagnosis._explained_share import matters, surely_less
from diffthrust.diagnosis._search_state import SOUGHT, FittedStage, SearchContext
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


def idle_bounds(context: SearchContext, last: FittedStage) -> tuple[str, ...]:
    """The parameters of the model as given that gain nothing beyond the bounds that stopped them.

    The last stage is fitted from where it is, without these bounds, and must surely err less over
    whole runs to speak for wider ones: "m22 is at its bound of 15 kg: widen it" was said of a
    BlueBoat, whose sway no mass explains. Without all of them first: masses, inertia and dampings
    share one scale, and none gains alone while a bound holds another.
    """
    names = [n for n in stopped_by_bound(last.fit) if n in context.given.parameters]
    if not names or _gains(context, last, names) is not False:
        return ()
    return tuple(names)


def _gains(context: SearchContext, last: FittedStage, names: Sequence[str]) -> bool | None:
    """Whether whole runs surely err less without these bounds; ``None`` where a fit cannot tell."""
    values = {n: p.value for n, p in last.fit.model.parameters.items() if not p.fixed}
    context.say(f"fitting without the bounds of {', '.join(names)}", SOUGHT)
    model = last.fit.model.replace({name: {"bounds": _opened(last.fit, name)} for name in names})
    freed = context.refit(model, [values], starts=1, substeps=last.fit.substeps)
    if not (freed.fit.status.ok and math.isfinite(freed.fit.train.nrmse)):
        return None
    worth, everywhere = worths_between(last, FittedStage(last.effects, *freed))
    return matters(worth, everywhere) or surely_less(everywhere)


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
        return abs(value - high) < abs(value - low)
    return value > fit.guess.get(name, value)


def is_whole(effect: str, name: str, value: float) -> bool:
    """Whether a number of a known effect is a share at its natural end: a full sag, a swap.

    Example:
        >>> is_whole("supply_voltage_sag", "share", 1.0), is_whole("load_exponent", "exponent", 4.0)
        (True, False)
    """
    declared = EFFECTS[effect].declared.get(name) if effect in EFFECTS else None
    ends = declared.bounds if declared and not declared.unit else ()
    return value in ends and value in (-1.0, 0.0, 1.0)

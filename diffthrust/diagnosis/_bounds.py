"""Parameters that a bound has stopped, and those of them that gain nothing beyond it."""

from __future__ import annotations

from diffthrust.diagnosis._admission import worths_between
from diffthrust.diagnosis._search_state import FittedStage, SearchContext
from diffthrust.effects import EFFECTS
from diffthrust.estimation._estimate import Estimate
from diffthrust.estimation._result import Fit
from diffthrust.models._base.parameter import Parameter


def stopped_by_bound(fit: Fit) -> tuple[str, ...]:
    """The parameters that a bound has stopped.

    Without those at the null of their effect, or at the zero of a logarithm: there the effect has
    vanished, which the notes say. And without shares that are whole, of which there is no more.
    """
    stopped = []
    for full, p in fit.model.parameters.items():
        e, (effect, _, name) = fit.parameters[full], full.rpartition(".")
        vanished = e.value == p.null or _is_zero(e, p)
        if e.at_bound and not vanished and not is_whole(effect, name, e.value):
            stopped.append(full)
    return tuple(stopped)


def idle_bounds(context: SearchContext, last: FittedStage) -> tuple[str, ...]:
    """The parameters of the model as given that gain nothing beyond the bound that stopped them.

    The last stage is fitted from where it is, without that bound, and must surely err less over
    whole runs to speak for a wider one: "m22 is at its bound of 15 kg: widen it" was said of a
    BlueBoat, whose sway no mass explains.
    """
    idle = []
    values = {n: p.value for n, p in last.fit.model.parameters.items() if not p.fixed}
    for name in stopped_by_bound(last.fit):
        if name not in context.given.parameters:
            continue
        context.say(f"fitting without the bound of {name}", 1.0)
        model = last.fit.model.replace({name: {"bounds": _opened(last.fit, name)}})
        freed = context.refit(model, [values], starts=1, substeps=last.fit.substeps)
        worth, everywhere = worths_between(last, FittedStage(last.effects, *freed))
        if not (worth.sure or everywhere.sure):
            idle.append(name)
    return tuple(idle)


def _opened(fit: Fit, name: str) -> tuple[float | None, float | None]:
    """The bounds of a parameter without the one at which it stands."""
    parameter, value = fit.model.parameters[name], fit.parameters[name].value
    low, high = parameter.bounds
    if high is not None and (low is None or abs(value - high) < abs(value - low)):
        return low, None
    return 0.0 if parameter.transform == "log" else None, high


def vanished_parameters(fit: Fit) -> tuple[str, ...]:
    """The parameters at the zero of a logarithm, where their terms are absent."""
    described = fit.model.parameters
    return tuple(n for n, e in fit.parameters.items() if e.at_bound and _is_zero(e, described[n]))


def _is_zero(estimate: Estimate, parameter: Parameter) -> bool:
    """Whether a parameter at a bound is at the zero of a logarithm."""
    low, high = parameter.limits
    above = abs(estimate.value - high) < abs(estimate.value - low)
    return parameter.transform == "log" and low <= 0 and not above


def is_whole(effect: str, name: str, value: float) -> bool:
    """Whether a number of a known effect is a share at its natural end: a full sag, a swap.

    Example:
        >>> is_whole("supply_voltage_sag", "share", 1.0), is_whole("load_exponent", "exponent", 4.0)
        (True, False)
    """
    declared = EFFECTS[effect].declared.get(name) if effect in EFFECTS else None
    ends = declared.bounds if declared and not declared.unit else ()
    return value in ends and value in (-1.0, 0.0, 1.0)

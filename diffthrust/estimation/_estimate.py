"""An estimated parameter with its error and its unit, and rows of estimates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from diffthrust._support.report import Rows
from diffthrust._support.words import number, with_error
from diffthrust.logs._written import ShownUnits, Size
from diffthrust.models._base.model import Model
from diffthrust.models._base.parameter import Parameter


@dataclass(frozen=True)
class Estimate:
    """One parameter after a fit.

    Args:
        value: the value, in ``unit``.
        std_error: standard deviation of the estimate; ``None`` where the parameter was fixed, lies
            at a bound, or cannot be told apart from others.
        unit: unit of both.
        fixed: it was not estimated.
        at_bound: the data hold it at one of its bounds.
        per: how many of ``shown_unit`` make one of ``unit``: a dead band is told in the unit in
            which the logs have the command.
        shown_unit: the unit for people; ``unit`` where it is empty.

    Example:
        >>> alpha = fit.parameters["alpha"]
        >>> alpha.unit, alpha.fixed, alpha.at_bound, alpha.std_error < 0.01
        ('1/rad', False, False, True)
        >>> len(alpha.shown), sorted(alpha.to_json())
        (3, ['at_bound', 'fixed', 'std_error', 'unit', 'value', 'written'])
    """

    value: float
    std_error: float | None
    unit: str
    fixed: bool
    at_bound: bool
    per: float = 1.0
    shown_unit: str = ""

    @property
    def shown(self) -> tuple[float, float | None, str]:
        """Value, standard error and unit for people."""
        error = None if self.std_error is None else self.per * self.std_error
        return self.per * self.value, error, self.shown_unit or self.unit

    def to_json(self) -> dict[str, Any]:
        """Plain data, in the parameter's unit and in that for people."""
        names = ("value", "std_error", "unit")
        kept = {name: getattr(self, name) for name in (*names, "fixed", "at_bound")}
        return {**kept, "written": dict(zip(names, self.shown, strict=True))}


def shown_unit(parameter: Parameter, model: Model, shown: ShownUnits) -> Size:
    """How many of which unit, for people, make one of a parameter's."""
    if not parameter.channel:
        return Size(1.0, parameter.unit)
    per, unit = shown.size(parameter.channel, 1.0, model.channel_units.get(parameter.channel, ""))
    return Size(per, parameter.pattern.replace(f"{{{parameter.channel}}}", unit))


def noise_rows(disturbance: Mapping[str, Estimate]) -> Rows:
    """What the innovations form estimated of random forces and lasting sensor errors."""
    rows = (
        (name.removeprefix("noise."), number(e.value, 3), e.unit, "at its bound" * e.at_bound)
        for name, e in disturbance.items()
    )
    return Rows.of(("Noise", "Value", "Unit", ""), rows, numbers=(1,))


def parameter_rows(parameters: Mapping[str, Estimate]) -> Rows:
    """One row for each parameter; numbers end at the second digit of their standard error."""
    rows = []
    for name, e in parameters.items():
        if e.fixed:
            remark = "fixed"
        elif e.at_bound:
            remark = "at its bound"
        else:
            remark = "" if e.std_error is not None else "not determined by these logs"
        size, spread, unit = e.shown
        rows.append((name, *with_error(size, spread), unit, remark))
    return Rows.of(("Parameter", "Value", "Std error", "Unit", ""), rows, numbers=(1, 2))

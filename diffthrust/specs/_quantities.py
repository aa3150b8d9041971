"""Numbers of ``[parameters]`` with their units, as reports print them: ``"25.03 us"``."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from diffthrust._support.errors import InputError
from diffthrust.estimation._estimate import shown_unit
from diffthrust.logs._units import convert_scale, same_quantity
from diffthrust.logs._written import FURTHEST, ShownUnits, Written
from diffthrust.models._base.model import Model
from diffthrust.models._base.parameter import Normal
from diffthrust.specs._parts import ParameterPart

_QUANTITY = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?inf)\s*(.*?)\s*")
_PER = " per "
"""As in ``rad/s per full effort``: what stands below a command that has no symbol."""


def fields_of(
    settings: ParameterPart, name: str, model: Model, written: Mapping[str, Written]
) -> dict[str, Any]:
    """The fields that `Model.replace` takes; ``written`` says how logs wrote each channel."""
    parameter = model.parameters.get(name)
    if parameter is None:  # refused by `Model.replace`, which names the nearest
        return {}
    per, shown = shown_unit(parameter, model, ShownUnits((written,)))
    read = partial(_read, unit=parameter.unit, shown=shown, scale=1 / per)
    fields: dict[str, Any] = {}
    if settings.value is not None:
        fields["value"] = read(settings.value)
    if settings.bounds is not None:
        low, high = map(read, settings.bounds)
        infinite = float("inf")
        fields["bounds"] = (None if low == -infinite else low, None if high == infinite else high)
    fields |= {
        key: getattr(settings, key)
        for key in ("fixed", "per_log", "width")
        if getattr(settings, key) is not None
    }
    if settings.prior is not None:
        fields["prior"] = Normal(read(settings.prior.mean), read(settings.prior.std))
    return fields


def _read(number: float | str, unit: str, shown: str, scale: float) -> float:
    """A number of a unit, or one with its own; ``scale`` of the unit are one of that shown."""
    if isinstance(number, str):
        return _with_unit(number, unit, shown, scale)
    if unit == "effort" and FURTHEST < abs(number) < float("inf"):
        # 25 of a dead band that reports show as 25 us would start the fit at 25 full commands.
        raise InputError(
            f"expected a share of the full command, found {number:g} times it.",
            f'Give the unit with the number: "{number:g} {shown}".'
            if shown != unit
            else "Write 0.05 for 5 %.",
        )
    return number


def _with_unit(text: str, unit: str, shown: str, scale: float) -> float:
    match = _QUANTITY.fullmatch(text)
    if match is None or not match[2]:
        raise InputError(
            f"expected a number, or a number with its unit, found {text!r}.",
            f'Write it as in "0.05 {shown}".' if shown else "Write it as in 0.05.",
        )
    number, written = float(match[1]), match[2]
    sizes = {unit: 1.0, shown: scale}
    if written in sizes:
        return number * sizes[written]
    for target in (shown, unit):
        if convert := _conversion(written, target):
            return convert(number) * sizes[target]
    units = " or ".join(f"'{u}'" for u in dict.fromkeys((shown, unit)) if u)
    raise InputError(
        f"expected a number in {units or 'no unit'}, found {text!r}.",
        f"Write it in {shown!r}, as reports do." if shown else "Leave the unit out.",
    )


def _conversion(unit: str, target: str) -> Callable[[float], float] | None:
    """How numbers in one unit become those in another, if they can."""
    (above, _, below), (wanted, _, same) = unit.partition(_PER), target.partition(_PER)
    if below != same or not same_quantity(above, wanted):
        return None
    return lambda number: convert_scale(number, above, wanted, where="")

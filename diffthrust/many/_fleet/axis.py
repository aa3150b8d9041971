"""The coordinate in which a parameter is compared between vehicles."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust.models._base.parameter import Parameter
from diffthrust.models._base.registry import catalogue

if TYPE_CHECKING:
    from diffthrust.many._fleet.entries import Entry

_TYPICAL = 0.5
"""Between-vehicle spread that counts as typical: this in a logarithm, or this share of the size."""


@dataclass(frozen=True)
class Axis:
    """A parameter's coordinate: its logarithm if it is positive by nature, else its value.

    Args:
        name: full name of the parameter.
        unit: of its value.
        log: the coordinate is the logarithm.
        typical: a typical spread between vehicles, in the coordinate; sizes the prior of `pool`.
    """

    name: str
    unit: str
    log: bool
    typical: float

    def coordinate(self, value: Any) -> Any:
        """The coordinate of a value; NaN if there is none."""
        with np.errstate(divide="ignore", invalid="ignore"):
            at = np.log(value) if self.log else np.asarray(value, float)
        return np.where(np.isfinite(at), at, np.nan)

    def value(self, coordinate: Any) -> Any:
        """The value at a coordinate."""
        return np.exp(coordinate) if self.log else np.asarray(coordinate, float)

    def slope(self, value: Any) -> Any:
        """d(value)/d(coordinate)."""
        return np.asarray(value, float) if self.log else np.ones_like(value, float)


def axes_of(entries: Iterable[Entry]) -> dict[str, Axis]:
    """The axes of all parameters estimated by at least one fit.

    The description comes from the fit's model, or for a table row from the catalogue; if neither
    is known, the coordinate is the value.
    """
    described: dict[str, Parameter] = {}
    sizes: dict[str, list[float]] = {}
    parameters: dict[tuple[str, tuple[str, ...]], Mapping[str, Parameter]] = {}
    for entry in entries:
        kind = (entry.model, entry.effects)
        if entry.fit is not None:
            parameters[kind] = entry.fit.model.parameters
        elif kind not in parameters:
            parameters[kind] = _from_catalogue(*kind)
        for name, (value, error) in entry.estimates.items():
            if error is not None:
                sizes.setdefault(name, []).append(abs(value))
                if name in parameters[kind]:
                    described.setdefault(name, parameters[kind][name])
    return {name: _axis(name, described.get(name), np.array(v)) for name, v in sizes.items()}


def _axis(name: str, p: Parameter | None, values: np.ndarray) -> Axis:
    if p is not None and p.transform == "log":
        return Axis(name, p.unit, True, _TYPICAL)
    # A parameter that may be negative or zero has no logarithm: its declared size sets the scale.
    size = p.size if p is not None and p.size is not None else float(np.median(values)) or 1.0
    return Axis(name, p.unit if p is not None else "", False, _TYPICAL * size)


def _from_catalogue(model: str, effects: tuple[str, ...]) -> Mapping[str, Parameter]:
    """The parameters of a model given by name; empty for a user's own model."""
    from diffthrust.models import MODELS

    with suppress(KeyError, InputError):
        made = MODELS[model]()
        for effect in effects:
            made = made + catalogue()[effect]()
        return made.parameters
    return {}

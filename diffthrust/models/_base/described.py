"""Parameters described by plain data: a unit alone, or a table of fields."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing, nearest, shortly
from diffthrust.models._base.parameter import Normal, Parameter, Relative, parameter

_FIELDS = tuple(f.name for f in fields(Parameter) if f.name != "pattern")
_USUAL = Parameter(0.0)
_PARTS: Mapping[str, type] = {"prior": Normal, "probes": Relative}
"""Fields that are tables themselves."""


def plain_description(where: str, given: Any) -> str | dict[str, Any]:
    """A description of a parameter as plain data: its unit, or its fields that are not usual.

    Args:
        where: the parameter, for messages.
        given: a unit, a `Parameter`, or a mapping of its fields with "unit".

    Raises:
        InputError: something else, or fields that a parameter does not have.

    Example:
        >>> plain_description("p", dft.parameter(1.5, bounds=(0.5, 3)))
        {'unit': '', 'value': 1.5, 'bounds': (0.5, 3)}
    """
    if isinstance(given, str):
        return given
    if isinstance(given, Parameter):
        told = {"unit": given.pattern or given.unit, "value": given.value}
        own = {name: getattr(given, name) for name in _FIELDS if name not in told}
        told |= {n: v for n, v in own.items() if v != getattr(_USUAL, n) and n != "transform"}
        if parameter(**told).transform != given.transform:
            told["transform"] = given.transform
        return _flat(told)
    if not isinstance(given, Mapping):
        raise InputError(
            f"{where}: expected a unit, a dft.parameter or a table with a unit, "
            f"found {shortly(given)}.",
            'Give its unit, "" for a pure number; with a value: {"unit": "rad/s", "value": 2.0}.',
        )
    for name in given:
        if name not in _FIELDS:
            near = nearest(str(name), _FIELDS)
            raise InputError(
                f"{where}: a parameter has no field {name!r}{'; ' + near if near else ''}.",
                f"Fields are {listing(_FIELDS)}.",
            )
    return _flat(given)


def described_fields(where: str, described: str | Mapping[str, Any]) -> dict[str, Any]:
    """The arguments of `parameter` that plain data describe.

    Raises:
        InputError: a prior, bounds or probes that are none.
    """
    if isinstance(described, str):
        return {"unit": described}
    told: dict[str, Any] = {"unit": "", **described}
    try:
        for name, made in _PARTS.items():
            if isinstance(told.get(name), Mapping):
                told[name] = made(**told[name])
        if isinstance(told.get("bounds"), tuple):
            told["bounds"] = tuple(
                None if b is None or abs(b) == float("inf") else float(b) for b in told["bounds"]
            )
        numbers = [told[n] for n in ("value", "null") if told.get(n) is not None]
        probes = told.get("probes", ())
        numbers += (*probes.factors, probes.power) if isinstance(probes, Relative) else probes
        hash((*told.values(), *map(math.isfinite, numbers)))
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(
            f"{where}: its fields {shortly(dict(described))} describe no parameter ({error}).",
            "Write bounds = [low, high], prior = { mean = 1.0, std = 0.1 }, probes = [0.5, 2.0].",
        ) from None
    return told


def _flat(value: Any) -> Any:
    """Tuples for lists, tables for what has parts, and Python's own numbers."""
    if isinstance(value, Normal | Relative):
        return {f.name: _flat(getattr(value, f.name)) for f in fields(value)}
    if isinstance(value, Mapping):
        return {name: _flat(each) for name, each in value.items() if each is not None}
    if isinstance(value, np.generic):
        return value.item()
    return tuple(map(_flat, value)) if isinstance(value, list | tuple) else value

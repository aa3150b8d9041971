"""Parameters described by plain data: a unit alone, or a table of fields."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing, nearest, short_repr
from diffthrust.models._base.parameter import Normal, Parameter, Relative, parameter

_FIELDS = tuple(f.name for f in fields(Parameter) if f.name != "pattern")
_USUAL = Parameter(0.0)
_PARTS: Mapping[str, type] = {"prior": Normal, "probes": Relative}
"""Fields that are tables themselves."""


def plain_description(where: str, described: Any) -> str | dict[str, Any]:
    """A description of a parameter as plain data: its unit, or its fields that are not usual.

    ``where`` names the parameter in messages; it is described by a unit, a `Parameter`, or a
    mapping of its fields with "unit".
    """
    if isinstance(described, str):
        return described
    if isinstance(described, Parameter):
        fields = {"unit": described.pattern or described.unit, "value": described.value}
        unusual = {name: getattr(described, name) for name in _FIELDS if name not in fields}
        fields |= {n: v for n, v in unusual.items() if v != getattr(_USUAL, n) and n != "transform"}
        if parameter(**fields).transform != described.transform:
            fields["transform"] = described.transform
        return _flat(fields)
    if not isinstance(described, Mapping):
        raise InputError(
            f"{where}: expected a unit, a dft.parameter or a table with a unit, "
            f"found {short_repr(described)}.",
            'Give its unit, "" for a pure number; with a value: {"unit": "rad/s", "value": 2.0}.',
        )
    for name in described:
        if name not in _FIELDS:
            near = nearest(str(name), _FIELDS)
            raise InputError(
                f"{where}: a parameter has no field {name!r}{'; ' + near if near else ''}.",
                f"Fields are {listing(_FIELDS)}.",
            )
    return _flat(described)


def described_fields(where: str, described: str | Mapping[str, Any]) -> dict[str, Any]:
    """The arguments of `parameter` that plain data describe."""
    if isinstance(described, str):
        return {"unit": described}
    fields: dict[str, Any] = {"unit": "", **described}
    try:
        for name, made in _PARTS.items():
            if isinstance(fields.get(name), Mapping):
                fields[name] = made(**fields[name])
        if isinstance(fields.get("bounds"), tuple):
            fields["bounds"] = tuple(
                None if b is None or abs(b) == float("inf") else float(b) for b in fields["bounds"]
            )
        numbers = [fields[n] for n in ("value", "null") if fields.get(n) is not None]
        probes = fields.get("probes", ())
        numbers += (*probes.factors, probes.power) if isinstance(probes, Relative) else probes
        # one attempt to use every field: what cannot be hashed or compared is refused here with its
        # name
        hash((*fields.values(), *map(math.isfinite, numbers)))
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(
            f"{where}: its fields {short_repr(dict(described))} describe no parameter ({error}).",
            "Write bounds = [low, high], prior = { mean = 1.0, std = 0.1 }, probes = [0.5, 2.0].",
        ) from None
    return fields


def _flat(value: Any) -> Any:
    """Tuples for lists, tables for what has parts, and Python's own numbers."""
    if isinstance(value, Normal | Relative):
        return {f.name: _flat(getattr(value, f.name)) for f in fields(value)}
    if isinstance(value, Mapping):
        return {name: _flat(each) for name, each in value.items() if each is not None}
    if isinstance(value, np.generic):
        return value.item()
    return tuple(map(_flat, value)) if isinstance(value, list | tuple) else value

"""Effects whose name, port and parameters are given where they are made, not by a class."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields
from inspect import get_annotations
from typing import Any, ClassVar

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing, nearest, short_repr
from diffthrust.models._base.effect import Effect
from diffthrust.models._base.parameter import Normal, Parameter, Relative, parameter
from diffthrust.models._base.signals import Signal, Signals

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


ARRIVING = "value"
"""The name of what arrives at the port, in expressions."""
_MEANT = (ARRIVING, "time")
"""What arrives at a port, and a signal that every model has."""


class MadeEffect(Effect):
    """An effect whose objects each have a name, a port and parameters of its own.

    Several of one class stand in one model under different names. A subclass has in ``name`` the
    word by which spec files ask for it (objects are called so by default), in ``main`` the
    argument that this word gives there, in ``options`` name, port and whatever else chooses its
    equations, and its constructor ends with `_make`.
    """

    required: ClassVar[tuple[str, ...]] = ()
    library: ClassVar[dict[str, type[MadeEffect]]] = {}  # pyright: ignore[reportIncompatibleVariableOverride]
    options: ClassVar[tuple[str, ...]] = ("name", "port")
    main: ClassVar[str] = ""
    given: Mapping[str, Any] = {}
    """Parameters as they were asked for, as plain data; see `plain_description`."""

    def _make(
        self, name: str, port: str, declared: Mapping[str, Parameter], reads: tuple[str, ...] = ()
    ) -> None:
        """Take name, port, parameters, and the signals that are read."""
        for what, value in (("name", name), ("port", port)):
            self._check_word(what, value)
        self._set(name=name, port=port, ports=(port,), reads=reads, declared=dict(declared))
        super().__init__()

    def _check_parameters(self, names: Iterable[str], symbols: Iterable[str], text: str) -> None:
        """Raise `InputError` for a parameter that an expression does not have, or cannot have."""
        word, symbols = type(self).name, tuple(symbols)
        for name in names:
            if name not in symbols:
                near = nearest(name, symbols)
                raise InputError(
                    f"{word}: the parameter {name!r} does not occur in {text!r}"
                    f"{'; ' + near if near else ''}.",
                    "Correct the name, or remove it.",
                )
            self._check_word("parameter", name)
            taken = hasattr(type(self), name) or name in get_annotations(type(self))
            if taken or name in _MEANT or name.startswith("_"):
                raise InputError(
                    f"{word}: a parameter cannot be called {name!r}, which means something else.",
                    "Give it another name.",
                )

    def _named(self, value: Signal, s: Signals) -> Callable[[str], Any]:
        """What a name in an expression stands for, where a value arrives beside these signals."""

        def named(name: str) -> Any:
            if name == ARRIVING:
                return value
            return getattr(self if name in self.given else s, name)

        return named

    def _check_word(self, what: str, value: object) -> None:
        # a port may be that of a part of a craft: "imu.yaw_rate"
        parts = value.split(".") if isinstance(value, str) and what == "port" else [value]
        if not all(isinstance(p, str) and p.isascii() and p.isidentifier() for p in parts):
            raise InputError(
                f"{type(self).name}: expected a {what} made of letters, digits and underscores, "
                f"found {value!r:.60}.",
                "Write it like the names of Python: tip_loss.",
            )

    @property
    def arguments(self) -> dict[str, Any]:
        """The arguments that it was made with, parameters as they were asked for."""
        return {**super().arguments, **self.given}

    def as_table(self) -> dict[str, Any]:
        """The entry of a spec file's effects that asks for it."""
        table = self.arguments
        return {type(self).name: table.pop(self.main), **table}

    def __repr__(self) -> str:
        arguments = [f"{n}={argument!r}" for n, argument in super().arguments.items()]
        arguments += [f"{n}={getattr(self, n):.4g}" for n in self._parameters]
        return f"{type(self).__name__}({', '.join(arguments)})"


MADE_EFFECTS = MadeEffect.library
"""The library's classes of such effects, by the words of spec files."""

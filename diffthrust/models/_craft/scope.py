"""A part of a model seen by itself: its signals, ports and parameters under their short names.

On a craft the command of the thruster ``port`` is the signal ``port.command``, its thrust passes
the port ``port.propeller``, its gain is the parameter ``port.gain``. The thruster's equations, and
the effects on it, read ``s.command`` and call ``port("propeller", ...)`` as they always do.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

from diffthrust.models._base.effect import Ports
from diffthrust.models._base.parameter import Parameter, Relative
from diffthrust.models._base.signals import Signal, Signals

COMMON = ("time", "supply_voltage")
"""Signals of the whole craft that its parts read by the same names: one clock, one battery."""
_PLACE = ("x", "y", "z")


def signals_under(s: Signals, scope: str) -> Signals:
    """The signals of a part by their short names, beside those of the whole."""
    prefix = f"{scope}."
    common = {name: s[name] for name in s if "." not in name}
    short = {name.removeprefix(prefix): s[name] for name in s if name.startswith(prefix)}
    return Signals({**common, **short})


class PortsUnder(Ports):
    """The ports of a part by their short names, inside those of the whole."""

    def __init__(self, whole: Ports, scope: str) -> None:
        self._whole = whole
        self._scope = scope

    def tell(self, **signals: Signal | float) -> None:
        """Let effects that follow read what the part has worked out."""
        self._whole.tell(**{f"{self._scope}.{name}": value for name, value in signals.items()})

    def __call__(self, port: str, value: Signal) -> Signal:
        return self._whole(f"{self._scope}.{port}", value)


def lifted(described: Parameter, scope: str, signals: Collection[str]) -> Parameter:
    """A parameter of a part as one of the whole: units and trial values follow the part's signals.

    Trial values may follow others, as the length of the logs: these are named as they were.
    """
    pattern, probes = described.pattern or described.unit, described.probes
    if "{" in pattern:
        described = replace(described, pattern=re.sub(r"\{(\w+)\}", rf"{{{scope}.\1}}", pattern))
    if isinstance(probes, Relative) and probes.signal in signals:
        described = replace(described, probes=replace(probes, signal=f"{scope}.{probes.signal}"))
    return described


def prefixed(scope: str, named: Any) -> dict[str, Any]:
    """What belongs to a part, by the names of the whole."""
    return {name if name in COMMON else f"{scope}.{name}": named[name] for name in named}


def place_parameters(scope: str, place: Sequence[float]) -> dict[str, Parameter]:
    """The place of a part, held."""
    return {
        f"{scope}.{axis}": Parameter(value, "m", fixed=True, size=0.3, doc="place")
        for axis, value in zip(_PLACE, place, strict=True)
    }


def place_of(scope: str, values: Mapping[str, Any]) -> tuple[Any, Any, Any]:
    """Where a part is, by the (possibly traced) values of the whole."""
    x, y, z = (values[f"{scope}.{axis}"] for axis in _PLACE)
    return x, y, z

"""What breaks while a loop runs: parameters that jump, a command that sticks or is cut off."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust._support.validation import finite

_ROUNDING = 1e-9
"""Seconds: an instant on the grid counts, whatever its rounding."""


@dataclass(frozen=True)
class Change:
    """Parameters of the thruster or the vehicle are multiplied by factors from an instant on.

    Args:
        at: the instant [s].
        factors: full name to factor: ``{"thruster.ct": 0.6, "vehicle.drag": 2.0}``.
        until: when it ends [s].

    Example:
        >>> dft.control.Change(at=8.0, factors={"thruster.alpha": 1.5, "thruster.ct": 0.7}).until
        inf
    """

    at: float
    factors: Mapping[str, float]
    until: float = math.inf

    def __post_init__(self) -> None:
        _check_times(self)
        if not isinstance(self.factors, Mapping) or not self.factors:
            raise InputError(
                f"Change: expected factors by the names of parameters, found {self.factors!r}.",
                'Write factors={"thruster.ct": 0.6}.',
            )
        for name, factor in self.factors.items():
            finite(f"Change, factor of '{name}'", factor, lambda x: True, "a number")


@dataclass(frozen=True)
class Stuck:
    """The motor controller keeps a command from an instant on.

    Args:
        at: the instant [s].
        value: the command that it keeps [V]; ``None`` for the last one.
        until: when it ends [s].

    Example:
        >>> dft.control.Stuck(at=10.0, until=12.0).value is None
        True
    """

    at: float
    value: float | None = None
    until: float = math.inf

    def __post_init__(self) -> None:
        _check_times(self)
        if self.value is not None:
            finite("Stuck, value", self.value, lambda x: True, "a number or None")


@dataclass(frozen=True)
class Limited:
    """The motor controller's output is limited from an instant on.

    Args:
        at: the instant [s].
        limit: the largest command [V].
        until: when it ends [s].

    Example:
        >>> dft.control.Limited(at=10.0, limit=1.0).limit
        1.0
    """

    at: float
    limit: float
    until: float = math.inf

    def __post_init__(self) -> None:
        _check_times(self)
        finite("Limited, limit", self.limit, lambda x: x >= 0, "a positive number")


Fault = Change | Stuck | Limited
FaultNumbers = tuple[dict[str, Any], ...]
"""The fields of faults: names, and what is ``None``, are structure, the numbers are leaves."""


def duct_obstruction(at: float, load: float = 2.0, thrust: float = 0.9) -> Change:
    """Something blocks the duct: the shaft is loaded more, and gives less thrust at a speed.

    Args:
        at: the instant [s].
        load: factor of ``thruster.alpha``.
        thrust: factor of ``thruster.ct``.

    Returns:
        The fault. Source: Yoerger, Cooke & Slotine 1990, figures 18 and 21, which say that the
        static and dynamic properties change but not by how much: the factors are examples.

    Example:
        >>> dft.control.duct_obstruction(8.0, load=2.0, thrust=0.9).factors
        {'thruster.alpha': 2.0, 'thruster.ct': 0.9}
    """
    return Change(at, {"thruster.alpha": load, "thruster.ct": thrust})


def _check_times(fault: Any) -> None:
    name = type(fault).__name__
    finite(f"{name}, at", fault.at, lambda x: True, "an instant in seconds")
    if not (isinstance(fault.until, int | float) and fault.until > fault.at):
        raise InputError(
            f"{name}, until: expected an instant after {fault.at:g} s, found {fault.until!r}.",
            "Leave it out where the fault lasts.",
        )


def check_faults(faults: Any, parameters: Mapping[str, Any]) -> tuple[Fault, ...]:
    """The faults of a loop as a tuple."""
    several = isinstance(faults, list | tuple)
    checked = tuple(faults) if several else (faults,)
    for fault in checked:
        if not isinstance(fault, Fault):
            raise InputError(
                f"faults: expected Change, Stuck or Limited, found {fault!r}.",
                "Write faults=[dft.control.duct_obstruction(at=8.0)].",
            )
        for name in fault.factors if isinstance(fault, Change) else ():
            if name not in parameters or name.startswith(("controller.", "compensator.")):
                plant = [n for n in parameters if n.startswith(("thruster.", "vehicle."))]
                raise InputError(
                    f"Change: the plant has no parameter '{name}'; it has {listing(plant)}.",
                    "Correct the name.",
                )
    return checked


def fault_numbers(faults: Iterable[Fault]) -> FaultNumbers:
    """Faults as a pytree, so that a scan over sizes of a fault compiles once."""
    fields = (
        {name: dict(v) if isinstance(v, Mapping) else v for name, v in vars(fault).items()}
        for fault in faults
    )
    return jax.tree.map(float, tuple(fields))


def factors_at(faults: FaultNumbers, time: Array) -> dict[str, Array]:
    """What each parameter of the plant is multiplied with at an instant, or at many."""
    out: dict[str, Array] = {}
    for n in faults:
        for name, factor in n.get("factors", {}).items():
            out[name] = out.get(name, 1.0) * jnp.where(_acts(n, time), factor, 1.0)
    return out


def taken_command(faults: FaultNumbers, sent: Array, last: Array, time: Array) -> Array:
    """The command that the motor controller takes, from the one sent and its last one."""
    for n in faults:
        if "value" in n:
            held = last if n["value"] is None else n["value"]
            sent = jnp.where(_acts(n, time), held, sent)
        elif "limit" in n:
            cut = jnp.clip(sent, -n["limit"], n["limit"])
            sent = jnp.where(_acts(n, time), cut, sent)
    return sent


def _acts(n: Mapping[str, Any], time: Array) -> Array:
    return (time >= n["at"] - _ROUNDING) & (time < n["until"] - _ROUNDING)

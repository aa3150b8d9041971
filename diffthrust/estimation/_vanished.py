"""Parameters that are positive by nature and that the logs push to zero.

A logarithm has no zero: it runs off to its limit, far below the start. Nothing depends on it there,
so that the next fit from that place could not move it, and would call it one of which the logs say
nothing.
"""

from __future__ import annotations

import numpy as np

from diffthrust.estimation._problem import Problem
from diffthrust.models._base.model import Model
from diffthrust.models._base.parameter import Parameter

_FAR = 23.0
"""Logarithms so far below their start, ten decades, are zero to all ends."""
_NOTHING = 1e-12
"""A value below this share of the usual one was left behind by a fit in which it vanished,"""
_ALIVE = 1e-2
"""and the next begins at this share of the usual one."""


def vanished(problem: Problem, z: np.ndarray) -> np.ndarray:
    """Which coordinates are logarithms that ran off to zero, ``(n,)``."""
    away = np.zeros(z.size, bool)
    for i, name in enumerate(problem.free):
        p = problem.named[name]
        away[i] = _may_vanish(p) and z[i] < np.log(p.value) - _FAR
    return away


def alive(model: Model) -> Model:
    """The model with parameters that vanished in an earlier fit back where logs can move them."""
    usual = {n: p for effect in model.effects for n, p in _usual(effect, f"{effect.name}.")}
    usual |= dict(_usual(model, ""))
    back = {
        name: _ALIVE * usual[name].value
        for name, p in model.parameters.items()
        if name in usual and _may_vanish(p) and p.value < _NOTHING * usual[name].value
    }
    return model.replace(back) if back else model


def vanished_notes(problem: Problem, z: np.ndarray) -> tuple[str, ...]:
    """A sentence for each parameter that vanished: what the model is without it."""
    away = vanished(problem, z)[: len(problem.own)]
    notes = []
    for name in (n for n, vanishes in zip(problem.own, away, strict=True) if vanishes):
        what = problem.named[name].doc
        term = f"the term of {name} ({what})" if what else f"the term of {name}"
        notes.append(
            f"{name} vanished: these logs push it to zero, where {term} is absent. "
            "The model fits them as well without that term."
        )
    return tuple(notes)


def _usual(component, prefix: str) -> list[tuple[str, Parameter]]:
    return [(f"{prefix}{name}", p) for name, p in component.declared.items()]


def _may_vanish(p: Parameter) -> bool:
    return p.transform == "log" and not p.fixed and p.limits[0] <= 0

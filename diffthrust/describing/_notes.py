"""What a user of a describing function should know besides its numbers."""

from __future__ import annotations

from typing import Any

import numpy as np

from diffthrust._support.words import joined
from diffthrust.describing._periodic.respond import Reason
from diffthrust.describing._periodic.truncation import more_than
from diffthrust.describing._request import Request
from diffthrust.estimation._result import Fit


def notes_of(asked: Request, given: Any, reason: np.ndarray) -> tuple[str, ...]:
    """Effects that were left out, points without an answer, inputs beyond a limit."""
    whole = given.model if isinstance(given, Fit) else given
    notes = []
    left = [e.name for e in whole.effects if e.name not in {e.name for e in asked.model.effects}]
    if left:
        notes.append(
            f"Left out, being effects on what the sensors report: {joined(left)} "
            "(sensors=True counts them)."
        )
    size = reason.size
    for kind in Reason:
        count = int(np.sum(reason == kind))
        if count and kind is not Reason.SETTLED:
            notes.append(f"{count} of {size} points are marked: {kind.words}.{_mend(kind, asked)}")
    reach = float(asked.amplitudes[-1]) + abs(asked.bias)
    for effect in asked.model.effects:
        limit = getattr(effect, "limit", None) if asked.input in effect.ports else None
        if limit is not None and reach > limit:
            unit = asked.units[0]
            notes.append(
                f"Inputs beyond {limit:.4g} {unit} are cut by '{effect.name}': the gain falls "
                "with the amplitude there."
            )
    return tuple(notes)


def _mend(kind: Reason, asked: Request) -> str:
    """What to do about a mark, where something can be done."""
    if kind is Reason.FEW_HARMONICS:
        return (
            f" {asked.harmonics} harmonics are too few for corners as sharp as there: give "
            f'harmonics={more_than(asked.harmonics)}, or method="simulation".'
        )
    if kind is Reason.COARSE and asked.method == "harmonic_balance":
        return ' Give method="simulation", which takes shorter steps.'
    if kind is Reason.MEMORY:
        names = joined([e.name for e in asked.model.effects if e.memory])
        return (
            f" Amplitude times frequency is far beyond a rate limit there, or a delay lasts many "
            f"periods: ask for smaller amplitudes or frequencies, or take out {names}."
        )
    return ""

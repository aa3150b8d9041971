"""Channels of which a fit explains little, in its message and as doubts."""

from __future__ import annotations

from collections.abc import Sequence

from diffthrust._support.words import joined, percent
from diffthrust.simulation._errors import Errors
from diffthrust.soundness._doubt import Doubt

_LITTLE = 20.0
"""A channel that is explained to less than so many per cent is not described by the model."""


def explained(errors: Errors, doubts: Sequence[Doubt]) -> tuple[str, tuple[Doubt, ...]]:
    """What to add to a fit's message, and its doubts with those on channels it hardly explains.

    Args:
        errors: of the fit on its training logs.
        doubts: on the logs themselves.
    """
    little = {name: e.fit_percent for name, e in errors.channels.items() if e.fit_percent < _LITTLE}
    if not little:
        return "", tuple(doubts)
    words = [f"{percent(max(share, 0.0) / 100)} of {name}" for name, share in little.items()]
    doubted = {word.strip(".,:;") for doubt in doubts for word in str(doubt).split()}
    added = [
        Doubt(
            name,
            "silent",
            f"the fit explains {percent(max(share, 0.0) / 100)} of {name}: it does not move as the "
            "model's does.",
            f"look at dft.compare(fit, logs).plot(), at the sign, unit and column of {name} and "
            "of the inputs, and at what dft.diagnose(fit, logs) finds missing.",
        )
        for name, share in little.items()
        if name not in doubted
    ]
    return f" But it explains {joined(words)}: look at the doubts first.", (*doubts, *added)

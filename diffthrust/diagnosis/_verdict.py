"""The verdict: one of four, from all that was found."""

from __future__ import annotations

from diffthrust.diagnosis._findings import Findings, Verdict


def verdict_of(found: Findings) -> Verdict:
    """The verdict on what a search has found.

    Structure remains where the one-step errors depend on a signal, where a channel contradicts the
    model, and where errors over whole runs are large and last and a flexible model surely explains
    a quarter of them: they repeat, so that no random force makes them. Large errors that do not
    repeat leave it undecided without an effect that was found; a constant alone decides nothing.
    """
    if found.remaining is not None or found.judged.hints or found.repeating:
        return "unexplained"
    if found.added or (found.held and not found.far):
        return "effects_found"
    return "undecided" if found.far else "adequate"

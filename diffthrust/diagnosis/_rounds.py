"""A search from its beginning to its end: stage after stage, while one finds something."""

from __future__ import annotations

from diffthrust.diagnosis._search import SearchState, Tools
from diffthrust.diagnosis._stages import next_stage
from diffthrust.diagnosis._whole_runs import from_whole_runs

_MOST_STAGES = 5


def searched(tools: Tools, known: SearchState) -> SearchState:
    """What is known when nothing more is found, or when enough is."""
    while max(known.number, len(known.detectable)) < _MOST_STAGES:
        before, known = known, next_stage(tools, known)
        if known.found == before.found:
            known = from_whole_runs(tools, known)
        if known.found == before.found:
            break
    return known

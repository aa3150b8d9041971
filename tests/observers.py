"""The observer behind the innovations, by itself: its gains, limits and passes."""

from diffthrust.estimation._innovations import one_step  # private: as a comparison calls it
from diffthrust.estimation._observer import (  # private: its parts against closed forms
    CLIP,
    REAL,
    WIDE,
    Correction,
    Limits,
    Observer,
    direction,
    guesses,
    innovations,
    is_memory,
    limited,
    observer_of,
    uncorrected,
)
from diffthrust.estimation._one_step import (  # private: as a diagnosis calls them
    cost,
    passes,
    settled_start,
    with_clip,
)

__all__ = [
    "CLIP",
    "REAL",
    "WIDE",
    "Correction",
    "Limits",
    "Observer",
    "cost",
    "direction",
    "guesses",
    "innovations",
    "is_memory",
    "limited",
    "observer_of",
    "one_step",
    "passes",
    "settled_start",
    "uncorrected",
    "with_clip",
]

"""Measures that decide in a diagnosis, on errors made by hand: no logs give errors so exactly."""

from diffthrust.diagnosis._explained_share import (  # private: the share and its interval
    BeforeAfter,
    Worth,
    explained_share,
    matters,
)
from diffthrust.diagnosis._verdict import far_above_noise  # private: a verdict shows it or not
from diffthrust.simulation._errors import ChannelError, Errors  # private: errors of no run

__all__ = [
    "BeforeAfter",
    "ChannelError",
    "Errors",
    "Worth",
    "explained_share",
    "far_above_noise",
    "matters",
]

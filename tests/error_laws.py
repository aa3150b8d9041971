"""The laws of errors as densities, which SciPy's are held against."""

from diffthrust.estimation._censored import (  # private: logs without a fit
    Censored,  # private: a spec knows laws by their words
    are_censored,
    rail_notes,
)
from diffthrust.estimation._laws import TAIL, Gaussian, StudentT  # private: likewise

__all__ = [
    "TAIL",
    "Censored",
    "Gaussian",
    "StudentT",
    "are_censored",
    "rail_notes",
]

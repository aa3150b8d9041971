"""The laws of errors as densities, which SciPy's are held against."""

from diffthrust.estimation._laws import (  # private: logs without a fit  # private: likewise
    TAIL,
    Censored,  # private: a spec knows laws by their words
    Gaussian,
    StudentT,
    are_censored,
    rail_notes,
)

__all__ = [
    "TAIL",
    "Censored",
    "Gaussian",
    "StudentT",
    "are_censored",
    "rail_notes",
]

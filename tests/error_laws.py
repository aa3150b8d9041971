"""The laws of errors as densities, which SciPy's are held against."""

from diffthrust.estimation._censored import Censored  # private: a spec knows laws by their words
from diffthrust.estimation._laws import TAIL, Gaussian, StudentT  # private: likewise

__all__ = ["TAIL", "Censored", "Gaussian", "StudentT"]

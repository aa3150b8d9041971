"""The laws of errors as densities, which SciPy's are held against."""

# private: laws without a fit; a spec knows them by their words
from diffthrust.estimation._laws import TAIL, Censored, Gaussian, StudentT, are_censored, rail_notes

__all__ = ["TAIL", "Censored", "Gaussian", "StudentT", "are_censored", "rail_notes"]

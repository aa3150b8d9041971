"""Least squares within limits and below lines, which SciPy's are held against."""

from diffthrust.control._bounded_lsq import least_squares_within  # private: within an MPC's step
from diffthrust.control._rows_lsq import least_squares_below  # private: likewise

__all__ = ["least_squares_below", "least_squares_within"]

"""Least squares within limits and below lines, which SciPy's are held against."""

from diffthrust.control._least_squares import (
    least_squares_below,  # private: likewise
    least_squares_within,  # private: within an MPC's step
)

__all__ = ["least_squares_below", "least_squares_within"]

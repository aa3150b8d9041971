"""Least squares within limits and below lines, which SciPy's are held against."""

from diffthrust._support.box import least_squares_below as least_squares_below  # private: as below
from diffthrust._support.box import least_squares_within as least_squares_within  # private: of MPC

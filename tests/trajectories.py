"""Simulations that JAX differentiates and maps: `simulate` returns arrays that it cannot trace."""

from diffthrust.simulation._inputs import hold_of, inputs_of  # private: what a Grid is made from
from diffthrust.simulation._trajectory import Grid, trajectory  # private: the traced part alone

__all__ = ["Grid", "hold_of", "inputs_of", "trajectory"]

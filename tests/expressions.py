"""Texts of formulas and their values, without a model around them."""

from diffthrust.effects._grammar import expression_of  # private: a Formula asks for parameters, too
from diffthrust.effects._memory import values_along  # private: its integrals against closed forms

__all__ = ["expression_of", "values_along"]

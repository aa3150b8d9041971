"""Texts of formulas and their values, without a model around them."""

from diffthrust.effects._expression import (
    values_along,  # private: its integrals against closed forms
)
from diffthrust.effects._forms import (  # private: the series alone
    delayed,
    lagged,
    rate_limited,
)
from diffthrust.effects._grammar import expression_of  # private: a Formula asks for parameters, too

__all__ = ["delayed", "expression_of", "lagged", "rate_limited", "values_along"]

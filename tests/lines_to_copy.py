"""The lines by which reports say how a model is made again, and what a spec makes of an entry."""

# private: the lines alone
from diffthrust.estimation._origin import effects_line, python_lines, spec_lines
from diffthrust.specs._scripts import effect_of  # private: an entry of any data, without a file

__all__ = ["effect_of", "effects_line", "python_lines", "spec_lines"]

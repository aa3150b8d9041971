"""Limit cycles of a loop around a nonlinear element or a fitted thruster."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)

"""A model held against logs: errors, regimes, residual tests, and which noise they look like."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)

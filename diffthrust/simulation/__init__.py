"""Models run on the time grids of logs: integration, step size, errors of simulated runs."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)

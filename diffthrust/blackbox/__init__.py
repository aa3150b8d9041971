"""Linear black-box models of a log's inputs and outputs.

They show how well any linear model of some order explains a log, without physics: ARX, ARMAX,
output error and state space, the selection of their orders, and their transfer functions.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)

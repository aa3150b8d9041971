"""Closed loops: controllers, compensators of the thruster's lag, faults, and gains that are tuned.

A `Loop` joins a thruster with its effects, a vehicle, and a sampled controller; `Loop.simulate`
gives a `LoopRun` whose ``log`` every other tool of the library reads.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)

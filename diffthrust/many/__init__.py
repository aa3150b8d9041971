"""Many logs, many vehicles, many machines.

The verbs here answer each member as if it were alone, compiled and run together; `campaign` does a
task for every spec of a folder, `fleet` holds all fits of a fleet together.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)

"""What is in a file: its columns or messages, what they may be, and a spec file to begin with."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)

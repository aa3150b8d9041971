"""Survey of a file: its columns or messages, their likely meaning, and a draft of a spec file."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)

"""The workbench: a page in the browser on which a model is held against logs and mended."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)

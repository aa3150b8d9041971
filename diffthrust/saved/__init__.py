"""Results out of files: fits, diagnoses and posteriors as they were saved."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)

"""Test plans for the papers' methods: files that a rig can run, and a check of what came back."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)

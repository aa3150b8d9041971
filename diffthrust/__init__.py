"""Differentiable models of underwater thrusters and small vessels, with batch estimation.

    log -> simulate -> compare -> diagnose -> model + effect -> fit -> compare ...

Names are loaded when they are touched. Importing the package switches JAX to double precision
(``jax_enable_x64``) and, unless a device was chosen (``JAX_PLATFORMS``, ``JAX_DEFAULT_DEVICE``),
to the processor, by variables that processes started from here inherit: in single precision a fit
cannot tell a stationary point from rounding.
"""

import os as _os
import sys as _sys

import lazy_loader as _lazy

# JAX reads the variable when it is first imported, which the command line's help never does
_os.environ["JAX_ENABLE_X64"] = "1"
if "jax" in _sys.modules:
    _sys.modules["jax"].config.update("jax_enable_x64", True)
# A GPU is told each step of a loop over samples: a fit of two runs of 1 500 samples took 7.9 s on
# an H200, and 0.083 s on the processor beside it.
if "JAX_PLATFORMS" not in _os.environ and "JAX_DEFAULT_DEVICE" not in _os.environ:
    _os.environ["JAX_DEFAULT_DEVICE"] = "cpu"
    if "jax" in _sys.modules and _sys.modules["jax"].config.jax_default_device is None:
        _sys.modules["jax"].config.update("jax_default_device", "cpu")
# XLA compiles a loop on the CPU as one kernel only while its body is small; models with effects
# are above its limit and run up to ten times slower. Its newer emitters take up to twice as long
# to compile as the older ones, for kernels that run no faster. The flag is read when JAX first
# computes, and an option that XLA no longer knows is ignored. It goes in front of the user's: XLA
# ignores all that follows a word without leading dashes.
if "xla_backend_extra_options" not in _os.environ.get("XLA_FLAGS", ""):
    _os.environ["XLA_FLAGS"] = (
        "--xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold=1000000000,"
        "xla_cpu_disable_new_fusion_emitters " + _os.environ.get("XLA_FLAGS", "")
    ).strip()

__version__ = "0.1.0"
__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)

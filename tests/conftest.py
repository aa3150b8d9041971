"""Settings for every test."""

import gc
import os

import jax

import diffthrust  # noqa: F401  (switches double precision on)

jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")

# text for people is as wide as the terminal: the same for every worker
os.environ["COLUMNS"] = "100"

# tracing makes many small things that live on: looking through them at each 700 takes a sixth of it
gc.set_threshold(100_000, 50, 50)

"""Settings for every test."""

import os

import jax

import diffthrust  # noqa: F401  (switches double precision on)

jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")

# text for people is as wide as the terminal: the same for every worker
os.environ["COLUMNS"] = "100"

"""Settings for every test."""

import jax

import diffthrust  # noqa: F401  (switches double precision on)

jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")

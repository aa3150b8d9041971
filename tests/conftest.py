"""Settings for every test."""

import gc
import os
from functools import lru_cache

import jax
import pytest
from processes import programs

import diffthrust  # noqa: F401  (switches double precision on)

jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")

# text for people is as wide as the terminal: the same for every worker
os.environ["COLUMNS"] = "100"

# the same models are fitted in many files: of so many programs the memory maps stay half of all
programs._kept = lru_cache(maxsize=200)(programs._kept.__wrapped__)

# tracing makes many small things that live on: looking through them at each 700 takes a sixth of it
gc.set_threshold(100_000, 50, 50)


@pytest.fixture
def nothing_stored(monkeypatch):
    """No traced program lies on disk: what is counted as traced was so in this test."""
    monkeypatch.setattr(programs, "program_store", lambda: None)


@pytest.fixture
def no_cache(monkeypatch):
    """Nothing is kept between runs, also by a command that runs in this process."""
    monkeypatch.setenv("DIFFTHRUST_CACHE", "off")

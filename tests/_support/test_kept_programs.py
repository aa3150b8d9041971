"""Programs: traced once for their code and shapes, and let go when others were used since."""

import sys
from functools import lru_cache
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from processes import KEPT, program, programs

MAPS = Path("/proc/self/maps")


@pytest.fixture(autouse=True)
def _as_users_have_it(monkeypatch, nothing_stored):
    """As many are kept as in a user's process; the other tests keep more."""
    usual = lru_cache(maxsize=KEPT)(programs._kept.__wrapped__)
    monkeypatch.setattr(programs, "_kept", usual)


@program(1)
def _power(exponent, numbers):
    return jnp.sum(numbers["x"] ** exponent)


def test_a_program_is_traced_once_for_its_code_and_shapes():
    before = _power.traces
    for x in (np.arange(3.0), np.ones(3), np.arange(4.0)):
        assert float(_power(2, {"x": x})) == float(np.sum(x**2))
    assert _power.traces == before + 2
    assert float(_power(3, {"x": np.arange(3.0)})) == 9.0
    assert _power.traces == before + 3


def test_what_was_not_used_for_long_is_let_go():
    x = {"x": np.arange(5.0)}
    for exponent in range(KEPT + 1):
        _power(exponent, x)
    before = _power.traces
    _power(KEPT, x)
    assert _power.traces == before
    assert float(_power(0, x)) == 5.0
    assert _power.traces == before + 1


@pytest.mark.skipif(not MAPS.exists(), reason=f"{sys.platform} does not list its memory maps")
def test_memory_maps_are_given_back():
    x = {"x": np.arange(7.0)}

    def maps(first):
        for exponent in range(first, first + KEPT):
            _power(exponent, x)
        return len(MAPS.read_text().splitlines())

    once = maps(100)
    assert maps(100 + KEPT) < once + KEPT  # one program alone has several

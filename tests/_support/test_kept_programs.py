"""Programs: traced once for their code and shapes, and let go when others were used since."""

import sys
import time
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from pathlib import Path
from threading import Barrier

import jax
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


def test_threads_that_begin_together_trace_it_once(monkeypatch):
    """Two runs of a fleet, on a busy machine, compiled their program twice."""
    began, before = Barrier(4), _power.traces
    monkeypatch.setattr(programs, "_stored", lambda *_: time.sleep(0.2))  # all threads come there

    def run(_):
        began.wait()
        return float(_power(2, {"x": np.arange(6.0)}))

    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(run, range(4))) == [55.0] * 4
    assert _power.traces == before + 1


def test_a_program_that_failed_is_made_again():
    @program(1)
    def broken(exponent, numbers):
        if broken.traces == 1:
            raise ValueError("not yet")
        return numbers["x"] * exponent

    with pytest.raises(ValueError, match="not yet"):
        broken(2, {"x": np.arange(2.0)})
    assert broken(2, {"x": np.arange(2.0)}).tolist() == [0.0, 2.0]


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


def test_within_a_trace_a_program_is_a_part_of_the_other():
    doubled = program(1)(lambda factor, x: factor * x)
    assert jax.grad(lambda x: doubled(2.0, x))(1.0) == 2.0
    assert jax.jit(lambda x: doubled(3.0, x))(1.0) == 3.0
    assert doubled.traces == 0


def test_options_that_xla_does_not_know_are_left_out(monkeypatch):
    programs._understood.cache_clear()
    monkeypatch.setattr(programs, "_OPTIONS", {"xla_no_such_option": 1})
    assert programs._understood(False) is None
    assert programs._understood(True) == programs._QUICK_OPTIONS
    programs._understood.cache_clear()


def test_a_program_is_optimised_where_it_works_on_much(monkeypatch):
    asked = []
    monkeypatch.setattr(programs, "_understood", lambda quick: asked.append(quick))
    monkeypatch.setattr(programs, "program_store", lambda: None)
    for size in (10, programs._QUICK + 1):
        program(0, quick_compile=True)(jnp.sum)(np.zeros(size))
        program(0)(jnp.sum)(np.zeros(size))
    assert asked == [True, False, False, False]

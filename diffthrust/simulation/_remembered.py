"""Simulations that a long work keeps, so that none is made twice.

A diagnosis asks for the same whole runs at several places: a fit for its errors, a stage beside the
next for what an effect is worth, a comparison at the end, and each of them with half the step.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

import numpy as np

from diffthrust.simulation._record import Record

States = dict[str, np.ndarray]

_simulations: ContextVar[dict[Hashable, tuple[Record, States]] | None] = ContextVar(
    "simulations", default=None
)


@contextmanager
def simulated_once() -> Iterator[None]:
    """Within it the same model is simulated over the same record only once."""
    outer = _simulations.get()
    token = _simulations.set({} if outer is None else outer)
    try:
        yield
    finally:
        _simulations.reset(token)


def remembered(key: Hashable, record: Record, simulate: Callable[[], States]) -> States:
    """The result of ``simulate()``, or that of an earlier call with the same key.

    The key holds the record's ``id``; the record is kept with the result, so that none of the same
    id can come after it.
    """
    results = _simulations.get()
    if results is None:
        return simulate()
    if key not in results:
        results[key] = record, simulate()
    return {name: values.copy() for name, values in results[key][1].items()}

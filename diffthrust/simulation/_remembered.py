"""Simulations that are remembered for a while, so that none is run twice."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

import numpy as np

from diffthrust.logs._log import Log

States = dict[str, np.ndarray]

_simulations: ContextVar[dict[Hashable, tuple[Log, States]] | None] = ContextVar(
    "simulations", default=None
)


@contextmanager
def simulated_once() -> Iterator[None]:
    """Within it, what has been simulated is remembered: the same model over the same log."""
    known = _simulations.get()
    token = _simulations.set({} if known is None else known)
    try:
        yield
    finally:
        _simulations.reset(token)


def remembered(asked: Hashable, log: Log, simulate: Callable[[], States]) -> States:
    """What ``simulate()`` gives, or gave when the same was asked of the log before."""
    known = _simulations.get()
    if known is None:
        return simulate()
    if asked not in known:
        known[asked] = log, simulate()  # as long as the log is kept, no other has its id
    return {name: values.copy() for name, values in known[asked][1].items()}

"""Which signals an effect may read at a port: those the equations have reported by then."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import jax
import jax.numpy as jnp

from diffthrust.models._base.effect import Ports
from diffthrust.models._base.signals import Signal, Signals


def reported_at(equations: Callable[..., Any], names: Iterable[str], port: str) -> tuple[str, ...]:
    """The signals that equations report to the effects at a port, besides their own inputs."""
    signals = tuple(dict.fromkeys(names))
    noted: dict[str, tuple[str, ...]] = {}

    def run(values: dict[str, Signal]) -> Signal:
        s = Signals(values)
        equations(s, _Noting(s, noted))
        return values["time"]

    # an abstract evaluation: the equations are walked through once, nothing is computed
    jax.eval_shape(run, {name: jnp.asarray(0.5) for name in ("time", *signals)})
    return tuple(name for name in noted.get(port, ()) if name not in ("time", *signals))


class _Noting(Ports):
    """Ports without effects that note what may be read at each."""

    def __init__(self, signals: Signals, noted: dict[str, tuple[str, ...]]) -> None:
        super().__init__((), signals)
        self._noted = noted

    def hears(self, part: str) -> bool:
        return True

    def __call__(self, port: str, value: Signal) -> Signal:
        self._noted[port] = tuple(self._signals)
        return value

"""Laws that may be missing at a place: a function of a signal or its past, times another."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from diffthrust.diagnosis._ports import DrivingPort
from diffthrust.diagnosis._structure import Observed, behind, recent
from diffthrust.diagnosis._trials import Trials
from diffthrust.effects._curve import CLOCK
from diffthrust.effects._grammar import expression_of
from diffthrust.models._base.made_effect import ARRIVING

_PASTS = (20, 100, 500)
"""Samples over which the past of a signal is remembered."""
_SLOW = (100, 500)
"""The same of its square, which heats."""


class Hypothesis(NamedTuple):
    """A law that may be missing: ``value + times * curve(signal)`` at a port.

    Args:
        port: where it acts.
        signal: an expression of signals, as a `Curve` reads it.
        times: the same of what the curve is multiplied by; empty for nothing.
        past: time constant of the signal's lag [s]; 0 for the signal itself.
        over: the signal log by log, ``(T,)``.
        factor: what the curve is multiplied by, log by log; ``None`` for nothing.
    """

    port: str
    signal: str
    times: str
    past: float
    over: Sequence[np.ndarray]
    factor: Sequence[np.ndarray] | None


def simple_laws(trials: Trials, place: DrivingPort, seen: Observed) -> Iterator[Hypothesis]:
    """Functions of one signal at a place: added there, or scaling what passes a port behind it."""
    for port in dict.fromkeys((place.port, *behind(trials, place))):
        for times in ("", ARRIVING) if port == place.port else (ARRIVING,):
            yield from _of_each_signal(trials, place, seen, port, times)


def products(
    trials: Trials, place: DrivingPort, seen: Observed, best: Hypothesis
) -> Iterator[Hypothesis]:
    """The law that is likeliest so far, and others at its place, times another signal."""
    names = _readable(trials, seen)
    for times in (expression for name in names for expression in (name, f"abs({name})")):
        for law in _of_each_signal(trials, place, seen, best.port, times):
            if law.past or law.signal not in times:  # a function of one signal alone is had already
                yield law


def along_log(expression: str, seen: Observed, port: str, log: int) -> np.ndarray:
    """An expression of signals over a log, as an effect at a port reads it, ``(T,)``."""
    path, passing = seen.paths[log], seen.ports[log]

    def named(name: str) -> np.ndarray:
        if name == CLOCK:
            return path["time"] - path["time"][0]
        return passing[port] if name == ARRIVING else path[name]

    return np.asarray(expression_of(expression)(named, np), float)


def _of_each_signal(
    trials: Trials, place: DrivingPort, seen: Observed, port: str, times: str
) -> Iterator[Hypothesis]:
    logs = range(len(seen.paths))
    step = float(np.median(np.diff(seen.paths[0]["time"])))
    factor = [along_log(times, seen, port, log) for log in logs] if times else None
    own = [ARRIVING] if port == place.port and place.state and not times else []
    names = _readable(trials, seen)
    wanted = [(name, samples) for name in names for samples in (0, *_PASTS)]
    wanted += [(f"{name}**2", samples) for name in names for samples in _SLOW]
    wanted += [(name, 0) for name in (*own, CLOCK)]
    for signal, samples in wanted:
        over = [along_log(signal, seen, port, log) for log in logs]
        if np.ptp(np.concatenate(over)) <= 1e-9 * (1.0 + np.abs(np.concatenate(over)).max()):
            continue  # a constant
        if samples:
            over = [recent(one, samples) for one in over]
        yield Hypothesis(port, signal, times, samples * step, over, factor)


def _readable(trials: Trials, seen: Observed) -> list[str]:
    """The inputs, and the states that are measured, as far as all logs have them."""
    everywhere = set.intersection(*(set(path) for path in seen.paths))
    model = trials.model
    names = [*model.inputs, *model.optional_inputs]
    names += [n for n in model.states if n in trials.channels or n in trials.logs[0].inputs]
    return [name for name in dict.fromkeys(names) if name in everywhere]

"""Laws that may be missing at a place: a function of a signal or its past, times another."""

from __future__ import annotations

import ast
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from diffthrust.diagnosis._ports import DrivingPort, words_and_unit
from diffthrust.diagnosis._structure import Observed, behind
from diffthrust.diagnosis._trials import Trials
from diffthrust.effects._grammar import expression_of
from diffthrust.effects._memory import value_along
from diffthrust.logs._units import product_unit
from diffthrust.models._base.made_effect import ARRIVING

CLOCK = "integral(1)"
"""The time since the log began."""
TIME, WIDTH = "time_constant", "half_width"
"""Parameters of what remembers."""
_PASTS = (20, 100, 500)
"""Samples over which the past of a signal is remembered."""
_SLOW = (100, 250, 600)
"""The same of its square, which heats what is cold at first."""
_PLAYS = (0.02, 0.06, 0.18)
"""Half the width of a play, over the range of its signal."""
_RANGE = 100.0
"""A time constant or a width is estimated within so many times its first guess."""


class Hypothesis(NamedTuple):
    """A law that may be missing: ``value + times * curve(signal)`` at a port.

    Args:
        port: where it acts.
        signal: an expression of signals, as a `Curve` reads it.
        times: the same of what the curve is multiplied by; empty for nothing.
        parameters: those of the signal, as a `Curve` takes them.
        over: the signal log by log, ``(T,)``.
        factor: what the curve is multiplied by, log by log; ``None`` for nothing.
    """

    port: str
    signal: str
    times: str
    parameters: Mapping[str, Mapping[str, Any]]
    over: Sequence[np.ndarray]
    factor: Sequence[np.ndarray] | None


def simple_laws(trials: Trials, place: DrivingPort, seen: Observed) -> Iterator[Hypothesis]:
    """Functions of one signal at a place: added there, or scaling what passes a port behind it."""
    for port in dict.fromkeys((place.port, *behind(trials, place))):
        for times in ("", ARRIVING) if port == place.port else (ARRIVING,):
            yield from _of_each_signal(trials, place, seen, port, times)


def products(
    trials: Trials, place: DrivingPort, seen: Observed, best: Sequence[Hypothesis]
) -> Iterator[Hypothesis]:
    """Functions of a signal as it is, and of those of the likeliest laws, times another signal.

    They act where the likeliest does.
    """
    names, port = _readable(trials, seen), best[0].port
    likely = {law.signal for law in best}
    for times in (expression for name in names for expression in (name, f"abs({name})")):
        for law in _of_each_signal(trials, place, seen, port, times, {*names, *likely}):
            if (
                law.parameters or law.signal not in expression_of(times).places
            ):  # one of one signal is had already
                yield law


def units_at(trials: Trials, port: str) -> dict[str, str]:
    """The units of what an effect may read at a port, as far as they are known."""
    model = trials.model
    known = {**model.inputs, **model.optional_inputs, **model.all_states, **model.channel_units}
    return {**known, ARRIVING: words_and_unit(model, port)[1]}


def unit_of(signal: str, units: Mapping[str, str]) -> str:
    """The unit of a signal of these hypotheses; "" where it is not known."""
    law, known = expression_of(signal), dict(units)
    for one in law.memories:
        inner = _unit(one.of, known)
        known[one.state] = product_unit((inner, 1), ("s", 1)) if one.kind == "integral" else inner
    return _unit(law.tree, known)


def _unit(node: ast.AST, units: Mapping[str, str]) -> str:
    if isinstance(node, ast.Name):
        return units.get(node.id, "")
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
        return product_unit((_unit(node.left, units), int(ast.unparse(node.right))))
    if isinstance(node, ast.Call):
        return _unit(node.args[0], units)
    return _unit(node.left, units) if isinstance(node, ast.BinOp) else ""


def _of_each_signal(
    trials: Trials,
    place: DrivingPort,
    seen: Observed,
    port: str,
    times: str,
    only: Collection[str] = (),
) -> Iterator[Hypothesis]:
    for signal, parameters in _expressions(trials, place, seen, port, times):
        if only and signal not in only:
            continue
        law = hypothesis(seen, port, signal, times, parameters)
        pooled = np.concatenate(law.over)
        if np.ptp(pooled) > 1e-9 * (1.0 + np.abs(pooled).max()):  # no constant
            yield law


def hypothesis(
    seen: Observed, port: str, signal: str, times: str, parameters: Mapping[str, Mapping[str, Any]]
) -> Hypothesis:
    """A law with its signal and factor along the logs, at the values of its parameters."""
    logs = range(len(seen.paths))
    over = [_along(signal, parameters, seen, port, log) for log in logs]
    factor = [_along(times, {}, seen, port, log) for log in logs] if times else None
    return Hypothesis(port, signal, times, parameters, over, factor)


def _expressions(
    trials: Trials, place: DrivingPort, seen: Observed, port: str, times: str
) -> Iterator[tuple[str, Mapping[str, Mapping[str, Any]]]]:
    """Signals, and what they were, with first guesses of the time or the width that it takes."""
    step = float(np.median(np.diff(seen.paths[0]["time"])))
    names, units = _readable(trials, seen), units_at(trials, port)
    for name in names:
        yield name, {}
        for text, pasts in (
            (f"lag({name}, {TIME})", _PASTS),
            (f"lag({name}**2, {TIME}, 0)", _SLOW),
        ):
            for samples in pasts:
                yield text, {TIME: _guessed(samples * step, "s")}
    arriving = [ARRIVING] if place.state and not times else []
    for name in (*names, *arriving):
        pooled = np.concatenate(
            [_along(name, {}, seen, port, log) for log in range(len(seen.paths))]
        )
        for share in _PLAYS:
            width = share * float(np.ptp(pooled))
            if width > 0:
                unit = units.get(name, "")
                yield f"{name} - play({name}, {WIDTH})", {WIDTH: _guessed(width, unit)}
        if name in names:
            yield f"integral({name})", {}
    if port == place.port and arriving:
        yield ARRIVING, {}
    yield CLOCK, {}


def _guessed(value: float, unit: str) -> dict[str, Any]:
    bounds = (value / _RANGE, value * _RANGE)
    return {"unit": unit, "value": value, "bounds": bounds, "transform": "log"}


def _along(
    expression: str,
    parameters: Mapping[str, Mapping[str, Any]],
    seen: Observed,
    port: str,
    log: int,
) -> np.ndarray:
    """An expression of signals over a log, as an effect at a port reads it, ``(T,)``."""
    path, passing = seen.paths[log], seen.ports[log]

    def named(name: str) -> Any:
        if name in parameters:
            return parameters[name]["value"]
        return passing[port] if name == ARRIVING else path[name]

    return value_along(expression_of(expression), named, path["time"])


def _readable(trials: Trials, seen: Observed) -> list[str]:
    """The inputs, and the states that are measured, as far as all logs have them."""
    everywhere = set.intersection(*(set(path) for path in seen.paths))
    model = trials.model
    names = [*model.inputs, *model.optional_inputs]
    names += [n for n in model.states if n in trials.channels or n in trials.logs[0].inputs]
    return [name for name in dict.fromkeys(names) if name in everywhere]

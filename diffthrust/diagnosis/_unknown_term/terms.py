"""Terms that may be missing at a port: a function of a signal or of its past, times another signal.

Each is evaluated along a trial's path, at every sample and just before the next one: an input may
be held between samples, so what it drives does not run straight to its value at the next sample.

"""

from __future__ import annotations

import ast
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from diffthrust.diagnosis._innovations_fit import CandidateFitter, TrialFit
from diffthrust.diagnosis._ports import DrivingPort, words_and_unit
from diffthrust.diagnosis._residual_structure import (
    ObservedSignals,
    Wave,
    downstream_ports,
    observed_signals,
    wave_along,
)
from diffthrust.effects._curve import Curve
from diffthrust.effects._grammar import expression_of
from diffthrust.effects._memory import values_along
from diffthrust.logs._units import product_unit
from diffthrust.models._base.made_effect import ARRIVING
from diffthrust.models._base.model import Model
from diffthrust.simulation._levels import port_readings


class PortSeries(NamedTuple):
    """What is added at a port log by log, ``(K, T)``: at the samples, and as the next ones come."""

    now: Sequence[np.ndarray]
    end: Sequence[np.ndarray]


class Regressors(NamedTuple):
    """What a trial sees at the samples of the training logs, and as the next ones come."""

    now: ObservedSignals
    end: ObservedSignals


def regressors_of(trials: CandidateFitter, trial: TrialFit) -> Regressors:
    """What a trial sees of the training logs."""
    now = observed_signals(trials, trial)
    paths = [
        {
            name: series if log.hold.get(name) == "zero" else np.append(series[1:], series[-1:])
            for name, series in path.items()
        }
        for log, path in zip(trials.logs, now.paths, strict=True)
    ]
    return Regressors(
        now, ObservedSignals(paths, [port_readings(trials.model, path) for path in paths])
    )


def expression_along(
    expression: str, parameters: Mapping[str, Mapping[str, Any]], regressors: Regressors, port: str
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """An expression of signals as an effect at a port reads it, log by log; ``(T,)`` each.

    At the samples, and as the next ones come.
    """
    law = expression_of(expression)
    values = {name: fields["value"] for name, fields in parameters.items()}

    def named(when: ObservedSignals, log: int) -> Callable[[str], Any]:
        return {**when.paths[log], ARRIVING: when.ports[log][port], **values}.__getitem__

    now, end = [], []
    for log, path in enumerate(regressors.now.paths):
        current, later = values_along(
            law, named(regressors.now, log), named(regressors.end, log), path["time"]
        )
        now.append(current)
        end.append(later)
    return now, end


CLOCK = "integral(1)"
"""The time since the log began."""
TIME, WIDTH = "time_constant", "half_width"
"""Parameters of what remembers,"""
NUMBER, PHASE = "wave_number", "phase"
"""and of waves."""
_LAG_SAMPLES = (20, 100, 500)
"""Samples over which the past of a signal is remembered."""
_HEAT_SAMPLES = (100, 250, 600)
"""The same of its square, which heats what is cold at first."""
_PLAY_SHARES = (0.02, 0.06, 0.18)
"""Half the width of a play, over the range of its signal;"""
_WIDEST_PLAY = 0.25
"""a wider one would hardly be pushed at all."""
_PARAMETER_RANGE = 100.0
"""A time constant or a width is estimated within so many times its first guess."""


class Term(NamedTuple):
    """A law that may be missing: ``value + times * curve(signal)`` at a port.

    Args:
        port: where it acts.
        signal: an expression of signals, as a `Curve` reads it.
        times: the same of what the curve is multiplied by; empty for nothing.
        parameters: those of the signal, as a `Curve` takes them.
        over: the signal log by log, ``(T,)``.
        factor: what the curve is multiplied by, log by log; ``None`` for nothing.
        over_end: the signal as the next sample comes, until which an input may be held.
        factor_end: the same of the factor.
    """

    port: str
    signal: str
    times: str
    parameters: Mapping[str, Mapping[str, Any]]
    over: Sequence[np.ndarray]
    factor: Sequence[np.ndarray] | None
    over_end: Sequence[np.ndarray]
    factor_end: Sequence[np.ndarray] | None

    def added(self, curve: Curve) -> PortSeries:
        """What each coefficient of a curve adds."""
        now = [curve.basis(series) for series in self.over]
        end = [curve.basis(series) for series in self.over_end]
        if self.factor is not None and self.factor_end is not None:
            now = [row * by for row, by in zip(now, self.factor, strict=True)]
            end = [row * by for row, by in zip(end, self.factor_end, strict=True)]
        return PortSeries(now, end)

    @property
    def straight(self) -> bool:
        """Whether its curve is a straight line: a wave has its shape already."""
        return NUMBER in self.parameters


class TermSpace(NamedTuple):
    """Of what laws may be made.

    Args:
        trials: the fits.
        place: where something is missing.
        seen: what the present trial sees of the logs.
        waves: those that stand out along states, by name.
    """

    trials: CandidateFitter
    place: DrivingPort
    seen: Regressors
    waves: Mapping[str, Wave]


def term_space(trials: CandidateFitter, trial: TrialFit, place: DrivingPort) -> TermSpace:
    """Of what a law may be made that is missing at a place beside a trial."""
    regressors = regressors_of(trials, trial)
    moving = [n for n in _readable(trials, regressors.now) if n in trials.model.states]
    waves = {name: wave for name in moving if (wave := wave_along(trial, name))}
    return TermSpace(trials, place, regressors, waves)


def single_signal_terms(at: TermSpace) -> Iterator[Term]:
    """Functions of one signal at a place: added there, or scaling what passes a port behind it."""
    for port in dict.fromkeys((at.place.port, *downstream_ports(at.trials, at.place))):
        for times in ("", ARRIVING) if port == at.place.port else (ARRIVING,):
            yield from _terms_of_signals(at, port, times)


def product_terms(at: TermSpace, best: Sequence[Term]) -> Iterator[Term]:
    """Functions of a signal as it is, and of those of the likeliest laws, times another signal.

    They act where the likeliest does.
    """
    names, port = _readable(at.trials, at.seen.now), best[0].port
    likely = {law.signal for law in best}
    for times in (expression for name in names for expression in (name, f"abs({name})")):
        for law in _terms_of_signals(at, port, times, {*names, *likely}):
            if (
                law.parameters or law.signal not in expression_of(times).places
            ):  # one of one signal is had already
                yield law


def units_at(trials: CandidateFitter, port: str) -> dict[str, str]:
    """The units of what an effect may read at a port, as far as they are known."""
    model = trials.model
    units = {**model.inputs, **model.optional_inputs, **model.all_states, **model.channel_units}
    return {**units, ARRIVING: words_and_unit(model, port)[1]}


def unit_at(trials: CandidateFitter, port: str, times: str) -> str:
    """The unit of what is added at a port when it is multiplied by something."""
    if times == ARRIVING:
        return ""
    units = units_at(trials, port)
    return product_unit((units[ARRIVING], 1), (unit_of(times, units) if times else "", -1))


def unit_of(signal: str, units: Mapping[str, str]) -> str:
    """The unit of a signal of these hypotheses; "" where it is not known."""
    law, units_of_states = expression_of(signal), dict(units)
    for memory in law.memories:
        inner = _unit(memory.of, units_of_states)
        units_of_states[memory.state] = (
            product_unit((inner, 1), ("s", 1)) if memory.kind == "integral" else inner
        )
    return _unit(law.tree, units_of_states)


def channel_of(signal: str, model: Model) -> str:
    """The channel of a model in whose unit a signal of these hypotheses is; "" for none."""
    law = expression_of(signal)
    followed = {memory.state: memory.of for memory in law.memories if memory.kind != "integral"}
    node = law.tree
    while not isinstance(node, ast.Name) or node.id in followed:
        if isinstance(node, ast.Name):
            node = followed[node.id]
        elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.Sub):
            node = node.left
        else:
            return ""
    return node.id if node.id in model.channel_units else ""


def unit_following(channel: str, unit: str) -> str:
    """The unit of a parameter that is in that of a channel, if there is one, and a unit if not."""
    return f"{{{channel}}}" if channel else unit


def _unit(node: ast.AST, units: Mapping[str, str]) -> str:
    if isinstance(node, ast.Name):
        return units.get(node.id, "")
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
        return product_unit((_unit(node.left, units), int(ast.unparse(node.right))))
    if isinstance(node, ast.Call):
        wave = isinstance(node.func, ast.Name) and node.func.id == "sin"
        return "" if wave else _unit(node.args[0], units)
    return _unit(node.left, units) if isinstance(node, ast.BinOp) else ""


def _terms_of_signals(
    at: TermSpace, port: str, times: str, only: Collection[str] = ()
) -> Iterator[Term]:
    for signal, parameters in _expressions(at, port, times):
        if only and signal not in only:
            continue
        law = term_along(at.seen, port, signal, times, parameters)
        pooled = np.concatenate(law.over)
        if np.ptp(pooled) > 1e-9 * (1.0 + np.abs(pooled).max()):  # no constant
            yield law


def term_along(
    regressors: Regressors,
    port: str,
    signal: str,
    times: str,
    parameters: Mapping[str, Mapping[str, Any]],
) -> Term:
    """A law with its signal and factor along the logs, at the values of its parameters."""
    over, over_end = expression_along(signal, parameters, regressors, port)
    factor, factor_end = expression_along(times, {}, regressors, port) if times else (None, None)
    return Term(port, signal, times, parameters, over, factor, over_end, factor_end)


def _expressions(
    at: TermSpace, port: str, times: str
) -> Iterator[tuple[str, Mapping[str, Mapping[str, Any]]]]:
    """Signals, and what they were, with first guesses of the time or the width that it takes."""
    trials, place, regressors, waves = at
    step = float(np.median(np.diff(regressors.now.paths[0]["time"])))
    names, units = _readable(trials, regressors.now), units_at(trials, port)
    for name in names:
        yield name, {}
        for text, pasts in (
            (f"lag({name}, {TIME})", _LAG_SAMPLES),
            (f"lag({name}**2, {TIME}, 0)", _HEAT_SAMPLES),
        ):
            for samples in pasts:
                yield text, {TIME: _guess(samples * step, "s")}
    for name, wave in waves.items():
        yield f"sin({NUMBER} * {name} + {PHASE})", _wave_parameters(wave, units.get(name, ""))
    arriving = [ARRIVING] if place.state and not times else []
    for name in (*names, *arriving):
        pooled = np.concatenate(expression_along(name, {}, regressors, port)[0])
        for share in _PLAY_SHARES:
            width = share * float(np.ptp(pooled))
            if width > 0:
                unit = unit_following(channel_of(name, trials.model), units.get(name, ""))
                parameter = _guess(width, unit, _WIDEST_PLAY * float(np.ptp(pooled)))
                yield f"{name} - play({name}, {WIDTH})", {WIDTH: parameter}
        if name in names:
            yield f"integral({name})", {}
    if port == place.port and arriving:
        yield ARRIVING, {}
    yield CLOCK, {}


def _guess(value: float, unit: str, most: float = np.inf) -> dict[str, Any]:
    bounds = (value / _PARAMETER_RANGE, min(value * _PARAMETER_RANGE, most))
    return {"unit": unit, "value": value, "bounds": bounds, "transform": "log"}


def _wave_parameters(wave: Wave, unit: str) -> dict[str, dict[str, Any]]:
    """Whole runs must not take it for another wave: their errors have many false minima."""
    (number, phase, off), turn = wave, 2.0 * np.pi
    unit = product_unit(("rad", 1), (unit, -1))
    of_phase = {"unit": "rad", "value": phase, "bounds": (phase - turn, phase + turn)}
    return {
        NUMBER: {"unit": unit, "value": number, "bounds": (number - off, number + off)},
        PHASE: of_phase,
    }


def _readable(trials: CandidateFitter, observed_logs: ObservedSignals) -> list[str]:
    """The inputs, and the states that are measured, as far as all logs have them."""
    everywhere = set.intersection(*(set(path) for path in observed_logs.paths))
    model = trials.model
    names = [*model.inputs, *model.optional_inputs]
    names += [n for n in model.states if n in trials.channels or n in trials.logs[0].inputs]
    return [name for name in dict.fromkeys(names) if name in everywhere]

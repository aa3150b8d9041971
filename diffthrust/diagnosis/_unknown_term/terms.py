"""Terms that may be missing at a port: a function of a signal or of its past, times another signal.

Each is evaluated along a trial's path, at every sample and just before the next one: under
zero-order hold an input keeps its value until then, and what it drives is no straight line between
the samples.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from diffthrust.diagnosis._candidates import DrivingPort, words_and_unit
from diffthrust.diagnosis._innovations_fit import CandidateFitter, TrialFit
from diffthrust.diagnosis._residual_structure import (
    ObservedSignals,
    Wave,
    downstream_ports,
    observed_signals,
    varies,
    wave_along,
)
from diffthrust.effects._expression import values_along
from diffthrust.effects._grammar import expression_of
from diffthrust.logs._units import product_unit
from diffthrust.models._base.made_effect import ARRIVING
from diffthrust.models._base.model import Model
from diffthrust.simulation._levels import port_readings
from diffthrust.simulation._record import are_tables

CLOCK = "integral(1)"
"""The time since the log began."""
TIME, WIDTH = "time_constant", "half_width"
"""Parameters of signals with a memory."""
NUMBER, PHASE = "wave_number", "phase"
"""Parameters of waves."""

# First guesses of memories. A factor of some five between them is close enough for the linear
# evidence to see a memory; the likeliest are then tuned (`tune_memory`).
_LAG_SAMPLES = (20, 100, 500)
"""Numerics: time constants of a lag, in samples."""
_HEAT_SAMPLES = (100, 250, 600)
"""Numerics: time constants of a squared signal, which heats what is cold at the start of a log."""
_PLAY_SHARES = (0.02, 0.06, 0.18)
"""Numerics: half-widths of a play, over the range of its signal."""
_WIDEST_PLAY = 0.25
"""Numerics: largest half-width: a wider play is hardly pushed at all, and its curve is not
identifiable."""
_PARAMETER_RANGE = 100.0
"""Numerics: a time constant or half-width is estimated within this factor of its first guess."""

Parameters = Mapping[str, Mapping[str, Any]]
"""The parameters of a signal, each with its fields: "value", "unit", "bounds"."""


class PortSeries(NamedTuple):
    """Series at a port, log by log ``(T,)`` or ``(K, T)``: at the samples, and as the next come."""

    current: Sequence[np.ndarray]
    upcoming: Sequence[np.ndarray]


class Regressors(NamedTuple):
    """Signals of the training logs along a trial: at the samples, and as the next ones come."""

    current: ObservedSignals
    upcoming: ObservedSignals


def regressors_of(fitter: CandidateFitter, trial: TrialFit) -> Regressors:
    """The signals of the training logs along a trial."""
    current = observed_signals(fitter, trial)
    # An input under zero-order hold keeps its value until the next sample. When it was taken as a
    # straight line between samples, a share of a constant drive looked like a missing term.
    paths = [
        {
            name: series if record.hold.get(name) == "zero" else np.append(series[1:], series[-1:])
            for name, series in path.items()
        }
        for record, path in zip(fitter.records, current.paths, strict=True)
    ]
    ports = [port_readings(fitter.model, path) for path in paths]
    return Regressors(current, ObservedSignals(paths, ports))


def expression_along(
    expression: str, parameters: Parameters, regressors: Regressors, port: str
) -> PortSeries:
    """An expression of signals as an effect at a port reads it."""
    law = expression_of(expression)
    values = {name: fields["value"] for name, fields in parameters.items()}

    def reader(signals: ObservedSignals, log: int) -> Callable[[str], Any]:
        return {**signals.paths[log], ARRIVING: signals.ports[log][port], **values}.__getitem__

    pairs = (
        values_along(
            law, reader(regressors.current, log), reader(regressors.upcoming, log), path["time"]
        )
        for log, path in enumerate(regressors.current.paths)
    )
    return PortSeries(*zip(*pairs, strict=True))


class Term(NamedTuple):
    """A term that may be missing: ``value + times * curve(signal)`` at a port.

    Args:
        port: where it acts.
        signal: an expression of signals, as a `Curve` reads it.
        times: expression of the factor of the curve; empty for none.
        parameters: those of the signal, as a `Curve` takes them.
        along: the signal along the logs, ``(T,)`` each.
        factor: the factor along the logs; ``None`` for none.
    """

    port: str
    signal: str
    times: str
    parameters: Parameters
    along: PortSeries
    factor: PortSeries | None

    @property
    def pooled(self) -> np.ndarray:
        """The signal at the samples of all logs, ``(N,)``."""
        return np.concatenate(self.along.current)

    def basis(self, functions: Callable[[np.ndarray], np.ndarray]) -> PortSeries:
        """What a unit of each of some functions of the signal, ``(T,) -> (K, T)``, adds."""
        rows = [[functions(x) for x in part] for part in self.along]
        if self.factor is not None:
            pairs = zip(rows, self.factor, strict=True)
            rows = [[r * f for r, f in zip(*pair, strict=True)] for pair in pairs]
        return PortSeries(*rows)

    @property
    def is_linear(self) -> bool:
        """Whether its curve is a straight line: a wave has its shape already."""
        return NUMBER in self.parameters


def term_along(
    regressors: Regressors, port: str, signal: str, times: str, parameters: Parameters
) -> Term:
    """A term with its signal and factor along the logs, at the values of its parameters."""
    along = expression_along(signal, parameters, regressors, port)
    factor = expression_along(times, {}, regressors, port) if times else None
    return Term(port, signal, times, parameters, along, factor)


class TermSpace(NamedTuple):
    """What terms are made of.

    Args:
        fitter: the fits in the innovations form.
        place: where something is missing.
        regressors: the signals of the logs along the current trial.
        waves: those that stand out along states, by name of the state.
    """

    fitter: CandidateFitter
    place: DrivingPort
    regressors: Regressors
    waves: Mapping[str, Wave]


def term_space(fitter: CandidateFitter, trial: TrialFit, place: DrivingPort) -> TermSpace:
    """What a term is made of that is missing at a place beside a trial."""
    regressors = regressors_of(fitter, trial)
    moving = [n for n in _readable(fitter, regressors.current) if n in fitter.model.states]
    waves = {name: wave for name in moving if (wave := wave_along(trial, name))}
    return TermSpace(fitter, place, regressors, waves)


def single_signal_terms(space: TermSpace) -> Iterator[Term]:
    """Functions of one signal: added at the place, or scaling what passes a port downstream."""
    place = space.place
    for port in dict.fromkeys((place.port, *downstream_ports(space.fitter, place))):
        for times in ("", ARRIVING) if port == place.port else (ARRIVING,):
            yield from _terms_of_signals(space, port, times)


def product_terms(space: TermSpace, likeliest: Sequence[Term]) -> Iterator[Term]:
    """Products of a function of one signal and another signal, at the port of the likeliest term.

    The function is of a plain signal, or of the signal of one of the likeliest terms.
    """
    names, port = _readable(space.fitter, space.regressors.current), likeliest[0].port
    signals = {*names, *(term.signal for term in likeliest)}
    for times in (expression for name in names for expression in (name, f"abs({name})")):
        for term in _terms_of_signals(space, port, times, signals):
            # x * curve(x) is a function of one signal, and among those already
            if term.parameters or term.signal not in expression_of(times).places:
                yield term


def _terms_of_signals(
    space: TermSpace, port: str, times: str, only: Collection[str] = ()
) -> Iterator[Term]:
    for signal, parameters in _signals(space, port, times):
        if only and signal not in only:
            continue
        term = term_along(space.regressors, port, signal, times, parameters)
        if varies(term.pooled):
            yield term


def _signals(space: TermSpace, port: str, times: str) -> Iterator[tuple[str, Parameters]]:
    """Signals, plain and with a memory, with first guesses of the parameters of the memory.

    Of static tables only what they list: a memory and the net push on a state take time.
    """
    fitter, place, regressors, waves = space
    if are_tables(fitter.records):
        yield from ((name, {}) for name in _readable(fitter, regressors.current))
        return
    step = float(np.median(np.diff(regressors.current.paths[0]["time"])))
    names, units = _readable(fitter, regressors.current), units_at(fitter, port)
    for name in names:
        yield name, {}
        for text, time_constants in (
            (f"lag({name}, {TIME})", _LAG_SAMPLES),
            (f"lag({name}**2, {TIME}, 0)", _HEAT_SAMPLES),
        ):
            for samples in time_constants:
                yield text, {TIME: _guess(samples * step, "s")}
    for name, wave in waves.items():
        yield f"sin({NUMBER} * {name} + {PHASE})", _wave_parameters(wave, units.get(name, ""))
    arriving = [ARRIVING] if place.state and not times else []
    for name in (*names, *arriving):
        span = float(np.ptp(np.concatenate(expression_along(name, {}, regressors, port).current)))
        for width in (share * span for share in _PLAY_SHARES):
            if width > 0:
                unit = unit_following(channel_of(name, fitter.model), units.get(name, ""))
                guess = _guess(width, unit, _WIDEST_PLAY * span)
                yield f"{name} - play({name}, {WIDTH})", {WIDTH: guess}
        if name in names:
            yield f"integral({name})", {}
    if port == place.port and arriving:
        yield ARRIVING, {}
    yield CLOCK, {}


def _guess(value: float, unit: str, largest: float = np.inf) -> dict[str, Any]:
    bounds = (value / _PARAMETER_RANGE, min(value * _PARAMETER_RANGE, largest))
    return {"unit": unit, "value": value, "bounds": bounds, "transform": "log"}


def _wave_parameters(wave: Wave, unit: str) -> dict[str, dict[str, Any]]:
    # bounds within which it stays this wave: the error of whole runs has a minimum at every other
    number, phase, uncertainty = wave
    bounds = (number - uncertainty, number + uncertainty)
    turn = (phase - 2.0 * np.pi, phase + 2.0 * np.pi)
    return {
        NUMBER: {"unit": product_unit(("rad", 1), (unit, -1)), "value": number, "bounds": bounds},
        PHASE: {"unit": "rad", "value": phase, "bounds": turn},
    }


def _readable(fitter: CandidateFitter, signals: ObservedSignals) -> list[str]:
    """The inputs, and the states that are measured, if all logs have them."""
    common = set.intersection(*(set(path) for path in signals.paths))
    model = fitter.model
    names = [*model.inputs, *model.optional_inputs]
    names += [n for n in model.states if n in fitter.channels or n in fitter.records[0].inputs]
    return [name for name in dict.fromkeys(names) if name in common]


def units_at(fitter: CandidateFitter, port: str) -> dict[str, str]:
    """The units of the signals that an effect may read at a port, where they are known."""
    model = fitter.model
    units = {**model.inputs, **model.optional_inputs, **model.all_states, **model.channel_units}
    return {**units, ARRIVING: words_and_unit(model, port)[1]}


def unit_at(fitter: CandidateFitter, port: str, times: str) -> str:
    """The unit of a curve at a port with a factor."""
    if times == ARRIVING:
        return ""
    units = units_at(fitter, port)
    return product_unit((units[ARRIVING], 1), (unit_of(times, units) if times else "", -1))


def unit_of(signal: str, units: Mapping[str, str]) -> str:
    """The unit of a signal of these terms; "" where it is not known."""
    law, units_of_states = expression_of(signal), dict(units)
    for memory in law.memories:
        inner = _unit(memory.of, units_of_states)
        integrated = product_unit((inner, 1), ("s", 1))
        units_of_states[memory.state] = integrated if memory.kind == "integral" else inner
    return _unit(law.tree, units_of_states)


def channel_of(signal: str, model: Model) -> str:
    """The channel of a model in whose unit a signal of these terms is; "" for none."""
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
    """A unit that follows that of a channel in the logs, or a fixed one where there is none."""
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

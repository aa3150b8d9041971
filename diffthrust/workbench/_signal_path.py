"""The signal path of a model, from its own equations: what depends on what, and where to draw it.

The equations are evaluated at one point, and again with each signal and each port a little off:
whatever changes depends on it. So a model of the user's own is drawn like the library's.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

from diffthrust.models._base.effect import Ports
from diffthrust.models._base.model import Model
from diffthrust.models._base.signals import Signals
from diffthrust.simulation._runge_kutta import plain_rate

_OFF = 1e-3
"""Numerics: by how much a signal is off; a dependence weaker than a billionth of that is none."""

Edge = tuple[str, str]


@dataclass(frozen=True)
class Node:
    """A signal of the path.

    Args:
        name: of an input, a port, a state or an output.
        kind: "input", "port", "state" or "output"; a state that is measured is a state.
        column: its place from left to right.
        row: its place from top to bottom; feedback runs below.
    """

    name: str
    kind: str
    column: float
    row: float


@dataclass(frozen=True)
class SignalPath:
    """Nodes with their places, and arrows between them."""

    nodes: tuple[Node, ...]
    edges: tuple[Edge, ...]


def signal_path(model: Model) -> SignalPath:
    """The signal path of a model without its effects.

    Example:
        >>> path = signal_path(dft.SpeedLoopThruster())
        >>> ("target", "loop") in path.edges, ("speed", "loop") in path.edges
        (True, True)
    """
    model = model._copy(effects=())
    edges = _edges(model)
    linked = {name for edge in edges for name in edge}
    kinds = dict.fromkeys(model.inputs, "input") | dict.fromkeys(model.ports, "port")
    kinds |= dict.fromkeys(model.states, "state")
    kinds |= {name: "output" for name in model.outputs if name not in kinds}
    names = [name for name in kinds if name in linked or kinds[name] in ("input", "port")]
    places = _places(names, edges, kinds)
    nodes = (Node(name, kinds[name], *places[name]) for name in names)
    return SignalPath(tuple(nodes), tuple(edges))


class _Recorder(Ports):
    """Ports that keep what arrives, and may let a little more leave."""

    def __init__(self, signals: Signals, off: str) -> None:
        super().__init__((), signals)
        self.off, self.arrived = off, {}

    def __call__(self, port: str, value: Any) -> Any:
        self.arrived[port] = float(value)
        return value + (_OFF if port == self.off else 0.0)


def _edges(model: Model) -> list[Edge]:
    """From each signal to what depends on it at once, not by way of another port."""
    names = [*model.inputs, *model.states]
    point = {name: 0.6 + 0.17 * index for index, name in enumerate(names)}
    point |= dict.fromkeys(model.optional_inputs, 0.5) | {"time": 0.0} | point
    plain = _evaluated(model, point, "")
    reached: dict[str, set[str]] = {}
    for name in names:
        off = _evaluated(model, {**point, name: point[name] + _OFF}, "")
        reached[name] = _changed(plain, off)
    for port in model.ports:
        reached[port] = _changed(plain, _evaluated(model, point, port)) - {port}
    ports = set(model.ports)
    return [
        (name, end)
        for name, ends in reached.items()
        for end in ends
        if end != name and not any(end in reached[via] for via in ends & ports - {end})
    ]


def _evaluated(model: Model, point: Mapping[str, float], off: str) -> dict[str, float]:
    """What arrives at each port, the rate of each state, and each output that is no state."""
    signals = Signals(dict(point))
    recorder = _Recorder(signals, off)
    rates, outputs = model.equations(signals, recorder)
    values = {n: float(v) for n, v in outputs.items() if n not in model.states}
    values |= {name: float(plain_rate(rate)) for name, rate in rates.items()}
    return values | recorder.arrived


def _changed(plain: Mapping[str, float], off: Mapping[str, float]) -> set[str]:
    return {name for name, value in off.items() if abs(value - plain[name]) > 1e-9 * _OFF}


def _places(
    names: Collection[str], edges: Collection[Edge], kinds: Mapping[str, str]
) -> dict[str, tuple[float, float]]:
    """By name column and row: from the inputs to the right, ports that lead back below."""
    depth = {name: 0 for name in names if kinds[name] == "input"}
    queue = deque(depth)
    while queue:
        name = queue.popleft()
        for begin, end in edges:
            if begin == name and end not in depth:
                depth[end] = depth[name] + 1
                queue.append(end)
    depth |= {name: 1 for name in names if name not in depth}
    into, out = {end: begin for begin, end in edges}, dict(edges)
    rows: dict[float, list[str]] = {}
    for name in names:
        column = float(depth[name])
        if kinds[name] == "port" and name in into and name in out:
            begin, end = depth[into[name]], depth[out[name]]
            column = 0.5 * (begin + end) if end < depth[name] else column
        rows.setdefault(column, []).append(name)
    places = {}
    for column, beside in rows.items():
        taken = [len(rows.get(float(c), ())) for c in (int(column), int(column) + 1)]
        below = max(taken) if column != int(column) else 0
        for index, name in enumerate(beside):
            places[name] = (column, float(below + index))
    return places

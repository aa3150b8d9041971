"""Commands of a craft that are exchanged, or of the wrong sign, named in words.

The forces that the commands of a craft give about its origin must be seen in the changes of its
measured velocities. Held against them by least squares, one axis after the other, every reading of
the commands (two of like thrusters exchanged, or one turned) is tried in one pass over the logs,
without a fit: a fit of a craft that is wired otherwise ends anywhere.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations

import jax.numpy as jnp
import numpy as np

from diffthrust._support.words import joined, percent
from diffthrust.models._base.effect import Ports
from diffthrust.models._base.model import Model
from diffthrust.models._base.signals import Signals
from diffthrust.models._craft.craft import Craft
from diffthrust.models._craft.six import Six, cross, scaled
from diffthrust.simulation._runs import Run
from diffthrust.soundness._doubt import Doubt, Reading

_AXES = {
    "velocity": "surge",
    "surge": "surge",
    "sway": "sway",
    "heave": "heave",
    "roll_rate": "roll",
    "pitch_rate": "pitch",
    "yaw_rate": "yaw",
}
"""The axis of each measured velocity."""
_SPAN = 0.6
"""Time over which changes of velocities are taken [s]: longer than a thruster takes to follow,
shorter than a craft takes to settle."""
_LEFT = 0.7
"""A reading must leave no more than this share of what the commands as logged leave unexplained. Of
a vehicle of six thrusters an exchange or a turned command leaves less; one thruster at 0.4 of its
strength, its dead band, a delay or another body leave more (tests/estimation/test_wiring.py)."""
_NEXT = 1.05
"""Readings that leave up to so many times what the best one leaves are as good."""
_MOST = 3
"""More readings that are as good say nothing."""


def wiring_doubts(model: Model, runs: Sequence[Run]) -> Iterator[Doubt]:
    """A doubt on the commands of a craft, where the logs fit another reading of them far better."""
    if not isinstance(model, Craft) or not runs:
        return
    parts = {n: f"{n}.command" for n, m in model.actuators.items() if "command" in m.model.inputs}
    parts = {n: c for n, c in parts.items() if {*model.actuators[n].model.inputs} == {"command"}}
    rows = [_Rows(model, run, parts) for run in runs]
    axes = [axis for axis in _AXES if all(axis in row.changes for row in rows)]
    if len(parts) < 2 or not axes:
        return
    logged = _unexplained(rows, axes, {})
    tried = [
        (_unexplained(rows, axes, reading), reading) for reading in _readings(model, tuple(parts))
    ]
    best = min((left for left, _ in tried), default=logged)
    if not best < _LEFT * logged:
        return
    likely = sorted((pair for pair in tried if pair[0] <= _NEXT * best), key=lambda pair: pair[0])
    if len(likely) > _MOST:
        return
    readings = tuple(_reading(reading, parts) for _, reading in likely)
    words = joined((reading.words for reading in readings), "or")
    kind = "exchanged" if len(likely[0][1]) == 2 else "sign"
    yield Doubt(
        parts[next(iter(likely[0][1]))],
        kind,
        f"the logs fit {words}: of the changes of {joined(axes)} the forces then leave "
        f"{percent(best)} unexplained, {percent(logged)} as logged.",
        readings[0].line,
        readings,
    )


_Wiring = Mapping[str, tuple[str, float]]
"""For each actuator that is read otherwise, whose command it has, and with which sign."""


def _readings(model: Craft, names: tuple[str, ...]) -> Iterator[_Wiring]:
    """Every command turned, and every two of like thrusters exchanged."""
    for name in names:
        yield {name: (name, -1.0)}
    for group in model.groups():
        for first, second in combinations([n for n in group if n in names], 2):
            yield {first: (second, 1.0), second: (first, 1.0)}


def _reading(wiring: _Wiring, parts: Mapping[str, str]) -> Reading:
    sources = {parts[n]: (parts[other], sign) for n, (other, sign) in wiring.items()}
    if len(wiring) == 1:
        (name,) = wiring
        line = f"give the command of {name} its other sign: scale = -1 for '{parts[name]}'."
        return Reading(f"the command of {name} turned", line, sources)
    first, second = wiring
    line = f"exchange the columns of '{parts[first]}' and '{parts[second]}'."
    return Reading(f"the commands of {first} and {second} exchanged", line, sources)


class _Rows:
    """What least squares of one run need: changes of velocities, and what they may follow.

    ``parts`` are the actuators, each with the name of its command.
    """

    def __init__(self, model: Craft, run: Run, parts: Mapping[str, str]) -> None:
        time = run.time
        self.span = max(1, round(_SPAN / float(np.median(np.diff(time)))))
        measured = {n: run.channels[n].measured for n in _AXES if n in run.channels}
        self.changes = {n: v[self.span :] - v[: -self.span] for n, v in measured.items()}
        self.velocities = {n: self._mean(v) for n, v in measured.items()}
        commands = {n: np.asarray(run.signals[c], float) for n, c in parts.items()}
        self.thrusts = {
            (name, other, sign): self._mean(_steady(model, name, sign * commands[other]))
            for name in parts
            for other, sign in ((name, -1.0), *((o, 1.0) for o in parts))
        }
        self.arms = {name: _arm(model, name) for name in parts}

    def _mean(self, values: np.ndarray) -> np.ndarray:
        total = np.concatenate([[0.0], np.cumsum(values)])
        return (total[self.span :] - total[: -self.span])[:-1] / self.span

    def columns(self, axis: str, wiring: _Wiring) -> np.ndarray:
        """The force along an axis, and what the velocities do besides, ``(n, k)``."""
        force = sum(
            getattr(self.arms[name], _AXES[axis])
            * self.thrusts[(name, *wiring.get(name, (name, 1.0)))]
            for name in self.arms
        )
        v = list(self.velocities.values())
        products = [a * b for a, b in combinations(v, 2)]
        along = self.velocities[axis]
        columns = [force + 0.0 * along, np.ones_like(along), *v, along * np.abs(along), *products]
        return np.stack(columns, axis=1)


def _unexplained(rows: Sequence[_Rows], axes: Sequence[str], wiring: _Wiring) -> float:
    """The mean share of the changes of velocities that a reading leaves over the axes."""
    shares = []
    for axis in axes:
        columns = np.concatenate([row.columns(axis, wiring) for row in rows])
        change = np.concatenate([row.changes[axis] for row in rows])
        valid = np.isfinite(change) & np.isfinite(columns).all(axis=1)
        columns, change = columns[valid], change[valid]
        if not np.any(columns[:, 0]):  # no thruster pushes along this axis
            continue
        solution, *_ = np.linalg.lstsq(columns, change, rcond=None)
        if solution[0] < 0:  # a force that works backwards explains nothing
            columns = columns[:, 1:]
            solution, *_ = np.linalg.lstsq(columns, change, rcond=None)
        residual = change - columns @ solution
        shares.append(float(residual @ residual) / max(float(np.sum(change**2)), 1e-300))
    return float(np.mean(shares)) if shares else 1.0


def _steady(model: Craft, name: str, command: np.ndarray) -> np.ndarray:
    """The thrust of an actuator where it has settled at a command."""
    part = model.actuator(name)
    s = Signals({"time": jnp.zeros(command.size), "command": jnp.asarray(command)})
    s = s.also({**dict.fromkeys(part.states, jnp.zeros(command.size)), **part.settled(s)})
    _, outputs = part.equations(s, Ports((), s))
    return np.asarray(outputs["thrust"])


def _arm(model: Craft, name: str) -> Six:
    """Force and moment of an actuator per thrust."""
    mounted = model.actuators[name]
    place = tuple(getattr(model, f"{name}.{axis}") for axis in "xyz")
    reaction = scaled(mounted.reaction or 0.0, mounted.pointing)
    moment = [a + b for a, b in zip(cross(place, mounted.pointing), reaction, strict=True)]
    return Six(*mounted.pointing, *moment)

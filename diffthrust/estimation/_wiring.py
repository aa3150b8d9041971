"""Commands of a craft that are exchanged, or of the wrong sign, named in words.

The forces that the commands give about the craft's origin must be seen in the changes of its
measured velocities. Held against them by least squares, one axis after the other, every reading of
the commands (two of like thrusters exchanged, one turned, or two such mistakes) is tried in one
pass over the logs, without a fit: a fit of a craft that is wired otherwise ends anywhere.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

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
"""A reading must leave no more than this share of what is left with a mistake less. Of a vehicle of
six thrusters an exchange or a turned command leaves less; one thruster at 0.4 of its strength, its
dead band, a delay or another body leave more (tests/estimation/test_wiring.py)."""
_ROWS = 20_000
"""Windows of a run at most: they overlap, and of eight thrusters each has 128 numbers."""
_NEXT = 1.05
"""Readings that leave up to so many times what the best one leaves are as good."""
_MOST = 3
"""More readings that are as good say nothing."""

_Sources = Mapping[str, tuple[str, float]]
"""For each actuator that is read otherwise, whose command it has, and with which sign."""


class _Wiring(NamedTuple):
    """Mistakes that are undone, in their order, and where each command then comes from."""

    mistakes: tuple[_Sources, ...]
    sources: _Sources


def wiring_doubts(model: Model, runs: Sequence[Run]) -> Iterator[Doubt]:
    """A doubt on the commands of a craft, where the logs fit another reading of them far better."""
    if not isinstance(model, Craft) or not runs:
        return
    parts = {n: f"{n}.command" for n, m in model.actuators.items() if "command" in m.model.inputs}
    parts = {n: c for n, c in parts.items() if {*model.actuators[n].model.inputs} == {"command"}}
    axes = [axis for axis in _AXES if all(axis in run.channels for run in runs)]
    if len(parts) < 2 or not axes:
        return
    like = [[n for n in group if n in parts] for group in model.groups()]
    balances = _balances(model, runs, parts, like, axes)
    if not balances:
        return
    own = {name: (name, 1.0) for name in parts}
    bar, likely = _misfit(balances, own), []
    # two mistakes are tried beside one: the sides of a BlueBoat are exchanged and one is turned
    for wirings in _wirings(parts, like):
        left = [_misfit(balances, own | wiring.sources) for wiring in wirings]
        if min(left) < _LEFT * bar:
            bar = min(left)
            near = sorted((v, k) for k, v in enumerate(left) if v <= _NEXT * bar)
            likely = [wirings[k] for _, k in near]
    if not 0 < len(likely) <= _MOST:
        return
    logged, then = (_unexplained(balances, own | sources) for sources in ({}, likely[0].sources))
    readings = tuple(_reading(wiring, parts) for wiring in likely)
    words = joined((reading.words for reading in readings), "or")
    crossed = any(source != name for name, (source, _) in likely[0].sources.items())
    yield Doubt(
        parts[next(iter(likely[0].sources))],
        "exchanged" if crossed else "sign",
        f"the logs fit {words}: of the changes of {joined(axes)} the forces then leave "
        f"{percent(then)} unexplained, {percent(logged)} as logged.",
        readings[0].line,
        readings,
    )


def _wirings(names: Iterable[str], like: Sequence[Sequence[str]]) -> Iterator[list[_Wiring]]:
    """Every single mistake, every two of like thrusters exchanged or one turned; then every two."""
    mistakes: list[_Sources] = []
    for group in like:
        for first, second in combinations(group, 2):
            mistakes.append({first: (second, 1.0), second: (first, 1.0)})
    mistakes += [{name: (name, -1.0)} for name in names]
    singles = [_Wiring((mistake,), mistake) for mistake in mistakes]
    yield singles
    seen = [wiring.sources for wiring in singles]
    doubles = []
    for first, second in combinations(mistakes, 2):
        after = {n: (first.get(o, (o, 1.0)), sign) for n, (o, sign) in second.items()}
        sources = {**first, **{n: (o, s * sign) for n, ((o, s), sign) in after.items()}}
        if sources not in seen:
            seen.append(sources)
            doubles.append(_Wiring((first, second), sources))
    yield doubles


def _reading(wiring: _Wiring, parts: Mapping[str, str]) -> Reading:
    words, lines = [], []
    for mistake in wiring.mistakes:
        first, *rest = mistake
        if rest:
            words.append(f"the commands of {first} and {rest[0]} exchanged")
            lines.append(f"exchange the columns of '{parts[first]}' and '{parts[rest[0]]}'")
        else:
            words.append(f"the command of {first} turned")
            lines.append(
                f"give the command of {first} its other sign: scale = -1 for '{parts[first]}'"
            )
    sources = {parts[n]: (parts[other], sign) for n, (other, sign) in wiring.sources.items()}
    return Reading(" and ".join(words), f"{'; then '.join(lines)}.", sources)


class _Balance(NamedTuple):
    """Least squares of an axis: its changes against the force of each actuator by each command.

    What else the velocities do is taken out of all of them. ``force`` has the products with the
    change, ``pairs`` those with each other, by place in ``places``.
    """

    places: Mapping[tuple[str, str, float], int]
    change: float
    total: float
    force: np.ndarray
    pairs: np.ndarray


def _balances(
    model: Craft,
    runs: Sequence[Run],
    parts: Mapping[str, str],
    like: Sequence[Sequence[str]],
    axes: Sequence[str],
) -> list[_Balance]:
    """Of each axis along which a thruster pushes."""
    fellows = {name: next(group for group in like if name in group) for name in parts}
    keys = [(n, other, sign) for n in parts for other in fellows[n] for sign in (1.0, -1.0)]
    arms = {name: _arm(model, name) for name in parts}
    rows = [_rows(model, run, parts, keys, axes) for run in runs]
    changes, velocities, thrusts = (np.concatenate(part) for part in zip(*rows, strict=True))
    products = [a * b for a, b in combinations(velocities.T, 2)]
    balances = []
    for k, axis in enumerate(axes):
        push = np.array([getattr(arms[name], _AXES[axis]) for name, *_ in keys])
        if not push.any():
            continue
        along, change = velocities[:, k], changes[:, k]
        other = [np.ones_like(along), *velocities.T, along * np.abs(along), *products]
        columns = np.stack([*other, change, *(push * thrusts).T], axis=1)
        columns = columns[np.isfinite(columns).all(axis=1)]
        if len(columns) < 2 * len(other) or not columns[:, len(other)].any():
            continue
        base, rest = columns[:, : len(other)], columns[:, len(other) :]
        rest = rest - base @ np.linalg.lstsq(base, rest, rcond=None)[0]
        gram = rest.T @ rest
        total = float(np.sum(columns[:, len(other)] ** 2))
        places = {key: place for place, key in enumerate(keys)}
        balances.append(_Balance(places, float(gram[0, 0]), total, gram[0, 1:], gram[1:, 1:]))
    return balances


def _explained(balance: _Balance, sources: _Sources) -> float:
    """The share of an axis' changes that its force explains; negative where it works backwards."""
    at = [balance.places[(name, *source)] for name, source in sources.items()]
    force, size = float(balance.force[at].sum()), float(balance.pairs[np.ix_(at, at)].sum())
    return force * abs(force) / size / balance.total if size > 0 else 0.0


def _misfit(balances: Sequence[_Balance], sources: _Sources) -> float:
    """What a reading leaves of the changes, a mean over the axes, and what works backwards.

    With one side of a BlueBoat turned its forces explain the surge as well as with both mistakes
    undone, and 26 % of the turning, backwards: that speaks against it as much as 26 % would for it.
    """
    return float(np.mean([b.change / b.total - _explained(b, sources) for b in balances]))


def _unexplained(balances: Sequence[_Balance], sources: _Sources) -> float:
    """What a reading leaves of the changes, a mean over the axes."""
    return float(np.mean([b.change / b.total - max(_explained(b, sources), 0.0) for b in balances]))


def _rows(
    model: Craft,
    run: Run,
    parts: Mapping[str, str],
    keys: Sequence[tuple[str, str, float]],
    axes: Sequence[str],
) -> tuple[np.ndarray, ...]:
    """Changes of a run's velocities over `_SPAN`; means over it of these and of the thrusts."""
    span = max(1, round(_SPAN / float(np.median(np.diff(run.time)))))
    every = max(1, run.time.size // _ROWS)

    def mean(values: np.ndarray) -> np.ndarray:
        there = np.isfinite(values)
        sums = np.stack([np.where(there, values, 0.0), there])
        total = np.cumsum(np.pad(sums, ((0, 0), (1, 0))), axis=1)
        total, count = (total[:, span:] - total[:, :-span])[:, :-1:every]
        return np.divide(total, count, out=np.full_like(total, np.nan), where=count > 0)

    velocities = [run.channels[axis].measured for axis in axes]
    commands = {n: np.asarray(run.signals[c], float) for n, c in parts.items()}
    thrusts = (_steady(model, name, sign * commands[other]) for name, other, sign in keys)
    changes = [(v[span:] - v[:-span])[::every] for v in velocities]
    parts_of_rows = (changes, map(mean, velocities), map(mean, thrusts))
    return tuple(np.stack([*part], axis=1) for part in parts_of_rows)


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

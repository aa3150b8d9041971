"""Commands of a craft that are exchanged, or of the wrong sign, named in words.

The forces that the commands give about the craft's origin must be seen in the changes of its
measured velocities, by the body's own channels or by sensors on it. Held against them by least
squares, one axis after the other, every reading of the commands (two of thrusters of one kind
exchanged, one turned, or two such mistakes) is tried in one pass over the logs, without a fit: a
fit of a craft that is wired otherwise ends anywhere.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from diffthrust._support.words import joined, percent
from diffthrust.models._base.effect import Ports
from diffthrust.models._base.model import Model
from diffthrust.models._base.signals import Signals
from diffthrust.models._craft.craft import Craft
from diffthrust.models._craft.placed import place_of
from diffthrust.models._craft.sensor import Sensor
from diffthrust.models._craft.six import Six, Triple, cross, scaled
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
"""The axis of each velocity of a body."""
_SPAN = 0.6
"""Time over which changes of velocities are taken [s]: longer than a thruster takes to follow,
shorter than a craft takes to settle."""
_LEFT = 0.7
"""A reading must leave no more than this share of what the commands as logged leave unexplained,
and two mistakes no more than this share of what the best single one leaves. Of a vehicle of six
thrusters an exchange or a turned command leaves less; one thruster at 0.4 of its strength, its dead
band, a delay or another body leave more (tests/estimation/test_wiring.py)."""
_SEEN = 0.05
"""Share of an axis' changes from which on a force that works backwards is seen in it."""
_NEXT = 1.05
"""Readings that leave up to so many times what the best one leaves are as good."""
_MOST = 3
"""More readings that are as good say nothing."""

_ROWS = 20_000
"""Numerics: rows of the least squares from which on they overlap less, down to not at all: eight
thrusters with numbers of their own on 100 000 samples took 630 MB with all of them."""

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
    balances = _balances(model, runs, parts) if len(parts) > 1 else []
    if not balances:
        return
    own = {name: (name, 1.0) for name in parts}
    bar, likely = _misfit(balances, own), []
    # two mistakes are tried beside one: the sides of a BlueBoat are exchanged and one is turned
    for wirings in _wirings(parts, _kinds(model, parts)):
        left = [_misfit(balances, {**own, **wiring.sources}) for wiring in wirings]
        near = sorted((v, k) for k, v in enumerate(left) if v <= _NEXT * min(left))
        if min(left) < _LEFT * bar and len(near) <= _MOST:
            likely = [wirings[k] for _, k in near]
        bar = min(bar, *left)
    logged = _unexplained(balances, own)
    then = _unexplained(balances, {**own, **likely[0].sources}) if likely else logged
    if not then < _LEFT * logged:
        return
    readings = [_reading(wiring, parts) for wiring in likely]
    if rival := _turned_sensors(balances, own, then):
        # one frame is likelier than two mistakes in the commands
        readings.insert(0 if len(likely[0].mistakes) > 1 else len(readings), rival)
    words = joined((reading.words for reading in readings), "or")
    channel, (source, _) = next(iter(readings[0].sources.items()))
    yield Doubt(
        channel,
        "sign" if source == channel else "exchanged",
        f"the logs fit {words}: of the changes of {joined(b.axis for b in balances)} the forces "
        f"then leave {percent(then)} unexplained, {percent(logged)} as logged.",
        readings[0].line,
        tuple(readings),
    )


def _kinds(model: Craft, parts: Iterable[str]) -> list[list[str]]:
    """The actuators by their model, whether they share its numbers or not."""
    kinds: dict[Hashable, list[str]] = {}
    for name in parts:
        kinds.setdefault(model.actuators[name].model.structure, []).append(name)
    return list(kinds.values())


def _turned_sensors(balances: Sequence[_Balance], own: _Sources, then: float) -> Reading | None:
    """The sensors of the axes along which all works backwards, where that explains as much.

    Of a boat with its sides exchanged the logs fit a turned yaw rate as well; of six thrusters two
    exchanged pairs are a sway and a yaw rate that count the other way.
    """
    turned = [b.axis for b in balances if _explained(b, own) < -_SEEN]
    either = float(np.mean([b.change - abs(_explained(b, own)) for b in balances]))
    if not turned or either > _NEXT * then:
        return None
    return Reading(
        f"{joined(turned)} of the other sign",
        f"give {joined(turned)} the other sign: scale = -1, or the frame of the sensor.",
        {axis: (axis, -1.0) for axis in turned},
    )


def _wirings(names: Iterable[str], like: Sequence[Sequence[str]]) -> Iterator[list[_Wiring]]:
    """Every single mistake, two of one kind exchanged or one turned; then every two of these."""
    mistakes: list[_Sources] = []
    for group in like:
        for first, second in combinations(group, 2):
            mistakes.append({first: (second, 1.0), second: (first, 1.0)})
    mistakes += [{name: (name, -1.0)} for name in names]
    singles = [_Wiring((mistake,), mistake) for mistake in mistakes]
    yield singles
    seen = {frozenset(mistake.items()) for mistake in mistakes}
    doubles = []
    for first, second in combinations(mistakes, 2):
        after = {n: (first.get(o, (o, 1.0)), sign) for n, (o, sign) in second.items()}
        sources = {**first, **{n: (o, s * sign) for n, ((o, s), sign) in after.items()}}
        if (key := frozenset(sources.items())) not in seen:
            seen.add(key)
            doubles.append(_Wiring((first, second), sources))
    yield doubles


def _reading(wiring: _Wiring, parts: Mapping[str, str]) -> Reading:
    words, lines = [], []
    for mistake in wiring.mistakes:
        first, *second = mistake
        if second:
            words.append(f"the commands of {first} and {second[0]} exchanged")
            lines.append(f"exchange the columns of '{parts[first]}' and '{parts[second[0]]}'")
        else:
            words.append(f"the command of {first} turned")
            lines.append(
                f"give the command of {first} its other sign: scale = -1 for '{parts[first]}'"
            )
    sources = {parts[n]: (parts[other], sign) for n, (other, sign) in wiring.sources.items()}
    return Reading(", then ".join(words), f"{'; then '.join(lines)}.", sources)


class _Balance(NamedTuple):
    """Least squares of an axis: its changes against the thrusts by each command, either way round.

    What else the velocities do is taken out of all of them, and all are shares of the changes'
    squares: ``change`` what is left of these, ``along`` the products of the thrusts with them,
    ``pairs`` those with each other. ``arms`` are the force or moment of each actuator per thrust,
    ``laws`` whose numbers it has, ``places`` the place of each law, command and sign.
    """

    axis: str
    arms: Mapping[str, float]
    laws: Mapping[str, str]
    places: Mapping[tuple[str, str, float], int]
    change: float
    along: np.ndarray
    pairs: np.ndarray


def _balances(model: Craft, runs: Sequence[Run], parts: Mapping[str, str]) -> list[_Balance]:
    """Of each axis that all runs measure, and along which a thruster pushes."""
    axes = measured_axes(model, runs)
    if not axes:
        return []
    laws = {name: model.actuators.owner(name) for name in parts}
    keys = dict.fromkeys(
        (laws[name], source, sign)
        for kind in _kinds(model, parts)
        for name in kind
        for source in kind
        for sign in (1.0, -1.0)
    )
    stride = max(1, sum(run.time.size for run in runs) // _ROWS)
    rows = [_rows(model, run, parts, [*keys], axes, stride) for run in runs]
    changes, velocities, thrusts = (np.concatenate(part) for part in zip(*rows, strict=True))
    products = [a * b for a, b in combinations(velocities.T, 2)]
    balances = []
    for k, (channel, axis) in enumerate(axes.items()):
        arms = {name: _arm(model, name, axis) for name in parts}
        along, change = velocities[:, k], changes[:, k]
        other = [np.ones_like(along), *velocities.T, along * np.abs(along), *products]
        columns = np.stack([*other, change, *thrusts.T], axis=1)
        columns = columns[np.isfinite(columns).all(axis=1)]
        base, moved = columns[:, : len(other)], columns[:, len(other) :]
        total = float(np.sum(moved[:, 0] ** 2))
        if not any(arms.values()) or len(moved) < 2 * len(other) or not total:
            continue
        moved = moved - base @ np.linalg.lstsq(base, moved, rcond=None)[0]
        gram = moved.T @ moved / total
        places = {key: place for place, key in enumerate(keys)}
        sums = gram[0, 0], gram[0, 1:], gram[1:, 1:]
        balances.append(_Balance(channel, arms, laws, places, *sums))
    return balances


def measured_axes(model: Craft, runs: Sequence[Run]) -> dict[str, str]:
    """By channel that all runs measure the axis that it tells of: one for each axis.

    The body's own come first. A sensor away from the origin tells a velocity of the body only
    beside all of its turning.
    """
    read = [name for name in model.outputs if all(name in run.channels for run in runs)]
    axes = {name: _AXES[name] for name in read if name in _AXES}
    for name in read:
        sensor, _, short = name.rpartition(".")
        if sensor in model.sensors:
            of_body = _sensor(model, sensor).as_of_body({short: np.zeros(1)})
            axis = _AXES.get(next(iter(of_body), "")) if len(of_body) == 1 else None
            if axis and axis not in axes.values():
                axes[name] = axis
    turning = {_AXES[n] for n in model.body.states if _AXES.get(n) in Six._fields[3:]}
    complete = turning <= {*axes.values()}
    return {
        name: axis
        for name, axis in axes.items()
        if complete or axis in turning or not any(_place(model, name.rpartition(".")[0]))
    }


def velocities_of(model: Craft, run: Run, axes: Mapping[str, str]) -> list[np.ndarray]:
    """The velocities of the body at its origin, as the channels tell them."""
    velocity: dict[str, np.ndarray] = {}
    for name, axis in axes.items():
        sensor, _, short = name.rpartition(".")
        values = np.asarray(run.channels[name].measured)
        if sensor:
            (values,) = _sensor(model, sensor).as_of_body({short: values}).values()
        velocity[axis] = values
    turning = {
        axis: _between(run.time, velocity[axis]) for axis in Six._fields[3:] if axis in velocity
    }
    for name, axis in axes.items():
        if axis in Six._fields[:3] and (sensor := name.rpartition(".")[0]):
            there = Six(**turning).at(_place(model, sensor))
            velocity[axis] = velocity[axis] - there[Six._fields.index(axis)]
    return [velocity[axis] for axis in axes.values()]


def _between(time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Readings between those there are, in gaps of less than `_SPAN`: sensors take turns."""
    there = np.isfinite(values)
    if not there.any():
        return values
    filled = np.interp(time, time[there], values[there])
    after = np.searchsorted(time[there], time)
    before = time[there][np.maximum(after - 1, 0)]
    gap = time[there][np.minimum(after, there.sum() - 1)] - before
    return np.where(gap < _SPAN, filled, np.nan)


def _sensor(model: Craft, name: str) -> Sensor:
    """A sensor with the present numbers of the craft."""
    sensor = model.sensors[name].model
    return sensor._bound({k: getattr(model, f"{name}.{k}") for k in sensor._parameters})


def _explained(balance: _Balance, sources: _Sources) -> float:
    """The share of an axis' changes that its force explains; negative where it works backwards."""
    weights = np.zeros(len(balance.places))
    for name, source in sources.items():
        weights[balance.places[balance.laws[name], *source]] += balance.arms[name]
    force, size = float(weights @ balance.along), float(weights @ balance.pairs @ weights)
    return force * abs(force) / size if size > 0 else 0.0


def _misfit(balances: Sequence[_Balance], sources: _Sources) -> float:
    """What a reading leaves of the changes, a mean over the axes, and what works backwards.

    With one side of a BlueBoat turned its forces explain the surge as well as with both mistakes
    undone, and 26 % of the turning, backwards: that speaks against it as much as 26 % would for it.
    """
    return float(np.mean([b.change - _explained(b, sources) for b in balances]))


def _unexplained(balances: Sequence[_Balance], sources: _Sources) -> float:
    """What a reading leaves of the changes, a mean over the axes."""
    return float(np.mean([b.change - max(_explained(b, sources), 0.0) for b in balances]))


def _rows(
    model: Craft,
    run: Run,
    parts: Mapping[str, str],
    keys: Sequence[tuple[str, str, float]],
    axes: Mapping[str, str],
    stride: int,
) -> tuple[np.ndarray, ...]:
    """Changes of a run's velocities over `_SPAN`; means over it of these and of the thrusts.

    Every ``stride``-th, as long as no sample is passed over.
    """
    span = max(1, round(_SPAN / float(np.median(np.diff(run.time)))))
    every = min(stride, span)

    def mean(values: np.ndarray) -> np.ndarray:
        there = np.isfinite(values)
        sums = np.stack([np.where(there, values, 0.0), there])
        total = np.cumsum(np.pad(sums, ((0, 0), (1, 0))), axis=1)
        total, count = (total[:, span:] - total[:, :-span])[:, :-1]
        return np.divide(total, count, out=np.full_like(total, np.nan), where=count > 0)

    velocities = velocities_of(model, run, axes)
    commands = {n: np.asarray(run.signals[c], float) for n, c in parts.items()}
    thrusts = (_steady(model, law, sign * commands[source]) for law, source, sign in keys)
    changes = [v[span:] - v[:-span] for v in velocities]
    parts_of_rows = (changes, map(mean, velocities), map(mean, thrusts))
    return tuple(np.stack([v[::every].copy() for v in part], axis=1) for part in parts_of_rows)


def _steady(model: Craft, name: str, command: np.ndarray) -> np.ndarray:
    """The thrust of an actuator where it has settled at a command."""
    part = model.actuator(name)
    s = Signals({"time": jnp.zeros(command.size), "command": jnp.asarray(command)})
    s = s.also({**dict.fromkeys(part.states, jnp.zeros(command.size)), **part.settled(s)})
    _, outputs = part.equations(s, Ports((), s))
    return np.asarray(outputs["thrust"])


def _arm(model: Craft, name: str, axis: str) -> float:
    """Force or moment of an actuator along an axis per thrust."""
    mounted, place = model.actuators[name], _place(model, name)
    reaction = scaled(mounted.reaction or 0.0, mounted.pointing)
    moment = [a + b for a, b in zip(cross(place, mounted.pointing), reaction, strict=True)]
    strength = getattr(model, f"{name}.strength", 1.0)
    return float(strength * getattr(Six(*mounted.pointing, *moment), axis))


def _place(model: Craft, part: str) -> Triple:
    """Where a part is; the origin for the body itself, and where it does not matter."""
    if not part or (part in model.sensors and not model.sensors[part].model.placed):
        return (0.0, 0.0, 0.0)
    return place_of(part, vars(model))

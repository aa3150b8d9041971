"""What a fit does not explain, and what its user may look at first.

Commands of a craft that are exchanged, or of the wrong sign, are named in words. The forces that
the commands give about the craft's origin must be seen in the changes of its measured velocities.
Held against them by least squares, one axis after the other, every reading of the commands (two of
like thrusters exchanged, or one turned) is tried in one pass over the logs, without a fit: a fit of
a craft that is wired otherwise ends anywhere.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations

import jax.numpy as jnp
import numpy as np

from diffthrust._support.words import joined, number, percent
from diffthrust.logs._log import Log
from diffthrust.models._base.effect import Ports
from diffthrust.models._base.model import Model
from diffthrust.models._base.signals import Signals
from diffthrust.models._craft.craft import Craft
from diffthrust.models._craft.six import Six, cross, scaled
from diffthrust.simulation._errors import Errors
from diffthrust.simulation._runs import Run
from diffthrust.soundness._doubt import Doubt, Reading
from diffthrust.soundness._doubts import doubts as doubts_of
from diffthrust.soundness._late import late_readings
from diffthrust.soundness._record import jumps

_LITTLE = 0.36
"""A channel of whose variance less is explained is not described by the model: an NRMSE of 0.8, a
fit of a fifth."""


def little_explained(errors: Errors) -> dict[str, str]:
    """Channels of whose variance a fit explains less than `_LITTLE`, and the share."""
    shares = {name: 1.0 - e.nrmse**2 for name, e in errors.channels.items()}
    return {name: percent(max(share, 0.0)) for name, share in shares.items() if share < _LITTLE}


def hint_at(little: Mapping[str, str]) -> str:
    """What to add to the message of a fit that explains little of some channels."""
    words = joined([f"{share} of the variance of {name}" for name, share in little.items()])
    return f" But it explains {words}: look at the doubts first." if little else ""


def doubts_about(
    little: Mapping[str, str], runs: Sequence[Run], model: Model, logs: Sequence[Log]
) -> tuple[Doubt, ...]:
    """The doubts of a fit: on its logs, the unseen ones too, and on channels it hardly explains.

    ``runs`` are those over its training logs; none where they failed.
    """
    wired = (*wiring_doubts(model, runs),)
    # errors of exchanged commands go with the slopes as well: of eight thrusters with two of them
    # exchanged the heading "came late by a varying time", too
    late = () if wired else late_readings(runs)
    doubts = (*_turning(model, runs), *wired, *late, *doubts_of(logs, model))
    return (*doubts, *silent_doubts(little, doubts, model, runs))


def silent_doubts(
    little: Mapping[str, str], doubts: Sequence[Doubt], model: Model, runs: Sequence[Run]
) -> tuple[Doubt, ...]:
    """Doubts on channels that a fit hardly explains, and that no other doubt names."""
    held = "".join(_held_against(model, runs)) if little else ""
    doubted = {word.strip(".,:;") for doubt in doubts for word in str(doubt).split()}
    return tuple(
        Doubt(
            name,
            "silent",
            f"the fit explains {share} of the variance of {name}: it does not move as the model's "
            "does.",
            f"look at dft.compare(fit, logs).plot(), at the sign, unit and column of {name} and "
            f"of the inputs, and at what dft.diagnose(fit, logs) finds missing.{held}",
        )
        for name, share in little.items()
        if name not in doubted
    )


def _turning(model: Model, runs: Sequence[Run]) -> Iterator[Doubt]:
    """Doubts on angles that jump by a full turn, of which the model's class does not say so."""
    for name, unit in model.outputs.items():
        for run in runs:
            if name in model.angles or name not in run.channels:
                continue
            measured = run.channels[name].measured
            if unit and jumps(measured[np.isfinite(measured)]) == unit:  # "" where none does
                yield Doubt(
                    name,
                    "unit",
                    f"{run.name}: {name} jumps by a full turn, 360 degrees, from one sample to the "
                    f"next, and {type(model).__name__} compares it as a plain number.",
                    f"name it in the class of the model: angles = ({name!r},); then {name} is "
                    "compared modulo a full turn.",
                )
                break


PUSHED = 0.5
"""Mean of a force, in its standard deviations, from which on it pushes one way. Lower: a dozen
levels drawn about zero have 0.3 by chance."""
NOWHERE = 0.3
"""Mean speed, in its standard deviations, up to which a vehicle comes back to where it was. Lower:
dives that end deeper than they begin (0.2). Higher: boats that follow such a force, if slowly."""
_WINDOWS = 50
"""Of a log, over which the rates of a measured position are taken: between samples it is noise."""
_SPEEDS = ("velocity", "surge")
"""Speeds along what a force pushes."""


def _held_against(model: Model, runs: Sequence[Run]) -> Iterator[str]:
    """A hint for forces that push one way on average while the vehicle goes nowhere.

    A heave axis whose thrust holds against the buoyancy has no drag and no mass that explain it: a
    fit ends at a mass of 22 t for 26 kg, which does not move at all.
    """
    port = next((name for name in ("force", "surge_force") if name in model.ports), "")
    speed = next((name for name in _SPEEDS if name in model.states), "")
    if not (port and speed):
        return
    speeds = np.concatenate([_speed(run, speed) for run in runs])
    if not speeds.size or abs(speeds.mean()) > NOWHERE * speeds.std():
        return
    mend = f'model + dft.effects.Formula("{port}", "push", push="N")'
    mend = 'model + "buoyancy"' if port == "force" else mend
    for name, unit in model.inputs.items():
        force = np.concatenate([run.log.inputs[name] for run in runs])
        if unit == "N" and abs(force.mean()) > PUSHED * force.std():
            yield (
                f" {name} is {number(float(force.mean()), 3)} N on average, and {speed} none: "
                "something constant (buoyancy, weight, a slope, a tare) may hold against it; add "
                f"it by {mend}."
            )


def _speed(run: Run, speed: str) -> np.ndarray:
    """The measured speed; that of the measured position where the speed is not measured."""
    if speed in run.channels:
        measured = run.channels[speed].measured
        return measured[np.isfinite(measured)]
    if speed != "velocity" or "position" not in run.channels:
        return np.zeros(0)
    position = run.channels["position"].measured
    seen = np.flatnonzero(np.isfinite(position))
    seen = seen[:: max(1, seen.size // _WINDOWS)]
    return np.diff(position[seen]) / np.diff(run.time[seen])


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

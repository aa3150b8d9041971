"""An audit of allocation: what a mixer does with the thrusters that were identified."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust._support.validation import finite
from diffthrust._support.words import joined, number
from diffthrust.control._allocation_result import Allocation
from diffthrust.export._steady import steady_outputs
from diffthrust.layouts._mixer import AXES, Mixer
from diffthrust.models._base.effect import Ports
from diffthrust.models._base.signals import RatesAndOutputs, Signals
from diffthrust.models._craft.body import Body
from diffthrust.models._craft.craft import Craft
from diffthrust.models._craft.placed import Placed
from diffthrust.models._craft.six import Six

_ROUNDS = 30
"""Newton steps of the corrected factors, as thrust curves are not linear; power laws take five."""
_SETTLED = 1e-9
"""The factors are found where they change by less than this share."""
_NEARBY = 1e-3
"""Share of a command over which the slope of a thrust curve is taken."""
_LEAST = 0.2
"""Slopes are taken as no less than this share of the chord at the largest command: that of a power
law, and of a dead band, is zero at the stop."""
_STEP = 0.05
"""Share of a standard error over which the slope to a parameter is taken."""
_KEPT = 0.98
"""Share of a command's force that corrected factors must keep: feedback removes the rest."""
_NOTHING = 1e-3
"""Thrusters with less than this share of the force of the strongest give nothing, to a mixer."""
_NONE = 0.1
"""A command that leads to less than this share of what its thrusters could do is not corrected."""
_DEPENDENT = 1e-3
"""Directions in which thrusters do less than this share of their most are none of theirs."""
_CENTRE = ("x_g", "y_g", "z_g")


def allocation(
    craft: Any,
    mixer: Mixer,
    *,
    level: float = 0.5,
    full: float = 1.0,
    inputs: Mapping[str, float] | None = None,
) -> Allocation:
    """Hold a mixer against the thrusters of a craft: which command gives how much unwanted force.

    Thrust curves are not linear, so all numbers are chords of the curves about a stated level: half
    the difference of what a command of ``level`` and one of ``-level`` lead to, the craft at rest
    in still water, moments about its centre of mass. What both directions have in common (a
    propeller that is weaker astern) is given beside it, since no linear mixer removes it.

    The corrected mixer keeps the force that each command has along its axis, takes away what it has
    beside it, and differs from the mixer by as little as that takes (least squares of the factors).
    Axes that are commanded come first; others are freed of what the remaining thrusters can. A
    command of which that costs force, or asks more of a thruster than it takes, keeps its factors;
    findings say so.

    Args:
        craft: a craft, or a fit of one; with a fit, forces have standard errors.
        mixer: what the controller sends: of ArduSub (`diffthrust.layouts.ardusub_mixer`), of a log
            (``dft.layouts.layout_in("dive.bin").mixer``), or a matrix (`diffthrust.layouts.Mixer`).
        level: size of the commands, a share of 1.
        full: what a factor of 1 sends to a thruster, in the unit of the craft's commands.
        inputs: values of what the thrusters read besides, such as ``{"supply_voltage": 15.2}``.

    Raises:
        InputError: no craft, other thrusters than those of the mixer, a thruster that turns, a
            level that is not above 0 and at most 1, or inputs that the thrusters do not read.

    Example:
        >>> boat = dft.layouts.BLUEBOAT.craft().replace({"starboard.strength": 0.8})
        >>> mixer = dft.layouts.Mixer(("surge", "yaw"), {"port": (1, 1), "starboard": (1, -1)})
        >>> audit = dft.control.allocation(boat, mixer, level=0.5)
        >>> print(audit.findings[1])
        A surge command of 1 gives 0.11 of yaw: 0.711 N m at 0.5.
        >>> {n: [round(v, 3) for v in row] for n, row in audit.corrected.factors.items()}
        {'port': [0.94, 0.94], 'starboard': [1.072, -1.072]}
    """
    model = getattr(craft, "model", craft)
    if not isinstance(model, Craft):
        raise InputError(
            f"allocation: expected a craft or a fit of one, found {craft!r:.60}.",
            "Place the thrusters on a body: dft.Craft(dft.bodies.Planar(), ...).",
        )
    _check_names(model, mixer)
    finite("allocation, level", level, lambda x: 0 < x <= 1, "a number above 0, at most 1")
    finite("allocation, full", full, lambda x: x > 0, "a number above zero")
    thrusts = _ThrustMap(model, inputs or {})
    mixer = replace(mixer, factors={name: mixer.factors[name] for name in model.actuators})
    size = level * full
    rows = _moving_rows(model)

    def forces(values: Mapping[str, float]) -> np.ndarray:
        return thrusts.mixed(mixer.matrix, size, values)[0]

    odd, even = thrusts.mixed(mixer.matrix, size)
    errors = _errors(craft, thrusts.parameters, forces)
    most = np.abs(mixer.matrix).max(axis=1)
    # at the largest command of each thruster; at a full one where it is never sent any
    chords = thrusts.chords(size * np.where(most > 0, most, 1.0))
    factors = _corrected(thrusts, mixer, size, rows, odd, chords)
    remaining, _ = thrusts.mixed(factors, size)
    uncorrected = _uncorrected(mixer, factors, (odd, remaining), chords, level)
    as_they_were = [k for k, name in enumerate(mixer.commands) if name in uncorrected]
    factors[:, as_they_were] = mixer.matrix[:, as_they_were]
    remaining[:, as_they_were] = odd[:, as_they_were]
    corrected = Mixer(
        mixer.commands,
        dict(zip(mixer.thrusters, factors.tolist(), strict=True)),
        f"{mixer.source}, corrected at {level:g}",
    )
    return Allocation(
        mixer,
        level,
        full,
        tuple(AXES[k] for k in rows),
        odd[rows],
        even[rows],
        None if errors is None else errors[rows],
        corrected,
        remaining[rows],
        uncorrected,
        chords,
        model,
    )


def _moving_rows(craft: Craft) -> list[int]:
    """The rows of `AXES` in which a craft moves."""
    s = Signals({name: jnp.zeros(()) for name in ("time", *craft.body.states)})
    body = craft.body._bound({n: getattr(craft, n) for n in craft.body._parameters})
    motion = body.motion(s, Ports((), s))
    # what a body does not have is the plain number 0.0
    return [k for k, v in enumerate(motion) if not isinstance(v, float)]


def _check_names(craft: Craft, mixer: Mixer) -> None:
    if not isinstance(mixer, Mixer):
        raise InputError(
            f"allocation: expected a mixer, found {mixer!r:.60}.",
            'Give dft.layouts.ardusub_mixer("vectored"), or dft.layouts.Mixer(("surge", "yaw"), '
            '{"port": (1, 1), "starboard": (1, -1)}).',
        )
    if {*mixer.factors} != {*craft.actuators}:
        raise InputError(
            f"allocation: the mixer sends to {listing(mixer.factors)}, the craft has "
            f"{listing(craft.actuators)}.",
            f"Name the mixer's thrusters in its order: mixer.named({[*craft.actuators]}).",
        )


def _slopes(thrusts: _ThrustMap, commands: np.ndarray, chords: np.ndarray) -> np.ndarray:
    """Slopes of the curves at commands, ``(..., 6, thrusters)``, where they are not too small."""
    around = np.where(np.abs(commands) > 1e-9, commands, 1e-9)
    high, low = thrusts.chords(np.stack([1 + _NEARBY, 1 - _NEARBY])[:, None, None] * around)
    slopes = (high * (1 + _NEARBY) - low * (1 - _NEARBY)) / (2 * _NEARBY)
    # both have the direction of the thruster: their lengths are compared
    lengths = np.linalg.norm(slopes, axis=-2), _LEAST * np.linalg.norm(chords, axis=-2)
    return np.where((lengths[0] > lengths[1])[..., None, :], slopes, _LEAST * chords)


def _corrected(
    thrusts: _ThrustMap,
    mixer: Mixer,
    size: float,
    rows: list[int],
    forces: np.ndarray,
    chords: np.ndarray,
) -> np.ndarray:
    """The factors that lead to the same forces along each axis, and to as little beside it."""
    factors = mixer.matrix.copy()
    used = [k for k in range(len(mixer.commands)) if np.any(factors[:, k])]
    own = [AXES.index(name) for name in mixer.commands]
    commanded = [own[k] for k in used if own[k] in rows]
    others = [k for k in rows if k not in commanded]
    most = np.abs(thrusts.chords(size * np.where(factors.T, factors.T, 1.0))[:, own, :])
    wanted = {}
    for k in used:
        could = float(size * most[k, k] @ np.abs(factors[:, k]))
        if own[k] in rows and abs(forces[own[k], k]) > _NONE * could:
            wanted[k] = abs(forces[own[k], k])
    for _ in range(_ROUNDS):
        now, _ = thrusts.mixed(factors, size)
        slopes = _slopes(thrusts, size * factors.T, chords)
        changes = np.zeros_like(factors)
        for k, force in wanted.items():
            goal = np.zeros(6)
            goal[own[k]] = force
            changes[:, k] = _change(slopes[k], goal - now[:, k], commanded, others) / size
        factors = factors + changes
        if np.abs(changes).max() < _SETTLED * np.abs(factors).max():
            break
    return factors


def _uncorrected(
    mixer: Mixer,
    factors: np.ndarray,
    forces: tuple[np.ndarray, np.ndarray],
    chords: np.ndarray,
    level: float,
) -> dict[str, str]:
    """Commands that no factors correct, and why: by forces as they are, and corrected."""
    takes = max(1.0, float(np.abs(mixer.matrix).max()))
    strengths = np.linalg.norm(chords[:3], axis=0)
    idle = [
        name
        for name, strength in zip(mixer.thrusters, strengths, strict=True)
        if strength < _NOTHING * strengths.max()
    ]
    reasons = {}
    for k, name in enumerate(mixer.commands):
        if np.array_equal(factors[:, k], mixer.matrix[:, k]):
            continue
        row, sent = AXES.index(name), level * np.abs(factors[:, k])
        before, after = abs(forces[0][row, k]), forces[1][row, k]
        unit = "N" if row < 3 else "N m"
        if not sent.max() <= takes * (1 + 1e-6):
            most = mixer.thrusters[int(np.argmax(sent))]
            reasons[name] = (
                f"at {level:g} {most} would be sent {number(sent.max(), 3)}, it takes {takes:g}"
            )
        elif after < _KEPT * before:
            fall = f"it falls from {number(before, 3)} to {number(after, 3)} {unit}"
            gives = "give" if len(idle) > 1 else "gives"
            reasons[name] = f"{fall}, as {joined(idle)} {gives} nothing" if idle else fall
    return reasons


def _change(
    chords: np.ndarray, residual: np.ndarray, commanded: list[int], others: list[int]
) -> np.ndarray:
    """The smallest change of commands that removes residual forces.

    First along the axes that are commanded, then along the others as far as that leaves a choice.
    """
    scale = np.abs(chords).sum(axis=1)
    # N and N m become shares of what the thrusters can do along each axis together
    kept = [k for k in commanded if scale[k] > 0], [k for k in others if scale[k] > 0]
    (a, r), (b, q) = ((chords[k] / scale[k, None], residual[k] / scale[k]) for k in kept)
    inverse = np.linalg.pinv(a, rcond=_DEPENDENT)
    change = inverse @ r
    free = np.eye(len(change)) - inverse @ a
    choice = b @ free
    # the commanded axes may leave no choice: what remains of the others is then rounding
    most = max(np.linalg.norm(choice), 1e-300)
    if most < _DEPENDENT * np.linalg.norm(b):
        return change
    share = _DEPENDENT * np.linalg.norm(b) / most
    return change + free @ np.linalg.pinv(choice, rcond=share) @ (q - b @ change)


def _errors(
    fit: Any, names: tuple[str, ...], forces: Callable[[Mapping[str, float]], np.ndarray]
) -> np.ndarray | None:
    """Standard errors of the forces by the covariance of a fit, to first order; None without."""
    if not hasattr(fit, "covariance"):
        return None
    free = [k for k, name in enumerate(fit.free) if name in names]
    covariance = np.asarray(fit.covariance)[np.ix_(free, free)]
    if not free or not np.all(np.isfinite(covariance)):
        return None
    slopes = []
    for row, k in enumerate(free):
        p = fit.model.parameters[fit.free[k]]
        step = _STEP * float(np.sqrt(covariance[row, row])) or 1e-9
        least, most = p.bounds
        low = p.value - step if least is None else max(p.value - step, least)
        high = p.value + step if most is None else min(p.value + step, most)
        at = [forces({fit.free[k]: value}) for value in (low, high)]
        slopes.append((at[1] - at[0]) / (high - low))
    jacobian = np.stack(slopes, axis=-1)
    variance = np.einsum("acp,pq,acq->ac", jacobian, covariance, jacobian)
    return np.sqrt(np.maximum(variance, 0.0))


class _HeldStill(Body):
    """A body that does not move, and reports the forces on it."""

    name = "held_still"
    outputs: ClassVar[Mapping[str, str]] = {
        **dict.fromkeys(AXES[:3], "N"),
        **dict.fromkeys(AXES[3:], "N m"),
    }

    def motion(self, s: Signals, port: Ports) -> Six:
        """None."""
        return Six()

    def equations(self, s: Signals, port: Ports, water: Six, forces: Six) -> RatesAndOutputs:
        """The forces of all actuators about the origin."""
        return {}, {n: 0.0 * s["time"] + f for n, f in zip(AXES, forces, strict=True)}


class _ThrustMap:
    """What each thruster of a craft does to it where it has settled at a command.

    The craft is held at rest in still water: places, strengths, torques and the effects on the
    thrusters are its own, what acts on its body is left out. ``inputs`` are what the thrusters read
    besides their commands.
    """

    def __init__(self, craft: Craft, inputs: Mapping[str, float]) -> None:
        turning = [n for n, m in craft.actuators.items() if "side_thrust" in m.model.outputs]
        if turning:
            raise InputError(
                f"allocation: {listing(turning)} turn; a mixer's factors are of thrusters that do "
                "not.",
                "Audit the craft with thrusters that point where yours stand.",
            )
        held = Craft(_HeldStill(), share=craft.share, command=craft.command, **craft.actuators)
        placed = tuple(effect for effect in craft.effects if isinstance(effect, Placed))
        self._craft = held._copy(effects=placed)
        self._commands = [f"{n}.{next(iter(m.model.inputs))}" for n, m in craft.actuators.items()]
        needed = {name for effect in placed for name in effect.needs} | {*held.inputs}
        needed -= {*self._commands}
        for name, value in inputs.items():
            if name not in needed:
                raise InputError(
                    f"allocation, inputs: expected what the thrusters read besides their commands "
                    f"({listing(sorted(needed))}), found {name!r}.",
                    "Leave it out: the mixer sends the commands."
                    if name in self._commands
                    else "Correct the name, or leave it out.",
                )
            finite(f"allocation, inputs, {name}", value, lambda _: True, "a finite number")
        missing = sorted(needed - {*inputs})
        if missing:
            raise InputError(
                f"allocation: the thrusters read {listing(missing)}, of which no value is given.",
                f'Give it: inputs={{"{missing[0]}": 16.0}}.',
            )
        self._inputs = {name: float(v) for name, v in inputs.items()}
        self._craft_values = {n: p.value for n, p in craft.parameters.items()}

    @property
    def parameters(self) -> tuple[str, ...]:
        """The parameters of the craft that matter: all but the body's."""
        return (*self._craft.parameters, *(n for n in _CENTRE if n in self._craft_values))

    def __call__(self, commands: np.ndarray, values: Mapping[str, float] = {}) -> np.ndarray:
        """Forces and moments of each thruster about the centre of mass, beyond those at rest.

        Of commands ``(..., thrusters)`` and parameters that are not the craft's own: ``(...,
        thrusters, 6)`` in N and N m, in the order of `AXES`.
        """
        now = {**self._craft_values, **values}
        craft = self._craft.bind({n: now[n] for n in self._craft.parameters})
        count = len(self._commands)
        flat = np.reshape(commands, (-1, count))
        # each thruster by itself, and none: the last row
        alone = np.concatenate([np.diag(row) for row in flat] + [np.zeros((1, count))])
        inputs = {name: alone[:, k] for k, name in enumerate(self._commands)}
        inputs |= {n: np.full(len(alone), v) for n, v in self._inputs.items()}
        forces = steady_outputs(craft, inputs, AXES).T
        forces = (forces[:-1] - forces[-1]).reshape(*np.shape(commands), 6)
        centre = np.array([now.get(n, 0.0) for n in _CENTRE])
        forces[..., 3:] -= np.cross(centre, forces[..., :3])
        return forces

    def mixed(
        self, factors: np.ndarray, size: float, values: Mapping[str, float] = {}
    ) -> tuple[np.ndarray, np.ndarray]:
        """Forces ``(6, commands)``: half the difference of both directions, and what both share."""
        commands = size * factors.T
        ahead, astern = self(np.stack([commands, -commands]), values).sum(axis=2)
        return 0.5 * (ahead - astern).T, 0.5 * (ahead + astern).T

    def chords(self, commands: np.ndarray) -> np.ndarray:
        """Force and moment of each thruster per unit of its command, ``(..., 6, thrusters)``."""
        ahead, astern = self(np.stack([commands, -commands]))
        return np.swapaxes(0.5 * (ahead - astern) / commands[..., None], -1, -2)

"""An audit of allocation: what a mixer does with the thrusters that were identified."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust._support.validation import finite
from diffthrust._support.words import joined, number
from diffthrust.control._allocation_result import Allocation
from diffthrust.control._thrust_map import ThrustMap, moving_axes
from diffthrust.layouts._mixer import AXES, Mixer
from diffthrust.models._craft.craft import Craft

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
    thrusts = ThrustMap(model, inputs or {})
    mixer = replace(mixer, factors={name: mixer.factors[name] for name in model.actuators})
    size = level * full
    rows = [AXES.index(name) for name in moving_axes(model)]

    def forces(values: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray]:
        return _of_mixer(thrusts, mixer.matrix, size, values)

    odd, even = forces({})
    errors = _errors(craft, thrusts.parameters, lambda values: forces(values)[0])
    factors = _corrected(thrusts, mixer, size, rows)
    remaining, _ = _of_mixer(thrusts, factors, size, {})
    chords = _chords(thrusts, _largest(mixer, size))
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


def _of_mixer(
    thrusts: ThrustMap, factors: np.ndarray, size: float, values: Mapping[str, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Forces ``(6, commands)``: half the difference of both directions, and what both share."""
    commands = size * factors.T
    ahead, astern = thrusts(np.stack([commands, -commands]), values).sum(axis=2)
    return 0.5 * (ahead - astern).T, 0.5 * (ahead + astern).T


def _chords(thrusts: ThrustMap, commands: np.ndarray) -> np.ndarray:
    """Force and moment of each thruster per unit of its command, ``(..., 6, thrusters)``."""
    ahead, astern = thrusts(np.stack([commands, -commands]))
    slopes = 0.5 * (ahead - astern) / commands[..., None]
    return np.swapaxes(slopes, -1, -2)


def _largest(mixer: Mixer, size: float) -> np.ndarray:
    """The largest command that the mixer sends to each thruster; a full one where it never does."""
    most = np.abs(mixer.matrix).max(axis=1)
    return size * np.where(most > 0, most, 1.0)


def _slopes(thrusts: ThrustMap, commands: np.ndarray, chords: np.ndarray) -> np.ndarray:
    """Slopes of the curves at commands, ``(..., 6, thrusters)``, where they are not too small."""
    around = np.where(np.abs(commands) > 1e-9, commands, 1e-9)
    high, low = _chords(thrusts, np.stack([1 + _NEARBY, 1 - _NEARBY])[:, None, None] * around)
    slopes = (high * (1 + _NEARBY) - low * (1 - _NEARBY)) / (2 * _NEARBY)
    # both have the direction of the thruster: their lengths are compared
    lengths = np.linalg.norm(slopes, axis=-2), _LEAST * np.linalg.norm(chords, axis=-2)
    return np.where((lengths[0] > lengths[1])[..., None, :], slopes, _LEAST * chords)


def _corrected(thrusts: ThrustMap, mixer: Mixer, size: float, rows: list[int]) -> np.ndarray:
    """The factors that lead to the same force along each axis, and to as little beside it."""
    factors = mixer.matrix.copy()
    used = [k for k in range(len(mixer.commands)) if np.any(factors[:, k])]
    own = [AXES.index(name) for name in mixer.commands]
    commanded = [own[k] for k in used if own[k] in rows]
    others = [k for k in rows if k not in commanded]
    begin, _ = _of_mixer(thrusts, factors, size, {})
    most = np.abs(_chords(thrusts, size * np.where(factors.T, factors.T, 1.0))[:, own, :])
    wanted = {}
    for k in used:
        could = float(size * most[k, k] @ np.abs(factors[:, k]))
        if own[k] in rows and abs(begin[own[k], k]) > _NONE * could:
            wanted[k] = abs(begin[own[k], k])
    chords = _chords(thrusts, _largest(mixer, size))
    for _ in range(_ROUNDS):
        now, _ = _of_mixer(thrusts, factors, size, {})
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

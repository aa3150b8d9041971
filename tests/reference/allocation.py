"""What thrusters do to a craft and what allocators send them, written anew with matrices."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

Array = np.ndarray


def wrench(
    place: Sequence[float],
    pointing: Sequence[float],
    reaction: float = 0.0,
    centre: Sequence[float] = (0.0, 0.0, 0.0),
) -> Array:
    """Force and moment about a centre of a thrust of 1."""
    x, y, z = np.subtract(place, centre)
    d = np.asarray(pointing, float)
    arm = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.concatenate([d, arm @ d + reaction * d])


def px4_allocation(parameters: Mapping[str, float], count: int) -> Array:
    """PX4's mix of all six axes, in the order forces, moments; by its sources as of 2023.

    effectiveness of a rotor: ct axis, and ct (p x axis - km axis); mix: pseudo-inverse by singular
    values; each thrust column over the mean of its entries, roll and pitch over the larger of
    sqrt(2 mean square), yaw over its largest entry.
    """

    def value(k: int, key: str, default: float) -> float:
        return parameters.get(f"CA_ROTOR{k}_{key}", default)

    columns = []
    for k in range(count):
        axis = np.array([value(k, "AX", 0.0), value(k, "AY", 0.0), value(k, "AZ", -1.0)])
        place = [value(k, f"P{x}", 0.0) for x in "XYZ"]
        column = wrench(place, axis / np.sqrt(axis @ axis), -value(k, "KM", 0.05))
        columns.append(value(k, "CT", 6.5) * column)
    u, s, vt = np.linalg.svd(np.stack(columns, axis=1), full_matrices=False)
    mix = vt.T @ np.diag(1.0 / s) @ u.T
    tilt = []
    for k in range(6):
        entries = np.abs(mix[:, k])
        if k < 3:
            mix[:, k] /= entries[entries > 1e-7].mean()
        elif k < 5:
            tilt.append(np.sqrt(2.0 * np.sum(entries**2) / np.sum(entries > 1e-3)))
        else:
            mix[:, k] /= mix[:, k].max()
    mix[:, 3:5] /= max(tilt)
    return np.where(np.abs(mix) < 1e-3, 0.0, mix)


def power_thrust(u: Array, gain: Array, exponent: Array, reverse: Array) -> Array:
    """A power law, weaker astern."""
    thrust = gain * np.sign(u) * np.abs(u) ** exponent
    return np.where(np.asarray(u) < 0, reverse * thrust, thrust)


def mixed_forces(wrenches: Array, laws: tuple[Array, Array, Array], factors: Array, level: float):
    """Half the difference, and the mean, of what commands of a level and its negative lead to.

    Args:
        wrenches: of each thruster per thrust, ``(6, thrusters)``.
        laws: gain, exponent and reverse of each.
        factors: ``(thrusters, commands)``.
        level: of the commands.
    """
    ahead = wrenches @ power_thrust(level * factors, *(law[:, None] for law in laws))
    astern = wrenches @ power_thrust(-level * factors, *(law[:, None] for law in laws))
    return (ahead - astern) / 2, (ahead + astern) / 2

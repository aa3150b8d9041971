"""The surface vessel of Siramdasu and Fahimi 2013 in three degrees of freedom, ratio form.

Equations (6) to (8), every ratio to the propeller constant A, surge u, sway v, yaw rate r:

    m11 u' - m22 v r + d11 u = X
    m22 v' + m11 u r + d22 v = Y
    i33 r' + (m22 - m11) u v + d33 r = N
    north' = u cos psi - v sin psi,  east' = u sin psi + v cos psi,  psi' = r

Convention: sway and the rudder angle a are positive to starboard, yaw rate and heading clockwise
from above. The propeller sits ``lever_arm`` behind the centre of gravity, so X = n^C cos a,
Y = n^C sin a, N = -lever_arm n^C sin a: pushing the stern to starboard turns the bow to port. This
is the sign of the paper's equations (15) and (16); its (3) and (8) have the other.
With twin thrusters X = left + right and N = lever_arm (left - right).
In a current the equations hold for the motion through the water (Fossen 2011, section 8.3).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from .hidden import Chain, Effect
from .integrate import pieces, solve
from .records import Record
from .vessel_hidden import VESSEL

Array = np.ndarray

#: Section 3 of the paper. The lever arm is not printed: a plausible one for a hull of 0.8 m.
SIRAMDASU = {
    "m11": 5.23,
    "m22": 5.93,
    "i33": 1.25,
    "d11": 4.03,
    "d22": 5.48,
    "d33": 1.13,
    "exponent": 0.27,
    "lever_arm": 0.5,
}
STATES = ("surge", "sway", "yaw_rate", "north", "east", "heading")
HINGED = ("propeller_speed", "rudder_angle")
TWIN = ("left_force", "right_force")
WIND = ("wind_speed", "wind_direction")


class Signals:
    """What an effect may look at: the signals of one instant, in SI units (propeller in rev/s)."""

    __slots__ = (
        "heading",
        "lever_arm",
        "propeller_speed",
        "rudder_angle",
        "surge",
        "surge_over_ground",
        "sway",
        "sway_over_ground",
        "thrust",
        "time",
        "wind_direction",
        "wind_speed",
        "yaw_rate",
    )


def simulate(
    time: Array,
    inputs: Mapping[str, Array],
    *,
    parameters: Mapping[str, float] = SIRAMDASU,
    disturbance: Array | None = None,
    initial: Mapping[str, float] | None = None,
    hold: str = "zero",
    method: str = "dop853",
    substeps: int = 4,
    catalogue: Mapping[str, Effect] = VESSEL,
    **hidden: float | Mapping[str, float],
) -> Record:
    """Run the vessel over ``time``.

    Args:
        time: sample instants [s], increasing.
        inputs: ``propeller_speed`` [rev/s] and ``rudder_angle`` [rad], or ``left_force`` and
            ``right_force`` (ratios to A); also ``wind_speed`` [m/s] and ``wind_direction``
            [rad] from which it blows, where measured.
        parameters: the ratios of ``SIRAMDASU``.
        disturbance: gusts at the samples, three columns added to X, Y, N.
        initial: states at the first sample that are not zero; velocities through the water.
        hold: inputs between samples, ``"zero"`` order or ``"linear"``.
        method: ``"dop853"`` or ``"rk4"``.
        substeps: steps of ``"rk4"`` per sample.
        catalogue: the effects that ``hidden`` may name.
        **hidden: sizes of hidden effects: a number for the main parameter, or a mapping.

    Returns:
        A record of the six states, velocities over ground; ``measured`` is without noise.
    """
    time = np.asarray(time, float)
    chain = Chain(catalogue, hidden)
    channels = HINGED if "propeller_speed" in inputs else TWIN
    given = {name: np.asarray(series, float) for name, series in inputs.items()}
    _, applied = chain.apply("inputs", time, given)
    zeros = np.zeros(len(time))
    gusts = np.zeros((len(time), 3)) if disturbance is None else np.asarray(disturbance, float)
    series = [applied[c] for c in channels] + [applied.get(c, zeros) for c in WIND] + list(gusts.T)
    segments = pieces(time, [(time, x) for x in series], hold)
    current_north, current_east = chain.apply("current", 0.0, 0.0)
    m23, d23 = chain.apply("coupling", 0.0, 0.0)
    p = {name: float(value) for name, value in parameters.items()}
    m11, m22, i33 = p["m11"], p["m22"], p["i33"]
    s = Signals()
    s.lever_arm = p["lever_arm"]

    def hinged(n: float, angle: float, owns: Sequence[float], out: list[float]) -> tuple:
        """Force and moment of the propeller on its hinge."""
        s.propeller_speed = n = chain.follow("propeller", n, s, owns, out)
        s.rudder_angle = angle = chain.follow("rudder", angle, s, owns, out)
        force = chain.follow("thrust", math.copysign(abs(n) ** p["exponent"], n), s, owns, out)
        s.thrust = force
        side = chain.follow("side", force * math.sin(angle), s, owns, out)
        return force * math.cos(angle), side, -p["lever_arm"] * side

    def over_ground(x: Sequence[float]) -> tuple[float, float]:
        """Surge and sway over ground from those through the water."""
        c, sn = math.cos(x[5]), math.sin(x[5])
        return (
            x[0] + current_north * c + current_east * sn,
            x[1] - current_north * sn + current_east * c,
        )

    def rates(t: float, x: Sequence[float], u: Sequence[float], direction: int) -> list[float]:
        surge, sway, yaw, heading, owns = x[0], x[1], x[2], x[5], x[6:]
        s.time, s.surge, s.sway, s.yaw_rate, s.heading = t, surge, sway, yaw, heading
        s.surge_over_ground, s.sway_over_ground = over_ground(x)
        s.wind_speed, s.wind_direction = u[2], u[3]
        out = [0.0] * chain.states
        if channels is HINGED:
            forces = hinged(u[0], u[1], owns, out)
        else:
            forces = (u[0] + u[1], 0.0, p["lever_arm"] * (u[0] - u[1]))
        along, aside, turn = chain.follow("hull", forces, s, owns, out)
        along += m22 * sway * yaw + m23 * yaw * yaw - p["d11"] * surge + u[4]
        aside -= m11 * surge * yaw + p["d22"] * sway + d23 * yaw - u[5]
        turn -= (m22 - m11) * surge * sway + m23 * surge * yaw
        turn -= p["d33"] * yaw + d23 * sway - u[6]
        if m23:
            whole = m22 * i33 - m23 * m23
            swaying, yawing = (i33 * aside - m23 * turn) / whole, (m22 * turn - m23 * aside) / whole
        else:
            swaying, yawing = aside / m22, turn / i33
        c, sn = math.cos(heading), math.sin(heading)
        return [
            along / m11,
            swaying,
            yawing,
            surge * c - sway * sn + current_north,
            surge * sn + sway * c + current_east,
            yaw,
            *out,
        ]

    start = [float((initial or {}).get(name, 0.0)) for name in STATES] + [0.0] * chain.states
    states = solve(rates, segments, time, start, method=method, substeps=substeps)
    truth: dict[str, Array] = dict(zip(STATES, states[:, :6].T.copy(), strict=True))
    truth["surge"], truth["sway"] = np.array([over_ground(x) for x in states.tolist()]).T
    return Record(time, given, dict(truth), truth, {**p, **chain.sizes})

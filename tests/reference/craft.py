"""Crafts by matrices: M v' + C(v) v + D(v) v + g = B u, integrated by DOP853.

Fossen 2021: M = H' diag(m) H with H the shift to the centre of mass (appendix A), C(v) from M by
equation 3.46, weight and buoyancy by 4.6, attitude as a rotation matrix (2.16, R' = R S(omega)).
A body of fewer degrees of freedom has the rows and columns that it moves in.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from .integrate import pieces, solve

Array = np.ndarray
AXES = ("surge", "sway", "heave", "roll_rate", "pitch_rate", "yaw_rate")


def skew(a: Sequence[float]) -> Array:
    """S(a), with S(a) b = a x b."""
    x, y, z = a
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def shift(place: Sequence[float]) -> Array:
    """H(r): velocities at a place from those at the origin."""
    h = np.eye(6)
    h[:3, 3:] = skew(place).T
    return h


def coriolis(m: Array, v: Array) -> Array:
    """C(v) of a mass matrix; Fossen 2021, equation 3.46."""
    a = m[:3, :3] @ v[:3] + m[:3, 3:] @ v[3:]
    b = m[3:, :3] @ v[:3] + m[3:, 3:] @ v[3:]
    c = np.zeros((6, 6))
    c[:3, 3:] = c[3:, :3] = -skew(a)
    c[3:, 3:] = -skew(b)
    return c


@dataclass(frozen=True)
class Actuator:
    """An actuator: its own states, and the force along its axis and to the right of it.

    Attributes:
        place: where it acts [m].
        pointing: where a positive force pushes.
        rates: rates of its states from states and inputs.
        force: along and aside, from states, inputs and the water past it.
        start: its states at the start.
        reaction: torque about the axis per force along it [m].
    """

    place: tuple[float, float, float]
    force: Callable[[Sequence[float], Sequence[float], float], tuple[float, float]]
    pointing: tuple[float, float, float] = (1.0, 0.0, 0.0)
    rates: Callable[[Sequence[float], Sequence[float]], list[float]] = lambda x, u: []
    start: tuple[float, ...] = ()
    reaction: float = 0.0
    columns: tuple[Array, Array, Array] = field(init=False)

    def __post_init__(self) -> None:
        d, r = np.array(self.pointing), np.array(self.place)
        aside = np.cross([0.0, 0.0, 1.0], d)
        columns = [np.concatenate([f, np.cross(r, f)]) for f in (d, aside)]
        torque = np.concatenate([np.zeros(3), self.reaction * d])
        object.__setattr__(self, "columns", (columns[0], columns[1], torque))

    def wrench(self, x: Sequence[float], u: Sequence[float], v: Array) -> Array:
        """Force and moment on the craft about its origin."""
        ahead, right, torque = self.columns  # by the first the water past it is seen as well
        along, aside = self.force(x, u, float(ahead @ v))
        return along * (ahead + torque) + aside * right


@dataclass(frozen=True)
class Body:
    """A rigid body in the water.

    Attributes:
        masses: the diagonal about the centre of mass, added masses included.
        centre: of mass.
        linear, quadratic: damping for each axis, at ``resistance`` in sway.
        weight, buoyancy: [N]; ``lift`` is where the second acts.
        free: the axes in which it moves.
    """

    masses: Sequence[float]
    linear: Sequence[float] = (0.0,) * 6
    quadratic: Sequence[float] = (0.0,) * 6
    centre: Sequence[float] = (0.0, 0.0, 0.0)
    resistance: Sequence[float] = (0.0, 0.0, 0.0)
    weight: float = 0.0
    buoyancy: float = 0.0
    lift: Sequence[float] = (0.0, 0.0, 0.0)
    free: Sequence[int] = (0, 1, 2, 3, 4, 5)
    mass_matrix: Array = field(init=False)
    mobility: Array = field(init=False)
    shifts: tuple[Array, Array, Array] = field(init=False)

    def __post_init__(self) -> None:
        h = shift(self.centre)
        object.__setattr__(self, "mass_matrix", h.T @ np.diag(self.masses) @ h)
        at, mobility = np.ix_(self.free, self.free), np.zeros((6, 6))
        mobility[at] = np.linalg.inv(self.mass_matrix[at])
        object.__setattr__(self, "mobility", mobility)
        shifts = tuple(shift(place) for place in (self.resistance, self.centre, self.lift))
        object.__setattr__(self, "shifts", shifts)

    def acceleration(self, v: Array, rotation: Array, applied: Array) -> Array:
        """v' of the free axes, zero for the others."""
        h, centre, lift = self.shifts
        at = h @ v
        damping = h.T @ ((np.array(self.linear) + np.array(self.quadratic) * np.abs(at)) * at)
        down = rotation.T @ [0.0, 0.0, 1.0]
        applied = applied + (self.weight * centre - self.buoyancy * lift)[:3].T @ down
        return self.mobility @ (applied - coriolis(self.mass_matrix, v) @ v - damping)


def simulate(
    time: Array,
    body: Body,
    actuators: Sequence[Actuator],
    commands: Sequence[Sequence[Array]],
    *,
    velocity: Sequence[float] = (0.0,) * 6,
    angles: Sequence[float] = (0.0, 0.0, 0.0),
) -> dict[str, Array]:
    """Run a craft; ``commands`` has the inputs of each actuator, held over a sample.

    Returns:
        The six velocities, north, east, depth, roll, pitch, heading, and the actuators' states
        as ``(k, number)``.
    """
    counts = [len(inputs) for inputs in commands]
    flat = [(time, np.asarray(series, float)) for inputs in commands for series in inputs]
    flat = flat or [(time, np.zeros(len(time)))]

    def rates(t: float, x: Sequence[float], u: Sequence[float], direction: int) -> list[float]:
        v, rotation = np.array(x[:6]), np.array(x[9:18]).reshape(3, 3)
        applied, own, at, first = np.zeros(6), [], 18, 0
        for actuator, count in zip(actuators, counts, strict=True):
            state, inputs = x[at : at + len(actuator.start)], u[first : first + count]
            applied = applied + actuator.wrench(state, inputs, v)
            own += actuator.rates(state, inputs)
            at, first = at + len(actuator.start), first + count
        acceleration = body.acceleration(v, rotation, applied)
        turning = (rotation @ skew(v[3:])).ravel()
        return [*acceleration, *(rotation @ v[:3]), *turning, *own]

    start = [*velocity, 0.0, 0.0, 0.0, *rotation_of(*angles).ravel()]
    start += [value for actuator in actuators for value in actuator.start]
    states = solve(rates, pieces(time, flat, "zero"), time, start)
    out = {name: states[:, k] for k, name in enumerate((*AXES, "north", "east", "depth"))}
    r = states[:, 9:18].reshape(-1, 3, 3)
    out["roll"] = np.arctan2(r[:, 2, 1], r[:, 2, 2])
    out["pitch"] = -np.arcsin(r[:, 2, 0])
    out["heading"] = np.unwrap(np.arctan2(r[:, 1, 0], r[:, 0, 0]))
    at = 18
    for k, actuator in enumerate(actuators):
        for i in range(len(actuator.start)):
            out[f"({k}, {i})"] = states[:, at + i]
        at += len(actuator.start)
    inputs = [[series[k] for _, series in flat] for k in range(len(time))]
    slopes = [rates(t, x, u, 1) for t, x, u in zip(time, states, inputs, strict=True)]
    out |= {f"{name}'": np.array(slopes)[:, k] for k, name in enumerate(AXES)}
    return out


# -- sensors, with rotation matrices, from a run ---------------------------------------------------


def _moved(run: Mapping[str, Array], place: Sequence[float]) -> tuple[Array, ...]:
    """Rotation matrix, velocity of the place and angular velocity at each sample."""
    angles = zip(run["roll"], run["pitch"], run["heading"], strict=True)
    rotation = np.array([rotation_of(*each) for each in angles])
    v = np.stack([run[name] for name in AXES], axis=1)
    return rotation, v[:, :3] + np.cross(v[:, 3:], place), v[:, 3:]


def dvl(run: Mapping[str, Array], place: Sequence[float]) -> Array:
    """The velocity of a place along forward, starboard, down, ``(n, 3)``."""
    return _moved(run, place)[1]


def accelerometer(run: Mapping[str, Array], place: Sequence[float]) -> Array:
    """The specific force at a place: dv/dt + w x v + dw/dt x r + w x (w x r) - R' g."""
    rotation, _, w = _moved(run, place)
    a = np.stack([run[f"{name}'"] for name in AXES], axis=1)
    v = np.stack([run[name] for name in AXES[:3]], axis=1)
    inertial = a[:, :3] + np.cross(w, v) + np.cross(a[:, 3:], place)
    inertial = inertial + np.cross(w, np.cross(w, place))
    return inertial - np.einsum("nji,j->ni", rotation, [0.0, 0.0, 9.80665])


def antenna(run: Mapping[str, Array], place: Sequence[float]) -> tuple[Array, Array]:
    """Position and velocity of a place to the north, to the east and down, ``(n, 3)`` each."""
    rotation, v, _ = _moved(run, place)
    origin = np.stack([run[name] for name in ("north", "east", "depth")], axis=1)
    return origin + rotation @ np.array(place), np.einsum("nij,nj->ni", rotation, v)


def rotation_of(roll: float, pitch: float, heading: float) -> Array:
    """From the body's axes to north, east, down; Fossen 2021, equation 2.31."""
    (cr, sr), (cp, sp), (ch, sh) = ((math.cos(a), math.sin(a)) for a in (roll, pitch, heading))
    x = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    y = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    z = np.array([[ch, -sh, 0.0], [sh, ch, 0.0], [0.0, 0.0, 1.0]])
    return z @ y @ x


# -- actuators, as in the papers -----------------------------------------------------------------


def torque_driven(p: Mapping[str, float], place: Sequence[float], **more) -> Actuator:
    """Yoerger, Cooke & Slotine 1990, section II C."""
    return Actuator(
        tuple(place),
        lambda x, u, flow: (p["ct"] * x[0] * abs(x[0]), 0.0),
        rates=lambda x, u: [p["beta"] * u[0] - p["alpha"] * x[0] * abs(x[0])],
        start=(0.0,),
        **more,
    )


def static(p: Mapping[str, float], place: Sequence[float], **more) -> Actuator:
    """A curve, weaker in reverse."""

    def force(x: Sequence[float], u: Sequence[float], flow: float) -> tuple[float, float]:
        size = p["gain"] * abs(u[0]) ** p["exponent"]
        return (size if u[0] >= 0 else -p["reverse"] * size), 0.0

    return Actuator(tuple(place), force, **more)


def azimuth(p: Mapping[str, float], place: Sequence[float], first: float, **more) -> Actuator:
    """A static curve on an axis that turns to an angle with a lag, the short way."""

    def turn(x: Sequence[float], u: Sequence[float]) -> list[float]:
        away = (u[1] - x[0] + math.pi) % (2.0 * math.pi) - math.pi
        return [away / p["slew_time"]]

    def force(x: Sequence[float], u: Sequence[float], flow: float) -> tuple[float, float]:
        size = p["gain"] * math.copysign(abs(u[0]) ** p["exponent"], u[0])
        return size * math.cos(x[0]), size * math.sin(x[0])

    return Actuator(tuple(place), force, rates=turn, start=(first,), **more)


def rudder(p: Mapping[str, float], place: Sequence[float], **more) -> Actuator:
    """A rudder in the race of a static propeller."""

    def force(x: Sequence[float], u: Sequence[float], flow: float) -> tuple[float, float]:
        thrust = p["gain"] * math.copysign(abs(u[0]) ** p["exponent"], u[0])
        lift = p["race"] * max(thrust, 0.0) + p["free_stream"] * flow * abs(flow)
        normal = lift * math.sin(u[1])
        return thrust - normal * math.sin(u[1]), normal * math.cos(u[1])

    return Actuator(tuple(place), force, **more)


def hinged(p: Mapping[str, float], place: Sequence[float], **more) -> Actuator:
    """Siramdasu & Fahimi 2013, equations (1) to (5)."""

    def force(x: Sequence[float], u: Sequence[float], flow: float) -> tuple[float, float]:
        size = p["gain"] * math.copysign(abs(u[0]) ** p["exponent"], u[0])
        return size * math.cos(u[1]), size * math.sin(u[1])

    return Actuator(tuple(place), force, **more)

"""The torque-driven thruster of Yoerger, Cooke and Slotine 1990, with hidden effects.

Section II C of the paper:

    dW/dt = beta c - alpha W|W|,    T = ct W|W|

W propeller speed [rad/s], c command [V], T thrust [N].
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from .hidden import THRUSTER, Chain, Effect
from .integrate import Rotor, pieces, solve, stops
from .records import Record

Array = np.ndarray

#: The Jason thruster: dynamic test, figure 10; ct between the two reported values.
JASON = {"alpha": 0.037, "beta": 42.0, "ct": 0.020}


class Signals:
    """What an effect may look at: the signals of one instant, in SI units."""

    __slots__ = ("command", "direction", "inflow", "speed", "supply_voltage", "time")


def simulate(
    time: Array,
    command: Array,
    *,
    alpha: float = JASON["alpha"],
    beta: float = JASON["beta"],
    ct: float = JASON["ct"],
    inflow: Array | None = None,
    supply_voltage: Array | None = None,
    disturbance: Array | None = None,
    initial_speed: float = 0.0,
    hold: str = "zero",
    method: str = "dop853",
    substeps: int = 8,
    catalogue: Mapping[str, Effect] = THRUSTER,
    **hidden: float | Mapping[str, float],
) -> Record:
    """Run the thruster over ``time``.

    Args:
        time: sample instants [s], increasing.
        command: command at the samples [V].
        alpha: load coefficient [1/rad].
        beta: drive coefficient [1/(V s^2)].
        ct: thrust coefficient [N s^2/rad^2].
        inflow: water speed at the propeller at the samples [m/s], measured.
        supply_voltage: supply at the samples [V], measured.
        disturbance: turbulent torque at the samples, as shaft acceleration [rad/s^2].
        initial_speed: speed at the first sample [rad/s].
        hold: inputs between samples, ``"zero"`` order or ``"linear"``.
        method: ``"dop853"`` (errors near 1e-9 of the speed) or ``"rk4"`` (quick, see tests).
        substeps: steps of ``"rk4"`` per sample.
        catalogue: the effects that ``hidden`` may name.
        **hidden: sizes of hidden effects: a number for the main parameter, or a mapping.

    Returns:
        A record with ``speed`` and ``thrust``, as they are (``truth``) and as perfect sensors
        with the hidden sensor effects report them (``measured``).
    """
    alpha, beta, ct = float(alpha), float(beta), float(ct)
    time = np.asarray(time, float)
    chain = Chain(catalogue, hidden)
    schedule_time, schedule = chain.apply("schedule", time, np.asarray(command, float))
    seen = {name: chain.apply(f"{name}_time", time) for name in ("speed", "thrust")}
    at = stops(time, schedule_time, *seen.values())
    zeros = np.zeros(len(time))
    inflow_series = zeros if inflow is None else np.asarray(inflow, float)
    supply_series = zeros if supply_voltage is None else np.asarray(supply_voltage, float)
    extra = zeros if disturbance is None else np.asarray(disturbance, float)
    segments = pieces(
        at,
        [(schedule_time, schedule), (time, inflow_series), (time, supply_series), (time, extra)],
        hold,
    )
    level, breakaway = chain.apply("friction", 0.0, 0.0)
    s = Signals()

    def shaft(u: Sequence[float], owns: Sequence[float], rates: list[float]) -> float:
        """Acceleration without dry friction, from the signals already set."""
        s.command, s.inflow, s.supply_voltage = u[0], u[1], u[2]
        drive = beta * chain.follow("command", u[0], s, owns, rates)
        drive = chain.follow("drive", drive, s, owns, rates)
        load = chain.follow("load", alpha * s.speed * abs(s.speed), s, owns, rates)
        return chain.follow("shaft", drive - load, s, owns, rates) + u[3]

    def readings(owns: Sequence[float], rates: list[float]) -> tuple[float, float, float]:
        """Thrust, and what the two sensors say."""
        thrust = chain.follow("thrust", ct * s.speed * abs(s.speed), s, owns, rates)
        return (
            thrust,
            chain.follow("speed_sensor", s.speed, s, owns, rates),
            chain.follow("thrust_sensor", thrust, s, owns, rates),
        )

    def rates(t: float, x: Sequence[float], u: Sequence[float], direction: int) -> list[float]:
        s.time, s.speed, s.direction = t, x[0], direction
        out = [0.0] * chain.states
        acceleration = shaft(u, x[1:], out) - level * direction
        if chain.states:
            readings(x[1:], out)
        return [acceleration if direction else 0.0, *out]

    def push(t: float, x: Sequence[float], u: Sequence[float]) -> float:
        s.time, s.speed, s.direction = t, 0.0, 0
        return shaft(u, x[1:], [0.0] * chain.states)

    states = solve(
        rates,
        segments,
        at,
        [initial_speed] + [0.0] * chain.states,
        rotor=Rotor(0, push, breakaway),
        method=method,
        substeps=substeps,
    )

    # The instant belongs to the interval that it begins; the last one to the interval before.
    rows = []
    for k, t in enumerate(at.tolist()):
        x = states[k].tolist()
        s.time, s.speed, s.direction = t, x[0], int(np.sign(x[0]))
        scratch = [0.0] * chain.states
        shaft(segments[min(k, len(segments) - 1)](t), x[1:], scratch)
        rows.append((x[0], *readings(x[1:], scratch)))
    speed, thrust, speed_reading, thrust_reading = np.array(rows).T

    def sampled(series: Array, instants: Array) -> Array:
        """Values at stops, exact there; before the first the first."""
        return np.interp(instants, at, series)

    inputs = {"command": np.asarray(command, float)}
    inputs |= {} if inflow is None else {"inflow": inflow_series}
    inputs |= {} if supply_voltage is None else {"supply_voltage": supply_series}
    return Record(
        time=time,
        inputs=inputs,
        measured={
            "speed": sampled(speed_reading, seen["speed"]),
            "thrust": sampled(thrust_reading, seen["thrust"]),
        },
        truth={"speed": sampled(speed, time), "thrust": sampled(thrust, time)},
        parameters={"alpha": alpha, "beta": beta, "ct": ct, **chain.sizes},
    )


def exact_spin(
    t: Array, command: float, initial_speed: float, alpha: float, beta: float
) -> tuple[Array, Array]:
    """Speed under a constant command, in closed form (the Riccati equation of section II C).

    With q = sqrt(beta |c| / alpha) and k = alpha q, in the direction of the command: tan while
    the speed is against the command, tanh or coth afterwards.

    Returns:
        Speed at ``t``, and whether the shaft has already turned round.
    """
    side = 1.0 if command > 0.0 else -1.0
    q = np.sqrt(beta * abs(command) / alpha)
    k, w = alpha * q, side * initial_speed
    t = np.asarray(t, float)
    at_rest = max(-np.arctan(w / q), 0.0) / k
    before = q * np.tan(np.minimum(k * t + np.arctan(w / q), 0.0)) if w < 0.0 else 0.0 * t
    after = k * np.maximum(t - at_rest, 0.0)
    ratio = max(w, 0.0) / q
    forward = q * (ratio + np.tanh(after)) / (1.0 + ratio * np.tanh(after))
    return side * np.where(t < at_rest, before, forward), t >= at_rest

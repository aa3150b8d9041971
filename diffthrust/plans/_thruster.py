"""Plans for thrusters: the static tests, the dynamic test, and steps of a speed loop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.validation import finite
from diffthrust.control import Loop, Step
from diffthrust.logs._log import Log
from diffthrust.models import DCMotorThruster
from diffthrust.models._base.model import Model
from diffthrust.papers._commands import lowpass_noise, staircase
from diffthrust.papers.aras import steady_map as aras_map
from diffthrust.plans._plan import Plan
from diffthrust.plans._settling import MAX_REST, checked_limits, settling_time, time_to_rest

_OUTPUTS = ("speed", "thrust")
_SOURCE = "Yoerger, Cooke & Slotine 1990, section III"
_REACHED = 0.01
"""Share by which a steady speed may differ from the wanted one."""


def static_test(
    model: Model,
    limits: tuple[float, float],
    *,
    levels: int = 8,
    hold: float = 5.0,
    step: float = 0.05,
    settle: float | None = None,
) -> Plan:
    """Levels held until speed and thrust have settled, and ``hold`` seconds more.

    On each side of zero that the limits allow, ``levels`` are evenly spaced up to the limit, the
    largest last, followed by zero. The smallest level settles most slowly, and sets the time.

    Args:
        model: a thruster, as it is believed to be.
        limits: lowest and highest command, in the model's unit.
        levels: how many on each side.
        hold: how long to measure at each [s].
        step: time between samples [s].
        settle: how long to wait at each [s]; by the model where not given.

    Raises:
        InputError: a model without a command, limits without a range, a model that does not settle.

    Source: Yoerger, Cooke & Slotine 1990, section III.

    Example:
        >>> plan = dft.plans.static_test(dft.Thruster(), limits=(-5, 5))
        >>> len(plan.levels)
        18
    """
    check_thruster("static_test", model)
    ends, count = _sides("static_test", limits, levels, 2, hold)
    return _held("static_test", _SOURCE, model, _steps(ends, count), hold, step, settle)


def dynamic_test(
    model: Model,
    limits: tuple[float, float],
    *,
    duration: float = 60.0,
    cutoff: float = 1.0,
    step: float = 0.02,
    seed: int = 0,
) -> Plan:
    """Noise through a low-pass, about the middle of the limits and up to them.

    Args:
        model: a thruster.
        limits: lowest and highest command, in the model's unit.
        duration: [s].
        cutoff: of the low-pass [Hz].
        step: time between samples [s].
        seed: of the noise.

    Raises:
        InputError: a model without a command, limits without a range, a cut-off beyond half the
            sample rate.

    Source: Yoerger, Cooke & Slotine 1990, section III.

    Example:
        >>> plan = dft.plans.dynamic_test(dft.Thruster(), limits=(-5, 5), duration=20.0)
        >>> [path.name for path in plan.save("plans")]
        ['dynamic_test.csv']
    """
    check_thruster("dynamic_test", model)
    low, high = checked_limits("dynamic_test", limits)
    time, noise = lowpass_noise(duration, step, 0.5 * (high - low), cutoff=cutoff, seed=seed)
    return Plan(
        name="dynamic_test",
        source=_SOURCE,
        runs={"dynamic_test": planned_run(model, time, 0.5 * (low + high) + noise)},
        settle=duration,  # nothing is held
        measure=_OUTPUTS,
        band=(min(5.0 / duration, 0.5 * cutoff), cutoff),
    )


def steady_map(
    model: DCMotorThruster,
    limits: tuple[float, float],
    *,
    levels: int = 8,
    hold: float = 5.0,
    step: float = 0.02,
    settle: float | None = None,
) -> Plan:
    """The static map V(T) on a bollard: voltages for evenly spaced thrusts, each held.

    On each side of zero that the limits allow, the voltages are those for which the model's steady
    thrust rises in even steps up to that of the limit; even voltages would crowd the points where
    the thrust is small. Zero is held behind them.

    Args:
        model: the thruster as it is believed to be, without effects.
        limits: lowest and highest voltage.
        levels: how many on each side.
        hold: how long to measure at each [s].
        step: time between samples [s].
        settle: how long to wait at each [s]; by the model where not given.

    Raises:
        InputError: another model, limits without a range, a limit at which the motor does not
            overcome its friction, a model that does not settle.

    Source: Aras et al. 2013, section 2.2 and equation 7.

    Example:
        >>> motor = dft.papers.aras.thruster(load=dft.papers.aras.load_from(280.4))
        >>> plan = dft.plans.steady_map(motor, limits=(-13, 13))
        >>> len(plan.levels)
        18
    """
    check_thruster("steady_map", model)
    ends, count = _sides("steady_map", limits, levels, 2, hold)
    # Even steps of thrust, not of voltage: thrust grows with the square of the voltage, so even
    # voltages would crowd the points where it is small.
    heights: list[float] = []
    for end in ends:
        thrust = np.linspace(0.0, _thrust_at(model, abs(end)), count + 1)[1:]
        heights += [*(np.sign(end) * aras_map(model, thrust).own), 0.0]
    plan = _held("steady_map", "Aras et al. 2013, section 2.2", model, heights, hold, step, settle)
    return replace(plan, note="On a bollard: the vessel held, the water at rest before each level.")


def _thrust_at(model: DCMotorThruster, voltage: float) -> float:
    """Steady thrust of a voltage above zero, by the map's inverse [N]."""
    from scipy.optimize import root_scalar  # takes a while

    def beyond(thrust: float) -> float:
        return float(aras_map(model, [thrust]).own[0]) - voltage

    small, top = 1e-9, 1.0
    if beyond(small) >= 0.0:
        raise InputError(
            f"steady_map, limits: at {voltage:g} V the motor does not overcome its friction.",
            "Widen the limits.",
        )
    while beyond(top) < 0.0:
        top *= 2.0
    return float(root_scalar(beyond, bracket=(small, top), xtol=1e-12).root)


def speed_steps(
    loop: Loop,
    limits: tuple[float, float],
    *,
    levels: int = 3,
    hold: float = 2.0,
    step: float = 0.01,
    settle: float | None = None,
) -> Plan:
    """Wanted speeds of a speed loop, each held until the loop has come to rest.

    On each side of zero that the limits allow: up to the limit in even steps, and from there to
    zero in one step. The loop is simulated from rest to the smallest and to the largest speed, to
    find how long it takes, and whether the motor reaches them.

    Args:
        loop: a thruster with its speed controller.
        limits: lowest and highest wanted speed [rad/s].
        levels: steps on each side.
        hold: time to measure at each speed [s].
        step: time between samples [s].
        settle: time to wait at each speed [s]; by default from the simulation.

    Raises:
        InputError: a loop that does not control a speed, limits without a range, a speed that the
            loop does not reach.

    Source: Aras et al. 2013, section 3.1 and figures 11 and 17.

    Example:
        >>> plan = dft.plans.speed_steps(dft.papers.aras.speed_loop(), limits=(0, 180))
        >>> list(plan.runs)
        ['speed_steps']
    """
    if not isinstance(loop, Loop) or loop.vehicle is not None:
        raise InputError(
            f"speed_steps: expected a loop of a thruster's speed, found {loop!r}.",
            "Give a dft.control.Loop without a vehicle, such as dft.papers.aras.speed_loop().",
        )
    ends, count = _sides("speed_steps", limits, levels, 1, hold, "speed")
    # The smallest step is the slowest because of quadratic drag, the largest may saturate the
    # motor.
    times = [_rests(loop, x) for end in ends for x in {end / count, end}]
    settle = max(times) if settle is None else settle
    time, wanted = staircase(_steps(ends, count), settle + hold, step)
    return Plan(
        name="speed_steps",
        source="Aras et al. 2013, section 3.1",
        runs={"speed_steps": Log(time, {"reference": wanted}, units={"reference": "rad/s"})},
        settle=settle,
        measure=("speed",),
        note="Record the command too: it shows whether the voltage was at its limit.",
    )


def _rests(loop: Loop, speed: float) -> float:
    """Settling time of the loop at a wanted speed [s]."""

    def simulated(span: float) -> tuple[np.ndarray, ...]:
        run = loop.simulate(Step(speed), span)
        return run.time, run["speed"]

    rested = time_to_rest(simulated, 1.0)
    if rested is None:
        raise InputError(
            f"speed_steps: the loop does not come to rest at {speed:.4g} rad/s within "
            f"{MAX_REST:g} s.",
            "Look at the gains, or narrow the limits.",
        )
    settling, (final,) = rested
    if abs(final - speed) > _REACHED * abs(speed):
        raise InputError(
            f"speed_steps: for {speed:.4g} rad/s the loop comes to rest at {final:.4g} rad/s.",
            "Narrow the limits, or look at the controller's integral and its limit.",
        )
    return settling


def _sides(
    who: str, limits: Any, levels: Any, least: int, hold: Any, what: str = "command"
) -> tuple[list[float], int]:
    """The limits on either side of zero, as far as they allow it, and the number of levels."""
    low, high = checked_limits(who, limits, what)
    finite(f"{who}, hold", hold, lambda x: x > 0, "seconds, above zero")
    count = finite(f"{who}, levels", levels, lambda x: x >= least, f"{least} or more")
    return [end for end in (max(high, 0.0), min(low, 0.0)) if end], int(count)


def _steps(ends: Sequence[float], count: int) -> list[float]:
    """Even steps up to the limit on each side of zero, followed by zero."""
    return [x for end in ends for x in (*np.linspace(0.0, end, count + 1)[1:], 0.0)]


def _held(
    name: str,
    source: str,
    model: Model,
    heights: Sequence[float],
    hold: float,
    step: float,
    settle: float | None,
) -> Plan:
    """A staircase of commands; the smallest settles most slowly, and sets the time of each."""
    # With quadratic drag the time constant grows as 1 / speed.
    if settle is None:
        smallest = min(abs(x) for x in heights if x)
        settle = settling_time(model, thruster_outputs(model), {"command": smallest})
    runs = {name: planned_run(model, *staircase(heights, settle + hold, step))}
    return Plan(name, source, runs, settle, _OUTPUTS)


def thruster_outputs(model: Model) -> list[str]:
    """Speed and thrust, as far as the model has them."""
    return [name for name in _OUTPUTS if name in model.outputs]


def planned_run(model: Model, time: np.ndarray, command: np.ndarray) -> Log:
    """A run of commands, as a log without measurements."""
    return Log(time, {"command": command}, units={"command": model.inputs["command"]})


def check_thruster(who: str, model: Any) -> None:
    """Raise `InputError` for what is no thruster."""
    if not isinstance(model, Model) or "command" not in model.inputs:
        raise InputError(
            f"{who}: expected a thruster with the input 'command', found {model!s}.",
            "Give a model such as dft.Thruster().",
        )

"""The plan for steps of a speed loop."""

from __future__ import annotations

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.validation import finite
from diffthrust.control import Loop, Step
from diffthrust.logs._log import Log
from diffthrust.papers._commands import staircase
from diffthrust.plans._checks import MAX_REST, checked_limits, settled
from diffthrust.plans._plan import Plan

_REACHED = 0.01
"""Share by which a steady speed may differ from the wanted one."""


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
    low, high = checked_limits("speed_steps", limits, "speed")
    finite("speed_steps, hold", hold, lambda x: x > 0, "seconds, above zero")
    count = int(finite("speed_steps, levels", levels, lambda x: x >= 1, "1 or more"))
    ends = [end for end in (max(high, 0.0), min(low, 0.0)) if end]
    heights = [x for end in ends for x in (*np.linspace(0.0, end, count + 1)[1:], 0.0)]
    # The smallest step is the slowest because of quadratic drag, the largest may saturate the
    # motor.
    times = [_rests(loop, x) for end in ends for x in {end / count, end}]
    settle = max(times) if settle is None else settle
    time, wanted = staircase(heights, settle + hold, step)
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
    span = 1.0
    while span <= MAX_REST:
        run = loop.simulate(Step(speed), span)
        settling = settled(run.time, run["speed"])
        if settling < 0.5 * span:
            if abs(run["speed"][-1] - speed) > _REACHED * abs(speed):
                raise InputError(
                    f"speed_steps: for {speed:.4g} rad/s the loop comes to rest at "
                    f"{run['speed'][-1]:.4g} rad/s.",
                    "Narrow the limits, or look at the controller's integral and its limit.",
                )
            return settling
        span *= 2.0
    raise InputError(
        f"speed_steps: the loop does not come to rest at {speed:.4g} rad/s within {MAX_REST:g} s.",
        "Look at the gains, or narrow the limits.",
    )

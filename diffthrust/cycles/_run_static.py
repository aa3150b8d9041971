"""Full simulation of a loop with a static element, near a cycle or from anywhere.

The linear part takes exact steps for an input that is straight within the step; where the element
jumps within a step, the line with the same mean and first moment stands for it, so that switching
instants are not rounded to the grid. A dead time is a whole number of steps.
"""

from __future__ import annotations

import math
from collections import deque
from itertools import pairwise
from typing import Any, Protocol

import numpy as np

from diffthrust._support.transfer import Transfer
from diffthrust.cycles._oscillation import CycleSeries, LoopCourse

STEPS_A_PERIOD = 256
"""Steps per period."""
BEYOND = 1e3
"""A course is followed until it is this many times as large as the cycle."""


class StepElement(Protocol):
    """What the simulation asks of an element: see `Static`."""

    def rest(self, e: float) -> Any: ...

    def passage(self, before: float, after: float, memory: Any) -> tuple[float, float, Any]: ...


def simulated(
    transfer: Transfer, element: StepElement, cycle: CycleSeries, factor: float, periods: float
) -> LoopCourse:
    """Simulate from a start on a cycle, made larger or smaller, the dead time's content included.

    The linear part must not pass its input at once.
    """
    period = cycle.oscillation.period
    wait = period / STEPS_A_PERIOD
    if periods <= 32:  # after a slow cycle the loop may oscillate at a faster pole
        fast = 2.0 * math.pi / transfer.corners[-1] / 64
        wait = max(min(wait, fast), 0.25 * wait)
    # the step is shortened so that the dead time is a whole number of steps: no interpolation of
    # jumps
    lagging = math.ceil(transfer.delay / wait) if transfer.delay else 0
    step = transfer.delay / lagging if lagging else wait
    earlier = step * np.arange(-max(math.ceil(period / step), lagging) - 1, 1)
    past = factor * cycle.signal(cycle.input, earlier)
    memory = element.rest(float(past[0]))
    pending: deque[tuple[float, float]] = deque(maxlen=lagging)
    for a, b in pairwise(past):
        first, last, memory = element.passage(float(a), float(b), memory)
        pending.append((first, last))
    x = factor * states_on(transfer, cycle)
    limit = BEYOND * max(cycle.oscillation.peak, float(np.abs(past).max()))
    count = round(periods * period / step)
    return _march(transfer, element, step, x, memory, pending, limit, count)


def _march(
    transfer: Transfer,
    element: StepElement,
    step: float,
    x: np.ndarray,
    memory: object,
    pending: deque[tuple[float, float]],
    limit: float,
    count: int,
) -> LoopCourse:
    grown, early, late = transfer.stepper(step)
    _, _, c, _ = transfer.state_space()
    ahead, by_first, by_last = c @ grown, float(c @ early), float(c @ late)
    e = np.empty(count + 1)
    y = np.empty(count + 1)
    e[0] = now = -float(c @ x)
    first, last = element.passage(now, now, memory)[:2]
    y[0] = last
    delayed = bool(pending.maxlen)
    for k in range(count):
        free = float(ahead @ x)
        if delayed:
            first, last = pending[0]
            after = -(free + by_first * first + by_last * last)
            *line, memory = element.passage(now, after, memory)
            pending.append((line[0], line[1]))
            y[k + 1] = line[1]
        else:
            after = -(free + (by_first + by_last) * last)  # as if the output stayed
            for _ in range(3):  # a jump or bend within the step moves the end of the step
                first, end, _ = element.passage(now, after, memory)
                after = -(free + by_first * first + by_last * end)
            first, last, memory = element.passage(now, after, memory)
            y[k + 1] = last
        x = grown @ x + early * first + late * last
        e[k + 1] = now = -float(c @ x)
        if abs(now) > limit:
            return LoopCourse(step * np.arange(k + 2), e[: k + 2], y[: k + 2], True)
    return LoopCourse(step * np.arange(count + 1), e, y, False)


def states_on(transfer: Transfer, cycle: CycleSeries) -> np.ndarray:
    """States of the linear part at the start of a cycle, ``(n,)``.

    The mean of a state behind an integrator follows from the mean of the element's input.
    """
    a, b, c, d = transfer.state_space()
    x = np.zeros(transfer.order)
    for k, e, y in zip(cycle.order, cycle.input, cycle.output, strict=True):
        s = 1j * cycle.frequency * k
        y = y * np.exp(-transfer.delay * s)
        # (s I - A) x = B y alone is singular at a pole of G: the output C x = -e - D y selects the
        # solution
        rows = np.vstack([s * np.eye(transfer.order) - a, c[None, :].astype(complex)])
        wanted = np.append(b * y, -e - d * y)
        x += np.linalg.lstsq(rows, wanted, rcond=None)[0].real
    return x

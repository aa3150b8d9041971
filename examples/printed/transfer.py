"""The depth loop around the transfer function that Aras et al. 2013 print, and its answers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from diffthrust import InputError
from diffthrust._support.figures import BLUE, VERMILLION, styled  # the library's own look
from diffthrust._support.transfer import Transfer, transfer_of  # offered by no folder
from diffthrust.papers.aras import plant

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def linear_loop(gain: float = 1.0) -> Transfer:
    """The depth loop of section 6: from the set point to the depth, under proportional control.

    Without an integral the depth rests at gain G(0) / (1 + gain G(0)) of the set point: at half of
    it with the paper's gain of 1.

    Raises:
        InputError: a gain that is zero or not a number.
    """
    if not (np.isfinite(gain) and gain):
        raise InputError(
            f"linear_loop, gain: expected a number other than zero, found {gain!r}.", "Correct it."
        )
    g = plant()
    num = gain * np.array([0.0, *g.num])
    return transfer_of((num[1:], g.den + num))


def gain_limit() -> float:
    """The proportional gain at which the depth loop begins to swing: 45.09 / 28.77."""
    g = plant()
    return float(-g.den[1] / g.num[0])


def step_response(linear: Any, time: Any, size: float = 1.0) -> np.ndarray:
    """The answer of a system at rest to a step at time zero.

    Args:
        linear: what `dft.cycles.limit_cycles` takes, such as ``(num, den)`` or an object of
            python-control.
        time: [s], ``(n,)``, evenly spaced from 0 on.
        size: of the step.

    Returns:
        ``(n,)``.

    Raises:
        InputError: not a linear system, one with a dead time, or times that are not even or do not
            begin at zero.
    """
    system, time = transfer_of(linear), np.asarray(time, float)
    steps = np.diff(time)
    if time.ndim != 1 or time.size < 2 or time[0] != 0 or np.ptp(steps) > 1e-6 * steps[0]:
        raise InputError(
            "step_response, time: expected evenly spaced seconds from 0 on.",
            "Write np.linspace(0.0, 10.0, 1001).",
        )
    if system.delay:
        raise InputError(
            f"step_response: a system with a dead time of {system.delay:g} s.",
            "Leave the dead time out, and add it to the times.",
        )
    grown, start, end = system.stepper(float(np.mean(steps)))
    _, _, c, direct = system.state_space()
    moved = (start + end) * size
    x, out = np.zeros(system.order), np.empty(time.size)
    for i in range(time.size):
        out[i] = c @ x + direct * size
        x = grown @ x + moved
    return out


def plot_responses(gain: float = 1.0, size: float = 1.0) -> Figure:
    """The answers to a step of the printed G(s), and of the depth loop around it."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.5, 3.8), layout="constrained")
    left, right = figure.subplots(1, 2)
    shown = (
        (left, plant(), 15.0, "Open loop: G(s)", BLUE),
        (right, linear_loop(gain), 3.0, f"Depth loop, proportional gain {gain:g}", VERMILLION),
    )
    for axes, system, until, title, colour in shown:
        time = np.linspace(0.0, until, 3001)
        axes.axhline(
            size, color="0.4", linestyle=":", label="set point" if axes is right else "input"
        )
        axes.plot(time, step_response(system, time, size), color=colour, label="answer")
        rest = size * float(np.real(system(0.0)))
        axes.axhline(rest, color="0.6", linestyle="--", linewidth=0.9, label=f"at rest: {rest:.3f}")
        styled(axes, title, "time [s]", "answer to a unit step [1]" if size == 1 else "answer")
        axes.legend(fontsize=8, frameon=False, loc="lower right")
    return figure

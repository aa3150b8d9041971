"""Limit cycles of a loop of a linear part and a nonlinear element under negative feedback.

    e = - G y,   y = element(e)

The describing function finds them, a balance of harmonics refines them, a full simulation decides.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from diffthrust._support.errors import InputError
from diffthrust._support.figures import Figure, showing
from diffthrust._support.transfer import Transfer, transfer_of
from diffthrust._support.validation import finite_row, whole_number
from diffthrust.cycles._classical import StaticNonlinearity
from diffthrust.cycles._crossings import crossings, grid_of, loop_poles
from diffthrust.cycles._element import (
    CycleSeries,
    LimitCycle,
    LoopCourse,
    Nonlinearity,
    NotSimulated,
    Oscillation,
)
from diffthrust.cycles._model_element import ModelElement
from diffthrust.cycles._result import LimitCycles
from diffthrust.models._base.model import Model

# few lengths, so that few programs are compiled: the number of steps is part of the program
_LENGTHS = (16, 32, 64, 128, 256)
_MOST_HARMONICS = 200
_FACTORS = (1.0, 0.9, 1.1)
_BACK, _AWAY = 0.05, 0.15


def limit_cycles(
    linear: Any,
    nonlinearity: Any,
    *,
    amplitudes: ArrayLike | None = None,
    frequencies: ArrayLike | None = None,
    verify: bool = True,
    harmonics: int | None = None,
) -> LimitCycles:
    """All limit cycles of a loop in a range of amplitude and frequency, and what they are worth.

    Each solution of 1 + N(A, w) G(jw) = 0 is found on a grid and polished, judged stable or not by
    the quasi-static criterion (Loeb), refined by a balance of more harmonics over the whole loop,
    and simulated from the cycle and from 10 % below and above it. The search takes the element's
    input without a mean; a mean (of an element that is not odd) comes with the refinement.

    Args:
        linear: G(s) under negative feedback: ``(num, den)``, ``(num, den, delay)`` with the dead
            time [s], or an object of python-control or SciPy.
        nonlinearity: an element such as `Relay`; a function of your own; or a model or fit with
            its effects, from its command to its thrust (`ModelElement` for others). A delay of
            its command is counted with the dead time of the linear part.
        amplitudes: lowest and highest amplitude at the element's input, in its unit, or a rising
            grid. By default a wide range around the element's own scale; for a model 0.001 to 100.
        frequencies: the same [rad/s]. By default around the corners of G; with a dead time up to
            its first turn.
        verify: refine and simulate each; otherwise the describing function alone speaks.
        harmonics: the highest in the refinement; 25, for a model 15.

    Returns:
        The cycles with `LimitCycles.report` and `LimitCycles.plot`; none is an answer too.

    Raises:
        InputError: a linear part that is improper, discrete or has several inputs; ranges that are
            not positive and rising; something that is no nonlinear element.

    Source: Gelb & Vander Velde 1968, chapter 3; Yoerger, Cooke & Slotine 1990, section IV.

    Example:
        >>> result = dft.cycles.limit_cycles(
        ...     ([6.0], [1, 3, 2, 0]), dft.cycles.Relay(1.0), verify=False
        ... )
        >>> round(result.cycles[0].amplitude, 2)
        1.27
    """
    element = _element(nonlinearity)
    transfer = transfer_of(linear).later(element.delay)
    high = element.harmonics if harmonics is None else whole_number("harmonics", harmonics)
    if high > _MOST_HARMONICS:
        raise InputError(
            f"harmonics: expected at most {_MOST_HARMONICS}, found {high}.", "Correct it."
        )
    a = _range("amplitudes", amplitudes, element.least)
    a, w = grid_of(transfer, element, a, _range("frequencies", frequencies, 0.0))
    cycles, f = crossings(transfer, element, a, w)
    if verify:
        cycles = [_verified(transfer, element, c, high) for c in cycles]
    size = np.where(np.isfinite(f), np.abs(f), np.inf)
    i, j = np.unravel_index(int(np.argmin(size)), size.shape)
    return LimitCycles(
        transfer=transfer,
        element=element,
        cycles=tuple(cycles),
        amplitudes=(float(a[0]), float(a[-1])),
        frequencies=(float(w[0]), float(w[-1])),
        nearest=(float(size[i, j]), float(a[i]), float(w[j])),
        nearest_at_edge=_falling_outwards(size, int(i), int(j)),
        ends=(_rightmost(transfer, element, a, w), _rightmost(transfer, element, a[::-1], w)),
        unknown=float(np.mean(~np.isfinite(f))),
        verified=verify,
    )


@showing
def plot_pole_motion(
    linear: Any, nonlinearity: Any, *, amplitudes: ArrayLike | None = None
) -> Figure:
    """The root locus of the quasi-linear loop over the amplitude at the element's input.

    Where the poles cross to the left as the amplitude grows, an oscillation that is too small
    grows and one that is too large shrinks: a stable limit cycle. A model's lag is taken at the
    frequency of the oscillating pair itself.

    Args:
        linear: G(s) as for `limit_cycles`.
        nonlinearity: the element, model or fit, as for `limit_cycles`.
        amplitudes: lowest and highest, or a rising grid; as for `limit_cycles`.

    Raises:
        InputError: as for `limit_cycles`, or no poles at any amplitude.

    Source: Yoerger, Cooke & Slotine 1990, figure 13.

    Example:
        >>> figure = dft.cycles.plot_pole_motion(([2.0], [1, 3, 2, 0]), dft.cycles.Saturation(1.0))
    """
    from diffthrust.cycles._figures import pole_figure

    transfer, element = transfer_of(linear), _element(nonlinearity)
    grid, scale = _range("amplitudes", amplitudes, element.least), element.scale
    if grid is None and scale is not None:
        grid = np.array([element.least + 0.1 * scale, 100.0 * scale])
    elif grid is None:
        grid, _ = grid_of(transfer, element, None, None)
    return pole_figure(transfer, element, (float(grid[0]), float(grid[-1])))


def _falling_outwards(size: np.ndarray, i: int, j: int) -> bool:
    """Whether a smallest value at the edge of the grid would become smaller beyond it."""
    inward = []
    if i in (0, size.shape[0] - 1):
        # three cells inwards: next to a solution at the very edge the neighbour may be as small
        inward.append(size[abs(i - min(3, size.shape[0] - 1)), j])
    if j in (0, size.shape[1] - 1):
        inward.append(size[i, abs(j - min(3, size.shape[1] - 1))])
    return any(bool(value > 1.001 * size[i, j] + 1e-12) for value in inward)


def _element(nonlinearity: Any) -> Nonlinearity:
    """An element as it is, a model or a fit from command to thrust, or a function."""
    if isinstance(nonlinearity, Nonlinearity):
        return nonlinearity
    if isinstance(getattr(nonlinearity, "model", nonlinearity), Model):
        return ModelElement(nonlinearity)
    if callable(nonlinearity) and not isinstance(nonlinearity, type):
        return StaticNonlinearity(nonlinearity)
    raise InputError(
        f"Expected a nonlinear element, a model, a fit or a function, found {nonlinearity!r}.",
        "Give dft.cycles.Relay(1.0), dft.cycles.Saturation(1.0), dft.Thruster(), or a function "
        "of an array.",
    )


def _verified(
    transfer: Transfer, element: Nonlinearity, c: LimitCycle, harmonics: int
) -> LimitCycle:
    """A solution, refined by a balance and simulated from it and from 10 % below and above."""
    balanced = element.balanced(transfer, c.amplitude, c.frequency, harmonics)
    refined = replace(c, refined=balanced and balanced.oscillation, harmonics=balanced)
    cycle = balanced or _sine(element, c)
    # four time constants of the deviation: 10 % falls below 0.2 %, or has grown fifty-fold
    wanted = 4.0 / max(abs(c.growth) * cycle.oscillation.period, 1e-9)
    periods = next((n for n in _LENGTHS if n >= wanted), _LENGTHS[-1])
    try:
        runs = element.courses(transfer, cycle, _FACTORS, periods)
    except NotSimulated as reason:
        return replace(refined, simulation=f"not simulated: {reason}")
    simulated, lasts, words = _judged(runs, cycle.oscillation, periods)
    return replace(refined, simulated=simulated, lasts=lasts, simulation=words)


def _sine(element: Nonlinearity, c: LimitCycle) -> CycleSeries:
    n = complex(element.describing(c.amplitude, c.frequency))
    coefficients = np.array([0.0, c.amplitude], complex)
    return CycleSeries(c.frequency, np.array([0, 1]), coefficients, n * coefficients)


def _rightmost(transfer: Transfer, element: Nonlinearity, a: np.ndarray, w: np.ndarray) -> float:
    """Largest real part of the quasi-linear loop's poles at the first amplitude that has an N."""
    middle = float(np.sqrt(w[0] * w[-1]))
    finite = np.isfinite(element.describing(a, middle))
    if not finite.any():
        return float("nan")
    poles = loop_poles(transfer, element, float(a[int(np.argmax(finite))]), middle)
    return float(np.real(poles).max()) if poles.size else float("-inf")


def _range(what: str, asked: ArrayLike | None, least: float) -> np.ndarray | None:
    """A range or grid as given, cut where the element begins to have an output."""
    if asked is None:
        return None
    values = finite_row(asked)
    if values is None or values.size < 2 or values[0] <= 0 or (np.diff(values) <= 0).any():
        raise InputError(
            f"{what}: expected a lowest and a highest value above zero, or a rising grid of them; "
            f"found {asked!r}.",
            f"Write {what}=(0.01, 10.0).",
        )
    if values[-1] <= least:
        raise InputError(
            f"{what}: the element has no output up to an input of {least:.4g}, and the range ends "
            f"at {values[-1]:.4g}.",
            "Raise the end of the range.",
        )
    if values[0] <= least:
        # the logarithm of what lies above ``least`` must exist at the first amplitude
        start = least + 1e-6 * (values[-1] - least)
        values = np.concatenate([[start], values[values > start]])
    return values


def _judged(
    runs: list[LoopCourse], cycle: Oscillation, periods: int
) -> tuple[Oscillation | None, bool | None, str]:
    """The course on the cycle in numbers, whether its neighbours come back, and this in words."""
    on, *sides = runs
    fates = [_fate(run, cycle, periods) for run in sides]
    away = [abs(end - 1.0) for end, _ in fates]
    stays, goes = all(x < _BACK for x in away), all(x > _AWAY for x in away)
    lasts = True if stays else False if goes else None
    # an unstable cycle is left sooner or later: only its first turns show it
    count = on.time.size if lasts else math.ceil(3.5 * cycle.period / on.time[1]) + 1
    oscillation = measured(on.time[:count], on.input[:count], turns=4 if lasts else 2)
    if oscillation and not lasts and abs(oscillation.peak / cycle.peak - 1.0) > 0.1:
        oscillation = None  # it had left already: these would be the figures of something else
    if lasts:
        words = "simulations from 10 % below and above come back to it"
    else:
        below, above = (f"it {fate}" for _, fate in fates)
        words = f"from 10 % below {below}, from 10 % above {above}"
        words = f"the simulation leaves it: {words}" if lasts is False else words
    return oscillation, lasts, words


def _fate(run: LoopCourse, cycle: Oscillation, periods: int) -> tuple[float, str]:
    """Height of the last two turns over the cycle's (inf where it fled), and this in words."""
    if run.fled:
        return math.inf, "grows a thousandfold"
    height = envelope(run.time, run.input, cycle.period)
    end = float(height[-2:].mean()) / cycle.peak
    if end < 0.1:
        return end, "dies out"
    if abs(end - 1.0) < _BACK:
        return end, "comes back"
    if abs(height[-1] / height[-3] - 1.0) < 1e-3:
        return end, f"goes to a peak of {height[-1]:.4g}"
    return end, f"has a peak of {height[-1]:.4g} after {periods} periods"


def measured(time: np.ndarray, e: np.ndarray, turns: int = 4) -> Oscillation | None:
    """The last turns of an evenly spaced course in numbers; ``None`` where it does not swing."""
    starts = upward(time, e)
    if starts.size < 2:
        return None
    first, last = starts[max(0, starts.size - 1 - turns)], starts[-1]
    count = min(turns, starts.size - 1)
    frequency = 2.0 * math.pi * count / (last - first)
    inside = (time >= first) & (time <= last)
    # whole turns on an even grid: the sum then is the Fourier integral without leakage
    fine = np.linspace(first, last, 256 * count, endpoint=False)
    values = np.interp(fine, time, e)
    mean = float(values.mean())
    fundamental = 2.0 * abs(np.mean((values - mean) * np.exp(-1j * frequency * fine)))
    return Oscillation(float(fundamental), 0.5 * float(np.ptp(e[inside])), float(frequency), mean)


def upward(time: np.ndarray, e: np.ndarray) -> np.ndarray:
    """Instants [s] at which the course rises through the middle of its last part."""
    late = e[e.size // 2 :]
    # not zero: a course with an offset may never cross it
    level = 0.5 * (late.max() + late.min())
    rises = np.flatnonzero((e[:-1] < level) & (e[1:] >= level))
    share = (level - e[rises]) / (e[rises + 1] - e[rises])
    return time[rises] + share * (time[rises + 1] - time[rises])


def envelope(time: np.ndarray, e: np.ndarray, period: float) -> np.ndarray:
    """Half the height of the course in each stretch of one period [s], ``(periods,)``."""
    width = max(2, round(period / (time[1] - time[0])))
    count = e.size // width
    pieces = e[: count * width].reshape(count, width)
    return 0.5 * np.ptp(pieces, axis=1)

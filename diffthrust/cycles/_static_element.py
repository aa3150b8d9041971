"""Elements that answer the course of their input, however fast, and the loop around them.

The balance goes beyond the fundamental. Unknown are the Fourier coefficients of the element's input
and the frequency; the fundamental's phase is held. The output's coefficients are integrals over
pieces between the jumps, bends and turns of the input, so that a switching instant is as exact as
the series itself.

In the simulation the linear part takes exact steps for an input that is straight within the step;
where the element jumps within a step, the line with the same mean and first moment stands for it,
so that switching instants are not rounded to the grid. A dead time is a whole number of steps.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections import deque
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import root

from diffthrust._support.transfer import Transfer
from diffthrust.cycles._element import (
    BEYOND,
    STEPS_A_PERIOD,
    CycleSeries,
    LoopCourse,
    Nonlinearity,
    NotSimulated,
)

_GAUSS = np.polynomial.legendre.leggauss(64)
_NUDGE = 1e-9
# an integral over one piece meets no jump: three Gauss points are exact to the fifth order there
_PIECES = 180
_POINTS = np.polynomial.legendre.leggauss(3)
_TAIL = 5e-4
"""Share of the fundamental that the last harmonic of the input may have."""


class Static(Nonlinearity):
    """An element that answers the course of its input, however fast: a curve, perhaps with memory.

    A subclass gives `over` (and `at`, where that can be faster), the levels of the input at which
    the output jumps or bends, and, if it remembers, `rest` and `passage`.
    """

    lags = False
    cells: tuple[int, int] = (320, 400)
    inward: tuple[float, float] = (1.0, 1.0)
    harmonics = 25
    jumps: tuple[float, ...] = ()
    """Levels of the input at which the output jumps, whatever came before."""
    bends: tuple[float, ...] = ()
    """Levels at which the output jumps, perhaps, or bends: where an integral is split."""

    @abstractmethod
    def over(self, e: np.ndarray) -> np.ndarray:
        """The output over one period, settled, from inputs in their order, ``(n,)``."""

    def at(self, e: float) -> float:
        """The output for one input, of an element without memory."""
        return float(self.over(np.array([e]))[0])

    def describing(self, amplitude: ArrayLike, frequency: ArrayLike) -> np.ndarray:
        """By quadrature over a quarter turn either way, split where the output jumps or bends."""
        a = amplitudes_of(amplitude, frequency)
        # N does not depend on the frequency: one integral for each amplitude of the grid
        levels, back = np.unique(a, return_inverse=True)
        n = np.array([self._projected(level) for level in levels], complex)
        return n[back].reshape(a.shape)

    def _projected(self, amplitude: float) -> float:
        inner = [math.asin(b / amplitude) for b in self.bends if abs(b) < amplitude]
        ends = np.array([-0.5 * math.pi, *sorted(inner), 0.5 * math.pi])
        half = 0.5 * np.diff(ends)[:, None]
        angle = (0.5 * (ends[1:] + ends[:-1])[:, None] + half * _GAUSS[0]).reshape(-1)
        weight = (half * _GAUSS[1]).reshape(-1)
        sine = np.sin(angle)
        return 2.0 / (math.pi * amplitude) * float(weight @ (self.over(amplitude * sine) * sine))

    def amplitudes(self, transfer: Transfer, frequencies: np.ndarray) -> np.ndarray:
        """A wide range around the element's own scale."""
        count = self.cells[0]
        if self.scale is not None:
            return self.least + self.scale * np.geomspace(1e-5, 1e5, count)
        # an ideal relay has no scale of its own: A = |G| times the fundamental of its output
        gain = np.abs(transfer(1j * frequencies)) * np.abs(self.describing(1.0, 1.0))
        gains = gain[np.isfinite(gain) & (gain > 0)]
        return np.geomspace(0.5 * gains.min(), 2.0 * gains.max(), count)

    def balanced(
        self, transfer: Transfer, amplitude: float, frequency: float, harmonics: int
    ) -> CycleSeries | None:
        """The cycle near a solution of the describing function.

        Where Newton's method fails with all harmonics at once they are added little by little;
        where the last one is not small yet (a relay before a first-order lag), four times as many
        are taken.
        """
        sine = CycleSeries(
            frequency, np.array([1]), np.array([amplitude + 0j]), np.zeros(1, complex)
        )
        # most loops converge with all harmonics at once, which is the least work
        cycle = _solved(transfer, self, sine, sine, harmonics)
        if cycle is None:
            cycle = sine
            for highest in sorted({*(n for n in (1, 3, 9) if n < harmonics), harmonics}):
                cycle = _solved(transfer, self, sine, cycle, highest)
                if cycle is None:
                    return None
        tail = np.abs(cycle.input[-2:]).max() / np.abs(cycle.input).max()
        if tail > _TAIL and harmonics > 1:
            return _solved(transfer, self, sine, cycle, 4 * harmonics + 1) or cycle
        return cycle

    def courses(
        self, transfer: Transfer, cycle: CycleSeries, factors: tuple[float, ...], periods: int
    ) -> list[LoopCourse]:
        """Simulate the loop from starts on a cycle."""
        if transfer.direct:
            raise NotSimulated("the linear part passes a step at once to an element that does")
        return [_simulated(transfer, self, cycle, factor, periods) for factor in factors]

    def rest(self, e: float) -> Any:
        """What the element remembers when its input has always been ``e``."""
        return None

    def passage(self, before: float, after: float, memory: Any) -> tuple[float, float, Any]:
        """The output while the input goes straight from one value to another.

        Where the output jumps on the way, the straight line that has the same mean and the same
        first moment stands for it: a linear system that follows cannot tell them apart to the
        third order of the step.

        Returns:
            Output at the start and the end, and what the element remembers then.
        """
        rise = after - before
        low, high = min(before, after), max(before, after)
        cuts = [(jump - before) / rise for jump in self.jumps if low < jump < high]
        if not cuts:
            tiny = _NUDGE * rise
            return self.at(before + tiny), self.at(after - tiny), memory
        pieces = []
        for s, t in pairwise([0.0, *sorted(cuts), 1.0]):
            inward = _NUDGE * (t - s)
            first, last = before + (s + inward) * rise, before + (t - inward) * rise
            pieces.append((s, t, self.at(first), self.at(last)))
        return (*straight(pieces), memory)


def amplitudes_of(amplitude: ArrayLike, frequency: ArrayLike) -> np.ndarray:
    """The amplitudes, of the shape to which they broadcast with the frequencies."""
    return np.broadcast_arrays(np.asarray(amplitude, float), np.asarray(frequency, float))[0]


def straight(pieces: Sequence[tuple[float, float, float, float]]) -> tuple[float, float]:
    """The line over a step that has the mean and the first moment of a broken one.

    Its pieces are ``(start, end, value at the start, value at the end)``, in shares of the step.
    """
    mean = moment = 0.0
    for s, t, u, v in pieces:
        width = t - s
        mean += 0.5 * width * (u + v)
        moment += width * (0.5 * s * (u + v) + width * (u / 6.0 + v / 3.0))
    slope = 12.0 * (moment - 0.5 * mean)
    return mean - 0.5 * slope, mean + 0.5 * slope


def _solved(
    transfer: Transfer, element: Static, sine: CycleSeries, guess: CycleSeries, harmonics: int
) -> CycleSeries | None:
    """Newton's method at a number of harmonics; ``None`` where it ends far from the sine.

    Unknown are the coefficients over the sine's amplitude, first their real parts, and, in the
    place of the fundamental's imaginary part, the logarithm of the frequency's change.
    """
    # an odd element on a cycle without a mean makes odd harmonics only; even ones would be zero
    # columns
    order = np.arange(1, harmonics + 1, 2) if element.odd else np.arange(harmonics + 1)
    amplitude, frequency = float(sine.input[0].real), sine.frequency
    mean = int(order[0] == 0)  # which has no imaginary part

    def unpacked(z: np.ndarray) -> tuple[np.ndarray, float]:
        imaginary = np.concatenate([np.zeros(mean), z[order.size :]])
        log_w, imaginary[mean] = imaginary[mean], 0.0
        # another cycle long before e^5, and no overflow where a search leads nowhere
        w = frequency * math.exp(np.clip(log_w, -5.0, 5.0))
        return amplitude * (z[: order.size] + 1j * imaginary), w

    def missed(z: np.ndarray) -> np.ndarray:
        e, w = unpacked(z)
        s = 1j * w * order
        num, den = np.polyval(transfer.num, s), np.polyval(transfer.den, s)
        # at a pole of G (k = 0 with an integrator) the output itself must vanish
        size = np.maximum(np.abs(den), 1e-9 * np.abs(num))
        size = np.where(np.abs(den) > 1e-12 * np.abs(num), size, np.abs(num))
        y = num * np.exp(-transfer.delay * s) * output_of(element, order, e)
        error = (den * e + y) / size / amplitude
        return np.concatenate([error.real, error[mean:].imag])

    by_order = dict(zip(guess.order.tolist(), guess.input, strict=True))
    e = np.array([by_order.get(k, 0j) for k in order.tolist()]) / amplitude
    start = np.concatenate([e.real, e.imag[mean:]])
    start[order.size] = math.log(guess.frequency / frequency)
    # A first step beyond 0.3 of the amplitude leaves the neighbourhood in which the linearization
    # says anything.
    options = {"eps": 1e-12, "xtol": 1e-11, "maxfev": 100 * order.size, "factor": 0.3}
    solution = root(missed, start, options=options)
    # Where a switching instant moves, the residual has corners at which the method may report no
    # further progress: what is missed decides, not its word.
    if not np.abs(solution.fun).max() <= 1e-6:
        return None
    e, w = unpacked(solution.x)
    cycle = CycleSeries(float(w), order, e, output_of(element, order, e))
    return cycle if cycle.near(amplitude, frequency) else None


def output_of(element: Static, order: np.ndarray, e: np.ndarray) -> np.ndarray:
    """Fourier coefficients of the settled output for those of the input, complex ``(m,)`` each."""

    def value(angle: np.ndarray) -> np.ndarray:
        return (_turns(angle, order) * e).sum(axis=1).real

    def slope(angle: np.ndarray) -> np.ndarray:
        return (_turns(angle, order) * (1j * order * e)).sum(axis=1).real

    # six pieces for each turn of the highest harmonic, or a sign change could hide between two
    # nodes
    pieces = max(_PIECES, 6 * int(order[-1]))
    grid = np.linspace(0.0, 2.0 * math.pi, pieces + 1)
    at, rising = value(grid), slope(grid)
    cuts = [_zeros(slope, grid, rising)]
    cuts += [_zeros(lambda a, b=b: value(a) - b, grid, at - b) for b in element.bends]
    nodes = np.sort(np.concatenate([grid, *cuts]))
    half = 0.5 * np.diff(nodes)[:, None]
    inner = nodes[:-1, None] + half * (1.0 + _POINTS[0])
    # the nodes go along: an element with memory must see the turns of its input
    places = np.concatenate([nodes[:-1, None], inner], axis=1).reshape(-1)
    turns = _turns(places, order)
    y = element.over((turns * e).sum(axis=1).real)
    weight = np.concatenate([0.0 * half, half * _POINTS[1]], axis=1).reshape(-1)
    # 2/T times the integral for the harmonics; the mean takes half of that
    y_k = ((weight * y)[:, None] * turns.conj()).sum(axis=0) / math.pi
    return np.where(order == 0, 0.5 * y_k, y_k)


def _turns(angle: np.ndarray, order: np.ndarray) -> np.ndarray:
    """exp(j k angle) for evenly spaced k, complex ``(n, m)``; by products, which are fast."""
    out = np.empty((angle.size, order.size), complex)
    out[:, 0] = np.exp(1j * order[0] * angle)
    step = np.exp(1j * np.ptp(order[:2]) * angle)
    for i in range(1, order.size):
        np.multiply(out[:, i - 1], step, out=out[:, i])
    return out


def _zeros(
    function: Callable[[np.ndarray], np.ndarray], grid: np.ndarray, values: np.ndarray
) -> np.ndarray:
    """Where a smooth function changes its sign: by the rule of Illinois, all places at once."""
    i = np.flatnonzero(values[:-1] * values[1:] < 0)
    left, right, f, g = grid[i], grid[i + 1], values[i], values[i + 1]
    for _ in range(8):
        # regula falsi alone keeps one end for ever on a bent curve; halving its value (Illinois)
        # makes it superlinear: Dowell & Jarratt 1971
        middle = right - g * (right - left) / np.where(g == f, 1.0, g - f)
        h = function(middle)
        turned = h * g < 0
        left, f = np.where(turned, right, left), np.where(turned, g, 0.5 * f)
        right, g = middle, h
        if np.abs(h).max(initial=0.0) == 0.0:
            break
    return right


def _simulated(
    transfer: Transfer, element: Static, cycle: CycleSeries, factor: float, periods: float
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
    x = factor * cycle.linear_states(transfer)
    limit = BEYOND * max(cycle.oscillation.peak, float(np.abs(past).max()))
    count = round(periods * period / step)
    return _march(transfer, element, step, x, memory, pending, limit, count)


def _march(
    transfer: Transfer,
    element: Static,
    step: float,
    x: np.ndarray,
    memory: Any,
    pending: deque[tuple[float, float]],
    limit: float,
    count: int,
) -> LoopCourse:
    """From states of the linear part and outputs that are still to arrive, up to a limit."""
    grown, early, late = transfer.stepper(step)
    _, _, c, _ = transfer.state_space()
    ahead, by_first, by_last = c @ grown, float(c @ early), float(c @ late)
    e = np.empty(count + 1)
    y = np.empty(count + 1)
    e[0] = now = -float(c @ x)
    first, last, _ = element.passage(now, now, memory)
    y[0] = last
    for k in range(1, count + 1):
        free = float(ahead @ x)
        if pending.maxlen:
            first, last = pending[0]
            after = -(free + by_first * first + by_last * last)
            begin, end, memory = element.passage(now, after, memory)
            pending.append((begin, end))
            y[k] = end
        else:
            after = -(free + (by_first + by_last) * last)  # as if the output stayed
            for _ in range(3):  # a jump or bend within the step moves the end of the step
                first, end, _ = element.passage(now, after, memory)
                after = -(free + by_first * first + by_last * end)
            first, last, memory = element.passage(now, after, memory)
            y[k] = last
        x = grown @ x + early * first + late * last
        e[k] = now = -float(c @ x)
        if abs(now) > limit:
            return LoopCourse(step * np.arange(k + 1), e[: k + 1], y[: k + 1], True)
    return LoopCourse(step * np.arange(count + 1), e, y, False)

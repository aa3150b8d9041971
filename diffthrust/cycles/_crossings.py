"""All solutions of 1 + N(A, w) G(jw) = 0 in a range, and whether a small disturbance grows.

The plane of amplitude and frequency is cut into cells; those in which both the real and the
imaginary part change their sign are polished by Newton's method.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from diffthrust._support.transfer import Transfer
from diffthrust.cycles._element import Nonlinearity

# two solutions closer than this in the logarithms are one; the stencil of the central differences
# is as wide, where truncation (1e-8) and rounding balance
_SAME = 1e-4
_STENCIL = 1e-4


@dataclass(frozen=True)
class Crossing:
    """One solution.

    Args:
        amplitude: of the fundamental at the element's input.
        frequency: [rad/s].
        growth: how fast a relative deviation of the amplitude grows [1/s]; negative: it dies out.
        others: the largest real part [1/s] of the other poles of the quasi-linear loop.
        edge: it lies in the outermost cells of the range.
    """

    amplitude: float
    frequency: float
    growth: float
    others: float
    edge: bool

    @property
    def stable(self) -> bool | None:
        """Whether the oscillation lasts by the quasi-static criterion; ``None``: undecided."""
        small = 1e-6 * self.frequency
        if abs(self.growth) < small:
            return None
        return bool(self.growth < 0 and self.others < small)


def grid_of(
    transfer: Transfer,
    element: Nonlinearity,
    amplitudes: np.ndarray | None,
    frequencies: np.ndarray | None,
) -> tuple[np.ndarray, np.ndarray]:
    """The amplitudes and frequencies [rad/s] of the cells; a given pair is the ends of a range."""
    if frequencies is None:
        corners = transfer.corners
        # two decades around the corners: beyond, the phase of a rational G is within a degree of
        # its limit
        top = 100.0 * corners[-1]
        if transfer.delay:  # the first turn of the dead time; later ones are asked for by range
            top = min(top, 5.0 / transfer.delay)
        low = min(0.01 * corners[0], 0.01 * top)
        frequencies = np.array([element.inward[0] * low, element.inward[1] * top])
    w = _grid(frequencies, element.cells[1])
    if amplitudes is None:
        return element.amplitudes(transfer, w), w
    return _grid(amplitudes, element.cells[0]), w


def _grid(ends: np.ndarray, count: int) -> np.ndarray:
    return np.geomspace(ends[0], ends[1], count) if ends.size == 2 else ends


def loop_balance(
    transfer: Transfer, element: Nonlinearity, amplitude: np.ndarray, frequency: np.ndarray
) -> np.ndarray:
    """1 + N(A, w) G(jw), NaN where there is no describing function."""
    with np.errstate(invalid="ignore", over="ignore"):
        return 1.0 + element.describing(amplitude, frequency) * transfer(1j * frequency)


def crossings(
    transfer: Transfer, element: Nonlinearity, amplitudes: np.ndarray, frequencies: np.ndarray
) -> tuple[list[Crossing], np.ndarray]:
    """All solutions in the range, amplitudes rising, and 1 + N G on the grid, ``(a, f)``."""
    f = loop_balance(transfer, element, amplitudes[:, None], frequencies[None, :])
    solutions: list[Crossing] = []
    for i, j, apart in _candidates(_turning(np.real(f)), _turning(np.imag(f))):
        cell = amplitudes[i : i + 2], frequencies[j : j + 2]
        # Newton's method costs a describing function for each stencil, a simulation for a model:
        # cells beside a solution are skipped
        if any(_cells_apart(cell, c) < apart for c in solutions):
            continue
        place = _polished(transfer, element, *cell)
        if place is None:
            continue
        a, w = place
        inside = amplitudes[0] <= a <= amplitudes[-1] and frequencies[0] <= w <= frequencies[-1]
        tried = any(
            abs(np.log(a / c.amplitude)) + abs(np.log(w / c.frequency)) < _SAME for c in solutions
        )
        if inside and not tried:
            edge = a < amplitudes[1] or a > amplitudes[-2]
            edge = edge or w < frequencies[1] or w > frequencies[-2]
            growth, further = stability(transfer, element, a, w)
            solutions.append(Crossing(float(a), float(w), growth, further, bool(edge)))
    return sorted(solutions, key=lambda c: c.amplitude), f


def _turning(values: np.ndarray) -> np.ndarray:
    """Cells whose corners are not all of one sign; none where a corner is not a number."""
    corners = np.stack([values[:-1, :-1], values[1:, :-1], values[:-1, 1:], values[1:, 1:]])
    with np.errstate(invalid="ignore"):
        return (corners.min(axis=0) <= 0) & (corners.max(axis=0) >= 0)


def _stencil(
    transfer: Transfer, element: Nonlinearity, a: float, w: float
) -> tuple[complex, complex, complex]:
    """1 + N G and its derivatives by the logarithms of what lies above ``least``, and of w."""
    # the describing function has a square root at the least amplitude (a relay's hysteresis): in
    # the logarithm of what lies above it the slope stays bounded
    above = a - element.least
    step = np.array([0.0, _STENCIL, -_STENCIL, 0.0, 0.0])
    at = element.least + above * np.exp(step)
    f = loop_balance(transfer, element, at, w * np.exp(step[[0, 3, 4, 1, 2]]))
    return complex(f[0]), (f[1] - f[2]) / (2 * _STENCIL), (f[3] - f[4]) / (2 * _STENCIL)


def _candidates(real: np.ndarray, imaginary: np.ndarray) -> Iterator[tuple[int, int, float]]:
    """Cells to polish, and the distance in cells within which an earlier solution replaces them.

    First the cells in which both parts change their sign. Then those in which one part does and
    the other does in a neighbour: a line that only bulges into a cell does not change the sign of
    its corners.
    """
    from scipy.ndimage import binary_dilation  # takes a while

    both, neighbours = real & imaginary, np.ones((3, 3))
    for i, j in np.argwhere(both):
        yield int(i), int(j), 0.75
    beside = (real & binary_dilation(imaginary, neighbours)) | (
        binary_dilation(real, neighbours) & imaginary
    )
    for i, j in np.argwhere(beside & ~both):
        yield int(i), int(j), 1.75


def _cells_apart(cell: tuple[np.ndarray, np.ndarray], c: Crossing) -> float:
    """How far a solution lies from the middle of a cell, in cells."""
    apart = []
    for (low, high), at in zip(cell, (c.amplitude, c.frequency), strict=True):
        apart.append(abs(np.log(at / np.sqrt(low * high))) / np.log(high / low))
    return float(max(apart))


def _polished(
    transfer: Transfer, element: Nonlinearity, amplitudes: np.ndarray, frequencies: np.ndarray
) -> tuple[float, float] | None:
    """Newton's method from the middle of a cell; ``None`` where it leads nowhere, or far away."""
    ends = np.log(amplitudes - element.least), np.log(frequencies)
    # farther than four cells it would find the solution of another cell again, or none
    reach = [end.mean() + 4.0 * np.ptp(end) * np.array([-1.0, 1.0]) for end in ends]
    a, w = element.least + float(np.exp(ends[0].mean())), float(np.exp(ends[1].mean()))
    for _ in range(40):
        log_a, log_w = np.log(a - element.least), np.log(w)
        if not (reach[0][0] <= log_a <= reach[0][1] and reach[1][0] <= log_w <= reach[1][1]):
            return None
        f, by_a, by_w = _stencil(transfer, element, a, w)
        matrix = np.array([[by_a.real, by_w.real], [by_a.imag, by_w.imag]])
        if not (np.isfinite(f) and np.isfinite(matrix).all()):
            return None
        # G and -1/N run parallel here: a whole line of solutions, or a touch, and no single
        # crossing
        if abs(np.linalg.det(matrix)) <= 1e-14 * np.abs(matrix).max() ** 2:
            return None
        move = np.clip(-np.linalg.solve(matrix, [f.real, f.imag]), -0.3, 0.3)
        a = element.least + (a - element.least) * float(np.exp(move[0]))
        w = w * float(np.exp(move[1]))
        if np.abs(move).max() < 1e-10:
            break
    f, _, _ = _stencil(transfer, element, a, w)
    return (a, w) if abs(f) < 1e-6 else None


def stability(transfer: Transfer, element: Nonlinearity, a: float, w: float) -> tuple[float, float]:
    """Growth of a deviation, and the other poles of the quasi-linear loop.

    The oscillation exp((s + jw) t) of a slightly larger one solves the balance with a shifted
    argument: s = -dF/dA dA / (dF/d(jw)), F = 1 + N G (Loeb's criterion in derivative form,
    Gelb & Vander Velde 1968, section 3.2). The other poles must lie to the left as well.

    Returns:
        Real part of the shift for dA = A [1/s], and the largest real part of other poles [1/s].
    """
    _, by_a, by_w = _stencil(transfer, element, a, w)
    # from the logarithm of what lies above ``least`` to that of the amplitude itself
    by_a = by_a * a / (a - element.least)
    growth = float(np.real(-by_a / (by_w / (1j * w))))
    poles = loop_poles(transfer, element, a, w)
    if poles.size <= 2:
        return growth, -np.inf
    # the oscillating pair is on the axis by construction: it says nothing of stability and is taken
    # out
    pair = np.argsort(np.abs(np.abs(np.imag(poles)) - w) + np.abs(np.real(poles)))[:2]
    return growth, float(np.real(np.delete(poles, pair)).max())


def loop_poles(
    transfer: Transfer, element: Nonlinearity, a: float, w: float, n: complex | None = None
) -> np.ndarray:
    """Poles [1/s] of the quasi-linear loop at one amplitude, the element's lag taken at ``w``."""
    plain = transfer.rational()
    n = complex(element.describing(a, w)) if n is None else n
    num, den = element.quasi_linear(n, a, w)
    return np.roots(np.polyadd(np.polymul(den, plain.den), np.polymul(num, plain.num)))

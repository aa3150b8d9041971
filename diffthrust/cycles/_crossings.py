"""All solutions of 1 + N(A, w) G(jw) = 0 in a range, and whether a small disturbance grows.

The plane of amplitude and frequency is cut into cells; those in which both the real and the
imaginary part change their sign are polished by Newton's method.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.transfer import Transfer
from diffthrust.cycles._element import LimitCycle, Nonlinearity

# two solutions closer than this in the logarithms are one; the stencil of the central differences
# is as wide, where truncation (1e-8) and rounding balance
_SAME = 1e-4
_STENCIL = 1e-4


def grid_of(
    transfer: Transfer,
    element: Nonlinearity,
    amplitudes: np.ndarray | None,
    frequencies: np.ndarray | None,
) -> tuple[np.ndarray, np.ndarray]:
    """The amplitudes and frequencies [rad/s] of the cells; a given pair is the ends of a range."""
    if frequencies is None:
        corners = transfer.corners
        # two decades around the corners: beyond, a rational G is within a degree of its last phase
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
) -> tuple[list[LimitCycle], np.ndarray]:
    """All solutions in the range, amplitudes rising, and 1 + N G on the grid, ``(a, f)``."""
    f = loop_balance(transfer, element, amplitudes[:, None], frequencies[None, :])
    solutions: list[LimitCycle] = []
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
            stable, growth = _stability(transfer, element, a, w)
            solutions.append(LimitCycle(float(a), float(w), stable, growth, bool(edge)))
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

    First those in which both parts change their sign, then those in which one does, and the other
    in a neighbour: a line that only bulges into a cell does not change the sign of its corners.
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


def _cells_apart(cell: tuple[np.ndarray, np.ndarray], c: LimitCycle) -> float:
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
        # G and -1/N run parallel here: a line of solutions, or a touch, and no single crossing
        if abs(np.linalg.det(matrix)) <= 1e-14 * np.abs(matrix).max() ** 2:
            return None
        move = np.clip(-np.linalg.solve(matrix, [f.real, f.imag]), -0.3, 0.3)
        a = element.least + (a - element.least) * float(np.exp(move[0]))
        w = w * float(np.exp(move[1]))
        if np.abs(move).max() < 1e-10:
            break
    f, _, _ = _stencil(transfer, element, a, w)
    return (a, w) if abs(f) < 1e-6 else None


def _stability(
    transfer: Transfer, element: Nonlinearity, a: float, w: float
) -> tuple[bool | None, float]:
    """Whether a solution is stable (``None``: undecided), and how fast a deviation grows [1/s].

    The oscillation exp((s + jw) t) of a slightly larger one solves the balance with a shifted
    argument: s = -dF/dA dA / (dF/d(jw)), F = 1 + N G (Loeb's criterion in derivative form,
    Gelb & Vander Velde 1968, section 3.2); the growth is the real part of s for dA = A. The other
    poles of the quasi-linear loop must lie to the left as well.
    """
    _, by_a, by_w = _stencil(transfer, element, a, w)
    # from the logarithm of what lies above ``least`` to that of the amplitude itself
    by_a = by_a * a / (a - element.least)
    growth = float(np.real(-by_a / (by_w / (1j * w))))
    small = 1e-6 * w
    if abs(growth) < small:
        return None, growth
    poles = loop_poles(transfer, element, a, w)
    # the oscillating pair is on the axis by construction, and says nothing of stability
    pair = np.argsort(np.abs(np.abs(np.imag(poles)) - w) + np.abs(np.real(poles)))[:2]
    others = np.real(np.delete(poles, pair)).max(initial=-np.inf)
    return bool(growth < 0 and others < small), growth


def loop_poles(
    transfer: Transfer, element: Nonlinearity, a: float, w: float, n: complex | None = None
) -> np.ndarray:
    """Poles [1/s] of the quasi-linear loop at one amplitude, the element's lag taken at ``w``."""
    plain = transfer.rational()
    n = complex(element.describing(a, w)) if n is None else n
    num, den = element.quasi_linear(n, a, w)
    return np.roots(np.polyadd(np.polymul(den, plain.den), np.polymul(num, plain.num)))


def pole_path(
    transfer: Transfer, element: Nonlinearity, amplitudes: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Amplitudes ``(m,)`` with a describing function, and the loop's poles [1/s], ``(m, n)``."""
    w = np.full(amplitudes.shape, np.sqrt(transfer.corners[0] * transfer.corners[-1]))
    rows: list[np.ndarray] = []
    for _ in range(8):  # the lag depends on the frequency of the pair that it moves
        rows, previous = [], w.copy()
        for i, n in enumerate(element.describing(amplitudes, w)):
            poles = np.empty(0, complex)
            if np.isfinite(n):
                poles = loop_poles(transfer, element, float(amplitudes[i]), float(w[i]), complex(n))
            turning = poles[np.imag(poles) > 1e-6 * np.abs(poles)]
            if turning.size:
                w[i] = complex(turning[int(np.argmax(np.real(turning)))]).imag
            rows.append(poles)
        if np.abs(np.log(w / previous)).max() < 1e-6:
            break
    most = max(row.size for row in rows)
    # where a lag has no phase to give, the order falls and the row has fewer poles
    complete = [i for i, row in enumerate(rows) if most and row.size == most]
    if not complete:
        raise InputError(
            "The quasi-linear loop has no poles at these amplitudes.",
            "Choose amplitudes at which the element has an output.",
        )
    return amplitudes[complete], np.array([rows[i] for i in complete])


def axis_crossings(a: np.ndarray, poles: np.ndarray) -> list[tuple[float, float, bool]]:
    """Where a pair crosses the imaginary axis: amplitude, frequency, and whether to the left."""
    crossed = []
    upper = np.where(np.imag(poles) > 1e-6 * np.abs(poles), poles, -np.inf)
    best = np.argmax(np.real(upper), axis=1)
    pair = upper[np.arange(a.size), best]
    for i in range(a.size - 1):
        start, end = pair[i], pair[i + 1]
        if np.isfinite(start.real) and np.isfinite(end.real) and start.real * end.real < 0:
            share = start.real / (start.real - end.real)
            amplitude = a[i] * (a[i + 1] / a[i]) ** share
            w = start.imag + share * (end.imag - start.imag)
            crossed.append((float(amplitude), float(w), bool(end.real < 0)))
    return crossed

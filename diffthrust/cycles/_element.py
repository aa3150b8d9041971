"""Nonlinear elements of a loop: what a describing function, a balance and a simulation ask of them.

An element answers a sine of amplitude A at its input by an output whose fundamental is N(A, w)
times that sine: the describing function (Gelb & Vander Velde 1968, chapter 2).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from diffthrust._support.transfer import Transfer
from diffthrust._support.validation import finite
from diffthrust.cycles._oscillation import CycleSeries, LoopCourse


class NotSimulated(Exception):
    """A loop that cannot be simulated from a cycle; its text says why."""


class Nonlinearity(ABC):
    """A nonlinear element: how it answers a sine, and what a search for limit cycles asks besides.

    `describing` is enough for cycles to be found; with `balanced` they are refined, and with
    `courses` simulated.

    Example:
        >>> relay = dft.cycles.Relay(1.0)
        >>> isinstance(relay, dft.cycles.Nonlinearity), relay.scale
        (True, None)
        >>> relay.describing(2.0, 1.0).round(3)
        np.complex128(0.637+0j)
    """

    odd: bool = True
    """The output of -e is minus that of e, so that there are no even harmonics."""
    least: float = 0.0
    """Below this amplitude it has no output, or none that is known."""
    delay: float = 0.0
    """A dead time [s] before it, which `describing` leaves to the linear part."""
    unit: str = ""
    """Unit of the input."""
    lags: bool = True
    """Its describing function depends on the frequency, too."""
    cells: tuple[int, int] = (32, 32)
    """Amplitudes and frequencies of the grid on which cycles are sought."""
    inward: tuple[float, float] = (10.0, 0.1)
    """On the ends of the widest range of frequencies, for the default one."""
    harmonics: int = 15
    """The highest in the balance, by default."""

    @property
    def scale(self) -> float | None:
        """The input at which the behaviour changes; ``None`` where there is none."""
        return None

    @abstractmethod
    def describing(self, amplitude: ArrayLike, frequency: ArrayLike) -> np.ndarray:
        """The describing function N(A, w), complex.

        Args:
            amplitude: of the sine at the input, positive.
            frequency: of the sine [rad/s], positive; broadcast with the amplitude.

        Returns:
            Fundamental of the output over the input; NaN where there is none.
        """

    def quasi_linear(
        self, n: complex, amplitude: float, frequency: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """A real rational function of s that equals N at ``s = jw``, for the poles of the loop.

        Args:
            n: the describing function there.
            amplitude: of the sine at the input.
            frequency: w [rad/s].

        Returns:
            Coefficients of numerator and denominator, highest power first.
        """
        # re + im s / w is the lowest order that is real in s and equals a complex N at s = jw
        if abs(n.imag) < 1e-12 * abs(n):
            return np.array([n.real]), np.ones(1)
        return np.array([n.imag / frequency, n.real]), np.ones(1)

    def amplitudes(self, transfer: Transfer, frequencies: np.ndarray) -> np.ndarray:
        """The amplitudes at which cycles are sought by default, rising."""
        return np.geomspace(1e-3, 1e2, self.cells[0])

    def balanced(
        self, transfer: Transfer, amplitude: float, frequency: float, harmonics: int
    ) -> CycleSeries | None:
        """The cycle near a solution of the describing function, by a balance of harmonics.

        Args:
            transfer: the linear part.
            amplitude: of the fundamental, the first guess.
            frequency: [rad/s], the first guess.
            harmonics: the highest harmonic.

        Returns:
            ``None`` where the balance does not converge near the guess.
        """
        return None

    def courses(
        self, transfer: Transfer, cycle: CycleSeries, factors: tuple[float, ...], periods: int
    ) -> list[LoopCourse]:
        """Simulate the loop from starts on a cycle, made larger or smaller.

        Args:
            transfer: the linear part.
            cycle: where to start.
            factors: on the cycle's size at the start, one simulation for each.
            periods: how long, in periods of the cycle.

        Raises:
            NotSimulated: and why.
        """
        raise NotSimulated("the element says nothing of its course in time")


def positive(what: str, value: Any, zero: bool = False) -> float:
    """A number above zero (or not below it)."""
    expected = "a number zero or more" if zero else "a number above zero"
    return finite(what, value, lambda x: x > 0 or (zero and x == 0), expected)

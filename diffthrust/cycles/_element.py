"""Nonlinear elements of a loop, what is asked of them, and the oscillations that they answer with.

An element answers a sine of amplitude A at its input by an output whose fundamental is N(A, w)
times that sine: the describing function (Gelb & Vander Velde 1968, chapter 2).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from diffthrust._support.results import Brief
from diffthrust._support.transfer import Transfer
from diffthrust._support.validation import finite

STEPS_A_PERIOD = 256
"""Steps of a simulation per period of the cycle."""
BEYOND = 1e3
"""A course is followed until it is this many times as large as the cycle."""


@dataclass(frozen=True, repr=False)
class Oscillation(Brief):
    """A periodic signal at the input of the nonlinear element.

    Args:
        amplitude: of the fundamental.
        peak: half the distance from the lowest to the highest value.
        frequency: [rad/s].
        offset: mean value.
    """

    amplitude: float
    peak: float
    frequency: float
    offset: float

    @property
    def period(self) -> float:
        """Length of a turn [s]."""
        return 2.0 * math.pi / self.frequency


@dataclass(frozen=True, repr=False)
class CycleSeries(Brief):
    """Input and output of the element over a period: the real part of sum c_k exp(j k w t).

    Args:
        frequency: w [rad/s].
        order: the k, ``(m,)``, rising, with 1 among them.
        input: coefficients of the input, complex ``(m,)``.
        output: coefficients of the output, complex ``(m,)``.
        states: those of the element's states, complex ``(states, m)``; ``None`` where it has none,
            or they are not known.
    """

    frequency: float
    order: np.ndarray
    input: np.ndarray
    output: np.ndarray
    states: np.ndarray | None = None

    def signal(self, coefficients: np.ndarray, time: np.ndarray) -> np.ndarray:
        """Values at times [s], ``(n,)``."""
        turn = np.exp(1j * self.frequency * np.outer(time, self.order))
        return np.real(turn @ coefficients)

    @property
    def fundamental(self) -> complex:
        """The input's first coefficient beside its mean."""
        return complex(self.input[int(np.flatnonzero(self.order == 1)[0])])

    def linear_states(self, transfer: Transfer) -> np.ndarray:
        """States of the linear part at the start, ``(n,)``.

        The mean of a state behind an integrator follows from the mean of the element's input.
        """
        a, b, c, d = transfer.state_space()
        x = np.zeros(transfer.order)
        for k, e, y in zip(self.order, self.input, self.output, strict=True):
            s = 1j * self.frequency * k
            y = y * np.exp(-transfer.delay * s)
            # (s I - A) x = B y is singular at a pole of G: C x = -e - D y selects the solution
            rows = np.vstack([s * np.eye(transfer.order) - a, c[None, :].astype(complex)])
            wanted = np.append(b * y, -e - d * y)
            x += np.linalg.lstsq(rows, wanted, rcond=None)[0].real
        return x

    def near(self, amplitude: float, frequency: float) -> bool:
        """Whether it still is the oscillation that was guessed, and no other one."""
        size, pace = abs(self.fundamental) / amplitude, self.frequency / frequency
        # harmonics move amplitude and frequency by parts of themselves; a factor of two or three is
        # another cycle
        return 0.3 < size < 3.0 and 0.5 < pace < 2.0

    @property
    def oscillation(self) -> Oscillation:
        """The input in numbers."""
        time = np.linspace(0.0, 2.0 * math.pi / self.frequency, 1024, endpoint=False)
        e = self.signal(self.input, time)
        offset = float(self.input[0].real) if self.order[0] == 0 else 0.0
        return Oscillation(
            float(abs(self.fundamental)), 0.5 * float(np.ptp(e)), self.frequency, offset
        )


@dataclass(frozen=True, repr=False)
class LoopCourse(Brief):
    """A simulated course of the element's input.

    Args:
        time: [s], evenly spaced, ``(n,)``.
        input: the element's input, ``(n,)``.
        output: the element's output, ``(n,)``.
        fled: the simulation was ended because it had grown a thousandfold.
    """

    time: np.ndarray
    input: np.ndarray
    output: np.ndarray
    fled: bool


@dataclass(frozen=True, repr=False)
class LimitCycle(Brief):
    """One limit cycle.

    Args:
        amplitude: of the fundamental at the element's input, by the describing function.
        frequency: [rad/s], by the describing function.
        stable: whether it lasts by the quasi-static criterion; ``None``: undecided.
        growth: how fast a relative deviation of the amplitude grows [1/s] by that criterion.
        at_edge: it lies at the edge of the range that was searched.
        refined: the same by a balance of more harmonics; ``None`` where that was not asked for or
            did not converge near it.
        simulated: the same as measured in a full simulation; of an unstable one its first turns.
        lasts: whether simulations from 10 % below and above come back; ``None``: undecided.
        simulation: what they did, in words.
        harmonics: Fourier coefficients of the refined cycle.

    Example:
        >>> result = dft.cycles.limit_cycles(
        ...     ([6.0], [1, 3, 2, 0]), dft.cycles.Relay(1.0), verify=False
        ... )
        >>> cycle = result.cycles[0]
        >>> round(cycle.amplitude, 2), round(cycle.frequency, 3), cycle.stable
        (1.27, 1.414, True)
        >>> cycle.verdict, round(cycle.best.frequency, 3), round(cycle.described.frequency, 3)
        ('stable', 1.414, 1.414)
    """

    amplitude: float
    frequency: float
    stable: bool | None
    growth: float
    at_edge: bool
    refined: Oscillation | None = None
    simulated: Oscillation | None = None
    lasts: bool | None = None
    simulation: str = "not simulated"
    harmonics: CycleSeries | None = field(repr=False, default=None)

    @property
    def described(self) -> Oscillation:
        """What the describing function says of it."""
        return Oscillation(self.amplitude, self.amplitude, self.frequency, 0.0)

    @property
    def best(self) -> Oscillation:
        """The most faithful numbers there are: refined, simulated, or the describing function's."""
        return self.refined or self.simulated or self.described

    @property
    def verdict(self) -> str:
        """``"stable"``, ``"unstable"`` or ``"undecided"``: the simulation's word before others."""
        # the quasi-static criterion is first order in the deviation: a full simulation overrules it
        word = self.lasts if self.lasts is not None else self.stable
        return "undecided" if word is None else "stable" if word else "unstable"


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

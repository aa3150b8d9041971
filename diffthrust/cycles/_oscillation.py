"""A limit cycle in numbers: from Fourier coefficients, or measured in a simulated course."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from diffthrust._support.results import Brief
from diffthrust._support.transfer import Transfer

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

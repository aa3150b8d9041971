"""Elements that answer the course of their input, however fast: curves, perhaps with memory."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from diffthrust._support.errors import InputError
from diffthrust._support.transfer import Transfer
from diffthrust.cycles._balance_static import balanced
from diffthrust.cycles._element import Nonlinearity, NotSimulated, positive
from diffthrust.cycles._oscillation import CycleSeries, LoopCourse
from diffthrust.cycles._run_static import simulated

_GAUSS = np.polynomial.legendre.leggauss(64)
_NUDGE = 1e-9


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
        a, _ = np.broadcast_arrays(np.asarray(amplitude, float), np.asarray(frequency, float))
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
            beyond = self.scale * np.geomspace(1e-5, 1e5, count)
            return self.least + beyond
        # an ideal relay has no scale of its own: A = |G| times the fundamental of its output
        gain = np.abs(transfer(1j * frequencies)) * np.abs(self.describing(1.0, 1.0))
        gains = gain[np.isfinite(gain) & (gain > 0)]
        return np.geomspace(0.5 * gains.min(), 2.0 * gains.max(), count)

    def balanced(
        self, transfer: Transfer, amplitude: float, frequency: float, harmonics: int
    ) -> CycleSeries | None:
        """The cycle near a solution of the describing function."""
        return balanced(transfer, self, amplitude, frequency, harmonics)

    def courses(
        self, transfer: Transfer, cycle: CycleSeries, factors: tuple[float, ...], periods: int
    ) -> list[LoopCourse]:
        """Simulate the loop from starts on a cycle."""
        if transfer.direct:
            raise NotSimulated("the linear part passes a step at once to an element that does")
        return [simulated(transfer, self, cycle, factor, periods) for factor in factors]

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
        cuts = [
            (jump - before) / rise
            for jump in self.jumps
            if min(before, after) < jump < max(before, after)
        ]
        if not cuts:
            tiny = _NUDGE * rise
            return self.at(before + tiny), self.at(after - tiny), memory
        ends = [0.0, *sorted(cuts), 1.0]
        pieces = []
        for s, t in pairwise(ends):
            inward = _NUDGE * (t - s)
            first, last = before + (s + inward) * rise, before + (t - inward) * rise
            pieces.append((s, t, self.at(first), self.at(last)))
        return (*straight(pieces), memory)


def straight(pieces: Sequence[tuple[float, float, float, float]]) -> tuple[float, float]:
    """The line over a step that has the mean and the first moment of a broken one.

    Args:
        pieces: ``(start, end, value at the start, value at the end)``, in shares of the step.
    """
    mean = moment = 0.0
    for s, t, u, v in pieces:
        width = t - s
        mean += 0.5 * width * (u + v)
        moment += width * (0.5 * s * (u + v) + width * (u / 6.0 + v / 3.0))
    slope = 12.0 * (moment - 0.5 * mean)
    return mean - 0.5 * slope, mean + 0.5 * slope


class StaticNonlinearity(Static):
    """A curve of your own, without memory; its describing function comes by quadrature.

    Args:
        function: from inputs to outputs, arrays of the same shape ``(n,)``.
        jumps: inputs at which it jumps.
        bends: inputs at which it bends sharply.
        scale: the input at which its behaviour changes, for the default range of a search.
        name: a word for reports and figures.

    Raises:
        InputError: it is no function, or does not give finite numbers of the same shape.

    Example:
        >>> cubic = dft.cycles.StaticNonlinearity(lambda e: e**3)
        >>> cubic.describing(1.0, 1.0).round(3), cubic.scale, cubic.over(np.array([2.0]))
        (np.complex128(0.75+0j), 1.0, array([8.]))
    """

    def __init__(
        self,
        function: Callable[[np.ndarray], object],
        *,
        jumps: Sequence[float] = (),
        bends: Sequence[float] = (),
        scale: float = 1.0,
        name: str = "function",
    ) -> None:
        if not callable(function):
            raise InputError(
                f"Expected a function from inputs to outputs, found {function!r}.",
                "Give a function of one array, such as lambda e: e**3.",
            )
        self.function: Callable[[np.ndarray], object] = function
        self.name: str = name
        self.jumps: tuple[float, ...] = tuple(float(jump) for jump in jumps)
        self.bends: tuple[float, ...] = (*self.jumps, *(float(bend) for bend in bends))
        self._scale = positive("scale", scale)
        probe = self._scale * np.linspace(0.03, 2.03, 9)
        self.odd: bool = bool(np.allclose(self.over(-probe), -self.over(probe), rtol=1e-9))

    @property
    def scale(self) -> float:
        """The input at which the behaviour changes, as given."""
        return self._scale

    def over(self, e: np.ndarray) -> np.ndarray:
        """The function's values."""
        with np.errstate(all="ignore"):  # what is not finite is named below
            out = np.asarray(self.function(e), float)
        if out.shape != e.shape or not np.isfinite(out).all():
            raise InputError(
                f"The nonlinear element '{self.name}': expected {e.size} finite outputs for inputs "
                f"between {e.min():.4g} and {e.max():.4g}, found shape {out.shape}"
                + (", not all finite." if out.shape == e.shape else "."),
                "Let the function act on every entry of an array and stay finite there, or search "
                "smaller amplitudes.",
            )
        return out

    def __str__(self) -> str:
        return self.name

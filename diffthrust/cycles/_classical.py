"""Relay, saturation, dead zone and backlash with closed describing functions; curves of your own.

Source: Gelb & Vander Velde 1968, appendix B; Slotine & Li 1991, section 5.2.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from diffthrust._support.errors import InputError
from diffthrust.cycles._element import positive
from diffthrust.cycles._static_element import Static, amplitudes_of, straight


class Relay(Static):
    """A switch: ``level`` times the sign of the input.

    Args:
        level: size of the output.
        hysteresis: how far the input must pass zero before the output changes its sign.
        dead_zone: half the width of the band around zero in which the output is zero.

    Raises:
        InputError: a size that is not positive, or hysteresis and dead zone at once.

    Example:
        >>> relay = dft.cycles.Relay(1.0, hysteresis=0.1)
        >>> relay.scale, relay.describing(1.0, 2.0).round(3)
        (0.1, np.complex128(1.267-0.127j))
        >>> relay.over(np.array([0.5, -0.5])), relay.rest(0.0), dft.cycles.Relay(1.0).at(0.5)
        (array([ 1., -1.]), 1.0, 1.0)
    """

    def __init__(self, level: float, *, hysteresis: float = 0.0, dead_zone: float = 0.0) -> None:
        self.level: float = positive("level", level)
        self.hysteresis: float = positive("hysteresis", hysteresis, zero=True)
        self.dead_zone: float = positive("dead_zone", dead_zone, zero=True)
        if hysteresis and dead_zone:
            raise InputError(
                "A relay with both hysteresis and a dead zone is not provided.",
                "Leave one of them out.",
            )
        self.least: float = self.hysteresis or self.dead_zone
        self.jumps: tuple[float, ...] = (
            () if hysteresis else tuple({-self.dead_zone, self.dead_zone})
        )
        self.bends: tuple[float, ...] = self.jumps or (-self.hysteresis, self.hysteresis)

    @property
    def scale(self) -> float | None:
        """Hysteresis or half the dead zone; none for an ideal relay."""
        return self.least or None

    def describing(self, amplitude: ArrayLike, frequency: ArrayLike) -> np.ndarray:
        """4 level / (pi A) (sqrt(1 - (b/A)^2) - j h/A), with b the hysteresis h or dead zone."""
        a = amplitudes_of(amplitude, frequency)
        share = self.least / a
        cosine = np.sqrt(np.maximum(0.0, 1.0 - share**2))
        turned = share if self.hysteresis else 0.0
        silent = np.nan if self.hysteresis else 0.0  # it does not switch: its sign is unknown
        n = 4.0 * self.level / (math.pi * a) * (cosine - 1j * turned)
        return np.where(a > self.least, n, silent)

    def over(self, e: np.ndarray) -> np.ndarray:
        """The output over a settled period."""
        if not self.hysteresis:
            return self.level * np.where(np.abs(e) > self.dead_zone, np.sign(e), 0.0)
        # the first period sets the memory, the second is the settled output
        twice = np.concatenate([e, e])
        decided = np.abs(twice) > self.hysteresis
        last = np.maximum.accumulate(np.where(decided, np.arange(twice.size), 0))
        return self.level * np.sign(twice[last])[e.size :]

    def at(self, e: float) -> float:
        """The output of a relay without hysteresis."""
        return math.copysign(self.level, e) if abs(e) > self.dead_zone else 0.0

    def rest(self, e: float) -> float:
        """The present output."""
        return self.level if e >= 0 else -self.level

    def passage(self, before: float, after: float, memory: Any) -> tuple[float, float, Any]:
        """The output as the input goes straight from one value to another."""
        if not self.hysteresis:
            return super().passage(before, after, memory)
        # it switches only when the input crosses the edge opposite to its present sign
        edge = math.copysign(self.hysteresis, -memory)
        if (after - edge) * memory >= 0:
            return memory, memory, memory
        share = min(1.0, max(0.0, (edge - before) / (after - before))) if after != before else 0.0
        line = straight([(0.0, share, memory, memory), (share, 1.0, -memory, -memory)])
        return (*line, -memory)

    def __str__(self) -> str:
        more = f", hysteresis {self.hysteresis:.4g}" if self.hysteresis else ""
        more += f", dead zone {self.dead_zone:.4g}" if self.dead_zone else ""
        return f"relay of level {self.level:.4g}{more}"


class Saturation(Static):
    """Proportional up to a largest output.

    Args:
        limit: largest output.
        slope: gain of small inputs.

    Example:
        >>> limit = dft.cycles.Saturation(1.0, slope=2.0)
        >>> (
        ...     limit.scale,
        ...     limit.describing(5.0, 1.0).round(3),
        ...     limit.at(3.0),
        ...     limit.over(np.array([0.1])),
        ... )
        (0.5, np.complex128(0.254+0j), 1.0, array([0.2]))
    """

    def __init__(self, limit: float, *, slope: float = 1.0) -> None:
        self.limit: float = positive("limit", limit)
        self.slope: float = positive("slope", slope)
        self.bends: tuple[float, ...] = (-self.scale, self.scale)

    @property
    def scale(self) -> float:
        """The input at which the output stops to rise."""
        return self.limit / self.slope

    def describing(self, amplitude: ArrayLike, frequency: ArrayLike) -> np.ndarray:
        """2 k/pi (asin(d/A) + d/A sqrt(1 - (d/A)^2)), d = limit / k; k below d."""
        share = np.minimum(1.0, self.scale / amplitudes_of(amplitude, frequency))
        return (self.slope * _kept(share)).astype(complex)

    def over(self, e: np.ndarray) -> np.ndarray:
        """The output."""
        return np.clip(self.slope * e, -self.limit, self.limit)

    def at(self, e: float) -> float:
        """The output."""
        return max(-self.limit, min(self.limit, self.slope * e))

    def __str__(self) -> str:
        return f"saturation at {self.limit:.4g}, slope {self.slope:.4g}"


class DeadZone(Static):
    """Nothing within a band around zero, proportional to what lies beyond it.

    Args:
        width: half the width of the band.
        slope: gain beyond it.

    Example:
        >>> zone = dft.cycles.DeadZone(0.5)
        >>> zone.describing(1.0, 1.0).round(3), zone.at(0.75), zone.over(np.array([0.2, 1.0]))
        (np.complex128(0.391+0j), 0.25, array([0. , 0.5]))
    """

    def __init__(self, width: float, *, slope: float = 1.0) -> None:
        self.width: float = positive("width", width)
        self.slope: float = positive("slope", slope)
        self.least: float = self.width
        self.bends: tuple[float, ...] = (-self.width, self.width)

    @property
    def scale(self) -> float:
        """Half the width of the band."""
        return self.width

    def describing(self, amplitude: ArrayLike, frequency: ArrayLike) -> np.ndarray:
        """The slope less the describing function of a saturation at the band; zero within it."""
        share = np.minimum(1.0, self.width / amplitudes_of(amplitude, frequency))
        return (self.slope * (1.0 - _kept(share))).astype(complex)

    def over(self, e: np.ndarray) -> np.ndarray:
        """The output."""
        return self.slope * (e - np.clip(e, -self.width, self.width))

    def at(self, e: float) -> float:
        """The output."""
        return self.slope * (e - max(-self.width, min(self.width, e)))

    def __str__(self) -> str:
        return f"dead zone of {self.width:.4g}, slope {self.slope:.4g}"


class Backlash(Static):
    """Play of a gear: the output follows when the input has crossed the gap, and else stands.

    Args:
        gap: half the width of the play, in units of the input.
        slope: gain while in contact.

    Example:
        >>> gear = dft.cycles.Backlash(0.1)
        >>> gear.scale, gear.describing(1.0, 1.0).round(3)
        (0.1, np.complex128(0.948-0.115j))
        >>> gear.rest(1.0), gear.over(np.array([1.0, 0.95])).shape
        (1.0, (2,))
    """

    def __init__(self, gap: float, *, slope: float = 1.0) -> None:
        self.gap: float = positive("gap", gap)
        self.slope: float = positive("slope", slope)
        self.least: float = self.gap

    @property
    def scale(self) -> float:
        """Half the width of the play."""
        return self.gap

    def describing(self, amplitude: ArrayLike, frequency: ArrayLike) -> np.ndarray:
        """k/2 (1 + 2/pi (asin x + x sqrt(1-x^2))) - j 4 k b/(pi A) (1 - b/A), x = 1 - 2 b/A."""
        a = amplitudes_of(amplitude, frequency)
        share = np.minimum(1.0, self.gap / a)
        real = 0.5 * self.slope * (1.0 + _kept(1.0 - 2.0 * share))
        lag = 4.0 * self.slope / math.pi * share * (1.0 - share)
        return np.where(a > self.gap, real - 1j * lag, 0.0)

    def over(self, e: np.ndarray) -> np.ndarray:
        """The output over a settled period."""
        # at its highest input the play is taken up whatever came before: memory starts right
        start = int(np.argmax(e))
        held, out = float(e[start]) - self.gap, []
        for x in np.roll(e, -start).tolist():
            held = max(x - self.gap, min(x + self.gap, held))
            out.append(held)
        return self.slope * np.roll(out, start)

    def rest(self, e: float) -> float:
        """The present output."""
        return self.slope * e

    def passage(self, before: float, after: float, memory: Any) -> tuple[float, float, Any]:
        """The output as the input goes straight from one value to another."""
        low, high = self.slope * (after - self.gap), self.slope * (after + self.gap)
        moved = max(low, min(high, memory))
        return memory, moved, moved

    def __str__(self) -> str:
        return f"backlash of {self.gap:.4g}, slope {self.slope:.4g}"


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


def _kept(share: np.ndarray) -> np.ndarray:
    """2/pi (asin x + x sqrt(1 - x^2)): what a saturation at x of the amplitude lets through."""
    # rounding may take 1 - x^2 below zero at the corner
    return 2.0 / math.pi * (np.arcsin(share) + share * np.sqrt(np.maximum(0.0, 1.0 - share**2)))

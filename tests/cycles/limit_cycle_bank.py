"""Loops whose limit cycles are known: in closed form, or from one equation solved apart."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.optimize import brentq

from diffthrust.cycles import Backlash, DeadZone, Relay, Saturation, StaticNonlinearity


@dataclass(frozen=True)
class Case:
    """A loop and what is known of it.

    Args:
        name: what it is.
        linear: the linear part.
        element: the nonlinear element.
        expected: amplitude, frequency [rad/s] and stability of each solution of the balance,
            from small to large amplitude.
        ranges: arguments of the search.
        exact: peak and frequency of the cycle itself, where a closed form exists.
    """

    name: str
    linear: Any
    element: Any
    expected: tuple[tuple[float, float, bool], ...]
    ranges: dict[str, Any] = field(default_factory=dict)
    exact: tuple[float, float] | None = None

    def __str__(self) -> str:
        return self.name


def third_order(gain: float, a: float, b: float) -> tuple[list[float], list[float]]:
    """K / (s (s + a) (s + b)); it crosses the real axis at sqrt(ab), at -K / (ab (a + b))."""
    return [gain], [1.0, a + b, a * b, 0.0]


def kept(x: float) -> float:
    """What a saturation at x of the amplitude lets through."""
    return 2 / math.pi * (math.asin(x) + x * math.sqrt(1 - x * x))


def relay_third_order() -> list[Case]:
    """A = 4 M K / (pi ab (a + b)) at w = sqrt(ab)."""
    cases = []
    for gain, a, b, level in ((6.0, 1.0, 2.0, 1.0), (40.0, 2.0, 5.0, 0.3), (1.0, 0.2, 0.2, 3.0)):
        size = 4 * level * gain / (math.pi * a * b * (a + b))
        expected = ((size, math.sqrt(a * b), True),)
        name = f"relay {level:g}, poles 0, {a:g}, {b:g}"
        cases.append(Case(name, third_order(gain, a, b), Relay(level), expected))
    a, gain = 1.5, 20.0
    expected = ((4 * gain / (8 * a**3 * math.pi), math.sqrt(3) * a, True),)
    triple = ([gain], np.poly([-a, -a, -a]))
    cases.append(Case("relay, three equal poles", triple, Relay(1.0), expected))
    return cases


def relay_dead_time() -> list[Case]:
    """The phase of the dead time and the lag is pi; the cycles themselves have closed forms."""
    gain, lag, wait, level = 2.0, 3.0, 0.8, 1.0
    w = brentq(lambda w: w * wait + math.atan(w * lag) - math.pi, 0.1, math.pi / wait)
    size = 4 * level * gain / math.pi / math.hypot(1.0, w * lag)
    half = lag * math.log(2 * math.exp(wait / lag) - 1)
    exact = (gain * level * (1 - math.exp(-wait / lag)), math.pi / half)
    first = Case(
        "relay, lag and dead time",
        ([gain], [lag, 1.0], wait),
        Relay(level),
        ((size, w, True),),
        exact=exact,
    )
    gain, wait = 0.7, 0.5
    w = math.pi / (2 * wait)
    second = Case(
        "relay, integrator and dead time",
        ([gain], [1.0, 0.0], wait),
        Relay(level),
        ((4 * level * gain / (math.pi * w), w, True),),
        exact=(gain * level * wait, w),
    )
    return [first, second]


def relay_hysteresis() -> list[Case]:
    """Im G = -pi h / (4 M), Re G = -pi sqrt(A^2 - h^2) / (4 M), for K / (s (T s + 1))."""
    cases = []
    for gain, lag, h, level in ((1.0, 0.5, 0.1, 1.0), (5.0, 2.0, 0.4, 0.6)):
        sine = math.pi * h / (4 * level)
        # K / (w (1 + (T w)^2)) = sine
        cubic = np.roots([lag**2, 0.0, 1.0, -gain / sine])
        w = float(cubic[np.abs(cubic.imag) < 1e-9 * np.abs(cubic)].real[0])
        real = gain * lag / (1 + (w * lag) ** 2)
        size = math.hypot(4 * level * real / math.pi, h)
        cases.append(
            Case(
                f"relay with hysteresis {h:g}, motor",
                ([gain], [lag, 1.0, 0.0]),
                Relay(level, hysteresis=h),
                ((size, w, True),),
            )
        )
    return cases


def relay_dead_zone() -> list[Case]:
    """A^4 - c^2 A^2 + c^2 d^2 = 0, c = 4 M K / (pi ab (a + b)): two cycles, or none below 2 d."""
    gain, a, b, d = 12.0, 1.0, 2.0, 0.5
    c = 4 * gain / (math.pi * a * b * (a + b))
    root = math.sqrt(c * c - 4 * d * d)
    small, large = (math.sqrt(c * (c + sign * root) / 2) for sign in (-1, 1))
    w = math.sqrt(a * b)
    linear = third_order(gain, a, b)
    two = ((small, w, False), (large, w, True))
    return [
        Case("relay with dead zone: two cycles", linear, Relay(1.0, dead_zone=d), two),
        Case("relay with wide dead zone: none", linear, Relay(1.0, dead_zone=0.51 * c), ()),
    ]


def saturated() -> list[Case]:
    """The kept share equals the inverse of the gain on the real axis."""
    a, b, w = 1.0, 2.0, math.sqrt(2.0)
    limit = a * b * (a + b)
    share = brentq(lambda x: kept(x) - limit / 15.0, 1e-9, 1.0)
    one = Case(
        "saturation: one cycle",
        third_order(15.0, a, b),
        Saturation(1.0),
        ((1.0 / share, w, True),),
    )
    none = Case("saturation, low gain: none", third_order(5.0, a, b), Saturation(1.0), ())
    # 3 (s + 2)^2 / s^3 is -3 at 2 rad/s: stable where the gain is above a third
    share = brentq(lambda x: kept(x) - 1.0 / 3.0, 1e-9, 1.0)
    conditional = Case(
        "saturation, conditionally stable: one unstable cycle",
        ([3.0, 12.0, 12.0], [1.0, 0.0, 0.0, 0.0]),
        Saturation(1.0),
        ((1.0 / share, 2.0, False),),
    )
    num, den = 40.0 * np.poly([-3.0, -3.0]) / 9.0, np.poly([0.0, -0.2, -0.2])
    w = _real_axis(num, den)
    gains = [-(np.polyval(num, 1j * x) / np.polyval(den, 1j * x)).real for x in w]
    sizes = [1.0 / brentq(lambda x, g=g: kept(x) - 1.0 / g, 1e-9, 1.0) for g in gains]
    order = np.argsort(sizes)
    both = tuple((sizes[i], w[i], stable) for i, stable in zip(order, (False, True), strict=True))
    two = Case("saturation, conditionally stable: two cycles", (num, den), Saturation(1.0), both)
    return [one, none, conditional, two]


def _real_axis(num: np.ndarray, den: np.ndarray) -> list[float]:
    """Frequencies at which num / den is real: roots of the imaginary part of num conj(den)."""

    def along(c: np.ndarray) -> np.ndarray:
        powers = np.arange(c.size - 1, -1, -1)
        return c * 1j**powers

    whole = np.polymul(along(num), along(den).conj()).imag
    roots = np.roots(np.trim_zeros(whole, "f"))
    return sorted(float(r.real) for r in roots if abs(r.imag) < 1e-9 * abs(r) and r.real > 1e-9)


def dead_zones() -> list[Case]:
    """Outside the dead zone the loop is unstable, within it nothing happens."""
    a, b, w = 1.0, 2.0, math.sqrt(2.0)
    share = brentq(lambda x: 1.0 - kept(x) - 6.0 / 15.0, 1e-9, 1.0)
    one = ((0.2 / share, w, False),)
    return [
        Case("dead zone: one unstable cycle", third_order(15.0, a, b), DeadZone(0.2), one),
        Case("dead zone, low gain: none", third_order(5.0, a, b), DeadZone(0.2), ()),
    ]


def with_backlash() -> list[Case]:
    """K / (s (s + 1)): the balance solved for the amplitude at the w that its phase asks for."""
    gain, gap = 10.0, 0.1

    def n(size: float) -> complex:
        x = 1 - 2 * gap / size
        real = 0.5 * (1 + 2 / math.pi * (math.asin(x) + x * math.sqrt(1 - x * x)))
        return complex(real, -4 * gap / (math.pi * size) * (1 - gap / size))

    def missed(size: float) -> float:
        """From jw (jw + 1) + K N = 0: w = -K Im N, w^2 = K Re N."""
        return gain * n(size).imag ** 2 - n(size).real

    grid = gap * np.geomspace(1.001, 100, 4000)
    sizes = [
        brentq(missed, one, two) for one, two in pairwise(grid) if missed(one) * missed(two) < 0
    ]
    expected = tuple(
        (size, -gain * n(size).imag, stable)
        for size, stable in zip(sizes, (False, True), strict=True)
    )
    low = Case("backlash, low gain: none", ([1.0], [1.0, 1.0, 0.0]), Backlash(gap), ())
    motor = ([gain], [1.0, 1.0, 0.0])
    return [Case("backlash and motor: two cycles", motor, Backlash(gap), expected), low]


def smooth() -> list[Case]:
    """A cube has N = 3/4 A^2."""
    a, b = 1.0, 2.0
    cube = StaticNonlinearity(lambda e: e**3, name="cube")
    size = math.sqrt(4 * a * b * (a + b) / (3 * 6.0))
    mu = 0.3
    third = StaticNonlinearity(lambda x: x**3 / 3, name="third of a cube")
    return [
        Case("cube: one unstable cycle", third_order(6.0, a, b), cube, ((size, 2**0.5, False),)),
        Case("Van der Pol", ([mu, 0.0], [1.0, -mu, 1.0]), third, ((2.0, 1.0, True),)),
        Case("straight line, stable: none", third_order(3.0, a, b), lambda e: 1.0 * e, ()),
        Case("straight line, unstable: none", third_order(9.0, a, b), lambda e: 1.0 * e, ()),
        Case(
            "saturation and double integrator: none", ([1.0], [1.0, 0.0, 0.0]), Saturation(1.0), ()
        ),
    ]


BANK = [
    *relay_third_order(),
    *relay_dead_time(),
    *relay_hysteresis(),
    *relay_dead_zone(),
    *saturated(),
    *dead_zones(),
    *with_backlash(),
    *smooth(),
]

"""Linear systems from coefficients or from objects of python-control and SciPy."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.validation import finite, finite_row

_PADE = 6
"""Order of the rational function that replaces a dead time where poles are needed."""


@dataclass(frozen=True, eq=False)
class Transfer:
    """A linear system with one input and one output: num(s) / den(s) * exp(-delay s).

    Args:
        num: coefficients of the numerator, highest power first, ``(m + 1,)``, ``m <= n``.
        den: coefficients of the denominator, highest power first, ``(n + 1,)``, the first one 1.
        delay: dead time [s].
    """

    num: np.ndarray
    den: np.ndarray
    delay: float = 0.0

    def __call__(self, s: Any) -> np.ndarray:
        """The transfer function at complex frequencies [1/s], of any shape; inf at a pole."""
        s = np.asarray(s, complex)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.polyval(self.num, s) * np.exp(-self.delay * s) / np.polyval(self.den, s)

    @property
    def order(self) -> int:
        """Number of states, without the dead time."""
        return self.den.size - 1

    @property
    def poles(self) -> np.ndarray:
        """Poles [1/s], ``(n,)``."""
        return np.roots(self.den)

    @property
    def corners(self) -> np.ndarray:
        """Corner frequencies [rad/s]: of poles and zeros; |G| = 1 for a pure power of s."""
        places = np.abs(np.concatenate([self.poles, np.roots(self.num)]))
        largest = float(places.max(initial=0.0))
        turning = places[places > 1e-9 * largest]
        if not turning.size:  # K / s^n
            gain = abs(float(self.num[-1]))
            turning = np.array([gain ** (1.0 / self.order) if self.order and gain else 1.0])
        return np.sort(turning)

    @property
    def direct(self) -> float:
        """Direct feedthrough: the part of a step that passes at once."""
        return float(self.num[0]) if self.num.size == self.den.size else 0.0

    def state_space(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
        """Matrices ``(n, n)``, ``(n,)``, ``(n,)`` and a number, without the dead time.

        The companion form in a time unit in which the denominator's coefficients are of size one:
        by itself it is badly scaled.
        """
        n = self.order
        sizes = (abs(c) ** (1.0 / k) for k, c in enumerate(self.den) if k and c)
        unit = max(sizes, default=1.0)
        power = unit ** np.arange(n + 1)
        den = self.den / power
        num = np.concatenate([np.zeros(n + 1 - self.num.size), self.num]) / power
        a, b = np.eye(n, k=-1), np.zeros(n)
        a[:1], b[:1] = -den[1:], 1.0
        return unit * a, unit * b, num[1:] - num[0] * den[1:], float(num[0])

    def later(self, delay: float) -> Transfer:
        """The same with a further dead time [s]."""
        return replace(self, delay=self.delay + delay)

    def rational(self) -> Transfer:
        """The same without dead time, which becomes an all-pass (Pade)."""
        if not self.delay:
            return self
        weights = [math.comb(_PADE, k) / math.perm(2 * _PADE, k) for k in range(_PADE + 1)]
        plus = np.array([w * self.delay**k for k, w in enumerate(weights)])[::-1]
        minus = plus * (-1.0) ** np.arange(_PADE + 1)[::-1]
        num, den = np.polymul(self.num, minus), np.polymul(self.den, plus)
        return Transfer(num / den[0], den / den[0])

    def stepper(self, step: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Exact step [s] of the states for an input that is a straight line within it.

        Matrix ``(n, n)`` for the states, and what the line's start and end add, ``(n,)`` each.
        """
        from scipy.linalg import expm  # slow to import

        a, b, _, _ = self.state_space()
        n = self.order
        # Van Loan's method (1978): the exponential of one block matrix gives the integrals over the
        # input's constant and ramp as well, without an inverse of `a`, singular for an integrator.
        block = np.zeros((n + 2, n + 2))
        block[:n, :n] = a * step
        block[:n, n] = b * step
        block[n, n + 1] = 1.0
        grown = expm(block)
        return grown[:n, :n], grown[:n, n] - grown[:n, n + 1], grown[:n, n + 1]

    def __str__(self) -> str:
        delay = f" exp(-{self.delay:.4g} s)" if self.delay else ""
        return f"({_polynomial(self.num)}) / ({_polynomial(self.den)}){delay}"


def transfer_of(linear: Any) -> Transfer:
    """A linear system from numbers or from an object.

    ``linear`` is ``(num, den)`` or ``(num, den, delay)`` with coefficients highest power first and
    the dead time [s]; or an object with ``num`` and ``den``, or ``A``, ``B``, ``C``, ``D``, such as
    those of python-control and SciPy. An `InputError` refuses what is not one of these, has several
    inputs or outputs, discrete time or more zeros than poles.
    """
    if isinstance(linear, Transfer):
        return linear
    if getattr(linear, "dt", None) not in (None, 0, 0.0, False):
        raise InputError(
            f"The linear part has the sample time {linear.dt}; limit cycles are sought in "
            "continuous time.",
            "Give the continuous transfer function, the sampling as a dead time of half a sample.",
        )
    delay: Any = 0.0
    if hasattr(linear, "num") and hasattr(linear, "den"):
        num, den = linear.num, linear.den
    elif all(hasattr(linear, name) for name in "ABCD"):
        num, den = _from_states(*(getattr(linear, name) for name in "ABCD"))
    elif isinstance(linear, Sequence) and not isinstance(linear, str) and len(linear) in (2, 3):
        num, den, delay = (*linear, 0.0)[:3]
    else:
        raise InputError(
            f"The linear part: expected (num, den), (num, den, delay) or an object with num and "
            f"den or A, B, C, D; found {linear!r}.",
            "Write ([1.0], [1.0, 2.0, 1.0]) for 1 / (s^2 + 2 s + 1).",
        )
    num, den = _coefficients(num, "numerator"), _coefficients(den, "denominator")
    if num.size > den.size:
        raise InputError(
            f"The linear part ({_polynomial(num)}) / ({_polynomial(den)}) is improper: its "
            f"numerator has degree {num.size - 1}, its denominator {den.size - 1}; no plant "
            "differentiates its input.",
            "Multiply the plant into it, or add the lag that limits the derivative.",
        )
    expected, mend = (
        "a number of seconds, zero or more",
        "Correct the third entry of the linear part.",
    )
    wait = finite("The dead time", delay, lambda x: x >= 0, expected, mend)
    return Transfer(num / den[0], den / den[0], wait)


def _coefficients(value: Any, what: str) -> np.ndarray:
    while isinstance(value, list | tuple | np.ndarray) and np.ndim(value) > 1:
        if len(value) != 1:  # python-control nests them by output and input
            raise InputError(
                f"The linear part has {len(value)} inputs or outputs; a limit cycle is sought in a "
                "loop with one.",
                "Pick one element of the transfer matrix.",
            )
        value = value[0]
    row = finite_row(value)
    if row is None:
        raise InputError(
            f"The {what} of the linear part: expected finite real coefficients, highest power "
            f"first; found {value!r}.",
            "Write a list such as [1.0, 2.0, 1.0] for s^2 + 2 s + 1.",
        )
    row = row[int(np.argmax(row != 0)) :] if row.any() else row[:0]
    if not row.size:
        raise InputError(
            f"The {what} of the linear part is zero.", "Give at least one coefficient that is not."
        )
    return row


def _from_states(a: Any, b: Any, c: Any, d: Any) -> tuple[Any, Any]:
    a, b, c, d = (np.atleast_2d(np.asarray(matrix, float)) for matrix in (a, b, c, d))
    if d.shape != (1, 1):
        raise InputError(
            f"The linear part has {d.shape[1]} inputs and {d.shape[0]} outputs; a limit cycle is "
            "sought in a loop with one of each.",
            "Pick one input and one output.",
        )
    if not a.size:
        return d[0], np.ones(1)
    from scipy.signal import ss2tf  # slow to import

    num, den = ss2tf(a, b, c, d)
    # ss2tf leaves leading coefficients of rounding size, each a zero at a very high frequency
    num = np.where(np.abs(num[0]) < 1e-12 * np.abs(num[0]).max(), 0.0, num[0])
    return num, den


def _polynomial(c: np.ndarray) -> str:
    words = []
    for power, value in zip(range(c.size - 1, -1, -1), c, strict=True):
        if value:
            size = f"{value:.4g}"
            unit = {0: "", 1: "s"}.get(power, f"s^{power}")
            words.append(size if not unit else unit if size == "1" else f"{size} {unit}")
    return " + ".join(words).replace("+ -", "- ") or "0"

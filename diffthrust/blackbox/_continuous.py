"""Conversion from sampled to continuous time."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust.blackbox._system import System

Method = Literal["zero", "linear", "tustin"]
_CLOSE = 1e-6


def continued(system: System, step: float, method: str) -> tuple[np.ndarray, ...]:
    """A, B, C and D of the continuous system whose sampling gives a system.

    The input between samples is held (``"zero"``) or ``"linear"``, which is inverted exactly;
    ``"tustin"`` is the bilinear transformation, for any system without a pole at -1.
    """
    a, b, c, d = system.a, system.b, system.c, system.d
    n = len(a)
    if method == "tustin":
        if np.min(np.abs(np.linalg.eigvals(a) + 1.0)) < 1e-9:
            raise InputError(
                "The sampled model has a pole at -1, which the bilinear transformation has not.",
                "Choose another order.",
            )
        inverse = np.linalg.inv(a + np.eye(n))
        # shared between B and C, as in control texts: the gramians stay those of the sampled system
        root = 2.0 / np.sqrt(step)
        return (2.0 / step * (a - np.eye(n)) @ inverse, root * inverse @ b, root * c @ inverse,
                d - c @ inverse @ b)  # fmt: skip
    if method not in ("zero", "linear"):
        raise InputError(
            f"method: expected 'zero', 'linear' or 'tustin', found {method!r}.", "Correct it."
        )
    grown = _logarithm(a) / step
    by_value, by_slope = _steps(grown, step)
    if method == "zero":
        return grown, np.linalg.solve(by_value, b), c, d
    # With z = x - by_slope B u, a linear input acts like a step of u.
    b = np.linalg.solve(by_value - by_slope + a @ by_slope, b)
    return grown, b, c, d - c @ by_slope @ b


def _steps(a: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Response within a step to u held, and to u rising from 0 to 1; ``(n, n)`` each."""
    from scipy.linalg import expm

    n = len(a)
    # Van Loan 1978: one exponential of a block matrix gives the integrals of exp(A t), without the
    # inverse of A, which an integrator does not have
    block = np.zeros((3 * n, 3 * n))
    block[:n, :n] = a * step
    block[:n, n : 2 * n] = np.eye(n) * step
    block[n : 2 * n, 2 * n :] = np.eye(n)
    grown = expm(block)
    return grown[:n, n : 2 * n], grown[:n, 2 * n :]


def _logarithm(a: np.ndarray) -> np.ndarray:
    from scipy.linalg import expm, logm

    poles = np.linalg.eigvals(a)
    # a sampled pole is exp(s T): never zero, and negative only as one of a pair that has lost its
    # partner
    real = np.abs(poles.imag) < 1e-12 * np.abs(poles)
    lost = poles[(np.abs(poles) < 1e-9) | (real & (poles.real <= 0))]
    if not lost.size:
        full: Any = logm(a)
        real_part = np.real(full)
        # the principal logarithm of a nearly defective matrix may be wrong without an error: taken
        # back
        if np.allclose(expm(real_part), a, rtol=_CLOSE, atol=_CLOSE):
            return real_part
    where = ", ".join(f"{pole.real:.3g}" for pole in lost) or "what rounding cannot tell from those"
    raise InputError(
        f"The sampled model has poles at {where}; no continuous system of its order, sampled, has "
        "poles at zero or on the negative real axis.",
        "Choose a lower order, no more coefficients in B than in A, or method='tustin'.",
    )

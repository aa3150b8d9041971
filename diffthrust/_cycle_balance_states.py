"""Harmonic balance of a whole loop around a model: its states take part in the unknowns."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from diffthrust._dynamic_element import ModelElement, plain_rate
from diffthrust._integrate import integrate
from diffthrust._oscillation import Harmonics
from diffthrust._transfer import Transfer

_ITERATIONS = 20


def balanced_states(
    transfer: Transfer, element: ModelElement, amplitude: float, frequency: float, harmonics: int
) -> tuple[Harmonics, np.ndarray] | None:
    """The cycle near a solution of the describing function.

    Args:
        transfer: the linear part.
        element: the model.
        amplitude: of the fundamental at its input, the first guess.
        frequency: [rad/s], the first guess.
        harmonics: the highest harmonic.

    Returns:
        The cycle and the coefficients of the model's states, complex ``(states, harmonics + 1)``;
        ``None`` where Newton's method does not converge near the guess.
    """
    start = element.begin(amplitude, frequency)
    if not np.isfinite(start).all():
        return None
    order = np.arange(harmonics + 1)
    width = max(9, transfer.den.size)  # one compilation for all loops of usual order
    num, den = (np.concatenate([np.zeros(width - c.size), c]) for c in (transfer.num, transfer.den))
    z, w, worst = _solved(
        element,
        harmonics,
        element.values,
        jnp.asarray(num),
        jnp.asarray(den),
        transfer.delay,
        amplitude,
        frequency,
        jnp.asarray(start),
    )
    z, w = np.asarray(z), float(w)
    if not (np.isfinite(z).all() and float(worst) < 1e-7 and 0.5 < w / frequency < 2.0):
        return None
    if not 0.3 < abs(z[0, 1]) / amplitude < 3.0:
        return None
    return Harmonics(w, order, z[0], z[-1]), z[1:-1]


@partial(jax.jit, static_argnums=(0, 1))
def _solved(
    element: ModelElement,
    harmonics: int,
    values: Any,
    num: Any,
    den: Any,
    delay: Any,
    amplitude: Any,
    frequency: Any,
    start: Any,
) -> tuple[Any, Any, Any]:
    names, count = element.states, harmonics + 1
    points = 8 * count
    angle = 2.0 * math.pi * jnp.arange(1.0 * points) / points
    order = jnp.arange(1.0 * count)
    jay = jax.lax.complex(jnp.zeros(count), order)  # j k
    turns = angle[:, None] * order[None, :]
    turn = jax.lax.complex(jnp.cos(turns), jnp.sin(turns))
    share = jnp.where(order == 0, 1.0, 2.0).astype(complex) / points

    def analysed(signal: Any) -> Any:
        return share * (jnp.conj(turn).T @ signal.astype(complex))

    def unpacked(z: Any) -> tuple[Any, Any]:
        """Coefficients of the input and the states, ``(1 + states, count)``, and the frequency."""
        rows = z.reshape(1 + len(names), 2, count)
        log_w = rows[0, 1, 1]  # the input's fundamental has no imaginary part: its phase is held
        imaginary = rows[:, 1].at[0, 1].set(0.0).at[:, 0].set(0.0)
        return jax.lax.complex(rows[:, 0], imaginary), frequency * jnp.exp(log_w)

    def courses(c: Any, w: Any) -> tuple[Any, Any, Any]:
        signals = (turn @ c.T).real * sizes[None, :]
        states = {name: signals[:, 1 + i] for i, name in enumerate(names)}
        rates, y = element.evaluate(values, states, signals[:, 0], angle / w)
        return states, rates, jnp.broadcast_to(y, angle.shape)

    def residual(z: Any) -> Any:
        c, w = unpacked(z)
        _, rates, y = courses(c, w)
        s = w.astype(complex) * jay
        g_num, g_den = (jnp.polyval(c.astype(complex), s) for c in (num, den))
        out = analysed(y / sizes[0]) * jnp.exp(-s * delay)
        size = jnp.where(jnp.abs(g_den) > 1e-12 * jnp.abs(g_num), jnp.abs(g_den), jnp.abs(g_num))
        loop = (g_den * c[0] + g_num * out) / size.astype(complex)
        own = [
            jay * c[1 + i]
            - analysed(jnp.broadcast_to(plain_rate(rates[name]), angle.shape) / w / sizes[1 + i])
            for i, name in enumerate(names)
        ]
        rows = jnp.stack([loop, *own])
        # the imaginary part of a mean is always zero: its unknown is held at zero instead
        held = rows.imag.at[:, 0].set(z.reshape(1 + len(names), 2, count)[:, 1, 0])
        return jnp.stack([rows.real, held], axis=1).reshape(-1)

    # the answer to a sine of the guess gives the first coefficients, in phase with a cosine
    path = _course(element, values, amplitude, frequency, start, points)
    guess = jnp.stack([analysed(path[name]) for name in names])
    guess = guess * jnp.exp(0.5 * math.pi * jay)[None, :]
    first = jnp.zeros((1, count), complex).at[0, 1].set(jnp.asarray(amplitude).astype(complex))
    c = jnp.concatenate([first, guess])
    sizes = jnp.maximum(jnp.abs(c).max(axis=1), 1e-300)
    c = c / sizes[:, None].astype(complex)
    z = jnp.stack([c.real, c.imag], axis=1).reshape(-1)

    def newton(_: Any, z: Any) -> Any:
        step = jnp.linalg.solve(jax.jacfwd(residual)(z), -residual(z))
        return z + step * jnp.minimum(1.0, 0.3 / jnp.maximum(jnp.abs(step).max(), 1e-300))

    z = jax.lax.fori_loop(0, _ITERATIONS, newton, z)
    c, w = unpacked(z)
    _, _, y = courses(c, w)
    return (
        jnp.concatenate([c * sizes[:, None].astype(complex), analysed(y)[None]]),
        w,
        jnp.abs(residual(z)).max(),
    )


def _course(
    element: ModelElement, values: Any, a: Any, w: Any, start: Any, points: int
) -> dict[str, Any]:
    """The settled answer to a sine, at evenly spaced instants of a period."""
    clock = 2.0 * math.pi / w * jnp.arange(points + 1.0) / points
    path = integrate(
        lambda x, u: element.evaluate(values, x, a * jnp.sin(w * u["time"]), u["time"])[0],
        dict(zip(element.states, start, strict=True)),
        {"time": (clock[:-1], clock[1:])},
        jnp.full(points, 2.0 * math.pi / points) / w,
        {},
        uniform=True,
    )
    return {name: value[:-1] for name, value in path.items()}

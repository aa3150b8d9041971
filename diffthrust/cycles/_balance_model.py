"""Harmonic balance of a whole loop around a model: its states take part in the unknowns."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from diffthrust._support.transfer import Transfer
from diffthrust.cycles._model_element import ModelElement, plain_rate
from diffthrust.cycles._oscillation import Harmonics

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
    own = element.answer(amplitude, frequency, harmonics)
    if not np.isfinite(own).all():
        return None
    order = np.arange(harmonics + 1)
    # the answer to a sine, moved by a quarter turn: the phase is held to that of a cosine
    sine = np.zeros((1, harmonics + 1), complex)
    sine[0, 1] = amplitude
    c = np.concatenate([sine, own * 1j**order])
    sizes = np.maximum(np.abs(c).max(axis=1), 1e-300)
    c = c / sizes[:, None]
    z = np.stack([c.real, c.imag], axis=1).reshape(-1)
    width = max(9, transfer.den.size)  # one compilation for all loops of usual order
    num, den = (np.concatenate([np.zeros(width - c.size), c]) for c in (transfer.num, transfer.den))
    loop = [jnp.asarray(x) for x in (num, den, transfer.delay, frequency, sizes)]
    worst, found, w = np.inf, c, frequency
    for _ in range(_ITERATIONS):
        r, slopes, found, w = (
            np.asarray(x)
            for x in _missed(element, harmonics, element.values, *loop, jnp.asarray(z))
        )
        worst = float(np.abs(r).max())
        if not (np.isfinite(r).all() and np.isfinite(slopes).all()) or worst < 1e-11:
            break
        try:
            step = np.linalg.solve(slopes, -r)
        except np.linalg.LinAlgError:
            return None
        z = z + step * min(1.0, 0.3 / max(np.abs(step).max(), 1e-300))
    if not (worst < 1e-7 and 0.5 < w / frequency < 2.0):
        return None
    if not 0.3 < abs(found[0, 1]) / amplitude < 3.0:
        return None
    return Harmonics(float(w), order, found[0], found[-1]), found[1:-1]


@partial(jax.jit, static_argnums=(0, 1))
def _missed(
    element: ModelElement,
    harmonics: int,
    values: Any,
    num: Any,
    den: Any,
    delay: Any,
    frequency: Any,
    sizes: Any,
    z: Any,
) -> tuple[Any, Any, Any, Any]:
    """What is missed, its slopes, the coefficients of input, states and output, the frequency."""
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

    def residual(z: Any) -> tuple[Any, Any]:
        rows = z.reshape(1 + len(names), 2, count)
        log_w = rows[0, 1, 1]  # the input's fundamental has no imaginary part: its phase is held
        imaginary = rows[:, 1].at[0, 1].set(0.0).at[:, 0].set(0.0)
        c, w = jax.lax.complex(rows[:, 0], imaginary), frequency * jnp.exp(log_w)
        signals = (turn @ c.T).real * sizes[None, :]
        states = {name: signals[:, 1 + i] for i, name in enumerate(names)}
        rates, y = element.evaluate(values, states, signals[:, 0], angle / w)
        y = jnp.broadcast_to(y, angle.shape)
        s = w.astype(complex) * jay
        g_num, g_den = (jnp.polyval(c.astype(complex), s) for c in (num, den))
        out = analysed(y / sizes[0]) * jnp.exp(-s * delay.astype(complex))
        # at a pole of G (k = 0 with an integrator) the output itself must vanish
        size = jnp.where(jnp.abs(g_den) > 1e-12 * jnp.abs(g_num), jnp.abs(g_den), jnp.abs(g_num))
        loop = (g_den * c[0] + g_num * out) / size.astype(complex)
        own = [
            jay * c[1 + i]
            - analysed(jnp.broadcast_to(plain_rate(rates[name]), angle.shape) / w / sizes[1 + i])
            for i, name in enumerate(names)
        ]
        missed = jnp.stack([loop, *own])
        # the imaginary part of a mean is always zero: its unknown is held at zero instead
        held = missed.imag.at[:, 0].set(rows[:, 1, 0])
        found = jnp.concatenate([c * sizes[:, None].astype(complex), analysed(y)[None]])
        flat = jnp.stack([missed.real, held], axis=1).reshape(-1)
        return flat, (flat, found, w)

    slopes, (r, found, w) = jax.jacfwd(residual, has_aux=True)(z)
    return r, slopes, found, w

"""A loop around a model, whose states take part: its harmonic balance, and its full simulation."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Protocol

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float
from scipy.optimize import root

from diffthrust._support._running.programs import program
from diffthrust._support.errors import InputError
from diffthrust._support.transfer import Transfer
from diffthrust.cycles._oscillation import CycleSeries, LoopCourse
from diffthrust.cycles._run_static import BEYOND, STEPS_A_PERIOD, states_on
from diffthrust.models._base.signals import Relaxing
from diffthrust.simulation._integrate import integrate
from diffthrust.simulation._runge_kutta import plain_rate


class ElementEquations(Protocol):
    """A system from an input to an output; equal and of one hash where the compiled code is."""

    @property
    def states(self) -> tuple[str, ...]: ...

    @property
    def values(self) -> dict[str, Array]: ...

    def evaluate(
        self,
        values: Mapping[str, Array],
        states: Mapping[str, Array],
        command: Array,
        time: Array,
    ) -> tuple[dict[str, Array | Relaxing], Array]: ...


def balanced_states(
    transfer: Transfer,
    element: ElementEquations,
    answer: np.ndarray,
    amplitude: float,
    frequency: float,
) -> CycleSeries | None:
    """The cycle near a solution of the describing function; ``None`` where there is none near it.

    ``answer`` are coefficients of the states' answer to a sine, ``(states, harmonics + 1)``.
    """
    if not np.isfinite(answer).all():
        return None
    harmonics = answer.shape[1] - 1
    order = np.arange(harmonics + 1)
    # the answer to a sine, moved by a quarter turn: the phase is held to that of a cosine
    sine = np.zeros((1, harmonics + 1), complex)
    sine[0, 1] = amplitude
    c = np.concatenate([sine, answer * 1j**order])
    # each signal is scaled by its own size: a command of 1 V beside a speed of 100 rad/s would
    # leave Newton's matrix badly conditioned
    sizes = np.maximum(np.abs(c).max(axis=1), 1e-300)
    c = c / sizes[:, None]
    z = np.stack([c.real, c.imag], axis=1).reshape(-1)
    width = max(9, transfer.den.size)  # one compilation for all loops of usual order
    num, den = (np.concatenate([np.zeros(width - c.size), c]) for c in (transfer.num, transfer.den))
    loop = [jnp.asarray(x) for x in (num, den, transfer.delay, frequency, sizes)]

    def missed(z: np.ndarray) -> list[np.ndarray]:
        results = _missed(element, harmonics, element.values, *loop, jnp.asarray(z))
        return [np.asarray(x) for x in results]

    if not np.isfinite(missed(z)[0]).all():
        return None
    # Unknowns are shares of their sizes and the frequency a logarithm: a first step beyond 0.3
    # leaves the neighbourhood in which the linearization says anything.
    z = root(lambda z: missed(z)[:2], z, jac=True, options={"xtol": 1e-12, "factor": 0.3}).x
    r, _, series, w = missed(z)
    worst = np.abs(r).max()
    # a balance may converge to another cycle, or to rest, which always solves it: only one near the
    # describing function's counts
    cycle = CycleSeries(float(w), order, series[0], series[-1], series[1:-1])
    return cycle if worst < 1e-7 and cycle.near(amplitude, frequency) else None


@program(2)
def _missed(
    element: ElementEquations,
    harmonics: int,
    values: Mapping[str, Array],
    num: Float[Array, " n"],
    den: Float[Array, " n"],
    delay: Float[Array, ""],
    frequency: Float[Array, ""],
    sizes: Float[Array, " signals"],
    z: Float[Array, " unknowns"],
) -> tuple[Array, Array, Array, Array]:
    """What is missed, its slopes, the coefficients of input, states and output, the frequency."""
    names, count = element.states, harmonics + 1
    # eight samples per harmonic: a product such as speed |speed| has harmonics beyond those that
    # are kept, which must not fold back onto them
    points = 8 * count
    angle = 2.0 * math.pi * jnp.arange(1.0 * points) / points
    order = jnp.arange(1.0 * count)
    jay = jax.lax.complex(jnp.zeros(count), order)  # j k
    turns = angle[:, None] * order[None, :]
    turn = jax.lax.complex(jnp.cos(turns), jnp.sin(turns))
    share = jnp.where(order == 0, 1.0, 2.0).astype(complex) / points

    def analysed(signal: Float[Array, " points"]) -> Complex[Array, " count"]:
        return share * (jnp.conj(turn).T @ signal.astype(complex))

    def residual(z: Array) -> tuple[Array, tuple[Array, Array, Array]]:
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
        state_errors = [
            jay * c[1 + i]
            - analysed(jnp.broadcast_to(plain_rate(rates[name]), angle.shape) / w / sizes[1 + i])
            for i, name in enumerate(names)
        ]
        missed = jnp.stack([loop, *state_errors])
        # the imaginary part of a mean is always zero: its unknown is held at zero instead
        held = missed.imag.at[:, 0].set(rows[:, 1, 0])
        series = jnp.concatenate([c * sizes[:, None].astype(complex), analysed(y)[None]])
        flat = jnp.stack([missed.real, held], axis=1).reshape(-1)
        return flat, (flat, series, w)

    # as many residuals as unknowns: forward mode stores no intermediate values
    slopes, (r, series, w) = jax.jacfwd(residual, has_aux=True)(z)
    return r, slopes, series, w


def simulated_states(
    transfer: Transfer,
    element: ElementEquations,
    cycle: CycleSeries,
    states: np.ndarray,
    factors: tuple[float, ...],
    periods: int,
) -> list[LoopCourse]:
    """Simulate from starts on a cycle, made larger or smaller by the factors.

    A dead time of the linear part is replaced by an all-pass of sixth order. ``states`` are
    coefficients of the model's states on the cycle, complex ``(states, m)``.
    """
    plain = transfer.rational()
    if plain.direct and _passes_at_once(element):
        raise InputError(
            "Both the linear part and the model pass a step of their input at once: the loop has "
            "no states at that instant to be simulated from.",
            "Add the fastest lag of the plant to the linear part.",
        )
    on = np.concatenate([states_on(plain, cycle), states.sum(axis=1).real])
    step = cycle.oscillation.period / STEPS_A_PERIOD
    starts = np.array(factors)[:, None] * on[None, :]
    limit = BEYOND * cycle.oscillation.peak
    return _courses(plain, element, starts, step, periods * STEPS_A_PERIOD, limit)


def course_of(
    transfer: Transfer, element: ElementEquations, output: float, period: float, duration: float
) -> LoopCourse:
    """Simulate a loop from a model's states at zero and a constant output of the linear part.

    The period of an oscillation [s] sets the step.
    """
    plain = transfer.rational()
    a, b, c, _ = plain.state_space()
    rows = np.vstack([a, c[None, :]])
    # a state at rest (A z = 0) with this output; an integrator has one, others come nearest to it
    z = np.linalg.lstsq(rows, np.append(0.0 * b, output), rcond=None)[0]
    start = np.concatenate([z, np.zeros(len(element.states))])
    count = math.ceil(duration / period) * STEPS_A_PERIOD
    limit = 1e12 * max(1.0, abs(output))
    return _courses(plain, element, start[None, :], period / STEPS_A_PERIOD, count, limit)[0]


def _courses(
    plain: Transfer,
    element: ElementEquations,
    starts: np.ndarray,
    step: float,
    count: int,
    limit: float,
) -> list[LoopCourse]:
    """From states of the linear part and the model, ``(starts, states)``, up to a limit."""
    matrices = zip("abcd", plain.state_space(), strict=True)
    linear = {name: jnp.asarray(value) for name, value in matrices}
    e, y = _marched(element, count, element.values, linear, step, jnp.asarray(starts))
    time = step * np.arange(count + 1)
    return [_cut(time, *row, limit) for row in zip(np.asarray(e), np.asarray(y), strict=True)]


def _cut(time: np.ndarray, e: np.ndarray, y: np.ndarray, limit: float) -> LoopCourse:
    # written so that NaN counts as outside
    outside = np.flatnonzero(~(np.abs(e) <= limit))
    end = int(outside[0]) if outside.size else e.size
    return LoopCourse(time[:end], e[:end], y[:end], bool(outside.size))


def _passes_at_once(element: ElementEquations) -> bool:
    """Whether a step at the model's input shows at once at its output."""
    # no special values: at zero a slope may vanish by chance, as that of speed |speed| does
    states = {name: jnp.asarray(0.7 + 0.1 * i) for i, name in enumerate(element.states)}

    def output(command: Array) -> Array:
        return element.evaluate(element.values, states, command, jnp.asarray(0.0))[1]

    return bool(jnp.any(jax.grad(lambda u: jnp.sum(output(u)))(jnp.asarray(0.5)) != 0.0))


@program(2)
def _marched(
    element: ElementEquations,
    count: int,
    values: Mapping[str, Array],
    linear: Mapping[str, Array],
    step: float,
    starts: Float[Array, "starts states"],
) -> tuple[Float[Array, "starts time"], Float[Array, "starts time"]]:
    names = element.states
    order = linear["b"].shape[0]
    lengths = jnp.full(count, 1.0) * step
    clock = step * jnp.arange(count + 1.0)

    def split(x: Mapping[str, Array]) -> tuple[list[Array], dict[str, Array]]:
        return [x[f"linear.{i}"] for i in range(order)], {name: x[name] for name in names}

    def loop(
        x: Mapping[str, Array], time: Array
    ) -> tuple[dict[str, Array | Relaxing], Array, Array]:
        z, instants = split(x)
        passed = sum((linear["c"][i] * z[i] for i in range(order)), 0.0 * time)
        # where the linear part passes its input at once, the output does not read the command
        _, ahead = element.evaluate(values, instants, -passed, time)
        command = -(passed + linear["d"] * ahead)
        rates, y = element.evaluate(values, instants, command, time)
        for i in range(order):
            row = sum((linear["a"][i, k] * z[k] for k in range(order)), linear["b"][i] * y)
            rates[f"linear.{i}"] = row
        return rates, command, y

    def one(start: Float[Array, " states"]) -> tuple[Array, Array]:
        begin = {f"linear.{i}": start[i] for i in range(order)}
        begin |= {name: start[order + i] for i, name in enumerate(names)}
        path = integrate(
            lambda x, u: loop(x, u["time"])[0],
            begin,
            {"time": (clock[:-1], clock[1:])},
            lengths,
            {},
            uniform=True,
        )
        _, command, y = loop(path, clock)
        return command, jnp.broadcast_to(y, clock.shape)

    return jax.vmap(one)(starts)

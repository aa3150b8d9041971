"""Plain diffrax and optimistix: the equation to `diffeqsolve`, its result to `least_squares`.

The command jumps at each sample, so the step controller is told the jumps. A constant step that
saves its own steps needs 0.4 of the time, but reads the next sample's command at the end of each.
"""

from __future__ import annotations

from typing import Any

import diffrax as dfx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx

from . import _problem
from ._problem import GUESS, NOISE, TRUTH, Record

jax.config.update("jax_enable_x64", True)


def _solve(p: Any, time: Any, command: Any) -> tuple[Any, Any]:
    """Speed and thrust at the samples; ``p`` are parameters and the initial speed."""

    def rate(t: Any, w: Any, args: Any) -> Any:
        held = command[jnp.searchsorted(time, t, side="right") - 1]
        return p[1] * held - p[0] * w * jnp.abs(w)

    control = dfx.ClipStepSizeController(dfx.PIDController(rtol=1e-6, atol=1e-6), jump_ts=time)
    found = dfx.diffeqsolve(
        dfx.ODETerm(rate), dfx.Tsit5(), time[0], time[-1], time[1] - time[0], p[3],
        saveat=dfx.SaveAt(ts=time), stepsize_controller=control,
        adjoint=dfx.ForwardMode(), max_steps=8 * time.size, throw=False,
    )  # fmt: skip
    speed = found.ys
    return speed, p[2] * speed * jnp.abs(speed)


@jax.jit
def _simulate(p: Any, time: Any, command: Any) -> tuple[Any, Any]:
    return _solve(p, time, command)


@jax.jit
def _fit(guess: Any, given: Record) -> tuple[Any, Any]:
    """Parameters and cost; the fit moves logarithms, without which it ends at wrong points."""

    def residual(z: Any, given: Record) -> Any:
        p = jnp.concatenate([guess * jnp.exp(z[:3]), z[3:]])
        speed, thrust = _solve(p, given.time, given.command)
        off = (speed - given.speed) / NOISE["speed"], (thrust - given.thrust) / NOISE["thrust"]
        return jnp.concatenate(off)

    begin = jnp.append(jnp.zeros(3), given.speed[0])
    solver = optx.LevenbergMarquardt(rtol=1e-8, atol=1e-8)
    found = optx.least_squares(residual, solver, begin, given, max_steps=100, throw=False)
    cost = jnp.sum(residual(found.value, given) ** 2)
    return guess * jnp.exp(found.value[:3]), cost


@jax.jit
def _period(amplitude: Any, frequency: Any, x: Any) -> tuple[Any, Any]:
    """One period of a cosine: the speed after it, and the first harmonic of the thrust."""

    def rate(at: Any, y: Any, args: Any) -> Any:
        thrust = TRUTH[2] * y[0] * jnp.abs(y[0])
        drive = TRUTH[1] * amplitude * jnp.cos(at)
        swing = (drive - TRUTH[0] * y[0] * jnp.abs(y[0])) / frequency
        return jnp.stack([swing, thrust * jnp.cos(at) / jnp.pi, -thrust * jnp.sin(at) / jnp.pi])

    found = dfx.diffeqsolve(
        dfx.ODETerm(rate), dfx.Tsit5(), 0.0, 2.0 * jnp.pi, 0.01, jnp.array([x, 0.0, 0.0]),
        stepsize_controller=dfx.PIDController(rtol=1e-6, atol=1e-8), max_steps=100_000,
    )  # fmt: skip
    x, real, imaginary = found.ys[-1]
    return x, jax.lax.complex(real / amplitude, imaginary / amplitude)


def simulation(samples: int) -> Any:
    given, p = _problem.record(samples), jnp.array([*TRUTH, 0.0])
    return lambda turn: np.stack(_simulate(p, given.time, given.command))


def fit(samples: int) -> Any:
    given, guess = _problem.record(samples), jnp.array(GUESS)
    return lambda turn: np.asarray(_fit(guess, given)[0])


def multi_start(samples: int) -> Any:
    given, starts = _problem.record(samples), _problem.guesses(_problem.STARTS)
    every = jax.jit(jax.vmap(_fit, in_axes=(0, None)))

    def run(turn: int) -> np.ndarray:
        found, cost = every(starts, given)
        return np.asarray(found)[np.nanargmin(cost)]

    return run


def describing_function(points: int) -> Any:
    amplitudes, frequencies = _problem.grids(points)

    def harmonic(amplitude: float, frequency: float) -> complex:
        x, found = 0.0, 0.0j
        for _ in range(400):
            before = found
            x, told = _period(amplitude, frequency, x)
            found = complex(told)
            if abs(found - before) <= 1e-6 * abs(found):
                break
        return found

    # one by one: side by side all would take the steps and the periods of the slowest
    return lambda turn: np.array([[harmonic(a, w) for w in frequencies] for a in amplitudes])


def many_logs(count: int) -> Any:
    given, guess = _problem.many_records(count), jnp.array(GUESS)
    return lambda turn: np.array([np.asarray(_fit(guess, one)[0]) for one in given])

"""numba for the simulation, SciPy for the least squares: what a careful user writes by hand."""

from __future__ import annotations

from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from typing import Any

import numba
import numpy as np
from scipy.optimize import least_squares

from . import _problem, _steady
from ._problem import GUESS, NOISE, TRUTH, Record


@numba.njit
def numba_rk4(t, c, alpha, beta, ct, w):
    """One loop over the log, compiled."""
    n = t.size
    speed, thrust = np.empty(n), np.empty(n)
    for i in range(n):
        speed[i] = w
        thrust[i] = ct * w * abs(w)
        if i == n - 1:
            break
        h, drive = t[i + 1] - t[i], beta * c[i]
        k1 = drive - alpha * w * abs(w)
        y = w + 0.5 * h * k1
        k2 = drive - alpha * y * abs(y)
        y = w + 0.5 * h * k2
        k3 = drive - alpha * y * abs(y)
        y = w + h * k3
        k4 = drive - alpha * y * abs(y)
        w += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return speed, thrust


def peer_fit(record: Record, guess: Any = GUESS) -> Any:
    """SciPy's result for the parameters and the initial speed."""
    t, c = record.time, record.command
    scales = NOISE["speed"], NOISE["thrust"]
    seen = np.concatenate([record.speed / scales[0], record.thrust / scales[1]])

    def residual(p):
        speed, thrust = numba_rk4(t, c, *p)
        return seen - np.concatenate([speed / scales[0], thrust / scales[1]])

    begin = [*guess, record.speed[0]]
    return least_squares(residual, begin, x_scale=[*guess, 1.0])  # twice as fast as with bounds


def best_fit(record: Record, guesses: Iterable[Any]) -> Any:
    """The best of some starts; nothing is checked."""
    best: Any = None
    with np.errstate(all="ignore"):
        for guess in guesses:
            try:
                found = peer_fit(record, guess)
            except ValueError:  # the simulation failed at the guess
                continue
            best = found if best is None or found.cost < best.cost else best
    return best


@numba.njit
def log_density(x, t, c, speed, thrust, speed_noise, thrust_noise):
    """Of the logarithms of the parameters and the initial speed, flat where nothing is measured."""
    p = np.exp(x[:3])
    modelled = numba_rk4(t, c, p[0], p[1], p[2], x[3])
    off = np.sum(((speed - modelled[0]) / speed_noise) ** 2)
    return -0.5 * (off + np.sum(((thrust - modelled[1]) / thrust_noise) ** 2))


step = numba.njit(_problem.rk4)
harmonic = numba.njit(_steady.harmonic)


@numba.njit
def period(steps, amplitude, frequency, x):
    """One period of a cosine: the speed after it, and the first harmonic of the thrust."""
    turn, total = 2.0 * np.pi / steps, 0.0 + 0.0j
    for k in range(steps):
        at = k * turn
        total += TRUTH[2] * x * abs(x) * np.exp(-1j * at)
        command = np.cos(at), np.cos(at + 0.5 * turn), np.cos(at + turn)
        a, b, c = amplitude * command[0], amplitude * command[1], amplitude * command[2]
        x = step(x, (a, b, c), TRUTH[0], TRUTH[1], turn / frequency)
    return x, 2.0 * total / steps / amplitude


def simulation(samples: int) -> Any:
    given = _problem.record(samples)
    return lambda turn: np.stack(numba_rk4(given.time, given.command, *TRUTH, 0.0))


def fit(samples: int) -> Any:
    given = _problem.record(samples)
    return lambda turn: peer_fit(given).x[:3]


def multi_start(samples: int) -> Any:
    given, starts = _problem.record(samples), _problem.guesses(_problem.STARTS)
    return lambda turn: best_fit(given, starts).x[:3]


def describing_function(points: int) -> Any:
    amplitudes, frequencies = _problem.grids(points)
    return lambda turn: np.array(
        [[harmonic(period, a, w) for w in frequencies] for a in amplitudes]
    )


def parameters(record: Record, starts: int = 1) -> np.ndarray:
    """The best of some starts."""
    return best_fit(record, _problem.guesses(starts)).x[:3]


def many_logs(count: int) -> Any:
    given = _problem.many_records(count)
    pool = ProcessPoolExecutor(2, mp_context=get_context("spawn"))
    work = partial(pool.map, parameters, given, chunksize=max(1, len(given) // 8))
    return lambda turn: np.array(list(work()))

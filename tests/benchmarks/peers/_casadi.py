"""CasADi: the log as a `mapaccum` of a symbolic step, with its exact Jacobian to SciPy.

The functions are interpreted by CasADi's virtual machine, as they are without a C compiler.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import casadi as ca
import numpy as np
from scipy.optimize import least_squares

from . import _problem, _steady
from ._problem import GUESS, NOISE, TRUTH, Record, rk4


@cache
def _simulate(samples: int) -> Any:
    """From parameters with the initial speed, commands and steps to speed and thrust."""
    w, c, h, p = (ca.SX.sym(name, size) for name, size in (("w", 1), ("c", 1), ("h", 1), ("p", 4)))
    once = ca.Function("once", [w, c, h, p], [rk4(w, (c, c, c), p[0], p[1], h)])
    p, c, h = ca.MX.sym("p", 4), ca.MX.sym("c", 1, samples), ca.MX.sym("h", 1, samples - 1)
    later = once.mapaccum(samples - 1)(p[3], c[:-1], h, ca.repmat(p, 1, samples - 1))
    speed = ca.horzcat(p[3], later).T
    return ca.Function("simulate", [p, c, h], [speed, p[2] * speed * ca.fabs(speed)])


@cache
def _residual(samples: int) -> Any:
    """The weighted residuals, and their Jacobian."""
    p, c, h = ca.MX.sym("p", 4), ca.MX.sym("c", 1, samples), ca.MX.sym("h", 1, samples - 1)
    seen = ca.MX.sym("seen", samples, 2)
    speed, thrust = _simulate(samples)(p, c, h)
    off = ca.vertcat((seen[:, 0] - speed) / NOISE["speed"], (seen[:, 1] - thrust) / NOISE["thrust"])
    return (
        ca.Function("residual", [p, c, h, seen], [off]),
        ca.Function("slopes", [p, c, h, seen], [ca.jacobian(off, p)]),
    )


def _fit(record: Record, guess: Any = GUESS) -> Any:
    residual, slopes = _residual(record.time.size)
    told = (
        ca.DM(record.command).T,
        ca.DM(np.diff(record.time)).T,
        ca.DM(np.stack([record.speed, record.thrust], axis=1)),
    )
    return least_squares(
        lambda p: np.asarray(residual(p, *told)).ravel(),
        [*guess, record.speed[0]],
        jac=lambda p: np.asarray(slopes(p, *told)),
        x_scale=[*guess, 1.0],
    )


@cache
def _turn(steps: int) -> Any:
    """One period: from the speed, amplitude and frequency to the speed and the harmonic's parts."""
    state, told, at = ca.SX.sym("state", 3), ca.SX.sym("told", 2), ca.SX.sym("at", 1)
    x, turn = state[0], 2.0 * np.pi / steps
    command = tuple(told[0] * ca.cos(at + share * turn) for share in (0.0, 0.5, 1.0))
    thrust = TRUTH[2] * x * ca.fabs(x)
    after = ca.vertcat(
        rk4(x, command, TRUTH[0], TRUTH[1], turn / told[1]),
        state[1] + thrust * ca.cos(at),
        state[2] - thrust * ca.sin(at),
    )
    return ca.Function("once", [state, at, told], [after]).fold(steps)


def period(steps: int, amplitude: float, frequency: float, x: float) -> tuple[float, complex]:
    angles = ca.DM(2.0 * np.pi * np.arange(steps) / steps).T
    told = ca.repmat(ca.DM([amplitude, frequency]), 1, steps)
    x, real, imaginary = np.asarray(_turn(steps)([x, 0.0, 0.0], angles, told)).ravel()
    return x, 2.0 * complex(real, imaginary) / steps / amplitude


def simulation(samples: int) -> Any:
    given, run = _problem.record(samples), _simulate(samples)
    told = [*TRUTH, 0.0], ca.DM(given.command).T, ca.DM(np.diff(given.time)).T
    return lambda turn: np.stack([np.asarray(part).ravel() for part in run(*told)])


def fit(samples: int) -> Any:
    given = _problem.record(samples)
    return lambda turn: _fit(given).x[:3]


def multi_start(samples: int) -> Any:
    given, starts = _problem.record(samples), _problem.guesses(_problem.STARTS)

    def run(turn: int) -> np.ndarray:
        found = []
        for guess in starts:
            try:
                found.append(_fit(given, guess))
            except ValueError:  # the simulation failed at the guess
                continue
        return min(found, key=lambda one: one.cost).x[:3]

    return run


def describing_function(points: int) -> Any:
    amplitudes, frequencies = _problem.grids(points)
    return lambda turn: np.array(
        [[_steady.harmonic(period, a, w) for w in frequencies] for a in amplitudes]
    )


def many_logs(count: int) -> Any:
    given = _problem.many_records(count)
    return lambda turn: np.array([_fit(one).x[:3] for one in given])

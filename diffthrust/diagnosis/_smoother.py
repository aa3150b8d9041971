"""The signal that is missing at a port, smoothed from all errors before and after each sample.

About the path that an observer has gone, the model is linear: a signal at a port pushes the state,
the state's deviation decays and shows in the error, beside white and lasting noise of the sensor.
The signal is a random one with a memory (Ornstein-Uhlenbeck), so that no form is assumed; its size,
its memory and the share of lasting noise are those of the greatest likelihood on a grid. A Kalman
filter and the smoother of Rauch, Tung & Striebel (1965) then give it with its standard error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

_SIZES = 10.0 ** np.linspace(-3.0, 1.5, 10)
"""What the signal does within a sample, over the noise."""
_MEMORIES = (3.0, 15.0, 75.0)
"""Samples for which the signal is remembered."""
_LASTING = (0.0, 0.5, 2.0, 8.0)
"""Standard deviation of the lasting noise, over that of the white."""
_ENOUGH = 500
"""Samples of each log that choose among these."""


@dataclass(frozen=True)
class LinearErrors:
    """The errors of one log, linear about an observer's path; each ``(T,)``.

    Args:
        seen: measured minus predicted; NaN where nothing was measured.
        kept: how much of a deviation of the state is left at the next sample.
        undone: what the observer moved the state by until the next sample.
        pushed: the deviation that a unit of the signal makes until the next sample.
        direct: what a unit of the signal adds to the measurement at once.
    """

    seen: np.ndarray
    kept: np.ndarray
    undone: np.ndarray
    pushed: np.ndarray
    direct: np.ndarray


def smoothed_signals(
    runs: Sequence[LinearErrors], lasting: float
) -> list[tuple[np.ndarray, np.ndarray]]:
    """The signal and its standard error, ``(T,)`` each, for every log.

    Args:
        runs: the logs.
        lasting: correlation of the sensor's lasting noise from sample to sample.
    """
    joined = np.concatenate([run.seen for run in runs])
    moved = np.concatenate([np.hypot(run.pushed, run.direct) for run in runs])
    valid = joined[np.isfinite(joined)]
    noise = float(np.sqrt(np.mean(valid**2))) if valid.size else 0.0
    unit = float(np.sqrt(np.mean(moved**2)))
    if not noise > 0 or not unit > 0:
        return [(np.zeros(run.seen.size), np.full(run.seen.size, np.nan)) for run in runs]
    steady = all(np.all(run.direct == 0) for run in runs)  # else nothing tells it from the signal
    grid = np.array(list(product(_SIZES / unit, _MEMORIES, _LASTING if steady else (0.0,))))
    scaled = [LinearErrors(run.seen / noise, run.kept, run.undone / noise, run.pushed, run.direct)
              for run in runs]  # fmt: skip
    cost, squares, count = np.zeros(len(grid)), np.zeros(len(grid)), 0
    for run in scaled:
        filtered = _filter(run, grid, lasting, _ENOUGH)
        cost, squares = cost + filtered.logs, squares + filtered.squares
        count += int(np.isfinite(run.seen[:_ENOUGH]).sum())
    best = int(np.argmin(cost + count * np.log(squares / count)))
    chosen = [_filter(run, grid[best : best + 1], lasting) for run in scaled]
    total = sum(float(filtered_run.squares[0]) for filtered_run in chosen)
    scale = noise * np.sqrt(total / valid.size)
    out = []
    for filtered_run in chosen:
        means, covariances = _smoother(filtered_run)
        spread = scale * np.sqrt(np.maximum(covariances[:, 1, 1], 0.0))
        out.append((noise * means[:, 1], spread))
    return out


class _Filtered:
    """What the likelihood needs, for all points of a grid; of a single point every moment, too."""

    def __init__(self, points: int) -> None:
        self.logs, self.squares = np.zeros(points), np.zeros(points)
        self.moments: list[tuple[np.ndarray, ...]] = []


def _filter(
    run: LinearErrors, grid: np.ndarray, lasting: float, most: int | None = None
) -> _Filtered:
    """Kalman filter over (deviation, signal, lasting noise), for all points of a grid at once."""
    size, memory, share = grid.T
    forgets = np.exp(-1.0 / memory)
    many, unmoved = len(grid), not run.pushed.any()
    x, p, q = np.zeros((many, 3)), np.zeros((many, 3, 3)), np.zeros((many, 3, 3))
    p[:, 0, 0], p[:, 1, 1], p[:, 2, 2] = 0.0 if unmoved else 100.0, size**2, share**2
    q[:, 1, 1] = size**2 * (1.0 - forgets**2)
    q[:, 2, 2] = share**2 * (1.0 - lasting**2)
    filtered = _Filtered(many)
    for t in range(run.seen[:most].size):
        ahead = x, p
        if np.isfinite(run.seen[t]):
            reads = np.array([1.0, run.direct[t], 1.0])
            gained = p @ reads
            spread = gained @ reads + 1.0
            error = run.seen[t] - x @ reads
            x = x + gained * (error / spread)[:, None]
            p = p - gained[:, :, None] * (gained / spread[:, None])[:, None, :]
            filtered.logs += np.log(spread)
            filtered.squares += error**2 / spread
        moves = np.zeros((many, 3, 3))
        moves[:, 0, 0], moves[:, 0, 1] = run.kept[t], run.pushed[t]
        moves[:, 1, 1], moves[:, 2, 2] = forgets, lasting
        if many == 1:
            filtered.moments.append((*(moment[0] for moment in (*ahead, x, p)), moves[0]))
        x = (moves @ x[:, :, None])[:, :, 0]
        x[:, 0] -= run.undone[t]
        p = moves @ p @ moves.transpose(0, 2, 1) + q
    return filtered


def _smoother(filtered: _Filtered) -> tuple[np.ndarray, np.ndarray]:
    """Means ``(T, 3)`` and covariances ``(T, 3, 3)``, given all samples."""
    ahead, spread, means, covariances, moves = map(np.array, zip(*filtered.moments, strict=True))
    undone = np.linalg.pinv(spread[1:], rcond=1e-12, hermitian=True)
    backs = covariances[:-1] @ moves[:-1].transpose(0, 2, 1) @ undone
    for t in range(len(backs) - 1, -1, -1):
        back = backs[t]
        means[t] += back @ (means[t + 1] - ahead[t + 1])
        covariances[t] += back @ (covariances[t + 1] - spread[t + 1]) @ back.T
    return means, covariances

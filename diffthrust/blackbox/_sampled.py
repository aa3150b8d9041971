"""Sampled logs as matrices, and the linear systems that are estimated from them, in states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from diffthrust._support.envelope import stretches
from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust.logs._log import Log

_EVEN = 1e-3
"""Largest relative deviation of steps from their median."""


@dataclass(frozen=True, eq=False)
class SampledLog:
    """Inputs ``(n, m)``, the last column 1 if an offset is estimated, and outputs ``(n, p)``."""

    u: np.ndarray = field(repr=False)
    y: np.ndarray = field(repr=False)
    """NaN where a sample is missing."""

    @property
    def complete(self) -> np.ndarray:
        """Whether all outputs of a sample were measured, ``(n,)``."""
        return np.asarray(np.isfinite(self.y).all(axis=1))

    @property
    def segments(self) -> np.ndarray:
        """Begin and end of each stretch without a missing output, ``(k, 2)``."""
        return stretches(self.complete)


@dataclass(frozen=True)
class Channels:
    """The channels of a model, their units and sampling.

    Args:
        inputs: their names.
        outputs: their names.
        units: by channel; those of the first log, empty if it has none.
        step: time between samples [s].
        hold: how inputs run between samples: ``"zero"`` or ``"linear"``.
        offset: a constant input is added.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    units: dict[str, str] = field(repr=False)
    step: float
    hold: str
    offset: bool

    def record(self, log: Log) -> SampledLog:
        """The channels of a log, which must be evenly sampled with the same step."""
        step = step_of(log)
        # coefficients belong to one step: a pole of 0.9 at 0.1 s is another lag at 0.2 s
        if abs(step - self.step) > _EVEN * self.step:
            raise InputError(
                f"{log.name}: expected a sample every {self.step:g} s, as in the logs that the "
                f"model is of, found one every {step:g} s.",
                "Sample all logs alike: log.averaged(n), or a resampled file.",
            )
        for name in self.inputs:
            if name not in log.inputs:
                raise InputError(
                    f"{log.name}: expected the input {name!r}, found {listing(log.inputs)}.",
                    "Name an input of the log: input=...",
                )
        for name in self.outputs:
            if name not in log.measured:
                raise InputError(
                    f"{log.name}: expected the measured channel {name!r}, found "
                    f"{listing(log.measured)}.",
                    "Name a measured channel of the log: output=...",
                )
            if name in log.unsigned:
                raise InputError(
                    f"{log.name}: the sensor of {name!r} gives no sign; a linear model needs one.",
                    "Use dft.fit, which takes care of it, or a log that moves in one direction "
                    "and does not name the channel as unsigned.",
                )
        u = [log.values(name, self.units[name]) for name in self.inputs]
        u += [np.ones(len(log))] if self.offset else []
        y = [log.values(name, self.units[name]) for name in self.outputs]
        return SampledLog(np.stack(u, axis=1), np.stack(y, axis=1))


def step_of(log: Log) -> float:
    """The step of an evenly sampled log [s]."""
    steps = np.diff(log.time)
    if len(log) < 3 or np.ptp(steps) > _EVEN * np.median(steps):
        description = f"{len(log)} samples"
        if len(log) > 1:
            description += f" with steps of {steps.min():g} to {steps.max():g} s"
        raise InputError(
            f"{log.name}: expected three or more evenly spaced samples, found {description}.",
            "Give missing samples as NaN at their own time, or resample the log; dft.fit takes "
            "any time stamps.",
        )
    return float(np.mean(steps))


def sampled_channels(
    logs: Log | Sequence[Log],
    input: str | Sequence[str],
    output: str | Sequence[str],
    offset: bool = False,
) -> tuple[Channels, list[SampledLog]]:
    """The channels of a model, and the records of its logs."""
    logs = [logs] if isinstance(logs, Log) else list(logs)
    inputs = (input,) if isinstance(input, str) else tuple(input)
    outputs = (output,) if isinstance(output, str) else tuple(output)
    if not logs:
        raise InputError("No log was given.", "Give one log or a list of them.")
    for what, names in (("input", inputs), ("output", outputs)):
        if not names or len(set(names)) < len(names):
            raise InputError(
                f"{what}: expected one or more different channels, found {listing(names)}.",
                f"Write {what}='command', or a list of names.",
            )
    first = logs[0]
    units = {name: first.units.get(name, "") for name in (*inputs, *outputs)}
    holds = {log.hold[name] for log in logs for name in inputs if name in log.inputs}
    hold = "linear" if holds == {"linear"} else "zero"
    channels = Channels(inputs, outputs, units, step_of(first), hold, offset)
    return channels, [channels.record(log) for log in logs]


_BLOCK = 64
"""Samples computed at once: matrix products replace a Python loop over samples."""


@dataclass(frozen=True, eq=False)
class System:
    """x(t + 1) = A x + B u + K e,  y = C x + D u + e,  with n states, m inputs and p outputs.

    The inputs are delayed by ``lags`` in samples, beyond what the states do, ``(m,)``.
    """

    a: np.ndarray
    b: np.ndarray
    c: np.ndarray
    d: np.ndarray
    k: np.ndarray = field(repr=False)
    lags: tuple[int, ...] = ()

    @property
    def order(self) -> int:
        """Number of states."""
        return self.a.shape[0]

    @property
    def unknown(self) -> int:
        """Samples at a log's start that depend on inputs before it."""
        return max(self.lags, default=0)

    def late(self, u: np.ndarray) -> np.ndarray:
        """The delayed inputs, zero before the log, ``(n, m)``."""
        if not self.unknown:
            return u
        out = np.zeros_like(u)
        for j, lag in enumerate(self.lags):
            out[lag:, j] = u[: max(len(u) - lag, 0), j]
        return out

    def simulate(self, u: np.ndarray, y: np.ndarray | None = None) -> np.ndarray:
        """Outputs ``(n, p)`` from inputs, infinite where an unstable system overflows.

        The starting states fit ``y`` best; the first samples, which depend on inputs before the
        log, are then NaN. Without ``y`` the system and its inputs start at rest.
        """
        skip = 0 if y is None else min(self.unknown, len(u))
        y = None if y is None else y[skip:]
        outputs = _run(self.a, self.b, self.c, self.d, self.late(u)[skip:], y)
        return np.concatenate([np.full((skip, len(self.c)), np.nan), outputs])

    def predict(self, u: np.ndarray, y: np.ndarray) -> np.ndarray:
        """One-step predictions, ``(n, p)``.

        Missing outputs do not correct the states. Starting states are estimated by least squares
        over the record; NaN as in `simulate`.
        """
        skip = min(self.unknown, len(u))
        u, y = self.late(u)[skip:], y[skip:]
        if np.isfinite(y).all():
            # without gaps the predictor is a linear system with the outputs as inputs, and runs in
            # blocks
            f = self.a - self.k @ self.c
            g = np.concatenate([self.b - self.k @ self.d, self.k], axis=1)
            d = np.concatenate([self.d, np.zeros((y.shape[1],) * 2)], axis=1)
            outputs = _run(f, g, self.c, d, np.concatenate([u, y], axis=1), y)
        else:
            outputs = self._predict_with_gaps(u, y)
        return np.concatenate([np.full((skip, len(self.c)), np.nan), outputs])

    def _predict_with_gaps(self, u: np.ndarray, y: np.ndarray) -> np.ndarray:
        n, p = self.order, y.shape[1]
        finite = np.isfinite(y)
        passed, driven = u @ self.d.T, u @ self.b.T
        x = np.concatenate([np.zeros((n, 1)), np.eye(n)], axis=1)  # driven, and by starting state
        out = np.empty((len(u), p, 1 + n))
        with np.errstate(over="ignore", invalid="ignore"):
            for t in range(len(u)):
                expected = self.c @ x
                expected[:, 0] += passed[t]
                out[t] = expected
                missed = -expected
                missed[:, 0] += np.where(finite[t], y[t], 0.0)
                missed[~finite[t]] = 0.0
                x = self.a @ x + self.k @ missed
                x[:, 0] += driven[t]
        return _started(out[:, :, 0], out[:, :, 1:], y)


def _run(
    a: np.ndarray,
    b: np.ndarray,
    c: np.ndarray,
    d: np.ndarray,
    u: np.ndarray,
    y: np.ndarray | None,
) -> np.ndarray:
    """Outputs by blocks: responses to the state at a block's start, and to its inputs."""
    n, m, p = a.shape[0], b.shape[1], c.shape[0]
    if not len(u):
        return np.zeros((0, p))
    length = min(_BLOCK, len(u))
    with np.errstate(over="ignore", invalid="ignore"):
        powers = [np.eye(n)]
        for _ in range(length):
            powers.append(a @ powers[-1])
        free = np.stack([c @ power for power in powers[:length]])  # (length, p, n)
        pulse = [d, *(c @ power @ b for power in powers[: length - 1])]
        i, j = np.indices((length, length))
        pulses = np.concatenate([np.stack(pulse), np.zeros((length, p, m))])
        # i - j below zero reads the zeros at the end: the matrix is causal
        forced = np.swapaxes(pulses[i - j], 1, 2).reshape(length * p, length * m)
        grown = np.concatenate([power @ b for power in powers[:length][::-1]], axis=1)
        blocks = -(-len(u) // length)
        padded = np.zeros((blocks * length, m))
        padded[: len(u)] = u
        rows = padded.reshape(blocks, length * m)
        columns = 1 if y is None else 1 + n
        x = np.zeros((n, columns))
        x[:, 1:] = np.eye(n)[:, : columns - 1]
        out = np.empty((blocks, length, p, columns))
        for i, row in enumerate(rows):
            out[i] = free @ x
            out[i, :, :, 0] += (forced @ row).reshape(length, p)
            x = powers[length] @ x
            x[:, 0] += grown @ row
    outputs = out.reshape(-1, p, columns)[: len(u)]
    if y is None:
        return np.where(np.isfinite(outputs[:, :, 0]), outputs[:, :, 0], np.inf)
    return _started(outputs[:, :, 0], outputs[:, :, 1:], y)


def _started(driven: np.ndarray, by_state: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Outputs with the starting states that fit the measurements best."""
    finite = np.isfinite(y)
    # Scale each output by its size, so that units do not weight them.
    size = np.sqrt(
        np.sum(np.where(finite, y, 0.0) ** 2, axis=0) / np.maximum(finite.sum(axis=0), 1)
    )
    size[~(size > 0)] = 1.0
    target, matrix = ((y - driven) / size)[finite], (by_state / size[:, None])[finite]
    if not (np.isfinite(matrix).all() and np.isfinite(target).all() and finite.any()):
        return np.full_like(driven, np.inf)
    scale = np.linalg.norm(matrix, axis=0)
    scale[scale == 0] = 1.0
    # a stable system forgets: the columns of fast states are tiny, and are scaled before the cut of
    # rank
    start, *_ = np.linalg.lstsq(matrix / scale, target, rcond=1e-10)
    return driven + by_state @ (start / scale)


def passed(by: Any, x: np.ndarray) -> np.ndarray:
    """Filter x by 1 / by(q) from rest, along the first axis."""
    from scipy.signal import lfilter  # takes a while

    return np.asarray(lfilter([1.0], by, x, axis=0))


def observer_form(a: Any, b: list[np.ndarray], delays: tuple[int, ...], c: Any = (1.0,)) -> System:
    """The system A(q) y = sum of q^-delay B(q) u + C(q) e in states.

    A and C hold the coefficients of 1, q^-1, ..., the first one 1; B those of q^-delay, ... by
    input, as the delays in samples.
    """
    lags = tuple(max(delay - 1, 0) for delay in delays)
    b = [np.concatenate([np.zeros(delay - lag), row])
         for row, delay, lag in zip(b, delays, lags, strict=True)]  # fmt: skip
    n = max(len(a), len(c), *(len(row) for row in b), 2) - 1

    def padded(values: Any) -> np.ndarray:
        return np.concatenate([values, np.zeros(n + 1 - len(values))])

    a, c = padded(a), padded(c)
    rows = np.stack([padded(row) for row in b], axis=1)
    matrix = np.eye(n, k=1)
    matrix[:, 0] = -a[1:]
    return System(
        matrix,
        rows[1:] - a[1:, None] * rows[0],
        np.eye(1, n),
        rows[:1],
        (c - a)[1:, None],
        lags,
    )

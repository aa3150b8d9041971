"""Evenly sampled inputs and outputs of logs as matrices."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

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

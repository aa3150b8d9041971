"""What a model takes from a log: inputs in its units, starting states, an unbroken time base."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model
from diffthrust.simulation._commands import command_kind


def inputs_of(model: Model, log: Log) -> dict[str, np.ndarray]:
    """The inputs that a model and its effects read from a log, in the model's units.

    Raises:
        InputError: a missing input, a unit of the wrong dimension, or a time base that such a
            system cannot have.
    """
    needed = dict(model.inputs)
    prescribed = [name for name in model.states if name in log.inputs]
    if prescribed:  # the state comes from the log; what would drive it is not needed
        needed = {name: unit for name, unit in needed.items() if name in log.inputs}
    optional = {
        n: u for n, u in {**model.optional_inputs, **model.states}.items() if n in log.inputs
    }
    for effect in model.effects:
        for name in effect.needs:
            if name not in log.inputs:
                raise InputError(
                    f"{log.name}: the effect '{effect.name}' needs the input '{name}', which the "
                    f"log does not have; it has {listing(log.inputs)}.",
                    f"Give the log the channel '{name}', or leave the effect out.",
                )
    for name in needed:
        if name not in log.inputs:
            raise InputError(
                f"{log.name}: the model '{model.name}' needs the input '{name}'; the log has "
                f"{listing(log.inputs)}.",
                f"Map a column to the channel '{name}'.",
            )
    for name in model.commanded:
        kind = command_kind(model, log.units[name]) if name in log.inputs else model.command
        if kind != model.command:
            raise InputError(
                f"{log.name}: the log gives {name!r} as {kind!r}, but the numbers of the model "
                f"'{model}' are for a command in {model.command!r}.",
                f"Fit the model to such a log, or make it with command={kind!r} and values of "
                "that kind.",
            )
    units = {**needed, **optional}
    extra = {name: "" for e in model.effects for name in e.needs if name not in units}
    _check_time(model, log)
    return {name: log.values(name, unit) for name, unit in {**units, **extra}.items()}


def check_samples(model: Model, logs: Sequence[Log]) -> None:
    """Raise `InputError` for a log that is too short to hold a model against it.

    One step says where the simulation began, and nothing of how the model goes on.
    """
    for log in logs:
        least = 2 if all(name in log.inputs for name in model.states) else 3
        if len(log) < least:
            raise InputError(
                f"{log.name}: expected at least {least} samples to hold a '{model.name}' against, "
                f"found {len(log)}.",
                "Give a longer log, or leave this one out; to simulate a short one, use simulate.",
            )


def input_ranges(model: Model, logs: Sequence[Log]) -> dict[str, tuple[float, float]]:
    """The smallest and largest value of each input that a model reads from logs, in its units."""
    every = [inputs_of(model, log) for log in logs]
    return {
        name: (
            float(min(np.nanmin(inputs[name]) for inputs in every)),
            float(max(np.nanmax(inputs[name]) for inputs in every)),
        )
        for name in every[0]
        if all(name in inputs for inputs in every)
    }


def measured_outputs(model: Model, logs: Sequence[Log]) -> tuple[str, ...]:
    """The outputs of a model that any of the logs measures."""
    return tuple(n for n in model.outputs if any(n in log.measured for log in logs))


def _check_time(model: Model, log: Log) -> None:
    fastest, slowest = model.time_scales
    if len(log) < 2 or all(name in log.inputs for name in model.states):  # nothing is integrated
        return
    looks, mend = f"a sample every {log.step:g} s", "is it 's' rather than 'ms'?"
    if log.step >= slowest / 4:
        mend = "is it 'ms' rather than 's'?"
    elif log.duration < fastest:
        looks = f"a whole log of {log.duration:g} s"
    elif log.step >= fastest / 50:
        return
    raise InputError(
        f"{log.name}: the time base gives {looks}, but a '{model.name}' has time constants between "
        f"{fastest:g} s and {slowest:g} s, which such a log is not made to show.",
        f"Check the unit of the time column ({mend}).",
    )


def hold_of(log: Log, inputs: Mapping[str, np.ndarray]) -> tuple[tuple[str, str], ...]:
    """How each input of a log runs between its samples."""
    return tuple((name, log.hold.get(name, "zero")) for name in sorted(inputs))


_EARLY = 10
"""A state begins at its first measurement where that is among so many samples, or comes as soon as
its measurements follow each other."""


def measured_start(model: Model, log: Log) -> dict[str, float]:
    """First measurement of each state that the log measures from its beginning."""
    start, log = {}, log.counted
    for name, unit in model.states.items():
        if name in log.measured and name not in log.inputs:
            values = log.values(name, unit)
            seen = np.flatnonzero(np.isfinite(values))
            if seen.size and seen[0] < max(_EARLY, np.median(np.diff(seen, prepend=-1))):
                start[name] = float(values[seen[0]])
    return start


def bridged(log: Log) -> tuple[Log, np.ndarray]:
    """A log without gaps in time, and where its original samples are.

    A step of more than 1.5 times the median is divided evenly into steps of at most the median (of
    more, where the log would otherwise grow tenfold). Inputs run on there as their ``hold`` says;
    nothing is measured.
    """
    if log.even:
        return log, np.arange(len(log))
    steps = np.diff(log.time)
    usual = log.step if steps.size else 1.0
    extra = np.where(steps > 1.5 * usual, np.ceil(steps / usual - 1e-6) - 1.0, 0.0)
    if not extra.any():
        return log, np.arange(len(log))
    parts = 1 + np.floor(extra * min(1.0, 9.0 * len(log) / extra.sum())).astype(int)
    original = np.concatenate([[0], np.cumsum(parts)])
    before = np.append(np.repeat(np.arange(steps.size), parts), steps.size)
    share = (np.arange(before.size) - original[before]) / np.append(parts, 1)[before]
    after = np.minimum(before + 1, steps.size)

    def between(values: np.ndarray) -> np.ndarray:
        return values[before] + share * (values[after] - values[before])

    def sparse(values: np.ndarray) -> np.ndarray:
        return np.where(share == 0.0, values[before], np.nan)

    longer = log.replaced(
        time=between(log.time),
        inputs={
            name: between(v) if log.hold[name] == "linear" else v[before]
            for name, v in log.inputs.items()
        },
        measured={name: sparse(values) for name, values in log.measured.items()},
    )
    return longer, original

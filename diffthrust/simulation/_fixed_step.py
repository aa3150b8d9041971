"""Simulation of a model over a record with a fixed number of integrator steps per sample."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import jax
import numpy as np

from diffthrust._support._running.batching import is_unbatched, padded, padded_length, run_program
from diffthrust._support._running.programs import program
from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust._support.validation import finite
from diffthrust.models._base.model import Model
from diffthrust.simulation._record import Record
from diffthrust.simulation._trajectory import (
    Grid,
    Key,
    driven,
    is_large,
    starting_point,
    trajectory,
)

_LEAST, _LONG = 256, 16_384
"""Numerics: samples to which short logs are padded, and above which lengths are powers of two."""


@program(1)
def compiled_simulation(static: tuple[Key, Grid], numbers: Any) -> Any:
    """A trajectory of the model and grid that are static, compiled once."""
    (key, grid), (values, time, inputs, start, substeps) = static, numbers
    grid = grid if substeps is None else replace(grid, substeps=substeps)
    return trajectory(key.model.bind(values), grid, time, inputs, start, {})


def _run(key: Key, grid: Grid, values: Any, time: Any, inputs: Any, start: Any) -> Any:
    # Each length is a program of its own, which XLA never unmaps: in a fit 13.5 MB and some 200
    # memory maps, and a process dies at 65 530 of them. So lengths are rounded up; steps of no
    # length leave the states where they are, and take no time where a program runs for one log.
    rounded = _rounded(time.size) if grid.padded else padded_length(time.size)
    spare = rounded - time.size
    if spare:
        time, inputs = jax.tree.map(lambda s: np.pad(s, (0, spare), "edge"), (time, inputs))
    substeps = None
    if grid.padded:  # one program for all numbers of steps
        grid, substeps = replace(grid, substeps=0), np.asarray(float(grid.substeps))
    return run_program(compiled_simulation, (key, grid), (values, time, inputs, start, substeps))


def _rounded(samples: int) -> int:
    """The length to which one log is padded: a power of four, of two where memory counts.

    The fit of a vessel to nine logs of 89 to 337 samples compiled 15 simulations, of seven lengths
    and three numbers of steps, in half of its time.
    """
    length = _LEAST
    while length < samples:
        length *= 4 if length < _LONG else 2
    return length


def simulate_fixed(
    model: Model, record: Record, initial: Mapping[str, float] | None, substeps: int
) -> dict[str, np.ndarray]:
    """States and outputs of a model at the samples of a record's log, ``(n,)`` each.

    Args:
        model: the model at its present values.
        record: inputs, time base, and measured initial states.
        initial: other initial states, and values of parameters that differ by log, by name.
        substeps: integrator steps per sample.
    """
    start = {**record.start, **checked_initial(model, initial)}
    values = {name: p.value for name, p in model.parameters.items()}
    return simulated_from(Key(model), values, record, start, substeps)


def simulated_from(
    key: Key,
    values: Mapping[str, float],
    record: Record,
    start: Mapping[str, float],
    substeps: int,
) -> dict[str, np.ndarray]:
    """As `simulate_fixed`, from the given start alone and with values of parameters."""
    inputs = record.inputs_for(key.model)
    differing = {n: start[n] for n in key.model.per_log if n in start}
    values, start = {**values, **differing}, {n: x for n, x in start.items() if n not in differing}
    outputs, states = _run(
        key,
        Grid(
            record.holds(inputs),
            substeps,
            uniform=record.even,
            compact=is_large(key.model),
            padded=is_unbatched(),
        ),
        {name: np.asarray(value, float) for name, value in values.items()},
        record.time,
        inputs,
        {name: np.asarray(value, float) for name, value in start.items()},
    )
    series = {**states, **outputs}
    return {name: np.asarray(value)[record.original] for name, value in series.items()}


def checked_initial(model: Model, initial: Any) -> dict[str, float]:
    """Initial states, and parameters that differ by log, by name, as numbers."""
    units = {**model.all_states, **{n: model.parameters[n].unit for n in model.per_log}}
    if initial is None:
        return {}
    if not isinstance(initial, Mapping):
        raise InputError(
            f"initial: expected a mapping from states to values, found {initial!r}.",
            f"Write initial={{'{next(iter(model.all_states), 'state')}': 0.0}}.",
        )
    unknown = [name for name in initial if name not in units]
    if unknown:
        shared = [name for name in unknown if name in model.parameters]
        raise InputError(
            f"The model '{model}' has no state {listing(unknown)}; it has {listing(units)}.",
            f"{listing(shared)} is one number for all logs: mark it with "
            f"model.replace({{{shared[0]!r}: {{'per_log': True}}}})."
            if shared
            else "Correct the names under initial.",
        )
    start = {}
    for name, value in initial.items():
        kind = "state" if name in model.all_states else "parameter"
        expected = f"a finite number for the {kind} '{name}'"
        mend = f"Give a number in {units[name] or 'no unit'}."
        start[name] = finite("initial", value, lambda x: True, expected, mend)
    return start


def starting_states(model: Model, record: Record) -> dict[str, float]:
    """Where every integrated state begins: first measurement, or the model's own initial value.

    Of the states of effects those that begin differently in every log.
    """
    inputs = record.inputs_for(model)
    series = {name: padded(value) for name, value in inputs.items()}
    _, first = driven(model, padded(record.time), series)
    integrated = [name for name in model.states if name not in inputs]
    start = {**(model.initial(first) if integrated else {}), **record.start}
    begin = {name: float(start.get(name, 0.0)) for name in integrated}
    if model.free_starts:
        every = starting_point(model, first, begin)
        begin |= {n: float(record.start.get(n, every[n])) for n in model.free_starts}
    return begin

"""Simulation of a model over a log with a given number of integrator steps."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import jax
import numpy as np

from diffthrust._support._running.batching import alone, padded_length, run_program
from diffthrust._support._running.programs import program
from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model
from diffthrust.simulation._inputs import bridged, hold_of, inputs_of, measured_start
from diffthrust.simulation._remembered import remembered
from diffthrust.simulation._trajectory import Grid, Key, driven, trajectory


@program(1)
def compiled_simulation(static: tuple[Key, Grid], numbers: Any) -> Any:
    """A trajectory of the model and grid that are static, compiled once."""
    values, time, inputs, start = numbers
    return trajectory(static[0].model.bind(values), static[1], time, inputs, start, {})


def _run(key: Key, grid: Grid, values: Any, time: Any, inputs: Any, start: Any) -> Any:
    spare = padded_length(time.size) - time.size
    if spare:  # steps of no length: the state rests
        time, inputs = jax.tree.map(lambda s: np.pad(s, (0, spare), "edge"), (time, inputs))
    return run_program(compiled_simulation, (key, grid), (values, time, inputs, start))


def simulate_fixed(
    model: Model, log: Log, initial: Mapping[str, float] | None, substeps: int
) -> dict[str, np.ndarray]:
    """As `simulate`, with so many integrator steps per sample."""
    start = {**measured_start(model, log), **checked_initial(model, initial)}
    key, values = Key(model), {name: p.value for name, p in model.parameters.items()}
    asked = (key, *values.values(), id(log), *sorted(start.items()), substeps)
    return remembered(asked, log, lambda: simulated_from(key, values, log, start, substeps))


def simulated_from(
    key: Key, values: Mapping[str, float], log: Log, start: Mapping[str, float], substeps: int
) -> dict[str, np.ndarray]:
    """A simulation with all that is known given; not remembered."""
    log, original = bridged(log)
    inputs = inputs_of(key.model, log)
    outputs, states = _run(
        key,
        Grid(hold_of(log, inputs), substeps, uniform=log.even, padded=alone()),
        {name: np.asarray(value, float) for name, value in values.items()},
        log.time,
        inputs,
        {name: np.asarray(value, float) for name, value in start.items()},
    )
    return {name: np.asarray(value)[original] for name, value in {**states, **outputs}.items()}


def checked_initial(model: Model, initial: Any) -> dict[str, float]:
    """Initial states by name, as numbers.

    Raises:
        InputError: something else, or a state that the model does not have.
    """
    if initial is None:
        return {}
    if not isinstance(initial, Mapping):
        raise InputError(
            f"initial: expected a mapping from states to values, found {initial!r}.",
            f"Write initial={{'{next(iter(model.all_states), 'state')}': 0.0}}.",
        )
    unknown = [name for name in initial if name not in model.all_states]
    if unknown:
        raise InputError(
            f"The model '{model}' has no state {listing(unknown)}; "
            f"it has {listing(model.all_states)}.",
            "Correct the names under initial.",
        )
    start = {}
    for name, value in initial.items():
        try:
            start[name] = math.nan if isinstance(value, bool | str) else float(value)
        except (TypeError, ValueError):
            start[name] = math.nan
        if not math.isfinite(start[name]):
            raise InputError(
                f"initial: expected a finite number for the state '{name}', found {value!r}.",
                f"Give a number in {model.all_states[name] or 'no unit'}.",
            )
    return start


def starting_states(model: Model, log: Log) -> dict[str, float]:
    """Where every integrated state begins: first measurement, or the model's own initial value."""
    inputs = inputs_of(model, log)
    _, first = driven(model, log.time, inputs)
    own = [name for name in model.states if name not in inputs]
    start = {**(model.initial(first) if own else {}), **measured_start(model, log)}
    return {name: float(start.get(name, 0.0)) for name in own}

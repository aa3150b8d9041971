"""Simulation of a model over a log: effects on the inputs, integration, outputs, sensors."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from numbers import Number
from typing import Any, Protocol

import jax
import jax.numpy as jnp
import numpy as np

from diffthrust._support._running.batching import is_unbatched, padded, padded_length, run_program
from diffthrust._support._running.programs import program
from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust._support.validation import finite
from diffthrust.models._base.effect import Ports
from diffthrust.models._base.model import Model
from diffthrust.models._base.signals import Relaxing, Signals, elementwise, expect
from diffthrust.simulation._integrate import integrate
from diffthrust.simulation._record import Record

_SIGNALS = (Number, np.ndarray, jax.Array, Relaxing)


_UNROLLED = 10
"""Numerics: the most states whose stages are written out one after the other. A craft of 21 states
compiled in 6.1 s of processor time written out and in 2.5 s in a loop, and 3 000 samples ran in 7.8
and 6.8 ms; with derivatives the difference in compilation is larger."""


def is_large(model: Model) -> bool:
    """Whether the stages of a step of a model run in a loop, as `Grid.compact`."""
    return len(model.all_states) > _UNROLLED


@dataclass(frozen=True)
class Grid:
    """How a log is integrated; fixes the compiled code.

    Args:
        hold: for each input "zero" (held over the sample) or "linear".
        substeps: steps of the integrator per sample; 0 where they are given as a number.
        restarted: measured states that may be set anew.
        uniform: all samples are equally far apart.
        compact: less code to compile, for many effects at a time; see `advance`.
        padded: samples at the end that follow at once are left out; see `integrate`.
    """

    hold: tuple[tuple[str, str], ...]
    substeps: int = 1
    restarted: tuple[str, ...] = ()
    uniform: bool = False
    compact: bool = False
    padded: bool = False


def trajectory(
    model: Model,
    grid: Grid,
    time: Any,
    inputs: Mapping[str, Any],
    start: Mapping[str, Any],
    restart: Mapping[str, tuple[Any, Any]],
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Simulate one log; traceable, the core of everything that simulates.

    Args:
        model: the model with (possibly traced) parameter values.
        grid: how to integrate.
        time: time stamps [s], ``(T,)``.
        inputs: input series in the model's units, ``(T,)`` each.
        start: initial values of some states; the others follow from `Model.initial`.
        restart: for the states named in ``grid.restarted``, values ``(T,)`` that the state is set
            to, NaN where it runs on, and whether its sensor is unsigned.

    Returns:
        Outputs and states at the time stamps, ``(T,)`` each.
    """
    series, path = march(model, grid, time, inputs, start, restart)
    return read_out(model, Signals({**path, **series, "time": time})), path


def march(
    model: Model,
    grid: Grid,
    time: Any,
    inputs: Mapping[str, Any],
    start: Mapping[str, Any],
    restart: Mapping[str, tuple[Any, Any]],
    observe: Observe | None = None,
) -> tuple[dict[str, Any], dict[str, Any]]:
    """The input series as they reach the model, and the states at the time stamps.

    With ``observe`` the states are corrected at each sample before they go on; those returned are
    the ones before the correction, with the observer's own states among them.
    """
    series, first = driven(model, time, inputs)
    states = starting_point(model, first, start)

    def rates(state: Mapping[str, Any], u: Mapping[str, Any]) -> dict[str, Any]:
        derivatives = rates_of(model, states, state, u)
        return derivatives if observe is None else observe.rates(derivatives, state)

    begin = states if observe is None else {**states, **observe.start}
    held = dict(grid.hold)
    spans = {
        name: (value[:-1],) if held.get(name, "linear") == "zero" else (value[:-1], value[1:])
        for name, value in {**series, "time": time}.items()
    }
    anew = {name: (restart[name][0][:-1], restart[name][1]) for name in grid.restarted}
    correct, rows = None, None
    if observe is not None:
        correct, rows = observe.correct, {name: row[:-1] for name, row in observe.rows.items()}
    return series, integrate(
        rates,
        begin,
        spans,
        jnp.diff(time),
        anew,
        correct,
        rows,
        uniform=grid.uniform,
        substeps=grid.substeps,
        compact=grid.compact,
        padded=grid.padded,
    )


def rates_of(
    model: Model, states: Iterable[str], state: Mapping[str, Any], u: Mapping[str, Any]
) -> dict[str, Any]:
    """The rates of the named states, and of those of the effects, from states and inputs."""
    s = Signals({**state, **u})
    port = Ports(model.effects, s)
    of_model, _ = equations_of(model, s, port)
    every = {**of_model, **port.rates}
    expect(f"{type(model).__name__}.equations", "rate of the state", states, every)
    return every


def read_out(model: Model, s: Signals) -> dict[str, Any]:
    """What the sensors report, from the states and inputs over a whole log."""
    return measured_by(model, s, equations_of(model, s, Ports(model.effects, s))[1])


def measured_by(model: Model, s: Signals, values: Mapping[str, Any]) -> dict[str, Any]:
    """What sensors make of the outputs of the equations over a whole log."""
    expect(f"{type(model).__name__}.equations", "output", model.outputs, values)
    # An output may be a constant or depend on parameters only; all are returned as series.
    outputs = {name: jnp.broadcast_to(values[name], s["time"].shape) for name in model.outputs}
    sensor = Ports(model.effects, s.also(outputs))
    return {name: sensor(name, value) for name, value in outputs.items()}


class Observe(Protocol):
    """What corrects a simulation by its measurements: an observer stands in a higher layer."""

    start: Mapping[str, Any]
    """The observer's own states at the start."""
    rows: Mapping[str, Any]
    """What it reads at each sample, ``(T,)`` each."""

    def rates(self, rates: dict[str, Any], state: Mapping[str, Any]) -> dict[str, Any]:
        """The rates with what the observer adds, and those of its own states."""
        ...

    def correct(self, state: dict[str, Any], u: Mapping[str, Any], row: Any) -> dict[str, Any]:
        """The states after a sample has been read."""
        ...


def driven(model: Model, time: Any, inputs: Mapping[str, Any]) -> tuple[dict[str, Any], Signals]:
    """The input series that reach the model through the effects on them, and the first samples."""
    series = arriving(model, time, inputs)
    return series, Signals({**{n: value[0] for n, value in series.items()}, "time": time[0]})


def arriving(model: Model, time: Any, inputs: Mapping[str, Any]) -> dict[str, Any]:
    """Inputs as they reach the model through the effects on them: series, or one sample of each."""
    arrived = dict(inputs)
    for effect in model.effects:  # one after the other: some read several channels
        outer = Ports((effect,), Signals({**arrived, "time": time}))
        arrived = {name: outer(name, value) for name, value in arrived.items()}
    return arrived


def equations_of(model: Model, s: Signals, port: Ports) -> tuple[Mapping[str, Any], ...]:
    """The rates and outputs of a model's equations, checked for their form."""
    where = f"{type(model).__name__}.equations"
    with elementwise(where):
        parts = model.equations(s, port)
    pair = isinstance(parts, tuple) and len(parts) == 2
    if not (pair and all(isinstance(mapping, Mapping) for mapping in parts)):
        kind = [type(mapping).__name__ for mapping in parts] if isinstance(parts, tuple) else parts
        raise InputError(
            f"{where}: expected two mappings, of the rates and of the outputs; found {kind}.",
            "Write return {state: rate}, {output: value}.",
        )
    for name, value in (item for mapping in parts for item in mapping.items()):
        if not isinstance(value, _SIGNALS):
            raise InputError(
                f"{where}: expected a number or an array for {name!r}, found "
                f"{type(value).__name__}.",
                "Return one signal for each name.",
            )
    return parts


def starting_point(model: Model, first: Signals, start: Mapping[str, Any]) -> dict[str, Any]:
    """All states at the start: those given, the model's own, and the effects' as they follow."""
    needed = [name for name in model.states if name not in first]
    default = model.initial(first) if needed else {}
    states = {name: start.get(name, default.get(name, 0.0)) for name in needed}
    for names in model.quaternions:
        if all(name in states for name in names):
            length = jnp.sqrt(sum(states[name] ** 2 for name in names))
            states |= {name: states[name] / length for name in names}
    # Zeros for states that have no value yet: an effect may read any signal to find where it
    # begins.
    s = first.also({**{n: 0.0 for n in model.all_states if n not in first}, **states})
    port = Ports(model.effects, s, starting=True)
    equations_of(model, s, port)
    return {**states, **{name: start.get(name, x) for name, x in port.initial.items()}}


@dataclass(frozen=True)
class Key:
    """A model as a static argument of compiled code: equal where the structure is equal."""

    model: Model = field(compare=False)
    structure: tuple[Hashable, ...] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "structure", self.model.structure)


def bare(model: Model) -> Model:
    """The model without the effects that act on what its sensors report."""
    kept = (e for e in model.effects if not all(port in model.outputs for port in e.ports))
    return model._copy(effects=tuple(kept))


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

"""The innovations form linearised from each sample to the next, all samples side by side.

The program is small because its loop goes over the substeps of one sample, with all samples of a
log as one array: the path is known, so no sample waits for the one before it. The derivatives of
the whole pass follow by a scan of small matrix products.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from diffthrust._support._running.programs import program
from diffthrust.estimation._likelihood import named_values, values_of_log
from diffthrust.estimation._observer import Correction, Limits, limited
from diffthrust.models._base.effect import Effect, Ports
from diffthrust.models._base.parameter import parameter
from diffthrust.models._base.signals import Relaxing, Signals
from diffthrust.simulation._integrate import advance, exponential_weights, within
from diffthrust.simulation._trajectory import (
    arriving,
    equations_of,
    rates_of,
    read_out,
    starting_point,
)

_RECORDED = ("moved.", "pushed.", "rest.")
"""Prefixes of what a path records besides states."""


class Passing(NamedTuple):
    """The signals that an effect could act on along a path; all series ``(B, T)``.

    Args:
        series: inputs and states.
        places: the signal that leaves each place, and the outputs that the model has computed until
            there.
    """

    series: Mapping[str, np.ndarray]
    places: Mapping[str, tuple[np.ndarray, Mapping[str, np.ndarray]]]


@dataclass(frozen=True, eq=False)
class StepSlopes:
    """Derivatives along a batch of logs: ``n`` states and colours, ``P`` places, ``C`` channels.

    Args:
        places: ports, measured channels and inputs.
        transition: of the next states by the states, ``(B, T, n, n)``.
        push_now: of the next states by a push at the sample, ``(B, T, n, P)``.
        push_over: of the next states by a push until the next sample, ``(B, T, n, P)``.
        output: of the errors by the states, ``(B, T, C, n)``.
        direct: of the errors by a push at the sample, ``(B, T, C, P)``.
        jacobian: of the errors by the coordinates, then by the initial states, ``(B, m, C, T)``.
        at_samples: the signals at each sample.
        at_next: the signals as the next sample comes: inputs under zero-order hold are unchanged.
    """

    places: tuple[str, ...]
    transition: np.ndarray
    push_now: np.ndarray
    push_over: np.ndarray
    output: np.ndarray
    direct: np.ndarray
    jacobian: np.ndarray
    at_samples: Passing
    at_next: Passing


@cache
def pushed_at(port: str) -> type[Effect]:
    """An effect that adds a number to the signal at a port or a channel."""

    def call(self: Any, value: Any, s: Signals) -> Any:
        return value + self.amount

    amount = parameter(0.0, null=0.0)
    return type("Push", (Effect,), {"name": _push_name(port), "port": port, "amount": amount,
                                    "__call__": call})  # fmt: skip


def _push_name(port: str) -> str:
    """A name for the push at a port; those of an actuator on a craft have dots."""
    return f"push_{port.replace('.', '_of_')}"


def step_slopes(
    layout: Any, numbers: Any, z: np.ndarray, paths: Sequence[Mapping[str, Any]]
) -> list[StepSlopes]:
    """The derivatives by batch, along the paths of a pass at coordinates ``z``."""
    out = []
    for index, slopes in enumerate(_linearised(layout, numbers, z, list(paths))):
        arrays = jax.tree.map(np.asarray, slopes)
        places = (*layout.key.model.ports, *layout.channels, *_input_names(numbers, index))
        out.append(StepSlopes(places, *arrays))
    return out


def _input_names(numbers: Any, index: int) -> tuple[str, ...]:
    return tuple(sorted(numbers.batches[index].inputs))


@program(1, quick_compile=True)
def _linearised(layout: Any, numbers: Any, z: Any, paths: Any) -> Any:
    shared, starts = numbers.split(z, layout.shared)
    out = []
    for index, (batch, start, path) in enumerate(zip(numbers.batches, starts, paths, strict=True)):

        def log_slopes(log_and_path: Any, index: int = index) -> Any:
            return _Step(layout, index, numbers, shared, *log_and_path).slopes()

        states = {n: v for n, v in path.items() if not n.startswith(_RECORDED)}
        out.append(jax.lax.map(log_slopes, (replace(batch, start=start), states)))
    return out


class _Step:
    """The step from each sample of one log to the next; traceable."""

    def __init__(
        self, layout: Any, index: int, numbers: Any, z: Any, log: Any, path: Mapping[str, Any]
    ) -> None:
        self.layout, self.grid, self.numbers = layout, layout.grids[index], numbers
        self.z, self.log, self.path = z, log, path
        self.names, self.inputs = tuple(path), _input_names(numbers, index)
        self.pushed = (*layout.key.model.ports, *layout.channels)
        self.model = layout.key.model + [pushed_at(place)() for place in self.pushed]
        count = len(self.pushed) + len(self.inputs)
        sizes = (z.shape[0], len(layout.local), len(self.names), count, count)
        self.ends = np.cumsum((0, *sizes))

    def slopes(self) -> Any:
        """The fields of `StepSlopes` after the places."""
        ends, zero = self.ends, jnp.zeros(self.ends[-1])
        start, next_states, errors = jax.jacfwd(self.step)(zero)
        next_states, errors = jnp.moveaxis(next_states, 0, 1), jnp.moveaxis(errors, 0, 1)
        states, now, over = (slice(ends[i], ends[i + 1]) for i in (2, 3, 4))
        coordinates = slice(0, ends[2])

        def body(x: Any, row: Any) -> tuple[Any, Any]:
            a, f, c, s = row
            return a @ x + f, c @ x + s

        transition, output = next_states[..., states], errors[..., states]
        rows = transition, next_states[..., coordinates], output, errors[..., coordinates]
        jacobian = jax.lax.scan(body, start[:, coordinates], rows)[1].transpose(2, 1, 0)
        pushes = next_states[..., now], next_states[..., over]
        return transition, *pushes, output, errors[..., now], jacobian, *self.passings()

    def values(self, z: Any, own: Any) -> dict[str, Any]:
        """The parameter values in this log."""
        return values_of_log(
            self.layout, self.numbers, named_values(self.layout, self.numbers, z), own
        )

    def pushed_model(self, values: Mapping[str, Any], push: Any) -> Any:
        """The model at some values, with a push at each port and channel."""
        amounts = {f"{_push_name(place)}.amount": push[i] for i, place in enumerate(self.pushed)}
        return self.model.bind({**values, **amounts})

    def pushed_inputs(self, model: Any, push: Any) -> dict[str, Any]:
        """The inputs as they arrive, with a push on each, and the time."""
        series = arriving(model, self.log.time, self.log.inputs)
        first = len(self.pushed)
        moved = {n: series[n] + push[first + i] for i, n in enumerate(self.inputs)}
        return {**series, **moved, "time": self.log.time}

    def step(self, w: Any) -> tuple[Any, Any, Any]:
        """States at the start ``(n,)``, those after each sample ``(n, T)``, errors ``(C, T)``."""
        ends, log, path = self.ends, self.log, self.path
        moved, initial, deviation, now, over = (w[a:b] for a, b in pairwise(ends))
        observer = self.layout.likelihood.observer
        values = self.values(self.z + moved, log.start + initial)
        model = self.pushed_model(values, now)
        limits = Limits(self.numbers.clip, self.numbers.reach)
        run = Correction(observer, model, values, log.time, log.measured, log.unsigned, limits)
        u = self.pushed_inputs(model, now)
        x = {n: path[n] + deviation[i] for i, n in enumerate(self.names)}
        predicted = read_out(model, Signals({**x, **u}))
        corrected = run.correct(x, u, run.rows)
        read = read_out(model, Signals({**corrected, **u}))
        errors, colours = [], {}
        for i, c in enumerate(observer.channels):
            colour = x.get(f"colour.{c}", 0.0)
            modelled = predicted[c] if c in observer.fed else read[c]
            errors.append(run.error(c, modelled, run.rows[c], colour))
            if c in observer.coloured and c not in observer.fed:
                gain, decay = values[f"noise.{c}.colour"], run.rows[f"colour.{c}"]
                colours[f"colour.{c}"] = decay * (colour + gain * limited(errors[-1], run.limit[i]))
        pushed = self.pushed_model(values, over)
        integrated = self.integrated(pushed, run, corrected, self.pushed_inputs(pushed, over))
        updated = {**integrated, **colours}
        first = Signals({n: value[0] for n, value in u.items()})
        starts = {n: log.start[i] + initial[i] for i, n in enumerate(self.layout.starts)}
        settled = starting_point(model, first, {**log.held, **starts})
        # arrays of no rows where nothing is a state: a simulated sensor has none, and no colours
        start = jnp.asarray([settled.get(n, 0.0) for n in self.names], float)
        next_states = jnp.zeros((len(self.names), log.time.size))
        for i, n in enumerate(self.names):
            next_states = next_states.at[i].set(updated[n])
        return start, next_states, jnp.stack(errors)

    def integrated(
        self, model: Any, run: Correction, states: Mapping[str, Any], u: Mapping[str, Any]
    ) -> dict[str, Any]:
        """The states at the next sample, from those after the correction at each."""
        grid, hold = self.grid, dict(self.grid.hold)
        # colours of channels that the observer does not integrate are updated at the sample
        updated = {f"colour.{c}" for c in self.layout.channels} - {*run.start}
        moving = [n for n in self.names if n not in updated]
        model_states = [n for n in moving if n not in run.start]

        def rates(state: Mapping[str, Any], inputs: Mapping[str, Any]) -> dict[str, Any]:
            return run.rates(rates_of(model, model_states, state, inputs), state)

        spans = {
            n: (v,) if hold.get(n, "linear") == "zero" else (v, jnp.append(v[1:], v[-1:]))
            for n, v in u.items()
        }
        steps = jnp.diff(u["time"], append=u["time"][-1:]) / grid.substeps
        first = {n: self.path[n][0] for n in moving}
        weights = {
            name: exponential_weights(steps, jnp.broadcast_to(k.decay, steps.shape))
            for name, k in rates(first, u).items()
            if isinstance(k, Relaxing)
        }

        def substep(k: Any, state: Mapping[str, Any]) -> dict[str, Any]:
            inputs = {n: within(span, k, grid.substeps) for n, span in spans.items()}
            return advance(rates, state, inputs, steps, weights, compact=True)

        state = {n: jnp.broadcast_to(states[n], steps.shape) for n in moving}
        return jax.lax.fori_loop(0, grid.substeps, substep, state)

    def passings(self) -> tuple[Passing, Passing]:
        """The signals along the path, at the samples and as the next ones come."""
        values = self.values(self.z, self.log.start)
        model, hold = self.layout.key.model.bind(values), dict(self.grid.hold)
        arrived = arriving(model, self.log.time, self.log.inputs)
        series = {**self.path, **arrived, "time": self.log.time}
        ends = {
            n: v if n in arrived and hold.get(n) == "zero" else jnp.append(v[1:], v[-1:])
            for n, v in series.items()
        }
        return self.passing(model, series), self.passing(model, ends)

    def passing(self, model: Any, series: Mapping[str, Any]) -> Passing:
        """The signal that leaves each place at some inputs and states."""
        s = Signals(series)
        port = _RecordingPorts(model.effects, s)
        _, outputs = equations_of(model, s, port)

        def wide(signals: Mapping[str, Any]) -> dict[str, Any]:
            return {n: jnp.broadcast_to(v, self.log.time.shape) for n, v in signals.items()}

        read = read_out(model, s)
        places = {c: (read[c], wide(outputs)) for c in self.layout.channels}
        places |= {n: (series[n], {}) for n in self.inputs}
        for name, (value, visible) in port.recorded.items():
            earlier = wide({n: v for n, v in visible.items() if n not in series})
            places[name] = wide({"": value})[""], earlier
        return Passing(dict(series), places)


class _RecordingPorts(Ports):
    """Ports that record what leaves them, and the signals that an effect there could read."""

    def __init__(self, effects: Sequence[Effect], signals: Signals) -> None:
        super().__init__(effects, signals)
        self.recorded: dict[str, tuple[Any, Signals]] = {}

    def __call__(self, port: str, value: Any) -> Any:
        value = super().__call__(port, value)
        self.recorded[port] = value, self._signals
        return value

"""The innovations form linearised from each sample to the next, all samples side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from diffthrust._support._running.programs import program
from diffthrust.estimation._likelihood import named_values
from diffthrust.estimation._observer import Correction, Limits, limited
from diffthrust.models._base.effect import Effect, Ports
from diffthrust.models._base.parameter import parameter
from diffthrust.models._base.signals import Relaxing, Signals
from diffthrust.simulation._integrate import within
from diffthrust.simulation._runge_kutta import advance, exponential_weights
from diffthrust.simulation._trajectory import (
    arriving,
    equations_of,
    rates_of,
    read_out,
    starting_point,
)

_NOTED = ("moved.", "pushed.", "rest.")
"""What a path notes besides states begins with these."""


class Passing(NamedTuple):
    """What an effect could act on along a path; all series ``(B, T)``.

    Args:
        series: inputs and states.
        places: what leaves each place, and what the model has told until there.
    """

    series: Mapping[str, np.ndarray]
    places: Mapping[str, tuple[np.ndarray, Mapping[str, np.ndarray]]]


@dataclass(frozen=True, eq=False)
class StepSlopes:
    """One batch of logs; ``n`` states, the observer's included, ``P`` places, ``C`` channels.

    Args:
        places: ports, measured channels and inputs.
        carry: of the next states by the states, ``(B, T, n, n)``.
        now: of the next states by a push at the sample, ``(B, T, n, P)``.
        over: of the next states by a push until the next sample, ``(B, T, n, P)``.
        seen: of the errors by the states, ``(B, T, C, n)``.
        shown: of the errors by a push at the sample, ``(B, T, C, P)``.
        jacobian: of the errors by the coordinates, then by the initial states, ``(B, m, C, T)``.
        early: what there is at each sample.
        late: what there is when the next sample comes: inputs that are held are as they were.
    """

    places: tuple[str, ...]
    carry: np.ndarray
    now: np.ndarray
    over: np.ndarray
    seen: np.ndarray
    shown: np.ndarray
    jacobian: np.ndarray
    early: Passing
    late: Passing


@cache
def pushed_at(port: str) -> type[Effect]:
    """An effect that adds a number to what passes a port or a channel."""

    def call(self: Any, value: Any, s: Signals) -> Any:
        return value + self.amount

    amount = parameter(0.0, null=0.0)
    return type("Push", (Effect,), {"name": f"push_{port}", "port": port, "amount": amount,
                                    "__call__": call})  # fmt: skip


def step_slopes(
    layout: Any, numbers: Any, z: np.ndarray, paths: Sequence[Mapping[str, Any]]
) -> list[StepSlopes]:
    """By batch, along the paths of a pass at coordinates ``z``."""
    out = []
    for index, slopes in enumerate(_linearised(layout, numbers, z, list(paths))):
        parts = jax.tree.map(np.asarray, slopes)
        places = (*layout.key.model.ports, *layout.channels, *_input_names(numbers, index))
        out.append(StepSlopes(places, *parts))
    return out


def _input_names(numbers: Any, index: int) -> tuple[str, ...]:
    return tuple(sorted(numbers.batches[index].inputs))


@program(1)
def _linearised(layout: Any, numbers: Any, z: Any, paths: Any) -> Any:
    shared, starts = numbers.split(z, layout.shared)
    out = []
    for index, (batch, start, path) in enumerate(zip(numbers.batches, starts, paths, strict=True)):

        def log_slopes(log_and_path: Any, index: int = index) -> Any:
            return _Step(layout, index, numbers, shared, *log_and_path).slopes()

        states = {n: v for n, v in path.items() if not n.startswith(_NOTED)}
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
        sizes = (z.shape[0], len(layout.starts), len(self.names), count, count)
        self.ends = np.cumsum((0, *sizes))

    def slopes(self) -> Any:
        """What `StepSlopes` holds, but the places."""
        ends, still = self.ends, jnp.zeros(self.ends[-1])
        begin, after, errors = jax.jacfwd(self.step)(still)
        after, errors = jnp.moveaxis(after, 0, 1), jnp.moveaxis(errors, 0, 1)
        states, now, over = (slice(ends[i], ends[i + 1]) for i in (2, 3, 4))
        initial = slice(0, ends[2])

        def body(x: Any, row: Any) -> tuple[Any, Any]:
            a, f, c, s = row
            return a @ x + f, c @ x + s

        rows = (after[..., states], after[..., initial], errors[..., states], errors[..., initial])
        jacobian = jax.lax.scan(body, begin[:, initial], rows)[1].transpose(2, 1, 0)
        matrices = after[..., states], after[..., now], after[..., over]
        by = errors[..., states], errors[..., now]
        return *matrices, *by, jacobian, *self.passings()

    def parts(self, w: Any) -> list[Any]:
        return [w[a:b] for a, b in zip(self.ends[:-1], self.ends[1:], strict=True)]

    def bound(self, values: Mapping[str, Any], push: Any) -> Any:
        amounts = {f"push_{place}.amount": push[i] for i, place in enumerate(self.pushed)}
        return self.model.bind({**values, **amounts})

    def driven(self, model: Any, push: Any) -> dict[str, Any]:
        """What arrives of the inputs, with a push on each, and the time."""
        series = arriving(model, self.log.time, self.log.inputs)
        ahead = len(self.pushed)
        moved = {n: series[n] + push[ahead + i] for i, n in enumerate(self.inputs)}
        return {**series, **moved, "time": self.log.time}

    def step(self, w: Any) -> tuple[Any, Any, Any]:
        """States at the start ``(n,)``, those after each sample ``(n, T)``, errors ``(C, T)``."""
        moved, start_push, away, now, over = self.parts(w)
        log, path = self.log, self.path
        observer = self.layout.likelihood.observer
        values = named_values(self.layout, self.numbers, self.z + moved)
        model, limits = self.bound(values, now), Limits(self.numbers.clip, self.numbers.reach)
        run = Correction(observer, model, values, log.time, log.measured, log.unsigned, limits)
        u = self.driven(model, now)
        x = {n: path[n] + away[i] for i, n in enumerate(self.names)}
        ahead = read_out(model, Signals({**x, **u}))
        corrected = run.correct(x, u, run.rows)
        read = read_out(model, Signals({**corrected, **u}))
        errors, waiting = [], {}
        for i, c in enumerate(observer.channels):
            colour = x[f"colour.{c}"]
            modelled = ahead[c] if c in observer.fed else read[c]
            errors.append(run.error(c, modelled, run.rows[c], colour))
            if c not in observer.fed:
                gain, kept = values[f"noise.{c}.colour"], run.rows[f"colour.{c}"]
                waiting[f"colour.{c}"] = kept * (colour + gain * limited(errors[-1], run.limit[i]))
        pushed = self.bound(values, over)
        after = {**self.carried(pushed, run, corrected, self.driven(pushed, over)), **waiting}
        first = Signals({n: value[0] for n, value in u.items()})
        initial = {n: log.start[i] + start_push[i] for i, n in enumerate(self.layout.starts)}
        begin = starting_point(model, first, {**log.held, **initial})
        start = jnp.stack([jnp.asarray(begin.get(n, 0.0), float) for n in self.names])
        wide = [jnp.broadcast_to(after[n], log.time.shape) for n in self.names]
        return start, jnp.stack(wide), jnp.stack(errors)

    def carried(
        self, model: Any, run: Correction, states: Mapping[str, Any], u: Mapping[str, Any]
    ) -> dict[str, Any]:
        """The states at the next sample, from those after the correction at each."""
        grid, hold = self.grid, dict(self.grid.hold)
        alone = {f"colour.{c}" for c in self.layout.channels} - {*run.start}
        moving = [n for n in self.names if n not in alone]
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

        def further(part: Any, state: Mapping[str, Any]) -> dict[str, Any]:
            inputs = {n: within(span, part, grid.substeps) for n, span in spans.items()}
            return advance(rates, state, inputs, steps, weights)

        state = {n: jnp.broadcast_to(states[n], steps.shape) for n in moving}
        return jax.lax.fori_loop(0, grid.substeps, further, state)

    def passings(self) -> tuple[Passing, Passing]:
        """Along the path, at the samples and when the next ones come."""
        values = named_values(self.layout, self.numbers, self.z)
        model, hold = self.layout.key.model.bind(values), dict(self.grid.hold)
        arrived = arriving(model, self.log.time, self.log.inputs)
        series = {**self.path, **arrived, "time": self.log.time}
        early = self.passing(model, series)
        ends = {
            n: v if n in arrived and hold.get(n) == "zero" else jnp.append(v[1:], v[-1:])
            for n, v in series.items()
        }
        return early, self.passing(model, ends)

    def passing(self, model: Any, series: Mapping[str, Any]) -> Passing:
        """What leaves each place where inputs and states are so."""
        s = Signals(series)
        port = _Noting(model.effects, s)
        _, outputs = equations_of(model, s, port)

        def wide(named: Mapping[str, Any]) -> dict[str, Any]:
            return {n: jnp.broadcast_to(v, self.log.time.shape) for n, v in named.items()}

        read = read_out(model, s)
        places = {c: (read[c], wide(outputs)) for c in self.layout.channels}
        places |= {n: (series[n], {}) for n in self.inputs}
        for name, (value, visible) in port.noted.items():
            earlier = wide({n: v for n, v in visible.items() if n not in series})
            places[name] = wide({"": value})[""], earlier
        return Passing(dict(series), places)


class _Noting(Ports):
    """Ports that note what leaves them, and the signals that an effect there could read."""

    def __init__(self, effects: Sequence[Effect], signals: Signals) -> None:
        super().__init__(effects, signals)
        self.noted: dict[str, tuple[Any, Signals]] = {}

    def __call__(self, port: str, value: Any) -> Any:
        value = super().__call__(port, value)
        self.noted[port] = value, self._signals
        return value

"""The innovations form of a simulation: at each sample the states are corrected by its error.

A simulation over a whole run accumulates what random forces do, and its residuals are long and
correlated. The innovations form (Ljung 1999, section 7.3; Kristensen, Madsen & Jorgensen 2004)
predicts each sample from all earlier ones. Beside the model run, for each measured state,

- a **drift**: a random acceleration with a memory, which the past errors reveal,
- a **colour**: a part of the sensor's error that lasts from one sample to the next,

and each error moves the state, its drift and its colour by constant gains. Angles from which a
quaternion follows are corrected like states, and it follows them. Gains and memories are
estimated with the model's parameters by maximum likelihood, so that they come out as large as the
logs ask: without random forces the gains vanish, and the simulation error is left. Outputs that
are not states (a thrust) are read from the corrected states and have a colour only.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust.estimation._numbers import AnyArray, Batch
from diffthrust.models._base.effect import Ports
from diffthrust.models._base.model import Model
from diffthrust.models._base.parameter import Parameter
from diffthrust.models._base.signals import Signals
from diffthrust.simulation._errors import wrapped
from diffthrust.simulation._integrate import with_push
from diffthrust.simulation._linearise import slopes_at
from diffthrust.simulation._record import Record, measured_outputs
from diffthrust.simulation._starts import told_by
from diffthrust.simulation._trajectory import Grid, equations_of, march, read_out

CLIP = 4.0
"""An error of more than so many standard deviations corrects as much as one of that size."""
WIDE = 5.0
"""As much as one of so many times that size, where large errors are no spikes of a sensor but tell
how the states moved."""
REAL = 10.0
"""That is so where the logs are likelier with `WIDE` by more than this (log-likelihood)."""

_PER_STEP = "1 / step"
"""Of what is handed to a correction beside the readings, by a name that no channel can have: of a
motor whose speed is called "rate" this took the place of the reading."""


@dataclass(frozen=True)
class Observer:
    """What is corrected by what; fixes the compiled code.

    One that is ``still`` corrects nothing, and no random force acts: what is left is a simulation
    whose sensors have errors that last ("ar1" noise). Where ``within`` is given, measured states
    follow their readings within so many seconds, by gains that are fixed and not estimated.
    """

    channels: tuple[str, ...]  # all that are measured
    fed: tuple[str, ...]  # those that are states, or tell what `follow`, and correct them
    corrected: tuple[tuple[str, tuple[str, ...]], ...]  # by state, the channels that correct it
    forced: tuple[str, ...]  # states on which random forces act
    still: bool = False
    lasting: bool = True  # sensors have errors that last
    within: float | None = None
    follow: tuple[str, ...] = ()  # states that follow from outputs, as a quaternion from angles

    @property
    def simulation(self) -> Observer:
        """That of a plain simulation, without any gain or memory."""
        return replace(self, corrected=(), forced=(), lasting=False)

    def forgetting(self, seconds: float) -> Observer:
        """That of a simulation whose measured states follow their readings within some time.

        It errs as on segments of that length: errors do not accumulate beyond it.
        """
        own = tuple((state, (state,)) for state in self.fed)
        return replace(self, corrected=own, forced=(), lasting=False, within=seconds)

    @property
    def coloured(self) -> tuple[str, ...]:
        """The channels whose sensors have errors that last."""
        return self.channels if self.lasting else ()

    @property
    def carried(self) -> tuple[str, ...]:
        """Those of them whose lasting error is a state of the observer."""
        return self.fed if self.lasting else ()

    def parameters(self, duration: float, step: float) -> dict[str, Parameter]:
        """The gains and memories, by name, with values to start from."""
        named: dict[str, Parameter] = {}
        longest = (0.5 * step, 10.0 * duration)

        def gain(value: float, signed: bool = True) -> Parameter:
            low, value = (0.0, value) if signed else (None, 0.0)
            value = 0.0 if self.still else value
            if self.within is not None:
                value = min(1.0, step / self.within)
            fixed = self.still or self.within is not None
            return Parameter(value, "", (low, 1.0), size=0.3, fixed=fixed)

        def memory(seconds: float, still: bool = False) -> Parameter:
            value = min(max(seconds, 2 * step), 0.5 * duration)
            return Parameter(value, "s", longest, transform="log", fixed=still)

        for state, sources in self.corrected:
            for c in sources:
                named[f"noise.{state}.gain.{c}"] = gain(0.2, state == c)
                if state in self.forced:
                    named[f"noise.{state}.drift.{c}"] = gain(0.05, state == c)
            if state in self.forced:
                named[f"noise.{state}.memory"] = memory(1.0, self.still)
        for c in self.coloured:
            unity = Parameter(1.0, "", (0.0, 1.0), size=0.3, fixed=True)
            named[f"noise.{c}.colour"] = unity if self.still else gain(0.2)
            named[f"noise.{c}.correlation"] = memory(5 * step)
        return named


def observer_of(
    model: Model,
    record: Record,
    channels: Sequence[str],
    remembering: Collection[str] = (),
    still: bool = False,
) -> Observer:
    """The observer of a model for some measured channels.

    A measured state is corrected by its own channel. A state that is not measured, but drives one
    that is, is corrected by all. Random forces act on the states whose rates pass a port (in a
    model without ports: on all). Channels named in ``remembering`` correct nothing: an effect there
    reads more than the present sample. Where no state is measured nothing is corrected, and the
    errors of the outputs keep their colour.
    """
    free = [n for n in model.states if n not in record.inputs]
    read = [n for n in channels if n not in remembering]
    measured = [n for n in free if n in read]
    telling, states = told_by(model, read)
    follow = tuple(n for n in states if n in free and n not in read)
    fed = (*measured, *(telling if follow else ()))
    rates, _ = slopes_at(model, record)
    corrected = {
        n: (n,) if n in measured else fed
        for n in free
        if n not in follow and (n in measured or any(rates[m][0][n] != 0 for m in measured))
    }
    forced = tuple(
        n for n in corrected if not model.ports or any(v != 0 for v in rates[n][1].values())
    )
    corrected |= {n: (n,) for n in fed}
    return Observer(tuple(channels), fed, (*corrected.items(),), forced, still, follow=follow)


def observer_for(model: Model, records: Sequence[Record]) -> Observer:
    """The observer of a model for what the records measure.

    Raises:
        InputError: no state is measured as it is, or the logs prescribe different states.
    """
    prescribed = {tuple(n for n in model.states if n in record.inputs) for record in records}
    if len(prescribed) > 1:
        raise InputError(
            f"The innovations form needs logs that drive the model alike; '{model}' is given "
            f"{' and '.join(listing(names) for names in prescribed)} as an input.",
            "Fit these logs apart, or use likelihood='simulation'.",
        )
    channels = measured_outputs(model, records)
    remembering = {port for effect in model.effects if effect.memory for port in effect.ports}
    observer = observer_of(model, records[0], channels, remembering)
    if not observer.fed:
        raise InputError(
            f"The innovations form needs a measured state of '{model}': expected one of "
            f"{listing(model.states)}, found {listing(channels)}.",
            "Map a column to one of these channels, or use likelihood='simulation'.",
        )
    return observer


def is_memory(name: str) -> bool:
    """Whether a parameter of an observer is a memory [s]; all others are gains."""
    return name.rpartition(".")[2] in ("memory", "correlation")


def guesses(names: Collection[str]) -> tuple[dict[str, float], ...]:
    """Gains from which to start: as given, nearly none, and errors that are mostly the sensor's."""
    quiet = {n: 0.02 for n in names if not is_memory(n)}
    if not quiet:
        return ({},)
    return {}, quiet, {**quiet, **{n: 0.9 for n in quiet if n.endswith(".colour")}}


def uncorrected(names: Collection[str]) -> dict[str, float]:
    """Gains with which nothing is corrected: a simulation, finite wherever the model's own is."""
    return {n: 0.0 for n in names if not is_memory(n)}


class Limits(NamedTuple):
    """By channel the size of a large error, and at how many times that errors are limited."""

    clip: Float[AnyArray, " channels"]
    reach: Float[AnyArray, ""]


class Correction:
    """One run of an observer over one log, which corrects what `march` simulates."""

    def __init__(
        self,
        observer: Observer,
        model: Model,
        values: Mapping[str, Any],
        time: Float[AnyArray, " time"],
        measured: Float[AnyArray, "channels time"],
        unsigned: Bool[AnyArray, " channels"],
        limits: Limits,
    ) -> None:
        self.observer, self.model, self.values = observer, model, values
        self.unsigned, self.clip = unsigned, limits.clip
        self.limit = limits.reach * self.clip
        step = jnp.diff(time, append=time[-1:])
        kept = {f"drift.{n}": values[f"noise.{n}.memory"] for n in observer.forced}
        kept |= {f"colour.{c}": values[f"noise.{c}.correlation"] for c in observer.coloured}
        decays = {name: jnp.exp(-step / memory) for name, memory in kept.items()}
        rate = jnp.where(step > 0, 1.0 / jnp.where(step > 0, step, 1.0), 0.0)
        readings = {c: measured[i] for i, c in enumerate(observer.channels)}
        self.rows: Mapping[str, Any] = {**decays, **readings, _PER_STEP: rate}
        self.start: Mapping[str, Any] = {f"drift.{n}": 0.0 for n in observer.forced}
        self.start = {**self.start, **{f"colour.{c}": 0.0 for c in observer.carried}}

    def rates(self, rates: dict[str, Any], state: Mapping[str, Any]) -> dict[str, Any]:
        """Random accelerations on the forced states; the observer's own states wait."""
        pushed = {n: with_push(rates[n], state[f"drift.{n}"]) for n in self.observer.forced}
        return {**rates, **pushed, **dict.fromkeys(self.start, 0.0)}

    def error(self, channel: str, modelled: Any, measured: Any, colour: Any) -> Any:
        """Measured minus predicted; zero where nothing was measured."""
        i = self.observer.channels.index(channel)
        # half a standard deviation of the errors: wider, it would bend what is read above zero
        size = modelled * direction(modelled, 0.5 * self.clip[i] / CLIP)
        modelled = jnp.where(self.unsigned[i], size, modelled)
        residual = jnp.where(jnp.isnan(measured), 0.0, measured) - modelled - colour
        if channel in self.model.angles:
            residual = wrapped(residual)
        return jnp.where(jnp.isnan(measured), 0.0, residual)

    def correct(self, state: dict[str, Any], u: Mapping[str, Any], row: Any) -> dict[str, Any]:
        """The states after a sample; elementwise, for one sample or a whole log."""
        o, v = self.observer, self.values
        s = Signals({**state, **u})
        _, outputs = equations_of(self.model, s, Ports(self.model.effects, s))
        sensor = Ports(self.model.effects, s.also(outputs))
        bounded, errors = {}, {}
        for c in o.fed:
            modelled = sensor(c, outputs[c])
            e = self.error(c, modelled, row[c], state.get(f"colour.{c}", 0.0))
            i = o.channels.index(c)
            bounded[c] = limited(e, self.limit[i])
            toward = jnp.where(self.unsigned[i], direction(modelled, self.clip[i]), 1.0)
            errors[c] = toward * bounded[c]
        derived = [name for name, _ in o.corrected if name not in state]
        new = {**state, **{name: outputs[name] for name in derived}}
        for name, sources in o.corrected:
            measured = name in o.fed
            pace = 1.0 if measured else row[_PER_STEP]
            new[name] = new[name] + pace * sum(
                v[f"noise.{name}.gain.{c}"] * errors[c] for c in sources
            )
            if name in o.forced:
                pace = row[_PER_STEP] if measured else row[_PER_STEP] ** 2
                drift = sum(v[f"noise.{name}.drift.{c}"] * errors[c] for c in sources)
                new[f"drift.{name}"] = row[f"drift.{name}"] * (
                    state[f"drift.{name}"] + pace * drift
                )
        if derived:
            following = self.model.start_from({name: new.pop(name) for name in derived})
            new |= {name: following[name] for name in o.follow}
        for c in o.carried:
            held = state[f"colour.{c}"] + v[f"noise.{c}.colour"] * bounded[c]
            new[f"colour.{c}"] = row[f"colour.{c}"] * held
        return new


def limited(error: Any, limit: Any) -> Any:
    """What an error corrects: itself where it is small, no more than ``limit``.

    The bend is smooth (0.7 % at 0.7 of the limit, 8 % at the limit). A corner would hold fits: with
    some thousand samples there is always one that sits on it.
    """
    square = jnp.minimum((error / limit) ** 2, 1e30)
    return error / jnp.sqrt(jnp.sqrt(jnp.sqrt(1.0 + square**4)))


def direction(modelled: Any, width: Any) -> Any:
    """The sign of what a sensor without one shows, smooth where it passes zero.

    Next to zero such a sensor does not tell on which side the state is, and a correction that jumps
    from one side to the other makes the likelihood jump with it.
    """
    smooth = jnp.tanh(modelled / jnp.where(jnp.isfinite(width), width, 1.0))
    return jnp.where(jnp.isfinite(width), smooth, jnp.where(modelled < 0, -1.0, 1.0))


def innovations(
    observer: Observer,
    model: Model,
    grid: Grid,
    values: Mapping[str, Any],
    log: Batch,
    start: Mapping[str, Any],
    limits: Limits,
) -> tuple[Any, dict[str, Any]]:
    """Errors of the one-step predictions, ``(C, T)``, and the states before each correction.

    The states come with ``moved.STATE``, what the correction adds to a corrected state, and
    ``pushed.STATE``, the random acceleration until the next sample; with ``rest.CHANNEL``, what is
    left of a measurement before its own past has predicted it, and ``colour.CHANNEL``, what that
    past predicts. ``values`` are the gains and memories by name.
    """
    run = Correction(observer, model, values, log.time, log.measured, log.unsigned, limits)
    series, path = march(model, grid, log.time, log.inputs, start, {}, run)
    signals = {**series, "time": log.time}
    ahead = read_out(model, Signals({**path, **signals}))
    corrected = run.correct(path, signals, run.rows)
    after = read_out(model, Signals({**corrected, **signals}))
    moved = [n for n, _ in observer.corrected if n in path]
    noted = {f"moved.{n}": corrected[n] - path[n] for n in moved}
    noted |= {f"pushed.{n}": corrected[f"drift.{n}"] for n in observer.forced}
    errors = []
    for c in observer.channels:
        modelled = ahead[c] if c in observer.fed else after[c]
        noted[f"rest.{c}"] = residual = run.error(c, modelled, run.rows[c], 0.0)
        if c in observer.fed:
            errors.append(run.error(c, modelled, run.rows[c], path.get(f"colour.{c}", 0.0)))
        elif not observer.lasting:
            errors.append(residual)
        else:
            gain, limit = values[f"noise.{c}.colour"], run.limit[observer.channels.index(c)]
            kept = run.rows[f"colour.{c}"]
            new, noted[f"colour.{c}"] = _whitened(residual, run.rows[c], gain, kept, limit)
            errors.append(new)
    return jnp.stack(errors), {**path, **noted}


def _whitened(
    residual: Any, measured: Any, gain: Any, kept: Any, limit: Any
) -> tuple[jax.Array, jax.Array]:
    """What remains of a residual after its own past has predicted it, and that prediction."""

    def body(colour: Any, x: Any) -> tuple[Any, Any]:
        r, finite, keep = x
        e = jnp.where(finite, r - colour, 0.0)
        return keep * (colour + gain * limited(e, limit)), (e, colour)

    finite = ~jnp.isnan(measured)
    _, both = jax.lax.scan(body, jnp.zeros(()), (residual, finite, kept))
    return both

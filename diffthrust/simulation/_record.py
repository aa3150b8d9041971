"""Logs bound to a model: checked, counted, without gaps, and in the model's units.

`bind` is called once, at the door of a public verb; everything below it works on records and
nothing there asks a log for a channel, a unit or a gap again. A record is bound to a model's
channels and not to its effects: it keeps every input of the log, and `Record.inputs_for` selects
what a model with some effects reads. So one record serves ``model + effect`` for any effect, and
any values of the parameters.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing, nearest, short_repr
from diffthrust._support.validation import check_known, finite
from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model
from diffthrust.simulation._commands import command_kind

_EARLY = 10
"""A state begins at its first measurement where that is among this many samples, or comes as soon
as its measurements follow each other. Later, the state has moved on from where it began."""


class RailSamples(NamedTuple):
    """Samples of a censored channel that stand at the ends of its sensor's range, ``(k,)`` each.

    Args:
        places: on the time base of the record.
        values: the end of the range, in the model's unit.
        sides: 1 where a sample says "at least", -1 where it says "at most".
    """

    places: np.ndarray
    values: np.ndarray
    sides: np.ndarray


@dataclass(frozen=True, eq=False, repr=False)
class Record:
    """One log as a model reads it. All arrays are read-only.

    Its time base has T samples: the n of the log, and further ones that bridge gaps in time.

    Args:
        log: the log as it was given, for its name, hash, written units and notes.
        counted: the log in which only what carries weight is measured.
        time: time stamps [s], ``(T,)``.
        original: places of the log's samples on the time base, ``(n,)``.
        step: median time between samples [s]; NaN for a single one.
        even: all samples are equally far apart.
        inputs: every input of the log, ``(T,)``: in the model's unit where the model names it, as
            stored where it does not, for an effect may read it.
        hold: "zero" or "linear" by input: how it runs between its samples.
        measured: outputs of the model that the log measures, ``(T,)``; NaN where nothing was
            measured, at repeats of held sensors and at rails.
        measured_states: the same of states, in the units of the states.
        recorded: outputs and states as they were logged, repeats and rails included, ``(n,)``: what
            they say of how large a signal is.
        noise: standard deviation of each measured output; None where the log does not state it.
        start: first measurement of each state that is measured from the beginning.
        rails: samples at the ends of the range, by channel that the log declares censored.
    """

    log: Log
    counted: Log
    time: np.ndarray
    original: np.ndarray
    step: float
    even: bool
    inputs: Mapping[str, np.ndarray]
    hold: Mapping[str, str]
    measured: Mapping[str, np.ndarray]
    measured_states: Mapping[str, np.ndarray]
    recorded: Mapping[str, np.ndarray]
    noise: Mapping[str, float | None]
    start: Mapping[str, float]
    rails: Mapping[str, RailSamples] = field(default_factory=dict)

    def __post_init__(self) -> None:
        series = (self.inputs, self.measured, self.measured_states, self.recorded)
        for array in (self.time, self.original, *(v for named in series for v in named.values())):
            array.flags.writeable = False

    def __len__(self) -> int:
        """Number of samples of the time base, T."""
        return int(self.time.size)

    @property
    def name(self) -> str:
        """Of the log."""
        return self.log.name

    @property
    def duration(self) -> float:
        """Time from the first to the last sample [s]."""
        return self.log.duration

    @property
    def unsigned(self) -> frozenset[str]:
        """Measured channels whose sensor reports the absolute value."""
        return self.log.unsigned

    def inputs_for(self, model: Model) -> dict[str, np.ndarray]:
        """The inputs that a model and its effects read, ``(T,)``, in the model's units.

        Args:
            model: that to which the log was bound, with any effects.

        Raises:
            InputError: an input that an effect needs and the log does not have.
        """
        return {name: self.inputs[name] for name in _inputs_read(model, self.inputs, self.name)}

    def holds(self, names: Collection[str]) -> tuple[tuple[str, str], ...]:
        """How each of some inputs runs between its samples, as a `Grid` takes it."""
        return tuple((name, self.hold.get(name, "zero")) for name in sorted(names))

    def at_samples(self, series: np.ndarray) -> np.ndarray:
        """A series of the time base at the samples of the log, ``(n,)``."""
        return series if self.original.size == self.time.size else series[self.original]

    @cached_property
    def observed(self) -> Mapping[str, np.ndarray]:
        """What is measured of each output at the samples of the log, ``(n,)``."""
        return {name: self.at_samples(values) for name, values in self.measured.items()}


def bind(model: Model, logs: Sequence[Log], *, compared: bool = True) -> tuple[Record, ...]:
    """Bind logs to a model: check them, and bring them into its units and on its time base.

    Args:
        model: the model, with its command in the unit of the logs (see `adopted`).
        logs: the logs.
        compared: the model is held against what they measure. A log that only drives a simulation
            may be short, and what it measures only says how fine a step must be: there repeats of
            held sensors and samples at rails stay.

    Raises:
        InputError: an input is missing, a unit measures another quantity, the command is of another
            kind, the time base is none that such a system can have, or a log is too short.
    """
    if compared:
        for log in logs:
            _check_length(model, log)
    return tuple(_bound(model, log, compared) for log in logs)


def input_ranges(model: Model, records: Sequence[Record]) -> dict[str, tuple[float, float]]:
    """The smallest and largest value of each input that a model reads from all records."""
    inputs = [record.inputs_for(model) for record in records]
    return {
        name: (
            float(min(np.nanmin(series[name]) for series in inputs)),
            float(max(np.nanmax(series[name]) for series in inputs)),
        )
        for name in inputs[0]
        if all(name in series for series in inputs)
    }


def measured_outputs(model: Model, records: Sequence[Record]) -> tuple[str, ...]:
    """The outputs of a model that any of the records measures."""
    return tuple(n for n in model.outputs if any(n in record.measured for record in records))


def _bound(model: Model, log: Log, compared: bool) -> Record:
    _inputs_read(model, log.inputs, log.name)
    _check_command(model, log)
    _check_time(model, log)
    counted = log.counted if compared else log
    longer, original = bridged(counted)
    units = {**model.inputs, **model.optional_inputs, **model.states}
    outputs = {name: unit for name, unit in model.outputs.items() if name in log.measured}
    states = {name: unit for name, unit in model.states.items() if name in log.measured}
    measured = {name: longer.values(name, unit) for name, unit in outputs.items()}
    measured_states = {name: longer.values(name, unit) for name, unit in states.items()}
    for names in model.quaternions:
        measured, measured_states = (_unturned(v, names) for v in (measured, measured_states))
    return Record(
        log=log,
        counted=counted,
        time=longer.time,
        original=original,
        step=longer.step,
        even=longer.even,
        inputs={name: longer.values(name, units.get(name, "")) for name in log.inputs},
        hold=dict(log.hold),
        measured=measured,
        measured_states=measured_states,
        recorded={name: log.values(name, unit) for name, unit in {**outputs, **states}.items()},
        noise={name: log.noise_in(name, unit) for name, unit in outputs.items()},
        start=_measured_start(model, log, states, outputs),
        rails=_rails(log, original, model.outputs) if compared else {},
    )


def _unturned(series: dict[str, np.ndarray], names: Sequence[str]) -> dict[str, np.ndarray]:
    """Series whose quaternion goes on as it began: a log may turn all its signs at any sample."""
    parts = [name for name in names if name in series]
    if not parts:
        return series
    rows = np.stack([series[name] for name in parts])
    valid = np.flatnonzero(np.isfinite(rows).all(axis=0))
    turned = np.sum(rows[:, valid[1:]] * rows[:, valid[:-1]], axis=0) < 0
    signs = np.ones(rows.shape[1])
    signs[valid[1:]] = 1.0 - 2.0 * (np.cumsum(turned) % 2)
    return {**series, **{name: signs * series[name] for name in parts}}


def _inputs_read(model: Model, inputs: Collection[str], where: str) -> tuple[str, ...]:
    """The inputs, of those that a log has, that a model and its effects read.

    Raises:
        InputError: one that they need is not there.
    """
    for effect in model.effects:
        for name in effect.needs:
            if name not in inputs:
                raise InputError(
                    f"{where}: the effect '{effect.name}' needs the input '{name}', which the "
                    f"log does not have; it has {listing(inputs)}.",
                    f"Give the log the channel '{name}', or leave the effect out.",
                )
    needed = list(model.inputs)
    if any(name in inputs for name in model.states):  # a prescribed state needs no driving inputs
        needed = [name for name in needed if name in inputs]
    for name in needed:
        if name not in inputs:
            raise InputError(
                f"{where}: the model '{model.name}' needs the input '{name}'; the log has "
                f"{listing(inputs)}.",
                f"Map a column to the channel '{name}'.",
            )
    optional = [name for name in (*model.optional_inputs, *model.states) if name in inputs]
    needs = [name for effect in model.effects for name in effect.needs]
    return tuple(dict.fromkeys([*needed, *optional, *needs]))


def _check_command(model: Model, log: Log) -> None:
    """Raise `InputError` where the log gives the command in another of the model's units."""
    for name in model.commanded:
        kind = command_kind(model, log.units[name]) if name in log.inputs else model.command
        if kind != model.command:
            raise InputError(
                f"{log.name}: the log gives {name!r} as {kind!r}, but the numbers of the model "
                f"'{model}' are for a command in {model.command!r}.",
                f"Fit the model to such a log, or make it with command={kind!r} and values of "
                "that kind.",
            )


def _check_time(model: Model, log: Log) -> None:
    """Raise `InputError` for a time base that looks to be in another unit than seconds.

    Only far beyond the model's time constants, for a slow log may be what there is.
    """
    # A time base in ms instead of s makes a thruster's log a thousand times slower: the fit would
    # not fail but return time constants of minutes.
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
    mend = f"Check the unit of the time column ({mend})."
    if log.static:
        mend = "Say how long each row of the table is held: read_log(..., time=0.5, static=True)."
    raise InputError(
        f"{log.name}: the time base gives {looks}, but a '{model.name}' has time constants between "
        f"{fastest:g} s and {slowest:g} s, which such a log is not made to show.",
        mend,
    )


def _check_length(model: Model, log: Log) -> None:
    """Raise `InputError` for a log that is too short to hold a model against it.

    One step says where the simulation began, and nothing of how the model goes on.
    """
    # A model without integrated states may be compared sample by sample.
    least = 2 if all(name in log.inputs for name in model.states) else 3
    if len(log) < least:
        raise InputError(
            f"{log.name}: expected at least {least} samples to hold a '{model.name}' against, "
            f"found {len(log)}.",
            "Give a longer log, or leave this one out; to simulate a short one, use simulate.",
        )


def are_tables(records: Iterable[Record]) -> bool:
    """Whether all records are static tables, without a time of their own."""
    return all(record.log.static for record in records)


def _measured_start(
    model: Model, log: Log, states: Mapping[str, str], outputs: Mapping[str, str]
) -> dict[str, float]:
    """The start of each state that a measurement from the beginning of the log tells."""
    first, counted = {}, log.counted
    for name, unit in {**outputs, **states}.items():
        if name not in log.inputs:
            values = counted.values(name, unit)
            valid = np.flatnonzero(np.isfinite(values))
            if valid.size and valid[0] < max(_EARLY, np.median(np.diff(valid, prepend=-1))):
                first[name] = float(values[valid[0]])
    measured = {name: value for name, value in first.items() if name in states}
    return {**measured, **_following(model, first, log.inputs)}


def _following(
    model: Model, first: Mapping[str, float], prescribed: Collection[str]
) -> dict[str, float]:
    """The states that a model, or the body of a craft, tells by first measurements, checked.

    What is no state of it is passed over as long as it is not nearly the name of one: outputs that
    were handed on, and states of an effect that this model does not have.
    """
    where = f"{type(getattr(model, 'body', model)).__name__}.start_from"
    follow = model.start_from(first)
    if not isinstance(follow, Mapping):
        raise InputError(
            f"{where}: expected a mapping from states to numbers, found {short_repr(follow)}.",
            f"Write return {{'{next(iter(model.states), 'state')}': value}}.",
        )
    start = {}
    apart = {*first, *model.outputs, *model.parameters, *prescribed}
    for name, value in follow.items():
        meant = name in apart or "." in str(name) or not nearest(str(name), model.all_states)
        if not meant:
            check_known(name, model.all_states, f"{where}: '{model}' has no state")
        start[name] = value
        if name in model.all_states and name not in prescribed:
            expected = f"a finite number for the state '{name}'"
            mend = "Return one number for each."
            start[name] = finite(where, value, lambda _: True, expected, mend)
    return start


def _rails(log: Log, original: np.ndarray, units: Mapping[str, str]) -> dict[str, RailSamples]:
    """The samples at the rails of a log's censored channels."""
    rails = {}
    for name in log.railed:
        if name in log.censored:
            low, high, side = log.railed[name]
            at = np.flatnonzero(side)
            ends = log.replaced(measured={name: np.where(side[at] > 0, high, low)})
            values = ends.values(name, units.get(name, ""))
            rails[name] = RailSamples(original[at], values, side[at])
    return rails


_GAP = 1.5
"""A step of more than this times the median is a gap. Uneven clocks jitter by less; one lost sample
makes a step of two."""
_MOST = 9.0
"""A log grows by at most this times its own length. A log of two bursts a day apart would otherwise
be simulated through the night; its steps in between are longer instead."""


def bridged(log: Log) -> tuple[Log, np.ndarray]:
    """A log without gaps in time, and the places of its own samples there, ``(n,)``.

    A gap is divided evenly into steps of at most the median. An integration step over the whole of
    it would be coarse, and padding that is cut short there would change what follows. Inputs run on
    in a gap as their ``hold`` says; nothing is measured.
    """
    if log.even:
        return log, np.arange(len(log))
    steps = np.diff(log.time)
    usual = log.step if steps.size else 1.0
    # 1e-6: a gap of ten steps that rounding makes 10.0000001 gets nine samples, not ten.
    missing = np.where(steps > _GAP * usual, np.ceil(steps / usual - 1e-6) - 1.0, 0.0)
    if not missing.any():
        return log, np.arange(len(log))
    pieces = 1 + np.floor(missing * min(1.0, _MOST * len(log) / missing.sum())).astype(int)
    original = np.concatenate([[0], np.cumsum(pieces)])
    previous = np.append(np.repeat(np.arange(steps.size), pieces), steps.size)
    share = (np.arange(previous.size) - original[previous]) / np.append(pieces, 1)[previous]
    following = np.minimum(previous + 1, steps.size)

    def straight(values: np.ndarray) -> np.ndarray:
        return values[previous] + share * (values[following] - values[previous])

    def sparse(values: np.ndarray) -> np.ndarray:
        return np.where(share == 0.0, values[previous], np.nan)

    longer = log.replaced(
        time=straight(log.time),
        inputs={
            name: straight(values) if log.hold[name] == "linear" else values[previous]
            for name, values in log.inputs.items()
        },
        measured={name: sparse(values) for name, values in log.measured.items()},
    )
    return longer, original

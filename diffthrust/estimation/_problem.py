"""An estimation problem: what fixes its compiled code, and the coordinates of its parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from diffthrust.estimation._numbers import ProblemNumbers
from diffthrust.estimation._residuals import Likelihood
from diffthrust.models._base.model import Model
from diffthrust.models._base.parameter import Parameter
from diffthrust.simulation._record import Record
from diffthrust.simulation._trajectory import Grid, Key

_WRITTEN_OUT = 2
"""Numerics: so many integrator steps per sample are part of the code."""


@dataclass(frozen=True)
class Layout:
    """What fixes the compiled code of a problem; equal layouts share it.

    With a ``width`` only so many coordinates are moved at a time, and which ones is a matter of
    numbers: many selections of parameters (see `Problem.focus`) then share one compilation. Each
    log has coordinates of its own: where the states ``starts`` begin, and how far the parameters
    ``per_log`` (with their transforms) are from the means that all logs share.
    """

    key: Key
    free: tuple[str, ...]
    transforms: tuple[str, ...]
    channels: tuple[str, ...]
    known_noise: tuple[bool, ...]
    starts: tuple[str, ...]
    per_log: tuple[tuple[str, str], ...]
    grids: tuple[Grid, ...]
    likelihood: Likelihood
    width: int | None = None

    @property
    def shared(self) -> int:
        """Number of coordinates before those of the logs."""
        return self.width or len(self.free)

    @property
    def local(self) -> tuple[str, ...]:
        """What each log has coordinates of its own for: initial states, then parameters."""
        return (*self.starts, *(name for name, _ in self.per_log))

    def cost(self, numbers: ProblemNumbers, rests: Sequence[Any]) -> Any:
        """Negative log-likelihood of residuals, and the noise level of each channel."""
        return self.likelihood.law.cost(rests, numbers, self.known_noise)


class Turn(NamedTuple):
    """Other coordinates: the values by log themselves, whose bounds are a box.

    How far they are from their means, in which a search goes quickest, has no such bounds: they
    would move with the means. The coordinates of a problem are ``matrix @ these + shift``.
    """

    matrix: np.ndarray
    shift: np.ndarray
    places: np.ndarray  # of the values, in turn for each log, ``(k,)``,
    low: np.ndarray  # and their bounds
    high: np.ndarray

    def to(self, z: np.ndarray) -> np.ndarray:
        """These coordinates of those of the problem."""
        away = z - self.shift
        return 2.0 * away - self.matrix @ away  # the matrix less the identity has a square of zero

    def limited(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Limits of the coordinates of the problem with the bounds of the values."""
        low, high = low.copy(), high.copy()
        low[self.places], high[self.places] = self.low, self.high
        return low, high

    def at_bound(self, z: np.ndarray) -> np.ndarray:
        """Which coordinates are values at a bound, ``(n,)``."""
        low, high = self.limited(np.full(z.size, -np.inf), np.full(z.size, np.inf))
        values = self.to(z)
        return (values <= low + 1e-9) | (values >= high - 1e-9)


@dataclass(frozen=True)
class Problem:
    """An estimation problem; its model's values are where the fit starts.

    With ``quick_compile`` it is solved for one model among many, each of which is compiled anew: as
    long as little was run, to compile counts more. One that is ``compared`` has a fit that is only
    compared with others', and need not creep to its end.
    """

    model: Model
    records: tuple[Record, ...]
    layout: Layout
    numbers: ProblemNumbers = field(repr=False)
    order: tuple[tuple[int, ...], ...] = ()  # for each batch, the indices of its records
    held: bool = False  # measured initial states stay at their measured values
    horizon: float | None = None  # length of its segments [s]; None for whole runs
    # of the observer or of the noise, estimated with the model's
    nuisance: Mapping[str, Parameter] = field(default_factory=dict, repr=False)
    chosen: tuple[str, ...] | None = None  # what is moved, where the layout has a width
    quick_compile: bool = False
    compared: bool = False

    @property
    def work(self) -> int:
        """Integrator steps of a pass, times the coordinates by which it is differentiated."""
        steps = sum(map(len, self.records)) * self.substeps
        return steps * (len(self.layout.free) + self.each)

    @property
    def substeps(self) -> int:
        """Integrator steps per sample."""
        given = self.numbers.substeps
        return self.layout.grids[0].substeps if given is None else int(given)

    def stepped(self, substeps: int) -> Problem:
        """The same problem with so many integrator steps per sample.

        More than two are a number, for which nothing is compiled again: the first fit of a BlueBoat
        took 1, 4, 8 and 16, and a third of its time for their programs. Two are a loop that XLA
        writes out, and a fit of many side by side may differ in its number.
        """
        numeric = substeps > _WRITTEN_OUT and not self.layout.likelihood.corrects
        numeric = numeric and all(grid.padded for grid in self.layout.grids)
        static, number = (0, np.asarray(float(substeps))) if numeric else (substeps, None)
        grids = tuple(replace(grid, substeps=static) for grid in self.layout.grids)
        layout = replace(self.layout, grids=grids)
        return replace(self, layout=layout, numbers=replace(self.numbers, substeps=number))

    @property
    def free(self) -> tuple[str, ...]:
        """Full names of the estimated parameters."""
        return self.layout.free if self.chosen is None else self.chosen

    @property
    def own(self) -> tuple[str, ...]:
        """Those of them that are the model's; those of the noise come after them."""
        return tuple(name for name in self.free if name not in self.nuisance)

    @cached_property
    def named(self) -> dict[str, Parameter]:
        """The parameters of the model and of the noise, by full name."""
        return {**self.model.parameters, **self.nuisance}

    def focus(
        self,
        names: Sequence[str],
        values: Mapping[str, float],
        begin: np.ndarray | None = None,
    ) -> Problem:
        """The same problem with other values, in which only these parameters are moved.

        ``begin`` gives the coordinates of the logs, ``(local,)``, in their order.
        """
        layout, named = self.layout, self.named
        assert layout.width is not None
        assert len(names) <= layout.width
        where = [layout.free.index(n) for n in names]
        spare = len(layout.free)  # a coordinate that nothing depends on
        chosen = where + [spare] * (layout.width - len(where))
        nuisance = {n: p.with_value(values.get(n, p.value)) for n, p in self.nuisance.items()}
        model = self.model.replace({n: values[n] for n in self.model.parameters if n in values})
        # arrays of numpy: as many of jax would take as long as a pass over the logs
        fixed = {n: np.asarray(values.get(n, p.value), float) for n, p in named.items()}
        moved = replace(self, model=model, nuisance=nuisance, chosen=tuple(names))
        scales = np.array([moved.named[n].scale for n in layout.free])
        batches = self.numbers.batches
        if begin is not None and begin.size:
            _, starts = self.numbers.split(begin, 0)
            batches = [replace(b, start=start) for b, start in zip(batches, starts, strict=True)]
        numbers = replace(
            self.numbers, chosen=np.array(chosen), values=fixed, scales=scales, batches=batches
        )
        return replace(moved, numbers=numbers)

    @property
    def local(self) -> int:
        """Number of coordinates of all logs: initial states, and parameters that differ by log."""
        return self.each * len(self.records)

    def sign_free(self) -> list[int]:
        """Coordinates of initial states that only an unsigned sensor reads."""
        if self.held:
            return []
        return [at for at, record, state in self._of_logs if state in record.unsigned]

    def start(self) -> np.ndarray:
        """Coordinates of the model's present values and of the measured initial states.

        A parameter that differs by log begins at its mean in all of them.
        """
        named = self.named
        ahead = [float(named[n].to_coordinate(named[n].value)) for n in self.free]
        states = [np.asarray(batch.start).reshape(-1) for batch in self.numbers.batches]
        spare = np.zeros(self.shared - len(ahead))
        return np.concatenate([np.asarray(ahead, float), spare, *states])

    def at(self, values: Mapping[str, float]) -> np.ndarray:
        """Coordinates of other values of some parameters, within the limits."""
        z, (low, high) = self.start(), self.limits()
        with np.errstate(divide="ignore"):  # the logarithm of a null ends at its limit
            for i, name in enumerate(self.free):
                if name in values:
                    z[i] = self.named[name].to_coordinate(np.float64(values[name]))
        return np.clip(z, low, high)

    def limits(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper limits of the coordinates."""
        low, high = self._limits
        return low.copy(), high.copy()

    @cached_property
    def _limits(self) -> tuple[np.ndarray, np.ndarray]:
        named = self.named
        pairs = [named[n].coordinate_limits() for n in self.free]
        pairs += [(0.0, 0.0)] * (self.shared - len(pairs))
        pairs += self._starting_range
        low, high = np.array(pairs, float).reshape(-1, 2).T
        start = self.start()
        for at in (*self._lengths, *(self._restarted if self.held else ())):
            low[at] = high[at] = start[at]
        return low, high

    @cached_property
    def _restarted(self) -> list[int]:
        """The coordinate of each initial state that is set anew where a segment begins."""
        pairs = zip(self.numbers.batches, self.order, strict=True)
        restarted = {
            (index, name)
            for batch, indices in pairs
            for row, index in enumerate(indices)
            for name, restart in batch.restarts.items()
            if np.isfinite(restart.series[row]).any()
        }
        places = self.places.items()
        names = [*enumerate(self.layout.local)]
        return [at + i for index, at in places for i, name in names if (index, name) in restarted]

    @cached_property
    def _lengths(self) -> list[int]:
        """The coordinate of each initial quaternion that is held, because only its length is free.

        That of the largest part. With all four free, a fit of eight thrusters went to a length of
        2.6 along an axis of information 1e-10, for what rounding and the steps make of it: 100
        steps, and several optima where there is one.
        """
        sizes, names = np.abs(self.start()), self.layout.local
        held: list[int] = []
        for quaternion in self.model.quaternions:
            if all(name in names for name in quaternion):
                parts = np.array([names.index(name) for name in quaternion])
                held += [int(max(parts + at, key=sizes.__getitem__)) for at in self.places.values()]
        return held

    @cached_property
    def _starting_range(self) -> list[tuple[float, float]]:
        """Within what each initial state is sought: what was measured, and twice as far about it.

        Where the first measurement comes long after the start nothing tells of it any more, and a
        search would run off to values at which the simulation fails.
        """
        pairs = []
        for _, record, state in self._of_logs:
            measured = record.measured_states.get(state, np.array([]))
            if state in self.model.angles or not np.isfinite(measured).any():
                pairs.append((-np.inf, np.inf))
                continue
            low, high = float(np.nanmin(measured)), float(np.nanmax(measured))
            if state in record.unsigned:
                low = -high
            room = 2.0 * (high - low)
            pairs.append((low - room, high + room) if room > 0 else (-np.inf, np.inf))
        return pairs

    @cached_property
    def turn(self) -> Turn | None:
        """Coordinates with the values by log themselves; None where these have no bounds."""
        kinds, names = self.numbers.varying, [name for name, _ in self.layout.per_log]
        low, high = (
            np.array([self._in_coordinate(n, getattr(kinds[n], end)) for n in names])
            for end in ("low", "high")
        )
        if not np.isfinite([*low, *high]).any():
            return None
        size, logs = self.shared + self.local, len(self.records)
        matrix, shift = np.eye(size), np.zeros(size)
        first = self.shared + len(self.layout.starts)
        places = (first + np.arange(logs)[:, None] * self.each + np.arange(len(names))).ravel()
        for i, name in enumerate(names):
            rows = places[i :: len(names)]
            if name in self.free:
                log = self.named[name].transform == "log"
                scale = self.numbers.scales[self.layout.free.index(name)] / kinds[name].scale
                matrix[rows, self.free.index(name)] = -1.0 if log else -scale
            else:
                shift[rows] = -self._in_coordinate(name, self.named[name].value)
        return Turn(matrix, shift, places, np.tile(low, logs), np.tile(high, logs))

    def _in_coordinate(self, name: str, value: float) -> float:
        """A value of a parameter that differs by log as a coordinate."""
        if self.named[name].transform == "log":
            return float(np.log(value)) if value > 0 else -np.inf
        return float(value / self.numbers.varying[name].scale)

    @property
    def _of_logs(self) -> list[tuple[int, Record, str]]:
        """Place, log and name of each coordinate that is a log's own, in their order."""
        return [
            (at + i, self.records[index], name)
            for index, at in self.places.items()
            for i, name in enumerate(self.layout.local)
        ]

    @property
    def shared(self) -> int:
        """Number of coordinates before those of the logs."""
        return self.layout.shared

    def values(self, z: np.ndarray) -> dict[str, float]:
        """Values of all parameters at some coordinates."""
        named = self.named
        out = {name: p.value for name, p in named.items()}
        for name, coordinate in zip(self.free, z, strict=False):
            out[name] = named[name].limited(named[name].from_coordinate(coordinate))
        return out

    def model_at(self, z: np.ndarray) -> Model:
        """The model with its parameters at some coordinates."""
        values = self.values(z)
        return self.model.replace({name: values[name] for name in self.model.parameters})

    def slopes(self, z: np.ndarray) -> np.ndarray:
        """d(value)/d(coordinate) of the free parameters."""
        named, values = self.named, self.values(z)
        return np.array(
            [values[n] if named[n].transform == "log" else named[n].scale for n in self.free]
        )

    def numbers_by_log(self, z: np.ndarray) -> list[dict[str, float]]:
        """What is each log's own, in the order of ``records``: initial states and parameters."""
        means, out = self.values(z), [{} for _ in self.records]
        for index, at in self.places.items():
            own = dict(zip(self.layout.local, map(float, z[at : at + self.each]), strict=True))
            for name, _ in self.layout.per_log:
                own[name] = self._moved(name, means[name], own[name])
            out[index] = own
        return out

    def coordinates_by_log(self, numbers: Sequence[Mapping[str, float]]) -> np.ndarray:
        """The coordinates of what is each log's own, ``(local,)``; see `numbers_by_log`.

        What is not given begins at zero, and a parameter at the mean of all logs.
        """
        out, means = np.zeros(self.local), {n: self.named[n].value for n, _ in self.layout.per_log}
        for index, at in self.places.items():
            own = {**dict.fromkeys(self.layout.starts, 0.0), **means, **numbers[index]}
            away = (self._apart(name, own[name]) for name in means)
            out[at - self.shared :][: self.each] = [*(own[n] for n in self.layout.starts), *away]
        return out

    def _moved(self, name: str, mean: float, away: float) -> float:
        """The value of a parameter in a log, from the mean of all and its coordinate."""
        own = self.numbers.varying[name]
        log = self.named[name].transform == "log"
        value = mean * np.exp(away) if log else mean + away * float(own.scale)
        return float(np.clip(value, own.low, own.high))

    def _apart(self, name: str, value: float) -> float:
        """The coordinate of a parameter in a log; the reverse of `_moved`."""
        mean, own = self.named[name].value, self.numbers.varying[name]
        if self.named[name].transform == "log":
            return float(np.log(value / mean))
        return (value - mean) / float(own.scale)

    @property
    def each(self) -> int:
        """Number of coordinates of one log."""
        return len(self.layout.local)

    @property
    def places(self) -> dict[int, int]:
        """Of each record the place of its first coordinate, in the order of the coordinates."""
        order = [index for indices in self.order for index in indices]
        return {index: self.shared + row * self.each for row, index in enumerate(order)}

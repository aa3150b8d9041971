"""One period of a model under a sinusoid: its inputs, its output, and the harmonics of that.

Traceable pieces that periodic responses are made of, however their states are found. One of them
is a *lane*: an amplitude, a frequency and values of the parameters. Lanes are worked through in
blocks of a few; how many there are is a number and not a shape, so that maps of every size share
one compilation.

Effects with memory act on a whole series. They are given several periods, in the first half of
which the amplitude grows from nothing. The last one counts. Its difference from the one before, and
from the last after a sudden start, is reported: what has settled has forgotten how it began. A rate
limit that acts all the time hardly forgets: then the search is for a start from which its series
repeats (`_repeating_start`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from diffthrust.models._base.model import Model
from diffthrust.models._base.signals import Signals
from diffthrust.simulation._trajectory import driven, read_out, starting_point

Numbers: TypeAlias = Any
"""Arrays of JAX while they are worked out, of numpy before and after."""
LANE_BLOCK = 8
"""Lanes that are worked out together."""
LENIENT = 1e-3
"""What two starts leave between them counts this much less than a change from period to period."""
TINY = 1e-300
"""Keeps a ratio finite where nothing moves."""
_HALVINGS = 40
"""Halvings of the range of starts. A thruster that turns slowly under a fast command feels the
smallest mean."""
_STARTS_APART = 0.01
"""Starts that all repeat may be so far apart, of the swing of the series."""
_STILL = 1e-8
"""A series repeats that rises less in a period, of the input's amplitude: the clock is rounded."""


@dataclass(frozen=True)
class Cycle:
    """How a period is worked out; fixes the compiled code."""

    input: str
    output: str
    samples: int  # steps of the period; the input is known twice as densely
    periods: int = 1  # that effects with memory are given to settle
    sought: bool = False  # the start of their series is sought, and not left to settle
    harmonics: int = 0  # of the states, for a harmonic balance
    states: tuple[str, ...] = ()  # others stay where they begin: the output does not feel them


class Lane(NamedTuple):
    """One point of a map; or many, with a leading axis in every leaf."""

    amplitude: Float[Numbers, "*lanes"]
    frequency: Float[Numbers, "*lanes"]  # [rad/s]
    values: dict[str, Float[Numbers, "*lanes"]]  # parameters by full name
    bias: Float[Numbers, "*lanes"]  # what the input swings about
    others: dict[str, Float[Numbers, "*lanes"]]  # constant values of other inputs
    clock: Float[Numbers, "*lanes"]  # the time [s] at which the period begins


class Harmonics(NamedTuple):
    """What the output of a period shows."""

    in_phase: Float[Numbers, "*lanes"]  # part of the first harmonic that goes with the input
    ahead: Float[Numbers, "*lanes"]  # its part a quarter of a period ahead
    mean: Float[Numbers, "*lanes"]
    distortion: Float[Numbers, "*lanes"]  # root sum square of higher harmonics over the first
    swing: Float[Numbers, "*lanes"]  # largest less least value
    unsettled: Float[Numbers, "*lanes"]  # change of series with memory in a period, over the swing


class PeriodSeries(NamedTuple):
    """The signals that reach the model over a period, at its ``2 samples + 1`` instants."""

    time: Float[Array, " instants"]
    inputs: dict[str, Float[Array, " instants"]]
    unsettled: Float[Array, ""]


def remembers(model: Model) -> bool:
    """Whether some effect reads other samples than the present one."""
    return any(effect.memory for effect in model.effects)


def driven_period(model: Model, cycle: Cycle, lane: Lane) -> PeriodSeries:
    """The inputs as they reach the model in the last of the periods."""
    dense = 2 * cycle.samples
    count = jnp.arange(cycle.periods * dense + 1)
    length = 2.0 * jnp.pi / lane.frequency
    time = lane.clock + length * (count.astype(float) / dense)
    turn = (count % dense).astype(float) * (2.0 * jnp.pi / dense)
    whole = lane.amplitude * jnp.sin(turn)

    def reaching(swing: Float[Array, " n"]) -> dict[str, Float[Array, " n"]]:
        size = swing.shape
        series = {name: jnp.full(size, value) for name, value in lane.others.items()}
        series[cycle.input] = lane.bias + swing
        series, _ = driven(model, time[: size[0]], series)
        return {name: jnp.broadcast_to(value, size) for name, value in series.items()}

    if cycle.periods == 1:
        return PeriodSeries(time, reaching(whole), jnp.asarray(0.0))
    if cycle.sought:
        twice = whole[: 2 * dense + 1]
        begin, repeats = _repeating_start(
            lambda x: reaching(twice.at[0].set(x))[cycle.input], lane.amplitude, dense
        )
        series = reaching(whole.at[0].set(begin))
        last = {name: value[-dense - 1 :] for name, value in series.items()}
        repeats = repeats & (_change(series, dense, cycle.periods) <= _STARTS_APART)
        return PeriodSeries(time[-dense - 1 :], last, jnp.where(repeats, 0.0, 1.0))
    # two ways to begin, slowly and at once: what has forgotten its beginning ends alike in both
    growing = jnp.minimum(count.astype(float) / (0.5 * dense * cycle.periods), 1.0)
    series, sudden = reaching(growing * whole), reaching(whole)
    last = {name: value[-dense - 1 :] for name, value in series.items()}
    apart = {n: jnp.concatenate([sudden[n][-dense:], v[-dense:]]) for n, v in series.items()}
    unsettled = jnp.maximum(
        _change(series, dense, cycle.periods), LENIENT * _change(apart, dense, cycle.periods)
    )
    return PeriodSeries(time[-dense - 1 :], last, unsettled)


def _repeating_start(
    reached: Callable[[Array], Float[Array, " n"]], amplitude: Float[Array, ""], period: int
) -> tuple[Float[Array, ""], Bool[Array, ""]]:
    """The start of a series that repeats, if it hardly forgets how it began.

    The command that a rate limit lets through is a triangle where the limit always acts. Its mean
    tends to that of the command, but by a share of 4 rate / (amplitude frequency) in a period only.
    So the start is sought instead: from one below the right one the series rises from period to
    period, from one above it falls, for effects with memory keep the order of two series.

    A rate limit that is worked out sample by sample does not feel where between two of them it
    switches: a range of starts repeats. Its middle is taken, which is the right one for a command
    that swings evenly; the range shrinks as the steps get finer.

    ``reached`` gives the series over two periods of so many instants, from the deviation with which
    the input begins. Returned are that deviation, and whether the range is narrow: only then there
    is one answer.
    """

    def rise(begin: Array) -> Array:
        series = reached(begin)
        return jnp.mean(series[-period:] - series[-2 * period : -period]) / amplitude

    def edge(least: Array) -> Array:
        def halve(_: Array, ends: tuple[Array, Array]) -> tuple[Array, Array]:
            low, high = ends
            middle = 0.5 * (low + high)
            rises = rise(middle) > least
            return jnp.where(rises, middle, low), jnp.where(rises, high, middle)

        return jax.lax.fori_loop(0, _HALVINGS, halve, (-amplitude, amplitude))[0]

    # bisection, since the rise has no slope to follow over the range of starts that repeat
    low, high = jax.vmap(edge)(jnp.asarray([_STILL, -_STILL]))
    begin = 0.5 * (low + high)
    return begin, high - low <= _STARTS_APART * jnp.ptp(reached(begin)[-period:])


def start_of(model: Model, series: PeriodSeries) -> dict[str, Float[Array, ""]]:
    """The states with which a log would begin at the start of the period."""
    first = {name: value[0] for name, value in series.inputs.items()}
    start = starting_point(model, Signals({**first, "time": series.time[0]}), {})
    return {name: jnp.asarray(value, float) for name, value in start.items()}


def harmonics_of(
    model: Model,
    cycle: Cycle,
    lane: Lane,
    series: PeriodSeries,
    states: Mapping[str, Float[Array, " points"]],
) -> Harmonics:
    """The harmonics of the output, from the states at every (second) instant, the end included."""
    size = next((value.shape[0] for value in states.values()), series.time.shape[0])
    stride = (series.time.shape[0] - 1) // (size - 1)
    points = size - 1
    signals = {n: v[::stride][:-1] for n, v in series.inputs.items()}
    signals |= {n: v[:-1] for n, v in states.items()}
    tiled = {n: jnp.tile(v, cycle.periods) for n, v in signals.items()}
    length = 2.0 * jnp.pi / lane.frequency
    count = jnp.arange(cycle.periods * points).astype(float)
    time = series.time[0] + length * (count / points)
    y = read_out(model, Signals({**tiled, "time": time}))[cycle.output]
    change = jnp.maximum(series.unsettled, _change({cycle.output: y}, points, cycle.periods))
    y = y[-points:]
    turn = jnp.arange(points).astype(float) * (2.0 * jnp.pi / points)
    in_phase = 2.0 * jnp.mean(y * jnp.sin(turn))
    ahead = 2.0 * jnp.mean(y * jnp.cos(turn))
    mean = jnp.mean(y)
    first = 0.5 * (in_phase**2 + ahead**2)
    # Parseval: the power of all harmonics less that of the first; rounding may make it negative
    higher = jnp.maximum(jnp.mean((y - mean) ** 2) - first, 0.0)
    distortion = jnp.where(first > 0, jnp.sqrt(higher / jnp.maximum(first, TINY)), 0.0)
    swing = jnp.max(y) - jnp.min(y)
    return Harmonics(in_phase, ahead, mean, distortion, swing, change)


def in_blocks(function: Callable[[Any], Any], count: int | Array, lanes: Any) -> Any:
    """A function of each of the first ``count`` lanes, block by block; zeros for the others.

    The number of blocks may be traced: maps of all sizes run the same program. The leading axis of
    the lanes is a multiple of `LANE_BLOCK`.
    """
    every = jax.vmap(function)

    def part(i: Array | int) -> Any:
        return jax.tree.map(
            lambda x: jax.lax.dynamic_slice_in_dim(x, i * LANE_BLOCK, LANE_BLOCK), lanes
        )

    size = jax.tree.leaves(lanes)[0].shape[0]
    shapes = jax.eval_shape(every, part(0))
    begin = jax.tree.map(lambda s: jnp.zeros((size, *s.shape[1:]), s.dtype), shapes)

    def body(i: Array, out: Any) -> Any:
        block = every(part(i))
        return jax.tree.map(
            lambda o, f: jax.lax.dynamic_update_slice_in_dim(o, f, i * LANE_BLOCK, 0), out, block
        )

    return jax.lax.fori_loop(0, (count + LANE_BLOCK - 1) // LANE_BLOCK, body, begin)


def idle(
    matrix: Float[np.ndarray, "lanes m m"], least: float | Float[np.ndarray, "lanes 1"]
) -> Bool[np.ndarray, "lanes m"]:
    """Unknowns that no equation depends on but those of others like it, ``(lanes, m)``.

    Such is the position of a vehicle that nothing pulls back: its own equation says only how fast
    it drifts, and is to be left out with it. Derivatives up to ``least`` count as none.
    """
    which = np.zeros(matrix.shape[:2], bool)
    size = np.abs(matrix)
    while True:
        residual = np.where(which[:, :, None], 0.0, size).max(axis=1, initial=0.0)
        more = (residual <= least) & ~which
        if not more.any():
            return which
        # once some are idle, those that only they depend on may be idle too
        which |= more


def held_fast(
    matrix: Float[np.ndarray, "lanes m m"],
    residual: Float[np.ndarray, "lanes m"],
    which: Bool[np.ndarray, "lanes m"],
) -> None:
    """Change equations such that the unknowns of ``which`` stay where they are; in place."""
    lane, place = np.nonzero(which)
    matrix[lane, place, :] = 0.0
    matrix[lane, place, place] = 1.0
    residual[lane, place] = 0.0


def _change(
    series: Mapping[str, Float[Array, " n"]], period: int, periods: int
) -> Float[Array, ""]:
    """The largest change from the last but one period to the last, over the swing."""
    if periods < 2:
        return jnp.asarray(0.0)
    changes = []
    for value in series.values():
        last, previous = value[-period:], value[-2 * period : -period]
        swing = jnp.max(last) - jnp.min(last)
        changes.append(jnp.max(jnp.abs(last - previous)) / jnp.maximum(swing, TINY))
    return jnp.max(jnp.stack(changes))

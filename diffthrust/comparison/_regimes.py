"""Where the error sits: the regime of the model's signals that holds most of the squared error.

The interval of one signal that holds the most squared error beyond its share of samples is found by
Kuiper's statistic on the distribution of the squared error over the signal (Kuiper 1960), the
largest over all signals, against what chance gives: the squared errors are cut into blocks and
assigned to the signals again, runs in random order and blocks in random order within them (Kunsch
1989 on resampling by blocks, Westfall & Young 1993 on the largest of many statistics).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from diffthrust._support.correlation import autocorrelation
from diffthrust._support.files import plain
from diffthrust._support.words import percent
from diffthrust.comparison._derived_signals import derived_signals

# least excess of a regime's share of the error over its share of the samples, and what a second
# signal must add to it
_EXCESS, _MORE = 0.15, 0.05
_MOST = 2
"""Regimes that are named of a channel."""
_LEVEL = 0.05
"""Share of searches with nothing to find that name an interval all the same."""
_DRAWS, _SAMPLES, _BINS = 199, 4000, 40
_RATIO, _SAME = 1.5, 0.02


@dataclass(frozen=True)
class SignalRange:
    """One signal between two values, either of which may be infinite."""

    signal: str
    low: float
    high: float
    unit: str

    def holds(self, values: np.ndarray) -> np.ndarray:
        """Whether each value lies in the interval."""
        return (values >= self.low) & (values < self.high)

    def phrase(self, prefix: str = "") -> str:
        """The interval in words, with a prefix to the signal's name."""
        signal = prefix + self.signal
        unit = f" {self.unit}" if self.unit else ""
        low, high = f"{self.low:.6g}", f"{self.high:.6g}"
        if math.isinf(self.low):
            return f"{signal} < {high}{unit}"
        if math.isinf(self.high):
            return f"{signal} > {low}{unit}"
        return f"{low} < {signal} < {high}{unit}"


@dataclass(frozen=True)
class Regime:
    """Where the squared error of a channel gathers.

    Args:
        channel: the measured channel.
        where: one interval, or two that hold together.
        share_of_error: share of the channel's squared error in the regime.
        share_of_samples: share of the channel's samples in it.
        p_value: how often chance gives as much, with the search and the correlation of the
            residual in time accounted for.
        outside: whether it leaves out the samples of a regime that was named before.
        modelled: those of its signals that are the model's, and not of the logs.
    """

    channel: str
    where: tuple[SignalRange, ...]
    share_of_error: float
    share_of_samples: float
    p_value: float
    outside: bool = False
    modelled: tuple[str, ...] = ()

    @property
    def signal(self) -> str:
        """Name of the first signal."""
        return self.where[0].signal

    @property
    def low(self) -> float:
        """Lower end on the first signal."""
        return self.where[0].low

    @property
    def high(self) -> float:
        """Upper end on the first signal."""
        return self.where[0].high

    def holds(self, derived: Mapping[str, tuple[np.ndarray, str]]) -> np.ndarray:
        """Which samples of a run are in it, by its `derived_of`."""
        ranges = [interval.holds(derived[interval.signal][0]) for interval in self.where]
        return np.logical_and.reduce(ranges)

    @property
    def sentence(self) -> str:
        """The regime in plain words, with units."""
        place = " and ".join(
            interval.phrase("modelled " * (interval.signal in self.modelled))
            for interval in self.where
        )
        outside = "Outside that, " if self.outside else ""
        return (
            f"{outside}{percent(self.share_of_error)} of the squared {self.channel} error lies in "
            f"{percent(self.share_of_samples)} of the samples: {place}."
        )

    def to_json(self) -> dict[str, Any]:
        """Plain data; an open end is null."""
        names = ("share_of_error", "share_of_samples", "p_value", "sentence")
        written = {
            "channel": self.channel,
            "where": [vars(interval) for interval in self.where],
            **{name: getattr(self, name) for name in names},
        }
        return plain(written)


def worst_regimes(
    channel: str,
    residuals: Sequence[np.ndarray],
    times: Sequence[np.ndarray | None],
    signals: Sequence[Mapping[str, np.ndarray]],
    units: Mapping[str, str],
    *,
    inputs: Collection[str],
    plain: Collection[str] = (),
    channels: int = 1,
) -> tuple[Regime, ...]:
    """Search for the regimes that hold the largest share of squared error beyond their samples.

    Beside the signals themselves, their sizes, rates of change, the time since the start and the
    time since an input jumped are searched. A regime is named only where chance gives as much in
    less than 5 % of cases, over all signals and channels, and where its share of the error is at
    least 15 points and one half above its share of the samples. Each further one lies outside those
    before it.

    Residuals are measured minus modelled of each run, ``(n,)``, NaN where nothing was measured;
    times are ``None`` for a table of readings. Signals that are no ``inputs`` are the model's; of
    ``plain`` ones, such as an angle that jumps by a turn, only the value is searched. P-values are
    multiplied by the number of ``channels`` that are searched in all.
    """
    samples = _gathered(residuals, times, signals, units, plain)
    if samples is None:
        return ()
    block = _block(residuals)
    logged = {name: signals[0][name] for name in inputs if name in signals[0]}
    of_logs = derived_signals(times[0], logged, units, plain)
    rng = np.random.default_rng(0)  # equal residuals give equal regimes
    everything, outside = float(samples.energy.sum()), np.ones(samples.energy.size, bool)
    regimes: list[Regime] = []
    while len(regimes) < _MOST:
        remaining = samples.at(outside)
        scale = float(remaining.energy.sum()) / everything
        # 15 points of the whole error, also when most of it is explained already
        best = worst_range(remaining, block, rng, channels, _EXCESS / max(scale, _EXCESS))
        if best is None:
            break
        where, p = [best[0]], best[1]
        inside = best[0].holds(remaining.signals[best[0].signal])
        closer = worst_range(remaining.at(inside), block, rng, channels, 0.0)
        if closer is not None and closer[0].signal != best[0].signal:
            both = inside & closer[0].holds(remaining.signals[closer[0].signal])
            if _excess(remaining, both) > _excess(remaining, inside) + _MORE:
                where, p, inside = [*where, closer[0]], max(p, closer[1]), both
        error = float(remaining.energy[inside].sum()) / everything
        share = float(inside.sum()) / outside.size
        modelled = tuple(i.signal for i in where if i.signal not in of_logs)
        regimes.append(Regime(channel, tuple(where), error, share, p, bool(regimes), modelled))
        outside[np.flatnonzero(outside)[inside]] = False
    return tuple(regimes)


class Samples(NamedTuple):
    """Squared errors ``(n,)``, the run of each, and the signals with their units."""

    energy: np.ndarray
    run: np.ndarray
    signals: dict[str, np.ndarray]
    units: Mapping[str, str]

    def at(self, chosen: np.ndarray) -> Samples:
        """The samples that a mask ``(n,)`` or indices choose."""
        signals = {name: values[chosen] for name, values in self.signals.items()}
        return Samples(self.energy[chosen], self.run[chosen], signals, self.units)


def _gathered(
    residuals: Sequence[np.ndarray],
    times: Sequence[np.ndarray | None],
    signals: Sequence[Mapping[str, np.ndarray]],
    units: Mapping[str, str],
    plain: Collection[str],
) -> Samples | None:
    """The measured samples of all runs; ``None`` where there is nothing that can be searched."""
    residual = np.concatenate(residuals)
    finite = ~np.isnan(residual)
    energy = residual[finite] ** 2
    if energy.size < 20 or not np.all(np.isfinite(energy)) or not energy.sum() > 0:
        return None
    run = np.repeat(np.arange(len(residuals)), [each.size for each in residuals])[finite]
    derived = [derived_signals(t, s, units, plain) for t, s in zip(times, signals, strict=True)]
    fine = {}
    for name in derived[0]:
        if all(name in by_name for by_name in derived):
            values = np.concatenate([by_name[name][0] for by_name in derived])[finite]
            if np.all(np.isfinite(values)):
                fine[name] = _coarse(values)
    fine = {name: values for name, values in fine.items() if np.ptp(values) > 0}
    return Samples(energy, run, fine, {name: derived[0][name][1] for name in fine})


def _coarse(values: np.ndarray) -> np.ndarray:
    """Values to a thousandth of their range, so that rounding errors make no regimes."""
    quantum = 1e-3 * (np.ptp(np.quantile(values, [0.01, 0.99])) or np.ptp(values))
    return np.round(values / quantum) * quantum if quantum > 0 else values


def _block(residuals: Sequence[np.ndarray]) -> int:
    """Samples in a block: some correlation times of the squared residual."""
    longest = max(residual.size for residual in residuals)
    measured = autocorrelation([residual**2 for residual in residuals], longest // 3)
    # of Gaussian noise the square has the squared correlation; the measured one is noisy on short
    # runs
    implied = autocorrelation(residuals, longest // 3) ** 2
    times = [_integral(measured), _integral(implied)]
    return max(5, math.ceil(5 * max(times)))


def _integral(correlation: np.ndarray) -> float:
    """Sum of an autocorrelation over both sides, up to where it has died away."""
    faded = np.flatnonzero(correlation < 0.05)
    return float(2 * correlation[: faded[0] if faded.size else None].sum() - 1)


def _excess(samples: Samples, inside: np.ndarray) -> float:
    """Share of the squared error inside, less the share of samples."""
    return float(samples.energy[inside].sum() / samples.energy.sum() - inside.mean())


def worst_range(
    samples: Samples, block: int, rng: np.random.Generator, channels: int, least: float
) -> tuple[SignalRange, float] | None:
    """The interval of one signal with the largest excess, and its p-value.

    ``None`` where none with the ``least`` excess is significant. The squared error is correlated
    over less than a ``block`` of samples; p-values are multiplied by ``channels``.
    """
    stride = -(-samples.energy.size // _SAMPLES)
    thin = samples.at(np.arange(samples.energy.size) % stride == 0)
    bins = {name: _edges(values) for name, values in thin.signals.items()}
    bins = {name: edges for name, edges in bins.items() if edges.size}
    if not bins or thin.energy.size < 20 or not thin.energy.sum() > 0:
        return None
    orders = _orders(thin.run, max(3, block // stride), rng)
    energy = np.concatenate([thin.energy[None], thin.energy[orders]]).T / thin.energy.sum()
    # single precision: 200 orders of 4000 samples in half the memory; only ranks are read from them
    energy = np.ascontiguousarray(energy, dtype=np.float32)
    excesses = {name: _largest(energy, thin.signals[name], edges) for name, edges in bins.items()}
    p_values = _adjusted(np.stack([scores for scores, _ in excesses.values()]), channels)
    sure = {
        name: (scores[0], p)
        for (name, (scores, _)), p in zip(excesses.items(), p_values, strict=True)
        if p <= _LEVEL and scores[0] >= least
    }
    if not sure:
        return None
    # of signals that say nearly the same, the plainest, which comes first
    largest = max(score for score, _ in sure.values())
    equals = [name for name, (score, _) in sure.items() if score >= largest - _SAME]
    name, size = equals[0], f"|{equals[0]}|"
    first, last = excesses[name][1]
    if size in equals and first > 0 and last <= bins[name].size:
        name = size  # -0.3 < x < 0.32 says the same as |x| < 0.3, and less plainly
    interval = _rounded(samples, name, bins[name], excesses[name][1])
    inside = interval.holds(samples.signals[name])
    if samples.energy[inside].sum() / samples.energy.sum() < _RATIO * inside.mean():
        return None
    return interval, float(sure[name][1])


def _largest(
    energy: np.ndarray, values: np.ndarray, edges: np.ndarray
) -> tuple[np.ndarray, tuple[int, int]]:
    """The largest excess over all runs of bins, ``(1 + draws,)``, and where the first one has it.

    The shares of the squared error are ``(n, 1 + draws)``, as they are and in random orders.
    """
    label = np.searchsorted(edges, values, side="right")
    weights, place = np.ones(label.size, np.float32), (label, np.arange(label.size))
    from scipy import sparse  # slow to import

    # sums by bin of all random orders at once, as one sparse product
    member = sparse.csr_array((weights, place), shape=(edges.size + 1, label.size))
    share = (member @ energy).T - np.bincount(label, minlength=edges.size + 1) / label.size
    path = np.concatenate([np.zeros((share.shape[0], 1)), np.cumsum(share, axis=1)], axis=1)
    # the largest rise of the running sum is the interval of largest excess: no pairs of ends tried
    rise = path - np.minimum.accumulate(path, axis=1)
    end = int(rise[0].argmax())
    return rise.max(axis=1), (int(path[0, : end + 1].argmin()), end)


def _edges(values: np.ndarray) -> np.ndarray:
    """Inner edges of bins of about equal counts, finer at the ends, one at zero."""
    levels = np.unique(values)
    if levels.size < 2:
        return np.zeros(0)
    fine = [0.005, 0.01, 0.99, 0.995]
    wanted = np.quantile(values, np.sort([*np.arange(1, _BINS) / _BINS, *fine]))
    above = np.clip(np.searchsorted(levels, wanted, side="left"), 1, levels.size - 1)
    between = (levels[above - 1] + levels[above]) / 2
    zero = [0.0] if levels[0] < 0 < levels[-1] else []
    return np.unique([*between, *zero])


def _orders(run: np.ndarray, block: int, rng: np.random.Generator) -> np.ndarray:
    """Indices ``(draws, n)``: runs in random order, blocks in random order within each."""
    parts = [np.flatnonzero(run == i) for i in np.unique(run)]
    draws = []
    for _ in range(_DRAWS):
        shuffled = []
        for i in rng.permutation(len(parts)):
            # blocks begin anywhere: fixed cuts would keep the same neighbours in every draw
            rolled = np.roll(parts[i], int(rng.integers(parts[i].size)))
            pieces = np.array_split(rolled, max(1, rolled.size // block))
            shuffled += [pieces[j] for j in rng.permutation(len(pieces))]
        # runs of unequal length come to lie across the ends of others: turn the whole as well
        draws.append(np.roll(np.concatenate(shuffled), int(rng.integers(run.size))))
    return np.stack(draws)


def _adjusted(scores: np.ndarray, channels: int) -> np.ndarray:
    """P-values ``(S,)`` of scores ``(S, 1 + draws)``, for the largest over the signals."""
    chance = scores[:, 1:]
    scale = np.maximum(chance.std(axis=1), 1e-12)
    # signals with many levels reach higher by chance: each is measured by its own chance
    standard = (scores - chance.mean(axis=1)[:, None]) / scale[:, None]
    largest = standard[:, 1:].max(axis=0)
    beaten = (largest[None, :] >= standard[:, :1]).sum(axis=1)
    return np.minimum(1.0, channels * (1 + beaten) / (1 + largest.size))


def _rounded(samples: Samples, name: str, edges: np.ndarray, span: tuple[int, int]) -> SignalRange:
    """The interval with ends rounded as far as the excess stays what it is."""
    values, unit = samples.signals[name], samples.units[name]
    low = edges[span[0] - 1] if span[0] > 0 else -math.inf
    high = edges[span[1] - 1] if span[1] <= edges.size else math.inf
    exact = SignalRange(name, float(low), float(high), unit)
    target = _excess(samples, exact.holds(values))
    width = np.ptp(values) if math.isinf(high - low) else high - low
    first = -math.floor(math.log10(width))
    for digits in range(first, first + 6):
        ends = [round(float(x), digits) if math.isfinite(x) else float(x) for x in (low, high)]
        near = SignalRange(name, ends[0] + 0.0, ends[1] + 0.0, unit)
        if abs(_excess(samples, near.holds(values)) - target) < 0.01:
            return near
    return exact

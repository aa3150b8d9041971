"""The interval of one signal that holds the most squared error beyond its share of samples.

Kuiper's statistic on the distribution of the squared error over the signal (Kuiper 1960), the
largest over all signals, against what chance gives: the squared errors are cut into blocks and
assigned to the signals again, runs in random order and blocks in random order within them (Kunsch
1989 on resampling by blocks, Westfall & Young 1993 on the largest of many statistics).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

_LEVEL = 0.05
"""Share of searches with nothing to find that name an interval all the same."""
_DRAWS, _SAMPLES, _BINS = 199, 4000, 40
_RATIO, _SAME = 1.5, 0.02


@dataclass(frozen=True)
class SignalRange:
    """One signal between two values, either of which may be infinite.

    Example:
        >>> SignalRange("|command|", -math.inf, 0.2, "V").phrase
        '|command| < 0.2 V'
    """

    signal: str
    low: float
    high: float
    unit: str

    def holds(self, values: np.ndarray) -> np.ndarray:
        """Whether each value lies in the interval."""
        return (values >= self.low) & (values < self.high)

    @property
    def phrase(self) -> str:
        """The interval in words."""
        unit = f" {self.unit}" if self.unit else ""
        low, high = f"{self.low:.6g}", f"{self.high:.6g}"
        if math.isinf(self.low):
            return f"{self.signal} < {high}{unit}"
        if math.isinf(self.high):
            return f"{self.signal} > {low}{unit}"
        return f"{low} < {self.signal} < {high}{unit}"


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


def excess(samples: Samples, inside: np.ndarray) -> float:
    """Share of the squared error inside, less the share of samples."""
    return float(samples.energy[inside].sum() / samples.energy.sum() - inside.mean())


def worst_range(
    samples: Samples, block: int, rng: np.random.Generator, channels: int, least: float
) -> tuple[SignalRange, float] | None:
    """The interval of one signal with the largest excess, and its p-value.

    Args:
        samples: what is searched.
        block: samples in a block, longer than the squared error is correlated.
        rng: of the random orders.
        channels: by how many searches like this the p-value is multiplied.
        least: the excess that an interval must have.

    Returns:
        ``None`` where no interval with that excess is significant.
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

    Args:
        energy: shares of the squared error as they are, and in random orders, ``(n, 1 + draws)``.
        values: the signal, ``(n,)``.
        edges: of the bins, ``(m,)``.
    """
    label = np.searchsorted(edges, values, side="right")
    weights, place = np.ones(label.size, np.float32), (label, np.arange(label.size))
    from scipy import sparse  # slow to import

    # sums by bin of all random orders at once, as one sparse product
    member = sparse.csr_array((weights, place), shape=(edges.size + 1, label.size))
    share = (member @ energy).T - np.bincount(label, minlength=edges.size + 1) / label.size
    path = np.concatenate([np.zeros((share.shape[0], 1)), np.cumsum(share, axis=1)], axis=1)
    # the largest rise of the running sum is the interval of largest excess: no pairs of ends are
    # tried
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
    target = excess(samples, exact.holds(values))
    width = np.ptp(values) if math.isinf(high - low) else high - low
    first = -math.floor(math.log10(width))
    for digits in range(first, first + 6):
        ends = [round(float(x), digits) if math.isfinite(x) else float(x) for x in (low, high)]
        near = SignalRange(name, ends[0] + 0.0, ends[1] + 0.0, unit)
        if abs(excess(samples, near.holds(values)) - target) < 0.01:
            return near
    return exact


def coarse(values: np.ndarray) -> np.ndarray:
    """Values to a thousandth of their range, so that rounding errors make no regimes."""
    quantum = 1e-3 * (np.ptp(np.quantile(values, [0.01, 0.99])) or np.ptp(values))
    return np.round(values / quantum) * quantum if quantum > 0 else values

"""Where the error sits: the regime of the model's signals that holds most of the squared error.

The search goes over intervals of every signal and asks which holds the largest share of squared
error beyond its share of samples (the statistic of Kuiper 1960 on the error's distribution over the
signal). What chance would give is measured on the residual itself: the squared errors are cut into
blocks longer than their correlation time and laid over the signals anew, runs in random order and
blocks in random order within them (Kunsch 1989 on resampling by blocks), and the best regime over
all signals is sought again each time (Westfall & Young 1993 on the maximum over many tests).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from diffthrust._derived import derived_signals
from diffthrust._residual_tests import autocorrelation

LEVEL = 0.05
"""Share of comparisons with nothing to find for which a regime is named all the same."""
_DRAWS, _SAMPLES, _BINS = 299, 6000, 40
_EXCESS, _RATIO, _MORE = 0.15, 1.5, 0.05


@dataclass(frozen=True)
class Interval:
    """One signal between two values, either of which may be infinite.

    Example:
        >>> Interval("|command|", -math.inf, 0.2, "V").phrase
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
    """

    channel: str
    where: tuple[Interval, ...]
    share_of_error: float
    share_of_samples: float
    p_value: float

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

    @property
    def unit(self) -> str:
        """Unit of the first signal."""
        return self.where[0].unit

    @property
    def sentence(self) -> str:
        """The regime in plain words, with units."""
        place = " and ".join(interval.phrase for interval in self.where)
        return (
            f"{percent(self.share_of_error)} of the squared {self.channel} error lies where "
            f"{place}, {percent(self.share_of_samples)} of the samples."
        )

    def to_json(self) -> dict[str, Any]:
        """Plain data; an open end is null."""
        ends = [
            {k: None if v in (-math.inf, math.inf) else v for k, v in vars(interval).items()}
            for interval in self.where
        ]
        return {
            "channel": self.channel,
            "where": ends,
            "share_of_error": self.share_of_error,
            "share_of_samples": self.share_of_samples,
            "p_value": self.p_value,
            "sentence": self.sentence,
        }


def percent(share: float) -> str:
    """A share as a percentage that never rounds something to nothing.

    Example:
        >>> percent(0.617), percent(0.0042)
        ('62 %', '0.4 %')
    """
    return f"{100 * share:.{0 if share >= 0.0095 or share == 0 else 1}f} %"


class _Samples(NamedTuple):
    """Squared errors ``(n,)``, the run of each, and the signals with their units."""

    energy: np.ndarray
    run: np.ndarray
    signals: dict[str, np.ndarray]
    units: Mapping[str, str]

    def at(self, chosen: np.ndarray) -> _Samples:
        signals = {name: values[chosen] for name, values in self.signals.items()}
        return _Samples(self.energy[chosen], self.run[chosen], signals, self.units)


def worst_regimes(
    channel: str,
    residuals: Sequence[np.ndarray],
    times: Sequence[np.ndarray],
    signals: Sequence[Mapping[str, np.ndarray]],
    units: Mapping[str, str],
    *,
    most: int = 2,
    channels: int = 1,
    seed: int = 0,
) -> tuple[Regime, ...]:
    """Search for the regimes that hold the largest share of squared error beyond their samples.

    Beside the signals themselves, their sizes, rates of change, the time since the start and the
    time since an input jumped are searched. A regime is named only where chance gives as much in
    less than 5 % of cases, over all signals and channels, and where its share of the error is at
    least 15 points and one half above its share of the samples.

    Args:
        channel: name of the channel, for the sentence.
        residuals: measured minus modelled of each run, ``(n,)``; NaN where nothing was measured.
        times: time stamps [s] of each run, ``(n,)``.
        signals: the signals of each run by name, ``(n,)`` each.
        units: unit of each signal.
        most: how many regimes to name; each further one lies outside those before it.
        channels: how many channels are searched in all; p-values are multiplied by it.
        seed: of the random orders; equal seeds give equal results.

    Returns:
        The regimes, the one with the largest excess first; none where none is significant.

    Example:
        >>> worst_regimes("speed", [rest], [log.time], [{"command": u}], {"command": "V"})[0].sentence
        '62 % of the squared speed error lies where |command| < 0.2 V, 9 % of the samples.'
    """
    samples = _gathered(residuals, times, signals, units)
    if samples is None:
        return ()
    block = _block(residuals)
    rng = np.random.default_rng(seed)
    everything, outside = float(samples.energy.sum()), np.ones(samples.energy.size, bool)
    found: list[Regime] = []
    while len(found) < most:
        left = samples.at(outside)
        scale = float(left.energy.sum()) / everything
        best = _search(left, block, rng, channels, _EXCESS / max(scale, _EXCESS))
        if best is None:
            break
        where, p = [best[0]], best[1]
        inside = best[0].holds(left.signals[best[0].signal])
        closer = _search(left.at(inside), block, rng, channels, 0.0)
        if closer is not None and closer[0].signal != best[0].signal:
            both = inside & closer[0].holds(left.signals[closer[0].signal])
            if _excess(left, both) > _excess(left, inside) + _MORE:
                where, p, inside = [*where, closer[0]], max(p, closer[1]), both
        error = float(left.energy[inside].sum()) / everything
        share = float(inside.sum()) / outside.size
        found.append(Regime(channel, tuple(where), error, share, p))
        outside[np.flatnonzero(outside)[inside]] = False
    return tuple(found)


def _gathered(
    residuals: Sequence[np.ndarray],
    times: Sequence[np.ndarray],
    signals: Sequence[Mapping[str, np.ndarray]],
    units: Mapping[str, str],
) -> _Samples | None:
    """The measured samples of all runs; ``None`` where there is nothing that can be searched."""
    derived = [derived_signals(t, s, units) for t, s in zip(times, signals, strict=True)]
    common = [name for name in derived[0] if all(name in d for d in derived)] if derived else []
    seen = [~np.isnan(rest) for rest in residuals]
    energy = np.concatenate([rest[ok] ** 2 for rest, ok in zip(residuals, seen, strict=True)])
    if energy.size < 20 or not np.all(np.isfinite(energy)) or not energy.sum() > 0:
        return None
    run = np.concatenate([np.full(int(ok.sum()), i) for i, ok in enumerate(seen)])
    joined = {
        name: np.concatenate([d[name][0][ok] for d, ok in zip(derived, seen, strict=True)])
        for name in common
    }
    fine = {name: v for name, v in joined.items() if np.all(np.isfinite(v)) and np.ptp(v) > 0}
    return _Samples(energy, run, fine, {name: derived[0][name][1] for name in fine})


def _block(residuals: Sequence[np.ndarray]) -> int:
    """Samples in a block: some correlation times of the squared residual."""
    longest = max(rest.size for rest in residuals)
    own = autocorrelation([rest**2 for rest in residuals], longest // 3)
    implied = autocorrelation(residuals, longest // 3) ** 2
    times = [_integral(own), _integral(implied)]
    return max(5, math.ceil(5 * max(times)))


def _integral(correlation: np.ndarray) -> float:
    """Sum of an autocorrelation over both sides, up to where it has died away."""
    gone = np.flatnonzero(correlation < 0.05)
    return float(2 * correlation[: gone[0] if gone.size else None].sum() - 1)


def _excess(samples: _Samples, inside: np.ndarray) -> float:
    return float(samples.energy[inside].sum() / samples.energy.sum() - inside.mean())


def _search(
    samples: _Samples, block: int, rng: np.random.Generator, channels: int, least: float
) -> tuple[Interval, float] | None:
    """The interval of one signal with the largest excess, and its p-value."""
    stride = -(-samples.energy.size // _SAMPLES)
    thin = samples.at(np.arange(samples.energy.size) % stride == 0)
    bins = {name: _edges(values) for name, values in thin.signals.items()}
    bins = {name: edges for name, edges in bins.items() if edges.size}
    if not bins or thin.energy.size < 20 or not thin.energy.sum() > 0:
        return None
    orders = _orders(thin.run, max(3, block // stride), rng)
    energy = np.concatenate([thin.energy[None], thin.energy[orders]]) / thin.energy.sum()
    scores, spans = {}, {}
    for name, edges in bins.items():
        label = np.searchsorted(edges, thin.signals[name], side="right")
        count = np.arange(label.size)
        member = sparse.csr_array((np.ones(label.size), (label, count)), (edges.size + 1, count.size))
        share = np.asarray((member @ energy.T).T) - np.asarray(member.sum(axis=1)) / label.size
        path = np.concatenate([np.zeros((share.shape[0], 1)), np.cumsum(share, axis=1)], axis=1)
        rise = path - np.minimum.accumulate(path, axis=1)
        scores[name] = rise.max(axis=1)
        end = int(rise[0].argmax())
        spans[name] = (int(path[0, : end + 1].argmin()), end)
    p_values = _adjusted(np.stack(list(scores.values())), channels)
    sure = [
        name
        for name, p in zip(scores, p_values, strict=True)
        if p <= LEVEL and scores[name][0] >= least
    ]
    if not sure:
        return None
    # of signals that say nearly the same, the plainest, which comes first
    largest = max(scores[name][0] for name in sure)
    alike = [name for name in sure if scores[name][0] >= largest - 0.02]
    name, size = alike[0], f"|{alike[0]}|"
    if size in alike and 0 < spans[name][0] and spans[name][1] <= bins[name].size:
        name = size  # -0.3 < x < 0.32 says the same as |x| < 0.3, and less plainly
    interval = _rounded(samples, name, bins[name], spans[name])
    inside = interval.holds(samples.signals[name])
    if samples.energy[inside].sum() / samples.energy.sum() < _RATIO * inside.mean():
        return None
    return interval, float(p_values[list(scores).index(name)])


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
        whole = []
        for i in rng.permutation(len(parts)):
            rolled = np.roll(parts[i], int(rng.integers(parts[i].size)))
            pieces = np.array_split(rolled, max(1, rolled.size // block))
            whole += [pieces[j] for j in rng.permutation(len(pieces))]
        # runs of unequal length come to lie across the ends of others: turn the whole as well
        draws.append(np.roll(np.concatenate(whole), int(rng.integers(run.size))))
    return np.stack(draws)


def _adjusted(scores: np.ndarray, channels: int) -> np.ndarray:
    """P-values ``(S,)`` of scores ``(S, 1 + draws)``, for the largest over the signals."""
    chance = scores[:, 1:]
    scale = np.maximum(chance.std(axis=1), 1e-12)
    standard = (scores - chance.mean(axis=1)[:, None]) / scale[:, None]
    largest = standard[:, 1:].max(axis=0)
    beaten = (largest[None, :] >= standard[:, :1]).sum(axis=1)
    return np.minimum(1.0, channels * (1 + beaten) / (1 + largest.size))


def _rounded(
    samples: _Samples, name: str, edges: np.ndarray, span: tuple[int, int]
) -> Interval:
    """The interval with ends rounded as far as the excess stays what it is."""
    values, unit = samples.signals[name], samples.units[name]
    low = edges[span[0] - 1] if span[0] > 0 else -math.inf
    high = edges[span[1] - 1] if span[1] <= edges.size else math.inf
    exact = Interval(name, float(low), float(high), unit)
    target = _excess(samples, exact.holds(values))
    width = np.ptp(values) if math.isinf(high - low) else high - low
    first = -math.floor(math.log10(width))
    for digits in range(first, first + 4):
        ends = [round(float(x), digits) if math.isfinite(x) else float(x) for x in (low, high)]
        near = Interval(name, ends[0] + 0.0, ends[1] + 0.0, unit)
        if abs(_excess(samples, near.holds(values)) - target) < 0.01:
            return near
    return exact

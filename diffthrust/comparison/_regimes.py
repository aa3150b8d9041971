"""Where the error sits: the regime of the model's signals that holds most of the squared error."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from diffthrust._support.correlation import autocorrelation
from diffthrust._support.words import percent
from diffthrust.comparison._derived_signals import derived_signals
from diffthrust.comparison._regime_search import Samples, SignalRange, coarse, excess, worst_range

# least excess of a regime's share of the error over its share of the samples, and what a second
# signal must add to it
_EXCESS, _MORE = 0.15, 0.05


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

    @property
    def unit(self) -> str:
        """Unit of the first signal."""
        return self.where[0].unit

    def holds(self, derived: Mapping[str, tuple[np.ndarray, str]]) -> np.ndarray:
        """Which samples of a run are in it, by its `derived_of`."""
        ranges = [interval.holds(derived[interval.signal][0]) for interval in self.where]
        return np.logical_and.reduce(ranges)

    @property
    def sentence(self) -> str:
        """The regime in plain words, with units."""
        place = " and ".join(
            interval.phrase + " by the model" * (interval.signal in self.modelled)
            for interval in self.where
        )
        outside = "Outside that, " if self.outside else ""
        return (
            f"{outside}{percent(self.share_of_error)} of the squared {self.channel} error lies "
            f"where {place}, {percent(self.share_of_samples)} of the samples."
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


def worst_regimes(
    channel: str,
    residuals: Sequence[np.ndarray],
    times: Sequence[np.ndarray | None],
    signals: Sequence[Mapping[str, np.ndarray]],
    units: Mapping[str, str],
    *,
    inputs: Collection[str],
    plain: Collection[str] = (),
    most: int = 2,
    channels: int = 1,
) -> tuple[Regime, ...]:
    """Search for the regimes that hold the largest share of squared error beyond their samples.

    Beside the signals themselves, their sizes, rates of change, the time since the start and the
    time since an input jumped are searched. A regime is named only where chance gives as much in
    less than 5 % of cases, over all signals and channels, and where its share of the error is at
    least 15 points and one half above its share of the samples.

    Args:
        channel: name of the channel, for the sentence.
        residuals: measured minus modelled of each run, ``(n,)``; NaN where nothing was measured.
        times: time stamps [s] of each run, ``(n,)``, or ``None`` for a table of readings.
        signals: the signals of each run by name, ``(n,)`` each.
        units: unit of each signal.
        inputs: signals that come from the logs; all others are the model's.
        plain: signals of which only the value is searched, such as an angle that jumps by a turn.
        most: how many regimes to name; each further one lies outside those before it.
        channels: how many channels are searched in all; p-values are multiplied by it.

    Returns:
        The regimes, the one with the largest excess first; none where none is significant.

    Example:
        >>> worst_regimes(
        ...     "speed", [rest], [t], [{"command": u}], {"command": "V"}, inputs=["command"]
        ... )[0].sentence
        '62 % of the squared speed error lies where |command| < 0.2 V, 9 % of the samples.'
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
    while len(regimes) < most:
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
            if excess(remaining, both) > excess(remaining, inside) + _MORE:
                where, p, inside = [*where, closer[0]], max(p, closer[1]), both
        error = float(remaining.energy[inside].sum()) / everything
        share = float(inside.sum()) / outside.size
        modelled = tuple(i.signal for i in where if i.signal not in of_logs)
        regimes.append(Regime(channel, tuple(where), error, share, p, bool(regimes), modelled))
        outside[np.flatnonzero(outside)[inside]] = False
    return tuple(regimes)


def _gathered(
    residuals: Sequence[np.ndarray],
    times: Sequence[np.ndarray | None],
    signals: Sequence[Mapping[str, np.ndarray]],
    units: Mapping[str, str],
    plain: Collection[str],
) -> Samples | None:
    """The measured samples of all runs; ``None`` where there is nothing that can be searched."""
    derived = [derived_signals(t, s, units, plain) for t, s in zip(times, signals, strict=True)]
    common = [name for name in derived[0] if all(name in d for d in derived)] if derived else []
    finite = [~np.isnan(residual) for residual in residuals]
    energy = np.concatenate(
        [residual[ok] ** 2 for residual, ok in zip(residuals, finite, strict=True)]
    )
    if energy.size < 20 or not np.all(np.isfinite(energy)) or not energy.sum() > 0:
        return None
    run = np.concatenate([np.full(int(ok.sum()), i) for i, ok in enumerate(finite)])
    joined = {
        name: np.concatenate([d[name][0][ok] for d, ok in zip(derived, finite, strict=True)])
        for name in common
    }
    fine = {name: coarse(v) for name, v in joined.items() if np.all(np.isfinite(v))}
    fine = {name: v for name, v in fine.items() if np.ptp(v) > 0}
    return Samples(energy, run, fine, {name: derived[0][name][1] for name in fine})


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

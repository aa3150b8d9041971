"""A line in the spectrum of errors: a force that is periodic in time, or with the turns of a shaft.

The periodograms of all logs are added, each over the level of its neighbourhood (Fisher 1929 and
Schuster 1898, with a background that need not be white). Random forces, whatever their memory, have
no line: their spectrum is smooth.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from diffthrust.diagnosis._settings import SETTINGS

_FINER = 2
"""Numerics: points of the periodogram for each independent frequency, so that a line between two
does not lose half its height."""
_OWN = 1.6
"""Numerics: half the width of a line, in cycles per log, under the window of Hann."""
_REACH = 1.6
"""Numerics: the background of a frequency is the mean from this factor below it to as much above:
over equal factors that is unbiased for spectra that fall with the square of the frequency."""
_WIDEST = 60
"""Numerics: and at most so many independent frequencies on each side."""
_CLIPPED = 8.0
"""Numerics: other lines stand above this multiple of the median, and are no background; noise does
in one case of 256."""


Series = tuple[np.ndarray, np.ndarray]
"""Time and values, ``(T,)`` each; NaN where nothing was measured."""


class Even(NamedTuple):
    """The errors of one channel over one log, evenly sampled, without gaps; ``(n,)`` each."""

    time: Float[np.ndarray, " n"]
    values: Float[np.ndarray, " n"]


class SpectralLine(NamedTuple):
    """The strongest line of one channel's errors.

    Args:
        channel: the channel.
        frequency: [Hz].
        height: of the periodogram there over its neighbourhood, mean over the logs.
        p_value: that noise shows one as high at any of the frequencies.
        amplitude: root mean square over the logs, in the unit of the channel.
    """

    channel: str
    frequency: float
    height: float
    p_value: float
    amplitude: float


def strongest_line(channel: str, logs: Sequence[Series]) -> SpectralLine | None:
    """The strongest line of a channel's errors; ``None`` where the logs are too short for any.

    Args:
        channel: its name.
        logs: time and errors of each log; NaN where nothing was measured.

    Example:
        >>> time, rng = 0.05 * np.arange(800), np.random.default_rng(0)
        >>> wave = 0.4 * np.sin(2 * np.pi * 0.7 * time + 1.0)
        >>> line = strongest_line("speed", [(time, wave + rng.standard_normal(800))])
        >>> round(line.frequency, 2), line.p_value < 1e-6
        (0.7, True)
    """
    errors = evenly(logs)
    if not errors:
        return None
    spectrum = _Spectrum.of(errors)
    if not spectrum.searched.any():
        return None
    p_values = spectrum.p_values()
    at = int(np.argmin(np.where(spectrum.searched, p_values, np.inf)))
    p_value = float(min(1.0, p_values[at] * spectrum.trials))
    frequency = float(spectrum.frequencies[at])
    if p_value < SETTINGS.line.level:  # no one asks where a line is that noise shows as well
        frequency = _sharpened(errors, frequency)
    swings = [2.0 * abs(_component(e, frequency)) for e in errors]
    return SpectralLine(
        channel,
        frequency,
        float(spectrum.heights[at]),
        p_value,
        float(np.sqrt(np.mean(np.square(swings)))),
    )


def height_at(logs: Sequence[Series], frequency: float) -> float:
    """How far the periodogram of some series stands above its neighbourhood at a frequency."""
    errors = evenly(logs)
    if not errors:
        return 0.0
    spectrum = _Spectrum.of(errors)
    near = np.abs(spectrum.frequencies - frequency) <= _OWN / min(_length(e) for e in errors)
    return float(np.max(spectrum.heights, where=near, initial=0.0))


def evenly(logs: Sequence[Series]) -> list[Even]:
    """Errors on an even time base, that of the slowest log's measurements.

    A sensor that is read every tenth sample says nothing between: a line above half the rate of its
    readings would be another one's image.
    """
    measured = [(t[np.isfinite(e)], e[np.isfinite(e)]) for t, e in logs]
    measured = [(t, e) for t, e in measured if t.size >= SETTINGS.line.least_samples]
    if not measured:
        return []
    step = max(float(np.median(np.diff(t))) for t, _ in measured)
    even = []
    for time, error in measured:
        base = time[0] + step * np.arange(int((time[-1] - time[0]) / step + 1e-6) + 1)
        even.append(Even(base, np.interp(base, time, error)))
    return [e for e in even if e.values.size >= SETTINGS.line.least_samples and np.ptp(e.values)]


class _Spectrum(NamedTuple):
    """Summed periodograms over their neighbourhood.

    Args:
        frequencies: [Hz], ``(F,)``.
        heights: ``(F,)``; 1 in the mean where there is no line.
        background: number of independent values behind each neighbourhood's mean, ``(F,)``.
        searched: frequencies that are looked at, ``(F,)``.
        trials: number of independent ones among these.
        logs: number of logs.
    """

    frequencies: np.ndarray
    heights: np.ndarray
    background: np.ndarray
    searched: np.ndarray
    trials: float
    logs: int

    @classmethod
    def of(cls, errors: Sequence[Even]) -> _Spectrum:
        step = float(errors[0].time[1] - errors[0].time[0])
        shortest, longest = min(map(_length, errors)), max(map(_length, errors))
        size = _FINER * round(longest / step)
        frequencies = np.fft.rfftfreq(size, step)
        power = np.zeros(frequencies.size)
        for e in errors:
            window = np.hanning(e.values.size)
            line = np.polynomial.polynomial.polyfit(e.time - e.time[0], e.values, 1)
            flat = e.values - np.polynomial.polynomial.polyval(e.time - e.time[0], line)
            spectrum = np.abs(np.fft.rfft(window * flat, size)) ** 2
            power += spectrum / np.sum(spectrum)
        per_cycle = size * step / shortest  # points of the grid for one cycle a log
        heights, background = _over_neighbours(power, per_cycle)
        low = SETTINGS.line.least_cycles / shortest
        searched = (frequencies >= low) & (frequencies <= SETTINGS.line.most_of_nyquist / step / 2)
        trials = np.sum(searched) / (size * step / longest) * _FINER
        return cls(frequencies, heights, background, searched, trials, len(errors))

    def p_values(self) -> np.ndarray:
        """That noise stands as high at one frequency: a ratio of two means of squares."""
        from scipy.special import fdtrc  # slow to import

        freedom = 2.0 * self.logs
        return np.asarray(fdtrc(freedom, freedom * self.background, self.heights))


def _over_neighbours(power: np.ndarray, per_cycle: float) -> tuple[np.ndarray, np.ndarray]:
    """Power over the mean of its neighbourhood, and the independent values behind that mean."""
    heights, counts = np.zeros(power.size), np.ones(power.size)
    own, widest = _OWN * per_cycle, _WIDEST * per_cycle
    for k in range(1, power.size):
        low, high = max(k / _REACH, k - widest, 1), min(k * _REACH, k + widest, power.size - 1)
        near = power[round(low) : round(high) + 1]
        away = np.abs(np.arange(round(low), round(high) + 1) - k) > own
        near = near[away]
        if near.size < per_cycle:
            continue
        near = near[near <= _CLIPPED * np.median(near)]
        heights[k] = power[k] / max(float(np.mean(near)), 1e-300)
        # neighbours under the window of Hann are correlated: 1.5 cycles a log are independent
        counts[k] = max(near.size / per_cycle / 1.5, 1.0)
    return heights, counts


def _length(errors: Even) -> float:
    return float(errors.time[-1] - errors.time[0])


def _component(errors: Even, frequency: float) -> complex:
    """The complex amplitude of a frequency, half that of a real sine."""
    window = np.hanning(errors.values.size)
    turns = np.exp(-2j * np.pi * frequency * (errors.time - errors.time[0]))
    return complex(np.sum(window * errors.values * turns) / np.sum(window))


def _sharpened(errors: Sequence[Even], frequency: float) -> float:
    """The frequency near a peak at which the logs' power is largest."""
    from scipy.optimize import minimize_scalar  # slow to import

    reach = 1.0 / max(map(_length, errors))

    def loss(f: float) -> float:
        return -sum(abs(_component(e, f)) ** 2 * e.values.size for e in errors)

    bounds = (frequency - reach, frequency + reach)
    optimum: Any = minimize_scalar(loss, bounds=bounds, method="bounded")
    return float(optimum.x)


# -- against the turns of a shaft ------------------------------------------------------------------


def height_over_turns(
    logs: Sequence[Series], rates: Sequence[np.ndarray], frequency: float
) -> float:
    """The height of the strongest line over the turns of a shaft, of orders near a frequency.

    A ripple that goes with the turns is one line over the angle, and smeared over time as far as
    the speed changes; a force that is periodic in time the other way round.

    Args:
        logs: time and errors of each log.
        rates: angular velocity of the shaft in each log [rad/s], at the same times.
        frequency: of the line over time [Hz].
    """
    turned: list[Series] = []
    for (time, error), rate in zip(logs, rates, strict=True):
        angle = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(time))])
        turned.append((angle / (2.0 * np.pi), error))
    spread = max(float(np.ptp(turns)) for turns, _ in turned)
    if not spread > SETTINGS.line.least_cycles:
        return 0.0
    mean = float(np.mean([np.mean(np.abs(rate)) for rate in rates])) / (2.0 * np.pi)
    orders = np.arange(1.0, 8.0 * frequency / mean * spread * _FINER) / (spread * _FINER)
    power = np.zeros(orders.size)
    for turns, error in turned:
        finite = np.isfinite(error)
        at, values = turns[finite], error[finite] - np.mean(error[finite])
        weighed = np.hanning(values.size) * values
        spectrum = _power_at(orders, at, weighed)
        power += spectrum / max(float(np.sum(spectrum)), 1e-300)
    heights, _ = _over_neighbours(power, float(_FINER))
    return float(np.max(heights, initial=0.0))


def _power_at(orders: np.ndarray, turns: np.ndarray, weighed: np.ndarray) -> np.ndarray:
    """The periodogram at arbitrary places, a few orders at a time to bound the memory."""
    pieces = np.array_split(orders, max(1, orders.size * turns.size // 2_000_000))
    return np.concatenate(
        [np.abs(np.exp(-2j * np.pi * np.outer(p, turns)) @ weighed) ** 2 for p in pieces]
    )

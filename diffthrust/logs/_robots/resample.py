"""Samples that came at different rates, on one time base; what was done is said.

Inputs that are held keep their last value. What is measured runs straight between two messages,
across gaps up to a limit; beyond it, it is missing. On a base of all messages nothing is made up:
inputs change when they changed, and what is measured stands at its own stamps alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing, nearest
from diffthrust.logs._robots.series import Series

_MESSAGES = "messages"

_SAME = 1e-9  # two stamps no further apart are one [s]
_MOST = 10_000_000  # samples; a step in the wrong unit asks for more


@dataclass(frozen=True)
class Resampled:
    """Channels on one time base.

    Args:
        time: time stamps [s], shape (n,).
        values: samples by channel, NaN where missing, each of shape (n,).
        notes: sentences on what was done.
    """

    time: np.ndarray
    values: dict[str, np.ndarray]
    notes: list[str]


def resample(
    file: str,
    series: Mapping[str, Series],
    held: Mapping[str, bool],
    inputs: frozenset[str],
    base: str | float,
    gap: float | None,
    faster: float,
) -> Resampled:
    """Put channels on one time base.

    Args:
        file: name of the file, for messages.
        series: the samples of each channel.
        held: for each channel, whether it keeps its last value.
        inputs: which of the channels are inputs: no sample is made where one is not known.
        base: the channel whose stamps are taken, ``"messages"`` for those of all, or a step [s].
        gap: the largest gap to interpolate across [s]; where None, three periods of each channel.
        faster: how many times faster than an interpolated channel the base may be.

    Raises:
        InputError: the base is no channel and no step, is too fast for a channel, or the channels
            have no time in common.
    """
    every = base == _MESSAGES
    step, stamps = _every_stamp(series, held) if every else _base(file, series, base)
    for name, one in series.items():
        if not held[name]:
            _check_rate(name, one, step, np.inf if every else faster)
    time, notes = _span(file, series, held, inputs, base, step, stamps)
    out = {}
    for name, one in series.items():
        role = "input" if name in inputs else "measured"
        head = f"{role} {name!r}: {_rate(one)}"
        if held[name]:
            out[name] = one.values[np.searchsorted(one.time, time + _SAME, side="right") - 1]
            late = (
                f", so a change appears up to {step:.3g} s late (on the base 'messages', on time)"
            )
            late = "" if every or name == base else late
            after = time[-1] - one.time[-1]
            end = f"; held for {after:.3g} s after its last message" if after > step else ""
            how = f"held between messages{late}{end}"
        elif every and name not in inputs:
            out[name], _ = _linear(one, time, -1.0)
            how = f"{int(np.isfinite(out[name]).sum())} samples, each at its own stamp"
        else:
            limit = 3 * one.period if gap is None else gap
            out[name], between = _linear(one, time, limit)
            missing = int(np.isnan(out[name]).sum())
            how = f"{between / time.size:.0%} of the samples are interpolated"
            how += f", {missing} are missing (gaps above {limit:.3g} s)" if missing else ""
            if one.period < 0.75 * step:
                how += "; it is faster than the base, and what is above half the base's rate folds"
        notes.append("; ".join([head, how, *one.notes]) + ".")
    return Resampled(time, out, notes)


def _every_stamp(
    series: Mapping[str, Series], held: Mapping[str, bool]
) -> tuple[float, np.ndarray]:
    """Their median distance [s], and all stamps; of held inputs those alone where they change."""
    stamps = []
    for name, one in series.items():
        changed = np.append(True, np.diff(one.values) != 0)
        stamps.append(one.time[changed] if held[name] else one.time)
    merged = np.sort(np.concatenate(stamps))
    merged = merged[np.append(True, np.diff(merged) > _SAME)]
    return float(np.median(np.diff(merged))) if merged.size > 1 else 0.0, merged


def _base(
    file: str, series: Mapping[str, Series], base: str | float
) -> tuple[float, np.ndarray | None]:
    """The step [s], and the stamps where a channel gives them."""
    if isinstance(base, str):
        if base not in series:
            near = nearest(base, series)
            raise InputError(
                f"{file}: expected a channel as time base, one of {listing(series)}, found "
                f"{base!r}{'; ' + near if near else ''}.",
                "name the channel whose stamps are to be taken, write 'messages' for those of all, "
                "or give a step in seconds.",
            )
        if series[base].time.size < 2:
            raise InputError.at(
                series[base].place,
                "expected several messages to take the stamps from, found one.",
                "choose another channel as base, or a step in seconds.",
            )
        return series[base].period, series[base].time
    if isinstance(base, bool) or not isinstance(base, int | float) or not 0 < base < float("inf"):
        raise InputError(
            f"{file}: expected a channel or a step above zero as time base, found {base!r}.",
            "write base = 'speed' for the stamps of that channel, or base = 0.05 for a step.",
        )
    return float(base), None


def _check_rate(name: str, one: Series, step: float, faster: float) -> None:
    if one.time.size < 2:
        raise InputError.at(
            one.place,
            f"expected several messages for the channel {name!r}, found one.",
            "choose another field; an input that is set once is read with hold = 'zero'.",
        )
    if one.period > faster * step * (1 + 1e-9):
        raise InputError.at(
            one.place,
            f"the time base has a step of {step:.4g} s, the channel {name!r} one of "
            f"{one.period:.4g} s: {one.period / step:.3g} samples of each message, expected at "
            f"most {faster:.3g}. Interpolated samples tell nothing new.",
            f"choose base = {name!r} or a longer step, or allow it with "
            f"faster = {np.ceil(one.period / step):.0f}.",
        )


def _span(
    file: str,
    series: Mapping[str, Series],
    held: Mapping[str, bool],
    inputs: frozenset[str],
    base: str | float,
    step: float,
    stamps: np.ndarray | None,
) -> tuple[np.ndarray, list[str]]:
    """The time base, where all inputs are known."""
    first = max((series[n].time[0] for n in inputs), default=-np.inf)
    last = min((series[n].time[-1] for n in inputs if not held[n]), default=np.inf)
    if stamps is None:
        seen = [one for name, one in series.items() if name not in inputs] or list(series.values())
        first = max(first, min(one.time[0] for one in seen))
        last = min(last, max(one.time[-1] for one in seen))
        count = int(np.floor((last - first) / step + 1e-9)) + 1 if last >= first else 0
        if count > _MOST:
            raise InputError(
                f"{file}: a step of {step:g} s makes {count} samples of {last - first:.6g} s.",
                "give the step in seconds.",
            )
        time = first + step * np.arange(count)
        note = f"time base: a step of {step:.6g} s, {count} samples."
    else:
        keep = (stamps >= first - _SAME) & (stamps <= last + _SAME)
        time = stamps[keep]
        whose = "all messages" if base == _MESSAGES else repr(base)
        rate = f"{1 / step:.4g} Hz, " if step > 0 else ""
        note = f"time base: the stamps of {whose}, {rate}{time.size} samples"
        cut = stamps.size - time.size
        note += f"; {cut} were cut, where an input is not known." if cut else "."
    if time.size == 0:
        ends = listing(f"{n} {s.time[0]:.6g} to {s.time[-1]:.6g} s" for n, s in series.items())
        raise InputError(
            f"{file}: the channels have no time in common: {ends}.",
            "choose channels that were recorded together.",
        )
    return time, [note]


def _rate(one: Series) -> str:
    if one.time.size < 2:
        return "one message"
    gap, moment = one.largest_gap
    return (
        f"{one.time.size} messages at {1 / one.period:.4g} Hz, largest gap {gap:.3g} s at "
        f"{moment:.6g} s, jitter {round(one.jitter * 1e3, 3):.2g} ms"
    )


def _linear(one: Series, time: np.ndarray, limit: float) -> tuple[np.ndarray, int]:
    """The values straight between two messages, and how many lie between."""
    after = np.clip(np.searchsorted(one.time, time), 1, one.time.size - 1)
    # A stamp of the base that is one of the channel's, up to rounding, is no interpolation.
    exact = np.minimum(np.abs(one.time[after] - time), np.abs(one.time[after - 1] - time)) <= _SAME
    width = one.time[after] - one.time[after - 1]
    inside = (time >= one.time[0] - _SAME) & (time <= one.time[-1] + _SAME)
    known = inside & (exact | (width <= limit * (1 + 1e-9)))
    values = np.where(known, np.interp(time, one.time, one.values), np.nan)
    return values, int((known & ~exact).sum())

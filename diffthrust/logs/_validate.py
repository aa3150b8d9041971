"""Checks that every log passes, whether made from arrays or read from a file."""

from collections.abc import Callable, Collection, Mapping
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError, Place
from diffthrust._support.names import listing, nearest
from diffthrust._support.validation import numeric_vector
from diffthrust.logs._units import convert, convert_scale, si_unit
from diffthrust.logs._written import Written

# Names a place for a message: the channel (or "time"), and the sample if a single one is at fault.
PlaceOf = Callable[[str, int | None], Place]


def place_in_log(log: str, channel: str, index: int | None = None) -> Place:
    """Name a channel of a log, or its time, and the sample where a single one is at fault."""
    sample = "" if index is None else f", sample {index}"
    if channel == "time":
        return Place(f"log {log!r}, time{sample}")
    return Place(f"log {log!r}, channel {channel!r}{sample}", channel=channel)


def _check_samples(
    bad: np.ndarray, channel: str, at: PlaceOf, problem: Callable[[int], str], mend: str
) -> None:
    """Raise InputError about the first of the marked samples, saying how many more there are."""
    marked = np.flatnonzero(bad)
    if marked.size:
        index = int(marked[0])
        more = f", and {marked.size - 1} more like it" if marked.size > 1 else ""
        raise InputError.at(at(channel, index), f"{problem(index)}{more}.", mend)


def _check_time(time: np.ndarray, at: PlaceOf) -> None:
    """Raise InputError unless the time stamps are finite and strictly increasing."""
    if time.size == 0:
        raise InputError.at(at("time", None), "expected time stamps, found none.", "give samples.")
    check_stamps(time, at)
    with np.errstate(all="ignore"):
        steps = np.diff(time, prepend=-np.inf)
    _check_samples(
        ~(steps > 0),
        "time",
        at,
        lambda k: (
            f"expected a time stamp after {time[k - 1]:.15g} s, found {time[k]:.15g} s "
            f"({'the same again' if time[k] == time[k - 1] else 'a step backward'})"
        ),
        "remove the repeated or misplaced samples; if the clock was restarted, split the log.",
    )
    # Stamps such as -1e308 and 1e308 are finite and increasing.
    if not np.isfinite(time[-1] - time[0]):
        problem = "the time stamps span more than numbers can hold."
        mend = "check the unit of the time."
        raise InputError.at(at("time", None), problem, mend)


def check_stamps(time: np.ndarray, at: PlaceOf) -> None:
    """Raise InputError unless the time stamps are finite."""
    _check_samples(
        ~np.isfinite(time),
        "time",
        at,
        lambda k: f"expected a time stamp, found {'none' if np.isnan(time[k]) else time[k]}",
        "complete the time stamp, or remove the sample.",
    )


def _check_finite_or_missing(values: np.ndarray, channel: str, at: PlaceOf) -> None:
    """Raise InputError if a sample is infinite: only NaN means missing."""
    _check_samples(
        np.isinf(values),
        channel,
        at,
        lambda k: f"expected a finite number, found {values[k]}",
        "correct the sample; a missing one is written as nan or left empty.",
    )


def _complete_input(
    time: np.ndarray, values: np.ndarray, channel: str, interpolate: bool, at: PlaceOf
) -> tuple[np.ndarray, str | None]:
    """An input without gaps, ``(n,)``, if the user allows it, and a note on what was filled.

    Straight lines between neighbours, and the nearest sample at the ends.
    """
    missing = np.isnan(values)
    count = int(missing.sum())
    if count == 0:
        return values, None
    if count == values.size:
        problem = f"expected an input, found no number in {count} samples."
        mend = "choose another column for this input."
        raise InputError.at(at(channel, None), problem, mend)
    _check_samples(
        missing & (not interpolate),
        channel,
        at,
        lambda _: "expected a value of the input, found none",
        "complete it, cut the log with start and stop, or set interpolate_inputs = true.",
    )
    filled = values.copy()
    with np.errstate(all="ignore"):
        filled[missing] = np.interp(time[missing], time[~missing], values[~missing])
    _check_finite_or_missing(filled, channel, at)
    if np.isnan(filled).any():  # the slope between huge neighbours overflows
        problem = "the gap cannot be interpolated, its neighbours are too large."
        mend = "correct the samples around it."
        raise InputError.at(at(channel, int(np.argmax(missing))), problem, mend)
    return filled, (
        f"input {channel!r}: {count} of {values.size} samples were missing and were interpolated."
    )


def _missing_note(values: np.ndarray, channel: str, at: PlaceOf) -> str | None:
    """Count the missing samples (NaN) of a measured channel, ``(n,)``; None if there are none."""
    count = int(np.isnan(values).sum())
    if count == values.size:
        problem = f"expected measured samples, found no number in {count} samples."
        mend = "choose another column, or leave this channel out."
        raise InputError.at(at(channel, None), problem, mend)
    about = f"{count} of {values.size} samples are missing and carry no weight."
    return f"measured {channel!r}: {about}" if count else None


_GAP = 10.0
"""A step above this multiple of the usual step is a gap."""


def _gap_note(time: np.ndarray) -> str | None:
    """A note on the largest gaps in time, with moment and length; None without gaps.

    The usual step is the 90 % quantile of the steps, not their median: where messages of several
    senders are merged, half of the steps lie between messages sent together.
    """
    steps = np.diff(time)
    if steps.size < 3:
        return None
    usual = float(np.quantile(steps, 0.9, method="lower"))
    gaps = np.flatnonzero(steps > _GAP * usual)
    if not gaps.size:
        return None
    largest = gaps[np.argsort(-steps[gaps], kind="stable")][:3]
    listed = ", ".join(f"{steps[k]:.3g} s after {time[k] - time[0]:.6g} s" for k in sorted(largest))
    many = (
        f"{gaps.size} gaps, the largest" if gaps.size > 3 else "gaps" if gaps.size > 1 else "a gap"
    )
    return f"time: {many} of {listed} from the start; the usual step is {usual:.3g} s."


def window(time: np.ndarray, start: float | None, stop: float | None, where: str) -> np.ndarray:
    """Mark the samples from start to stop [s after the first], ``(n,)``; InputError if none is."""
    with np.errstate(all="ignore"):
        elapsed = time - time[0]
    keep = np.ones(time.size, dtype=bool)
    # The slack keeps a last sample at 150.00000000000003 s within stop = 150.
    if start is not None:
        keep &= elapsed >= start - 1e-9 * max(1.0, abs(start))
    if stop is not None:
        keep &= elapsed <= stop + 1e-9 * max(1.0, abs(stop))
    if not keep.any():
        last = "the end" if stop is None else f"{stop:g} s"
        raise InputError(
            f"{where}: expected samples from {start or 0.0:g} to {last} after the first, found "
            f"none; the log lasts {elapsed[-1]:.6g} s.",
            "choose start and stop inside the log.",
        )
    return keep


def _check_mappings(inputs: Any, measured: Any, units: Any, noise: Any, name: str) -> None:
    for kind, values, example in (
        ("inputs", inputs, "{'command': [0.0, 2.0]}"),
        ("measured", measured, "{'speed': [0.0, 60.0]}"),
        ("units", units, "{'speed': 'rpm'}"),
        ("noise", noise, "{'speed': 0.5}"),
    ):
        if not isinstance(values, Mapping):
            raise InputError(
                f"log {name!r}: {kind}: expected a dictionary by the names of channels, found "
                f"{type(values).__name__}.",
                f"write {kind}={example}.",
            )


def checked_fields(
    *,
    time: Any,
    inputs: Mapping[str, Any],
    measured: Mapping[str, Any],
    units: Mapping[str, str],
    unsigned: Collection[str],
    noise: Mapping[str, float | None],
    hold: str | Mapping[str, str],
    name: str,
    interpolate_inputs: bool,
    notes: tuple[str, ...],
    written: Mapping[str, Written],
    rails: Mapping[str, Any],
    censored: Collection[str],
    static: bool,
    at: PlaceOf,
) -> dict[str, Any]:
    """Check, copy and convert the fields of a log, of which it returns the final ones.

    The arguments are those of ``Log``; ``written`` describes how the channels were written where
    ``units`` does not, and ``at`` names places, so that a message gives line and column of a file.
    """
    _check_mappings(inputs, measured, units, noise, name)
    unsigned = (unsigned,) if isinstance(unsigned, str) else unsigned
    censored = (censored,) if isinstance(censored, str) else censored
    hold = dict.fromkeys(inputs, hold) if isinstance(hold, str) else hold
    options = {"unsigned": unsigned, "noise": noise, "rails": rails, "censored": censored}
    _check_names(inputs, measured, units, options, hold, name, at)
    for key, word in hold.items():
        check_hold(word, at(key, None))

    stamps = numeric_vector(time, at("time", None))
    stamps = convert(stamps, units.get("time") or "s", "s", where=at("time", None))
    _check_time(stamps, at)

    stored_units: dict[str, str] = {}
    stored: dict[str, np.ndarray] = {}
    sentences: list[str | None] = [_gap_note(stamps)]
    for key, samples in {**inputs, **measured}.items():
        numbers, stored_units[key] = _in_si(key, samples, units.get(key) or "", stamps.size, at)
        if key in inputs:
            numbers, sentence = _complete_input(stamps, numbers, key, interpolate_inputs, at)
        else:
            sentence = _missing_note(numbers, key, at)
        stored[key] = numbers
        sentences.append(sentence)
    for key in unsigned:
        if negative := int((stored[key] < 0).sum()):
            sentences.append(
                f"measured {key!r}: {negative} samples are negative although the sensor is "
                "declared to report the absolute value."
            )
    about = {key: (units.get(key) or "", stored_units[key], at(key, None)) for key in measured}
    return dict(
        time=stamps,
        inputs={key: stored[key] for key in inputs},
        measured={key: stored[key] for key in measured},
        units=stored_units,
        unsigned=frozenset(unsigned),
        noise={k: _checked_noise(noise[k], *about[k]) for k in about if noise.get(k) is not None},
        hold={key: hold.get(key, "zero") for key in inputs},
        written={key: written.get(key) or Written(units.get(key) or "") for key in stored},
        rails={k: _checked_rails(rails[k], *about[k]) for k in about if rails.get(k) is not None},
        censored=frozenset(censored),
        static=bool(static),
        name=name,
        notes=tuple(dict.fromkeys([*notes, *(s for s in sentences if s)])),
    )


def _in_si(channel: str, samples: Any, unit: str, size: int, at: PlaceOf) -> tuple[np.ndarray, str]:
    """The samples of a channel in the unit in which they are kept, and that unit."""
    where = at(channel, None)
    numbers = numeric_vector(samples, where)
    if numbers.size != size:
        problem = f"expected {size} samples as in time, found {numbers.size}."
        mend = "give one sample for each time stamp, nan where a measured one is missing."
        raise InputError.at(where, problem, mend)
    _check_finite_or_missing(numbers, channel, at)
    kept = si_unit(unit, channel, where)
    if unit:
        numbers = convert(numbers, unit, kept, where=where)
        _check_finite_or_missing(numbers, channel, at)
    return numbers, kept


def _check_names(
    inputs: Collection[str],
    measured: Collection[str],
    units: Collection[str],
    options: Mapping[str, Collection[str]],
    hold: Collection[str],
    name: str,
    at: PlaceOf,
) -> None:
    """Raise InputError unless each channel has one role and every option names a channel."""
    channels = [*inputs, *measured]
    for key in set(inputs) & set(measured):
        problem = "expected an input or a measured channel, found both."
        mend = "give it under one of the two."
        raise InputError.at(at(key, None), problem, mend)
    if "time" in channels:
        raise InputError(f"log {name!r}: a channel is called 'time'.", "give it another name.")
    for kind, keys, allowed in (
        ("units", units, [*channels, "time"]),
        *((kind, keys, measured) for kind, keys in options.items()),
        ("hold", hold, inputs),
    ):
        for key in keys:
            if key not in allowed:
                raise InputError(
                    f"log {name!r}: {kind} names {key!r}, expected one of {listing(allowed)}"
                    f"{nearest(str(key), allowed, '; ')}.",
                    f"correct the name under {kind}, or give the channel.",
                )


def check_hold(word: str, where: Place) -> None:
    """Raise InputError unless a hold is 'zero' or 'linear'."""
    if word not in ("zero", "linear"):
        problem = f"expected a hold of 'zero' or 'linear', found {word!r}."
        mend = "write 'zero' for a held command, 'linear' for a measured input."
        raise InputError.at(where, problem, mend)


def _checked_noise(value: Any, unit: str, stored_unit: str, where: Place) -> float:
    try:
        sigma = float(value)
    except (TypeError, ValueError):
        sigma = float("nan")
    if unit and np.isfinite(sigma):
        sigma = convert_scale(sigma, unit, stored_unit, where=where)
    if not (np.isfinite(sigma) and sigma > 0):
        problem = f"expected a standard deviation above zero as noise, found {value!r}."
        mend = "give the noise in the unit of the channel, or leave it out to have it estimated."
        raise InputError.at(where, problem, mend)
    return sigma


def _checked_rails(value: Any, unit: str, stored_unit: str, where: Place) -> tuple[float, float]:
    try:
        low, high = (float(end) for end in value)
    except (TypeError, ValueError):
        low = high = float("nan")
    if not low < high:
        raise InputError.at(
            where,
            f"expected rails as (low, high), the lower one first, found {value!r}.",
            "give both ends of the sensor's range in the unit of the channel; -inf or inf where "
            "there is none.",
        )
    ends = np.array([low, high])
    low, high = convert(ends, unit, stored_unit, where=where) if unit else ends
    return float(low), float(high)

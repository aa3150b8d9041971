"""Read logs of marine robots: ROS bags, ArduPilot's and PX4's logs, on one time base.

Held inputs keep their last value. Measured channels are interpolated linearly across gaps up to a
limit and missing beyond it. On a base of all messages no sample is made up: inputs change at their
original times, and measured channels have samples only at their own time stamps.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from operator import le
from os import PathLike
from pathlib import Path

import numpy as np

from diffthrust._support.errors import InputError, Place
from diffthrust._support.names import listing, nearest
from diffthrust._support.validation import finite
from diffthrust._support.visible import in_line
from diffthrust.logs._columns import Column, channel_columns, fields_of_columns
from diffthrust.logs._edits import unwrapped
from diffthrust.logs._identity import log_file
from diffthrust.logs._kinds import kind_of
from diffthrust.logs._log import Log
from diffthrust.logs._robots.fields import Series, series_in
from diffthrust.logs._robots.messages import column_place
from diffthrust.logs._units import CHANNEL_UNITS
from diffthrust.logs._validate import window

_MESSAGES = "messages"

# Time stamps no further apart than this are equal [s]: recorders count in ns.
_SAME = 1e-9
# Samples of a base; a step in the wrong unit (50 for 50 ms) gives more, and would fill the memory.
_MOST = 10_000_000


def read_robot_log(
    path: str | PathLike[str],
    *,
    base: str | float | None = None,
    inputs: Mapping[str, str | Column] | None = None,
    measured: Mapping[str, str | Column] | None = None,
    gap: float | None = None,
    faster: float = 2.0,
    stamps: str = "recorder",
    missing_values: Sequence[str | float] = (),
    interpolate_inputs: bool = False,
    start: float | None = None,
    stop: float | None = None,
    rate: float | None = None,
    name: str | None = None,
) -> Log:
    """Read a log from a ROS bag, an MCAP file, or a log of ArduPilot or PX4.

    Messages come at different rates, so you choose a time base. With ``"messages"`` no sample is
    made up: the log has the time stamps of all messages, inputs change at their original times,
    and measured channels have samples at their own stamps and are missing in between. The stamps
    of one channel, or a fixed step, give shorter logs. There an input keeps its last value
    (``hold="zero"``), so its changes are late by up to a step, which biases a fit unless the step
    is short against the motion. Measured channels, and inputs with ``hold="linear"``, are
    interpolated linearly, and missing across longer gaps. Angles in rad or deg are unwrapped.
    ``log.notes`` lists rate, largest gap and jitter of each channel, the delay of inputs, and the
    share of interpolated samples.

    The library rosbags turns message definitions in a bag into code: read only bags from sources
    that you trust.

    Args:
        path: ArduPilot's .bin; the folder of a ROS 2 bag or a file ending in .mcap, .db3 or, of ROS
            1, .bag (all need ``pip install 'diffthrust[ros]'``); a .tlog
            (``'diffthrust[ardupilot]'``); PX4's .ulg (``'diffthrust[px4]'``).
        base: ``"messages"``, the channel whose time stamps are used, or a step [s]. Required.
        inputs: message and field of each input, by channel name: ``"/cmd.data"``,
            ``"/rpm.data[0]"``, ``"RCOU.C1"``, ``"ESC[0].RPM"``, ``"1/ATTITUDE.yaw"`` (of system 1),
            ``"actuator_outputs.output[0]"``, ``"esc_status[1].esc[0].esc_rpm"``,
            ``"/odom.pose.pose.orientation.heading"`` (rad, clockwise from north where x is east
            and y is north, as ROS has it).
        measured: message and field of each measured channel.
        gap: the largest gap to interpolate across [s]; if None, three periods of each channel.
        faster: how many times faster than an interpolated channel the base may be. More is refused:
            interpolated samples add no information, but a fit would count them as if they did.
        stamps: ``"recorder"``, the time of reception, or ``"header"``, the stamp in the message's
            header if it has one (ROS).
        missing_values: numbers that mean missing, such as 65535.
        interpolate_inputs: fill missing samples of inputs instead of refusing them.
        start: first moment to keep, in seconds after the first sample.
        stop: last moment to keep, in seconds after the first sample.
        rate: samples a second to bring the log to, as by `Log.resampled`; the base is then
            ``"messages"`` where none is given.
        name: name of the log; by default the file's name.

    Returns:
        The log, in the library's units. Time starts at the first message that was read.

    Raises:
        InputError: the file, a message, a field or the time base cannot be used, or the library
            that reads it is not installed. The message names them, what was found, and the mend.

    Example:
        >>> try:
        ...     dft.read_robot_log("run1.csv", inputs={"command": "RCOU.C1"})
        ... except dft.InputError as error:
        ...     print(error.mend)
        give base="messages" for all stamps, base="speed" for those of that channel, ...
    """
    file = Path(path)
    base = "messages" if base is None and rate is not None else base
    if base is None:
        raise InputError(
            f"{file.name}: expected a time base, found none; its messages come at different rates.",
            'give base="messages" for all stamps, base="speed" for those of that channel, '
            "base=0.05 for a step, or rate=10 for means of 10 samples a second.",
        )
    driving, sensed = channel_columns(file.name, inputs, measured)
    columns = {**driving, **sensed}
    numbers = _checked(file, stamps, gap=gap, faster=faster, start=start, stop=stop)
    missing = _numbers(file, missing_values)
    wanted = list(dict.fromkeys(column.column for column in columns.values()))
    kind = kind_of(file)
    if not kind.messages:
        raise InputError(
            f"{file.name}: expected messages with separate time stamps, found {kind.article}.",
            "tables are read by read_log.",
        )
    fields = series_in(file, kind, wanted, stamps == "header", missing)
    series = {
        key: _unwrapped(fields[c.column], c, key, driving=key in driving)
        for key, c in columns.items()
    }
    even = resample(file.name, series, base, numbers.get("gap"), numbers.get("faster", np.inf))
    # Cut after resampling: a held input keeps the value that was set before `start`.
    keep = window(even.time, numbers.get("start"), numbers.get("stop"), file.name)
    notes = even.notes
    if not keep.all():
        notes.append(f"{int((~keep).sum())} of {keep.size} samples were cut by start and stop.")

    def at(channel: str, index: int | None) -> Place:
        moment = "" if index is None else f" at {even.time[keep][index]:.6g} s"
        if channel == "time":
            return Place(file.name + moment)
        return column_place(file.name, columns[channel].column, moment)

    fields = fields_of_columns(
        driving,
        sensed,
        time=even.time[keep],
        values={key: values[keep] for key, values in even.values.items()},
        name=in_line(file.name if name is None else str(name)),
        interpolate_inputs=interpolate_inputs,
        notes=notes,
        static=False,
        at=at,
    )
    log = Log.of_checked({**fields, "file": log_file(file)})
    return log if rate is None else log.resampled(rate)


def _checked(file: Path, stamps: str, **numbers: float | None) -> dict[str, float]:
    """Those of the numbers that are given."""
    checked = {}
    for word, value in numbers.items():
        least = {"gap": 0.0, "faster": 1.0}.get(word, -np.inf)
        bound = f" of at least {least:g}" if np.isfinite(least) else ""
        mend = "give a number." if word == "faster" else "give a number of seconds."
        if value is not None:
            expected = f"{word} as a number{bound}"
            checked[word] = finite(file.name, value, partial(le, least), expected, mend)
    if stamps not in ("recorder", "header"):
        raise InputError(
            f"{file.name}: expected stamps 'recorder' or 'header', found {stamps!r}.",
            "write 'header' for the stamps in the messages' headers.",
        )
    return checked


def _numbers(file: Path, words: Sequence[str | float]) -> list[float]:
    words = (words,) if isinstance(words, str | int | float) else words
    try:
        return [float(word) for word in words]
    except (TypeError, ValueError):
        raise InputError(
            f"{file.name}: expected numbers as missing_values, found {list(words)!r}.",
            "the fields of such a log are numbers; list those that mean missing.",
        ) from None


def _unwrapped(series: Series, column: Column, channel: str, *, driving: bool) -> Series:
    """The series of a channel; an angle so that nothing is interpolated between pi and -pi."""
    values = unwrapped(series.values, column.unit or CHANNEL_UNITS.get(channel, ""))
    # where an angle was unwrapped it differs by turns, of 6.28 or 360
    jumps = int((np.abs(np.diff(values - series.values)) > 1.0).sum())
    notes = (*series.notes, f"{jumps} jumps of a full turn were removed") if jumps else series.notes
    held = driving and column.hold == "zero"
    return replace(series, values=values, notes=notes, driving=driving, held=held)


@dataclass(frozen=True)
class Resampled:
    """Channels on one time base [s], ``(n,)`` each, NaN where missing, and what was done."""

    time: np.ndarray
    values: dict[str, np.ndarray]
    notes: list[str]


def resample(
    file: str,
    series: Mapping[str, Series],
    base: str | float,
    gap: float | None,
    faster: float,
) -> Resampled:
    """Put channels on one time base; its arguments are those of `read_robot_log`.

    The log covers the time in which all inputs are known.
    """
    every = base == _MESSAGES
    step, stamps = _merged_stamps(series) if every else _step_and_stamps(file, series, base)
    for name, channel in series.items():
        if not channel.held:
            _check_rate(name, channel, step, np.inf if every else faster)
    time, note = _time_base(file, series, base, step, stamps)
    notes, out = [note], {}
    for name, channel in series.items():
        if channel.held:
            # A message at the very time of a sample counts already, in spite of rounding.
            at = np.searchsorted(channel.time, time + _SAME, side="right") - 1
            out[name], how = channel.values[at], "held between messages"
            if not every and name != base:
                how += f", so a change appears up to {step:.3g} s late (on the base 'messages', on "
                how += "time)"
            after = time[-1] - channel.time[-1]
            how += f"; held for {after:.3g} s after its last message" if after > step else ""
        elif every and not channel.driving:
            # A negative limit: no interpolation at all, only samples at their own stamps.
            out[name], _ = _interpolated(channel, time, -1.0)
            how = f"{int(np.isfinite(out[name]).sum())} samples, each at its own stamp"
        else:
            limit = 3 * channel.period if gap is None else gap
            out[name], between = _interpolated(channel, time, limit)
            missing = int(np.isnan(out[name]).sum())
            how = f"{between / time.size:.0%} of the samples are interpolated"
            how += f", {missing} are missing (gaps above {limit:.3g} s)" if missing else ""
            if channel.period < 0.75 * step:
                how += "; it is faster than the base: content above half the base's rate is aliased"
        head = f"{'input' if channel.driving else 'measured'} {name!r}: {_rate_note(channel)}"
        notes.append("; ".join([head, how, *channel.notes]) + ".")
    return Resampled(time, out, notes)


def _merged_stamps(series: Mapping[str, Series]) -> tuple[float, np.ndarray]:
    """The median step [s] and the time stamps of all messages; of held inputs only the changes."""
    stamps = []
    for channel in series.values():
        # A held input often repeats its value at 50 Hz: its repeats would only add samples without
        # any measurement.
        changed = np.append(True, np.diff(channel.values) != 0)
        stamps.append(channel.time[changed] if channel.held else channel.time)
    merged = np.sort(np.concatenate(stamps))
    merged = merged[np.append(True, np.diff(merged) > _SAME)]
    return float(np.median(np.diff(merged))) if merged.size > 1 else 0.0, merged


def _step_and_stamps(
    file: str, series: Mapping[str, Series], base: str | float
) -> tuple[float, np.ndarray | None]:
    """The step [s], and the time stamps if a channel is the base."""
    if isinstance(base, str):
        if base not in series:
            raise InputError(
                f"{file}: expected a channel as time base, one of {listing(series)}, found "
                f"{base!r}{nearest(base, series, '; ')}.",
                "name the channel whose stamps to use, write 'messages' for those of all, "
                "or give a step in seconds.",
            )
        if series[base].time.size < 2:
            problem = "expected several messages to take the stamps from, found one."
            mend = "choose another channel as base, or a step in seconds."
            raise InputError.at(series[base].place, problem, mend)
        return series[base].period, series[base].time
    expected = "a channel or a step above zero as time base"
    mend = "write base = 'speed' for the stamps of that channel, or base = 0.05 for a step."
    return finite(file, base, lambda step: step > 0, expected, mend), None


def _check_rate(name: str, channel: Series, step: float, faster: float) -> None:
    if channel.time.size < 2:
        problem = f"expected several messages for the channel {name!r}, found one."
        mend = "choose another field; an input that is set once is read with hold = 'zero'."
        raise InputError.at(channel.place, problem, mend)
    if channel.period > faster * step * (1 + 1e-9):
        raise InputError.at(
            channel.place,
            f"the time base has a step of {step:.4g} s, the channel {name!r} one of "
            f"{channel.period:.4g} s: {channel.period / step:.3g} samples of each message, "
            f"expected at most {faster:.3g}. Interpolated samples add no information.",
            f"choose base = {name!r} or a longer step, or allow it with "
            f"faster = {np.ceil(channel.period / step):.0f}.",
        )


def _time_base(
    file: str,
    series: Mapping[str, Series],
    base: str | float,
    step: float,
    stamps: np.ndarray | None,
) -> tuple[np.ndarray, str]:
    """The time base, limited to the time in which all inputs are known, and a note."""
    # Before its first message an input is unknown. After the last one a held input keeps its value;
    # an interpolated one is unknown.
    inputs = [channel for channel in series.values() if channel.driving]
    first = max((channel.time[0] for channel in inputs), default=-np.inf)
    last = min((channel.time[-1] for channel in inputs if not channel.held), default=np.inf)
    if stamps is None:
        measured = [c for c in series.values() if not c.driving] or inputs
        first = max(first, min(channel.time[0] for channel in measured))
        last = min(last, max(channel.time[-1] for channel in measured))
        # 1e-9: ten seconds of 0.1 s are 100 steps, though the quotient may be 99.999...
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
    return time, note


def _rate_note(channel: Series) -> str:
    """How often a channel is sent, its largest gap, and by how much its period varies (95 %)."""
    if channel.time.size < 2:
        return "one message"
    steps = np.diff(channel.time)
    largest = int(np.argmax(steps))
    jitter = 1e3 * float(np.quantile(np.abs(steps - channel.period), 0.95))
    return (
        f"{channel.time.size} messages at {1 / channel.period:.4g} Hz, largest gap "
        f"{steps[largest]:.3g} s at {channel.time[largest]:.6g} s, jitter {round(jitter, 3):.2g} ms"
    )


def _interpolated(channel: Series, time: np.ndarray, limit: float) -> tuple[np.ndarray, int]:
    """Linear interpolation between messages, and the number of interpolated samples."""
    after = np.clip(np.searchsorted(channel.time, time), 1, channel.time.size - 1)
    # A time stamp of the base that coincides with a message, up to rounding, is not interpolated.
    exact = (
        np.minimum(np.abs(channel.time[after] - time), np.abs(channel.time[after - 1] - time))
        <= _SAME
    )
    width = channel.time[after] - channel.time[after - 1]
    inside = (time >= channel.time[0] - _SAME) & (time <= channel.time[-1] + _SAME)
    valid = inside & (exact | (width <= limit * (1 + 1e-9)))
    values = np.where(valid, np.interp(time, channel.time, channel.values), np.nan)
    return values, int((valid & ~exact).sum())

"""Read logs of marine robots: ROS bags, ArduPilot's and PX4's logs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from operator import le
from os import PathLike
from pathlib import Path

import numpy as np

from diffthrust._support.errors import InputError, Place
from diffthrust._support.validation import finite
from diffthrust._support.visible import in_line
from diffthrust.logs._channels import CHANNELS
from diffthrust.logs._columns import Column, channel_columns, fields_of_columns
from diffthrust.logs._edits import unwrapped
from diffthrust.logs._identity import log_file
from diffthrust.logs._kinds import kind_of
from diffthrust.logs._log import Log
from diffthrust.logs._robots.fields import Series, series_in
from diffthrust.logs._robots.messages import column_place
from diffthrust.logs._robots.resample import resample
from diffthrust.logs._validate import window


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
    _check(file, stamps, gap=gap, faster=faster, start=start, stop=stop)
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
    even = resample(file.name, series, base, gap, faster)
    # Cut after resampling: a held input keeps the value that was set before `start`.
    keep, notes = window(even.time, start, stop, file.name), even.notes
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


def _check(file: Path, stamps: str, **numbers: float | None) -> None:
    for word, value in numbers.items():
        least = {"gap": 0.0, "faster": 1.0}.get(word, -np.inf)
        bound = f" of at least {least:g}" if np.isfinite(least) else ""
        mend = "give a number." if word == "faster" else "give a number of seconds."
        if value is not None:
            finite(file.name, value, partial(le, least), f"{word} as a number{bound}", mend)
    if stamps not in ("recorder", "header"):
        raise InputError(
            f"{file.name}: expected stamps 'recorder' or 'header', found {stamps!r}.",
            "write 'header' for the stamps in the messages' headers.",
        )


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
    standard = CHANNELS[channel].unit if channel in CHANNELS else ""
    values = unwrapped(series.values, column.unit or standard)
    # where an angle was unwrapped it differs by turns, of 6.28 or 360
    jumps = int((np.abs(np.diff(values - series.values)) > 1.0).sum())
    notes = (*series.notes, f"{jumps} jumps of a full turn were removed") if jumps else series.notes
    held = driving and column.hold == "zero"
    return replace(series, values=values, notes=notes, driving=driving, held=held)

"""One recorded experiment: time, inputs, measured channels and their units."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from diffthrust._support.errors import InputError, Place
from diffthrust._support.figures import showing
from diffthrust._support.names import listing, nearest
from diffthrust.logs._columns import Column
from diffthrust.logs._edits import LogEdits
from diffthrust.logs._figures import line_of, log_figure, report_of
from diffthrust.logs._held import Hold, held_note
from diffthrust.logs._identity import LogFile, LogIdentity, content_hash
from diffthrust.logs._rails import Railed, railed, railed_note
from diffthrust.logs._tables.frame import read_frame, time_of
from diffthrust.logs._tables.request import TableRequest
from diffthrust.logs._units import convert, convert_scale
from diffthrust.logs._validate import checked_fields, place_in_log
from diffthrust.logs._written import ShownUnits, Written

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False, init=False, repr=False)
class Log(LogEdits):
    """One recorded experiment. All arrays are read-only.

    Args:
        time: time stamps, shape (n,), strictly increasing; the step need not be uniform.
        inputs: what drove the system, each of shape (n,).
        measured: what sensors reported, each of shape (n,); NaN where a sample is missing.
        units: unit of each channel as given, and of ``"time"`` (seconds where not named). Without
            a unit the numbers are taken to be in the model's unit.
        unsigned: measured channels whose sensor reports the absolute value.
        noise: known standard deviations of measured channels, in the unit of the channel as given.
        hold: between samples an input keeps its last value (``"zero"``) or runs straight to the
            next (``"linear"``); one word for all inputs, or a mapping by input.
        name: a name for messages and figures.
        interpolate_inputs: fill missing samples of inputs instead of refusing them.
        notes: sentences to keep with the log.
        written: how channels were written, where ``units`` does not say it: an effort that was
            ``PWM(stop=1500, full=1900).effort(widths)`` by ``Written("us", pwm=PWM(1500, 1900))``.
        rails: where the range of a sensor ends, ``(low, high)`` by measured channel, in the unit of
            the channel as given: samples there carry no weight. Rails of channels not named are
            detected; ``(-inf, inf)`` says that a channel has none.
        censored: measured channels whose samples at a rail count as "at least" or "at most" it
            in fits of the simulation error with white Gaussian noise, instead of being ignored.
        static: the rows are points of a table that were not recorded in time: ``time`` counts them,
            or holds each for a while, so that a diagnosis tries no effect that takes time.

    Attributes:
        time: time stamps [s], shape (n,).
        inputs: in SI, whatever the file has; ``log.values(name, in_units=True)`` is as written.
        measured: in SI as well.
        units: unit in which the stored numbers are (SI); empty where the user gave none.
        hold: ``"zero"`` or ``"linear"`` for each input.
        written: for each channel the unit in which the user wrote it, and the conversion back;
            tables and figures use these units.
        notes: one sentence for whatever was dropped, trimmed, missing or interpolated.
        file: the file it was read from, with its hash; ``None`` for a log made from arrays.
        left_out: first and last time stamp [s] of each stretch that `leave_out` left out.

    Raises:
        InputError: lengths differ, time does not increase, an input is missing a sample, a number
            is infinite, a measured channel is empty, or a unit, channel or hold is unknown.

    Example:
        >>> record = dft.Log(
        ...     time=[0, 40, 80],
        ...     inputs={"command": [0.0, 2.0, 2.0]},
        ...     measured={"speed": [0.0, 60.0, float("nan")]},
        ...     units={"time": "ms", "command": "V", "speed": "rpm"},
        ...     unsigned=("speed",),
        ... )
        >>> record.units["speed"], record.duration, record.time.shape
        ('rad/s', 0.08, (3,))
    """

    file: LogFile | None = field(default=None, init=False)
    left_out: tuple[tuple[float, float], ...] = field(default=(), init=False)

    def __init__(
        self,
        time: Any,
        inputs: Mapping[str, Any] | None = None,
        measured: Mapping[str, Any] | None = None,
        units: Mapping[str, str] | None = None,
        unsigned: Collection[str] = (),
        noise: Mapping[str, float] | None = None,
        hold: str | Mapping[str, str] = "zero",
        name: str = "log",
        interpolate_inputs: bool = False,
        notes: Iterable[str] = (),
        written: Mapping[str, Written] | None = None,
        rails: Mapping[str, Sequence[float]] | None = None,
        censored: Collection[str] = (),
        static: bool = False,
    ) -> None:
        checked = checked_fields(
            time=time,
            inputs={} if inputs is None else inputs,
            measured={} if measured is None else measured,
            units={} if units is None else units,
            unsigned=unsigned,
            noise={} if noise is None else noise,
            hold=hold,
            name=str(name),
            interpolate_inputs=interpolate_inputs,
            notes=tuple(notes),
            written=written or {},
            rails=rails or {},
            censored=censored,
            static=static,
            at=partial(place_in_log, name),
        )
        self._set(checked)

    @classmethod
    def from_dataframe(
        cls,
        frame: Any,
        *,
        time: str | Column | float | None = None,
        inputs: Mapping[str, str | Column] | None = None,
        measured: Mapping[str, str | Column] | None = None,
        missing_values: Sequence[str | float] = (),
        interpolate_inputs: bool = False,
        start: float | None = None,
        stop: float | None = None,
        name: str = "log",
        static: bool = False,
    ) -> "Log":
        """Make a log from a pandas DataFrame.

        Args:
            frame: a DataFrame, one sample a row.
            time: the time column, or the name of the index; None for the index, which may hold
                dates (with or without a time zone), durations or seconds. A number is the step [s]
                of samples without time stamps.
            inputs: the column of each input, by channel name.
            measured: the column of each measured channel, by channel name.
            missing_values: texts or numbers that mean missing.
            interpolate_inputs: fill missing samples of inputs instead of refusing them.
            start: first moment to keep, in seconds after the first.
            stop: last moment to keep, in seconds after the first.
            name: a name for messages and figures.
            static: the rows are points of a table that were not recorded in time.

        Raises:
            InputError: as in `read_log`; or the index only counts rows.

        Example:
            >>> import pandas as pd
            >>> frame = pd.DataFrame({"t": [0.0, 0.1], "u": [0.0, 2.0], "rpm": [0.0, 60.0]})
            >>> record = dft.Log.from_dataframe(
            ...     frame,
            ...     time="t",
            ...     inputs={"command": "u"},
            ...     measured={"speed": dft.Column("rpm", unit="rpm")},
            ... )
            >>> record.measured["speed"].round(3)
            array([0.   , 6.283])
        """
        source = read_frame(frame, name)
        clock = time_of(frame, source) if time is None else time
        request = TableRequest(
            name, clock, inputs, measured, missing_values, interpolate_inputs, start, stop, static
        )
        return cls.of_checked(request.fields(source, name))

    @classmethod
    def of_checked(cls, fields: Mapping[str, Any]) -> "Log":
        """Make a log from fields that are already checked and in the library's units.

        Example:
            >>> fields = {name: value for name, value in vars(log).items() if name != "file"}
            >>> dft.Log.of_checked(fields).name
            'run1.csv'
        """
        log = object.__new__(cls)
        log._set(fields)
        return log

    def replaced(self, **fields: Any) -> "Log":
        """Copy the log with some fields replaced, unchecked; `dataclasses.replace` checks them.

        ``units`` may name only some channels; the remaining channels keep their units.

        Raises:
            InputError: a channel without a unit, such as one under a new name.

        Example:
            >>> log.replaced(name="another.csv").name
            'another.csv'
        """
        kept = {key: getattr(self, key) for key in self.__dataclass_fields__}
        units = {**self.units, **fields.get("units", {})}
        for name in {**fields.get("inputs", {}), **fields.get("measured", {})}:
            if name not in units:
                raise InputError(
                    f"{self.name}: expected the channels {listing(self.units)}, found {name!r}.",
                    f"Give its unit: units={{'{name}': ...}}.",
                )
        return Log.of_checked({**kept, **fields, "units": units})

    def __reduce__(self) -> tuple[Any, ...]:
        # Worker processes receive logs pickled, and a MappingProxyType cannot be pickled.
        fields = {key: getattr(self, key) for key in self.__dataclass_fields__}
        plain = {k: dict(v) if isinstance(v, Mapping) else v for k, v in fields.items()}
        return Log.of_checked, (plain,)

    @property
    def duration(self) -> float:
        """Time from the first to the last sample [s].

        Example:
            >>> round(log.duration, 2)
            11.95
        """
        return float(self.time[-1] - self.time[0])

    @cached_property
    def step(self) -> float:
        """Median time between samples [s]; NaN for a single sample.

        Example:
            >>> round(log.step, 3)
            0.05
        """
        return float(np.median(np.diff(self.time))) if len(self) > 1 else float("nan")

    @cached_property
    def even(self) -> bool:
        """Whether samples are equally spaced, up to rounding of the time stamps.

        Example:
            >>> log.even
            True
        """
        steps = np.diff(self.time)
        # Time stamps such as 0.1 k are rounded: exactly equal differences occur only by luck.
        return bool(steps.size) and float(np.ptp(steps)) <= 1e-6 * self.step

    @cached_property
    def holds(self) -> Mapping[str, Hold]:
        """How sensors that repeat their last reading are read, by measured channel.

        Usually empty. Commands are held by nature: inputs are never among them.

        Example:
            >>> log.holds
            {}
        """
        return {name: hold for name in self.measured if (hold := self._hold_of(name))}

    @cached_property
    def unrepeated(self) -> "Log":
        """The log with repeats of held sensors marked missing; the log itself if there are none.

        A sensor read at every tenth sample and held in between gives one reading, not ten.
        Counted as ten, its one-step errors would be almost zero and any model would look
        adequate. A note records what was done.

        Example:
            >>> log.unrepeated.measured["speed"].shape
            (240,)
        """
        if not self.holds:
            return self
        readings = {n: np.where(h.read, self.measured[n], np.nan) for n, h in self.holds.items()}
        notes = [held_note(name, hold, self.time) for name, hold in self.holds.items()]
        return self.replaced(measured={**self.measured, **readings}, notes=(*self.notes, *notes))

    @cached_property
    def railed(self) -> Mapping[str, Railed]:
        """Samples at the ends of a sensor's range, by measured channel; usually empty.

        Rails are given by the log, or detected from its values.

        Example:
            >>> log.railed
            {}
        """
        by_channel, drives = {}, self.inputs.values()
        for channel, values in self.unrepeated.measured.items():
            others = [v for name, v in self.measured.items() if name != channel]
            by_channel[channel] = railed(values, self.rails.get(channel), drives, others)
        return {channel: at for channel, at in by_channel.items() if at is not None}

    @cached_property
    def counted(self) -> "Log":
        """The log without repeats of held sensors and without samples at a rail.

        A sensor at the end of its range reports "at least", not "exactly". Fits, comparisons and
        diagnoses use this log, in which such samples are missing; a note names each channel.

        Example:
            >>> log.counted is log  # no sample lies at a rail of its sensor
            True
        """
        log, ends = self.unrepeated, self.railed
        if not ends:
            return log
        measured, notes, display = dict(log.measured), [*log.notes], ShownUnits([self.written])
        for channel, at in ends.items():
            measured[channel] = np.where(at.side == 0, measured[channel], np.nan)
            about = (display, self.units[channel], channel in self.censored)
            notes.append(railed_note(channel, at, *about))
        # Without its rails a channel has a new largest value, which would be detected in turn.
        rails = {**self.rails, **dict.fromkeys(ends, (-np.inf, np.inf))}
        return self.replaced(measured=measured, rails=rails, notes=tuple(notes))

    @cached_property
    def sha256(self) -> str:
        """Hash of the content: time, and channels in the library's units, to the last bit.

        Equal for logs with the same content, whatever their name and file.

        Example:
            >>> len(log.sha256)
            64
        """
        return content_hash(self)

    @property
    def identity(self) -> LogIdentity:
        """What identifies the log: name, length, hash, and the file it came from.

        Example:
            >>> log.identity.name, log.identity.samples
            ('run1.csv', 240)
        """
        return LogIdentity(self.name, len(self), self.duration, self.sha256, self.file)

    def values(self, channel: str, unit: str = "", *, in_units: bool = False) -> np.ndarray:
        """Samples of a channel in the unit that a model needs, or in that of the log's file.

        Args:
            channel: name of an input or a measured channel.
            unit: the unit wanted. Where the log or the caller names none, the stored numbers are
                returned unchanged, which are in SI, and an effort of 1 at the full command.
            in_units: as the log was written, instead: in rpm, kgf, or as widths of pulses.

        Returns:
            Samples in ``unit``, float64, shape (n,).

        Raises:
            InputError: the log has no such channel, or its unit measures another quantity.

        Example:
            >>> log.values("speed", "rpm").shape
            (240,)
            >>> rpm = dft.Log([0, 1, 2], {}, {"speed": [0.0, 60.0, 90.0]}, units={"speed": "rpm"})
            >>> rpm.measured["speed"].round(1), rpm.values("speed", in_units=True)
            (array([0. , 6.3, 9.4]), array([ 0., 60., 90.]))
        """
        samples, stored = self._samples(channel), self.units[channel]
        if in_units:
            return ShownUnits([self.written]).values(channel, samples, stored)
        if not stored or not unit or stored == unit:
            return samples
        return convert(samples, stored, unit, where=place_in_log(self.name, channel))

    def noise_in(self, channel: str, unit: str) -> float | None:
        """The known standard deviation of a measured channel.

        Args:
            channel: name of a measured channel.
            unit: the unit wanted, as in ``values``.

        Returns:
            The standard deviation in ``unit``, or None where it is not known.

        Raises:
            InputError: the log has no such channel, or its unit measures another quantity.

        Example:
            >>> log.noise_in("speed", "rpm") is None  # the log names no noise
            True
        """
        self._samples(channel)  # raises if there are none
        sigma, stored = self.noise.get(channel), self.units[channel]
        if sigma is None or not stored or not unit or stored == unit:
            return sigma
        return convert_scale(sigma, stored, unit, where=place_in_log(self.name, channel))

    @showing
    def plot(self) -> "Figure":
        """Plot all channels over time, stacked: inputs on top, gaps in time shaded.

        Of a held channel only the readings are drawn, as dots.

        Returns:
            The figure; its time axis starts at the first sample, as ``start`` and ``stop`` do.

        Example:
            >>> log.plot().savefig("run1.png")
        """
        return log_figure(self, self.unrepeated.measured)

    def __repr__(self) -> str:
        return line_of(self, self.duration, self.holds)

    def _repr_html_(self) -> str:
        from diffthrust._support.page import notebook_html

        return notebook_html(report_of(self, self.duration, self.step))

    def _samples(self, channel: str) -> np.ndarray:
        channels = {**self.inputs, **self.measured}
        if channel not in channels:
            problem = f"expected a channel {channel!r}, found {listing(channels)}"
            problem += f"{nearest(str(channel), channels, '; ')}."
            place = Place(f"log {self.name!r}", channel=channel)
            raise InputError.at(place, problem, f"map a column of the log to {channel!r}.")
        return channels[channel]

"""A doubt about a channel of a log."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from diffthrust._support.errors import InputError
from diffthrust._support.words import number
from diffthrust.logs._log import Log

DOUBT_KINDS = (
    *("sign", "exchanged", "frame", "unit", "time_base", "lag", "stuck", "saturated", "sentinel"),
    *("outliers", "gap", "odd_log", "silent", "runaway"),
)
"""What may be wrong with a channel, the graver mistakes first; "runaway" is of a parameter."""
_LONGEST_STAMP = 1e5
"""Display: of stamps of a clock that counts since 1970 the first four digits say nothing: an
Otter's compass stood still "from t = 1.714e+09 s on"."""


@dataclass(frozen=True)
class Reading:
    """How channels are read where one mistake is undone.

    Args:
        words: what is done, such as "left_force and right_force exchanged".
        line: what to write in a spec file and in Python.
        sources: for each channel that changes (or ``"time"``), the channel that its numbers come
            from, and what they are multiplied by.

    Example:
        >>> turned = dft.soundness.Reading("turned", "scale = -1", {"thrust": ("thrust", -1)})
        >>> bool((turned.log(log).measured["thrust"] == -log.measured["thrust"]).all())
        True
    """

    words: str
    line: str
    sources: Mapping[str, tuple[str, float]] = field(default_factory=dict)

    def log(self, log: Log) -> Log:
        """A log as it would be without the mistake; itself where it lacks a channel of it."""
        values = {"time": log.time, **log.inputs, **log.measured}
        if not {source for source, _ in self.sources.values()} <= set(values):
            return log
        new = {name: factor * values[source] for name, (source, factor) in self.sources.items()}
        # the ends of a range and the noise of a sensor go with its numbers
        origins = {name: self.sources.get(name, (name, 1.0)) for name in values}
        return log.replaced(
            time=new.get("time", log.time),
            inputs={name: new.get(name, x) for name, x in log.inputs.items()},
            measured={name: new.get(name, x) for name, x in log.measured.items()},
            rails={
                name: tuple(sorted(factor * end for end in log.rails[source]))
                for name, (source, factor) in origins.items()
                if source in log.rails
            },
            noise={
                name: abs(factor) * log.noise[source]
                for name, (source, factor) in origins.items()
                if source in log.noise
            },
        )


@dataclass(frozen=True)
class Doubt:
    """Something in a log that is probably not what its name, unit or clock says.

    Args:
        channel: the channel that is doubted, or ``"time"``; of a fit also a parameter.
        kind: one of ``sign``, ``exchanged``, ``unit``, ``time_base``, ``lag``, ``stuck``,
            ``saturated``, ``sentinel``, ``outliers``, ``gap``, ``odd_log``, ``silent``,
            ``runaway``.
        evidence: what was seen, with its figures; names the log.
        mend: a line to copy, or what to look at.
        readings: how channels are read where the mistake is undone, the likeliest first; several
            where these logs cannot tell which it was, none where no other reading undoes it.
        logs: names of the logs that it concerns; empty for all of them.
        also: other channels of which the same is true.

    Example:
        >>> reversed_sign = dft.Log(
        ...     log.time, log.inputs, {**log.measured, "thrust": -log.measured["thrust"]}
        ... )
        >>> doubt = dft.soundness.doubts(reversed_sign, dft.Thruster())[0]
        >>> doubt.channel, doubt.kind, doubt.contrary, doubt.harmless, list(doubt.to_json())
        ('thrust', 'sign', True, False, ['channel', 'kind', 'evidence', 'mend'])
        >>> (mended,) = doubt.mended([reversed_sign])
        >>> bool((mended.measured["thrust"] == log.measured["thrust"]).all())
        True
    """

    channel: str
    kind: str
    evidence: str
    mend: str
    readings: tuple[Reading, ...] = ()
    logs: tuple[str, ...] = ()
    also: tuple[str, ...] = ()

    @property
    def contrary(self) -> bool:
        """Whether the channel moves against the others: its sign is doubted, or its column."""
        return self.kind in ("sign", "exchanged")

    @property
    def harmless(self) -> bool:
        """Whether fits allow for it already, so that nothing is to be mended."""
        return self.mend.startswith("none is needed")

    def mended(self, logs: Iterable[Log], reading: int = 0) -> tuple[Log, ...]:
        """The logs as they would be without the mistake.

        Args:
            logs: of the call that raised the doubt; those that it does not concern stay.
            reading: which of ``readings``.

        Raises:
            InputError: the doubt has no such reading.
        """
        if not 0 <= reading < len(self.readings):
            raise InputError(
                f"This doubt on {self.channel} has {len(self.readings)} readings that undo it, "
                f"found number {reading}.",
                f"Look at its mend: {self.mend}",
            )
        return tuple(
            self.readings[reading].log(log) if not self.logs or log.name in self.logs else log
            for log in logs
        )

    def __str__(self) -> str:
        return f"{self.channel} ({self.kind}): {self.evidence} Mend: {self.mend}"

    def to_json(self) -> dict[str, str]:
        """Plain data."""
        return {name: getattr(self, name) for name in ("channel", "kind", "evidence", "mend")}


def moment(log: Log, time: float) -> str:
    """A time stamp in words; since the log's start where four digits do not show it."""
    if abs(time) < _LONGEST_STAMP:
        return f"t = {number(time)} s"
    return f"{number(time - float(log.time[0]))} s after its start"

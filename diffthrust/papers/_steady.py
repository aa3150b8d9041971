"""The steady portions of records: where the inputs have been held long enough."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust._support.results import Brief
from diffthrust._support.validation import finite
from diffthrust.estimation._arguments import listed
from diffthrust.logs._log import Log


@dataclass(frozen=True, repr=False)
class Steady(Brief):
    """One portion of a record over which the inputs were held.

    Args:
        log: the record.
        first: its first sample, after what the inputs changed had settled.
        end: the sample behind its last one.

    Example:
        >>> part = dft.papers.steady_portions(held, settle=3.0)[0]
        >>> round(part.start, 2), round(part.stop, 2), round(part.mean("speed", "rad/s"), 1)
        (3.0, 5.95, 33.7)
        >>> part.std_error("speed", "rad/s") < 0.1, abs(part.drift("speed", "rad/s")) < 0.1
        (True, True)
    """

    log: Log = field(repr=False)
    first: int
    end: int

    @property
    def start(self) -> float:
        """When it begins [s]."""
        return float(self.log.time[self.first])

    @property
    def stop(self) -> float:
        """Its last sample [s]."""
        return float(self.log.time[self.end - 1])

    def mean(self, channel: str, unit: str) -> float:
        """The mean of a channel, in ``unit``; NaN where nothing was measured."""
        values = self.log.values(channel, unit)[self.first : self.end]
        return float(np.nanmean(values)) if np.isfinite(values).any() else float("nan")

    def std_error(self, channel: str, unit: str) -> float:
        """Standard error of the mean under white noise; NaN where fewer than two were measured."""
        values = self.log.values(channel, unit)[self.first : self.end]
        finite = values[np.isfinite(values)]
        if finite.size < 2:
            return float("nan")
        return float(np.std(finite, ddof=1) / np.sqrt(finite.size))

    def drift(self, channel: str, unit: str) -> float:
        """What a channel changed by over the portion, by the line through its samples.

        NaN where fewer than three samples were measured.
        """
        portion = slice(self.first, self.end)
        time, values = self.log.time[portion], self.log.values(channel, unit)[portion]
        finite = np.isfinite(values)
        if finite.sum() < 3:
            return float("nan")
        slope = np.polyfit(time[finite] - time[0], values[finite], 1)[0]
        return float(slope * (time[-1] - time[0]))


def steady_portions(
    logs: Log | Sequence[Log],
    *,
    settle: float,
    least: float = 0.0,
    inputs: Iterable[str] | None = None,
    tolerance: float = 1e-3,
) -> list[Steady]:
    """Where the inputs stay where they are, from ``settle`` seconds after they last moved.

    Args:
        logs: one record or several.
        settle: how long what is measured needs to come to rest [s].
        least: how long a portion must last at least, after that [s].
        inputs: which inputs have to be held; all of a record's where not given.
        tolerance: an input counts as held while it moves by less than this share of the range it
            has in all records.

    Returns:
        The portions in the order of the records.

    Raises:
        InputError: no record, one without such an input, no portion anywhere, a time that is
            negative.

    Example:
        >>> for part in dft.papers.steady_portions(held, settle=3.0):
        ...     print(part.mean("command", "V"), round(part.mean("speed", "rad/s"), 1))
        1.0 33.7
        2.0 47.6
    """
    logs = records("steady_portions", logs)
    for name, value in (("settle", settle), ("least", least)):
        finite(f"steady_portions, {name}", value, lambda x: x >= 0, "seconds, zero or more")
    names = list(inputs) if inputs is not None else sorted({n for g in logs for n in g.inputs})
    for log in logs:
        absent = [name for name in names if name not in log.inputs]
        if absent:
            raise InputError(
                f"{log.name}: expected the input {listing(absent)}, found {listing(log.inputs)}.",
                "Name the inputs that all records have: inputs=[...].",
            )
    allowed = {
        name: tolerance * max(1e-300, float(np.ptp(np.concatenate([g.inputs[name] for g in logs]))))
        for name in names
    }
    portions = []
    for log in logs:
        edges = _edges([log.inputs[name] for name in names], [allowed[name] for name in names])
        for begin, end in pairwise(edges):
            # a sample exactly ``settle`` after the step counts, whatever the rounding of the clock
            first = int(np.searchsorted(log.time, log.time[begin] + settle - 1e-9))
            if end - first >= 2 and log.time[end - 1] - log.time[first] >= least - 1e-9:
                portions.append(Steady(log, first, end))
    if not portions:
        raise InputError(
            f"steady_portions: no stretch over which {listing(names)} were held for "
            f"{settle + least:g} s.",
            "Hold each level longer, or lower settle.",
        )
    return portions


def _edges(series: list[np.ndarray], allowed: list[float]) -> list[int]:
    """Where a held stretch begins, and the end: every sample is compared with the stretch's first.

    Compared with the sample before, a slow ramp would count as held.
    """
    samples = series[0].size
    edges = [0]
    for k in range(1, samples):
        begin = edges[-1]
        if any(abs(u[k] - u[begin]) > a for u, a in zip(series, allowed, strict=True)):
            edges.append(k)
    return [*edges, samples]


def records(what: str, logs: Any) -> tuple[Log, ...]:
    """One record or several as a tuple; ``what`` names the method that finds none."""
    several = listed(logs)
    if not several:
        raise InputError(f"{what}: no record was given.", "Give one log or a list of them.")
    return several


def true_stretches(good: np.ndarray) -> list[tuple[int, int]]:
    """First and last index of each run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], good.astype(int), [0]])))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]

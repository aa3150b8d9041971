"""A test plan: inputs over time for each run, as files, and a check of recorded logs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from diffthrust._support.envelope import stretches
from diffthrust._support.errors import InputError
from diffthrust._support.files import made_folder, write_whole
from diffthrust._support.names import listing
from diffthrust._support.report import Report, Rows, Section
from diffthrust._support.results import Brief, Result
from diffthrust.logs._log import Log

_NEAR = 0.02
"""A level is met by a held stretch within this share of the range of the plan."""
_PARTS = 8
"""Parts of the band, evenly spaced in the logarithm of frequency."""
_ENOUGH = 0.1
"""Share of the planned power in a part; a tenth is a third of the amplitude."""


class Level(NamedTuple):
    """A stretch of a run over which the inputs must be held.

    Args:
        run: its name.
        start: when it begins [s].
        stop: when it ends [s].
        inputs: planned values, in the model's units.

    Example:
        >>> plan = dft.plans.static_test(dft.Thruster(), limits=(0, 5), levels=2, hold=1.0)
        >>> plan.levels[0].inputs
        {'command': 2.5}
    """

    run: str
    start: float
    stop: float
    inputs: dict[str, float]


class Finding(NamedTuple):
    """The outcome of a check for one level, or for one input of a moving run.

    Args:
        run: its name.
        what: the level, or the input.
        found: in words.
        good: whether it is as planned.

    Example:
        >>> plan = dft.plans.static_test(dft.Thruster(), limits=(0, 5), levels=2, hold=1.0)
        >>> finding = plan.check(held).findings[0]
        >>> finding.run, finding.good
        ('static_test', False)
    """

    run: str
    what: str
    found: str
    good: bool


@dataclass(frozen=True, repr=False)
class PlanCheck(Result):
    """A plan compared with recorded logs.

    Args:
        findings: by run and level, in the order of the plan.

    Example:
        >>> plan = dft.plans.static_test(dft.Thruster(), limits=(0, 5), levels=2, hold=1.0)
        >>> checked = plan.check(held)
        >>> checked.good, len(checked.missing)
        (False, 3)
    """

    findings: tuple[Finding, ...]

    @property
    def good(self) -> bool:
        """Whether everything was run as planned."""
        return all(finding.good for finding in self.findings)

    @property
    def missing(self) -> tuple[Finding, ...]:
        """The findings that are not as planned: still to be run."""
        return tuple(finding for finding in self.findings if not finding.good)

    def _report(self) -> Report:
        rows = [(f.run, f.what, f.found, "ok" if f.good else "!") for f in self.findings]
        headings = ("Run", "Planned", "Found", "")
        return Report(Section("", Rows.of(headings, rows), f"{self._line()}."))

    def _line(self) -> str:
        return f"{sum(f.good for f in self.findings)} of {len(self.findings)} as planned"


@dataclass(frozen=True, repr=False)
class Plan(Brief):
    """The runs of a test: one series of inputs each.

    Args:
        name: of the test.
        source: the paper and its section.
        runs: name to a log with inputs and no measurements.
        settle: settling time of the slowest response, by the model [s].
        measure: the channels that the method needs.
        note: advice for the test.
        band: lowest and highest frequency that runs without levels must excite [Hz].

    Example:
        >>> plan = dft.plans.static_test(dft.Thruster(), limits=(0, 5), levels=2, hold=1.0)
        >>> plan.duration > 2.0, len(plan.levels)
        (True, 3)
        >>> [path.name for path in plan.save("plans")]
        ['static_test.csv']
    """

    name: str
    source: str
    runs: Mapping[str, Log]
    settle: float
    measure: tuple[str, ...]
    note: str = field(default="", repr=False)
    band: tuple[float, float] | None = None

    @property
    def duration(self) -> float:
        """Total duration of all runs [s]."""
        return sum(run.duration for run in self.runs.values())

    @property
    def _units(self) -> Mapping[str, str]:
        return next(iter(self.runs.values())).units

    @property
    def levels(self) -> tuple[Level, ...]:
        """The stretches over which inputs are held for longer than the settling time."""
        return tuple(
            level for name, run in self.runs.items() for level in _levels(name, run, self.settle)
        )

    def save(self, folder: str | Path) -> list[Path]:
        """Write one CSV for each run: time [s] and inputs, with their units in the header.

        Each file is written whole or not at all.

        Returns:
            The files.

        Raises:
            InputError: the folder cannot be made or written to.
        """
        target = made_folder(Path(folder), "Name another one.")
        written = []
        for name, run in self.runs.items():
            header = ["time [s]", *(f"{n} [{run.units.get(n, '')}]" for n in run.inputs)]
            rows = np.column_stack([run.time, *run.inputs.values()])
            lines = [",".join(header), *(",".join(f"{x:.10g}" for x in row) for row in rows)]
            written.append(target / f"{name}.csv")
            write_whole(written[-1], ("\n".join(lines) + "\n").encode())
        return written

    def check(self, logs: Log | Sequence[Log]) -> PlanCheck:
        """Compare the plan with recorded logs, in any order and cut in any way.

        A level counts as run where its inputs were held for at least ``settle`` seconds while the
        channels that the method needs were measured; a level that is planned twice must be held
        twice, or for twice the time. A run without levels counts where a log moves each input over
        nine tenths of its planned range, and excites the plan's band.

        Raises:
            InputError: a log without an input of the plan.

        Example:
            >>> plan = dft.plans.static_test(dft.Thruster(), limits=(0, 5), levels=2, hold=1.0)
            >>> plan.check(held).good
            False
        """
        logs = [logs] if isinstance(logs, Log) else list(logs)
        for log in logs:
            absent = [n for run in self.runs.values() for n in run.inputs if n not in log.inputs]
            if absent:
                raise InputError(
                    f"{log.name}: expected the input {listing(dict.fromkeys(absent))} of the plan "
                    f"'{self.name}', found {listing(log.inputs)}.",
                    "Map a column to it.",
                )
        return PlanCheck(tuple(self._findings(logs)))

    def _findings(self, logs: Sequence[Log]) -> Iterator[Finding]:
        # Each recorded stretch may serve one planned level only, so that a level that is planned
        # twice must be run twice.
        stays: dict[tuple[tuple[str, float], ...], Iterator[_Held]] = {}
        for name, run in self.runs.items():
            levels = _levels(name, run, self.settle)
            for level in levels:
                key = tuple(sorted(level.inputs.items()))
                if key not in stays:
                    stays[key] = iter(self._held(level, logs))
                yield self._level(level, next(stays[key], None), logs)
            if not levels:
                for channel, values in run.inputs.items():
                    unit = run.units.get(channel, "")
                    yield _moved(name, channel, values, unit, logs)
                    if self.band:
                        yield _excites(name, channel, unit, run, logs, self.band)

    def _held(self, level: Level, logs: Sequence[Log]) -> list[_Held]:
        """The stretches that held a level, the longest first; one of double length counts twice."""
        units = self._units
        spans = {n: max(np.ptp(np.concatenate([r.inputs[n] for r in self.runs.values()])), 1e-12)
                 for n in level.inputs}  # fmt: skip
        stays = []
        for log in logs:
            held = np.all(
                [np.abs(log.values(n, units.get(n, "")) - x) <= _NEAR * spans[n]
                 for n, x in level.inputs.items()], axis=0
            )  # fmt: skip
            for begin, end in stretches(held):
                lasted = float(log.time[end - 1] - log.time[begin])
                portion = slice(begin, end)
                absent = tuple(n for n in self.measure if n not in log.measured
                               or not np.isfinite(log.measured[n][portion]).any())  # fmt: skip
                # 0.05: a sample less than the planned time, as logs have it, still counts.
                times = max(1, int(lasted / (level.stop - level.start) + 0.05))
                stays += times * [_Held(lasted / times, absent)]
        return sorted(stays, key=lambda held: -held.lasted)

    def _level(self, level: Level, held: _Held | None, logs: Sequence[Log]) -> Finding:
        units = self._units
        planned = (f"{n} = {x:.4g} {units.get(n, '')}".rstrip() for n, x in level.inputs.items())
        good = False
        if held is None or held.lasted == 0.0:
            outcome = _not_run(level, units, logs)
        elif held.lasted < self.settle:
            outcome = f"held for {held.lasted:.3g} s; it takes {self.settle:.3g} s to settle"
        elif held.absent:
            outcome = f"{listing(held.absent)} not measured"
        else:
            good = True
            rested = held.lasted - self.settle
            outcome = f"held for {held.lasted:.3g} s, at rest for {rested:.3g} s"
        return Finding(level.run, ", ".join(planned), outcome, good)


class _Held(NamedTuple):
    """How long a level was held, and which channels were not measured meanwhile."""

    lasted: float
    absent: tuple[str, ...]


def _not_run(level: Level, units: Mapping[str, str], logs: Sequence[Log]) -> str:
    """The words "not run", with the recorded range of an input where the level lies outside it."""
    for name, wanted in level.inputs.items() if logs else ():
        unit = units.get(name, "")
        values = np.concatenate([log.values(name, unit) for log in logs])
        low, high = values.min(), values.max()
        if not low <= wanted <= high:
            return f"not run: {name} from {low:.3g} to {high:.3g} {unit}".rstrip()
    return "not run"


def _levels(name: str, run: Log, settle: float) -> list[Level]:
    moved = np.any([np.diff(values) != 0 for values in run.inputs.values()], axis=0)
    edges = [0, *(np.flatnonzero(moved) + 1), len(run) - 1]
    t = run.time
    return [
        Level(name, float(t[a]), float(t[b]), {n: float(v[a]) for n, v in run.inputs.items()})
        for a, b in pairwise(edges)
        if t[b] - t[a] >= settle
    ]


def _moved(name: str, channel: str, wanted: np.ndarray, unit: str, logs: Sequence[Log]) -> Finding:
    low, high = float(wanted.min()), float(wanted.max())
    words = f"{channel} from {low:.3g} to {high:.3g} {unit}".rstrip()
    recorded = (log.values(channel, unit) for log in logs)
    reached = [(float(v.min()), float(v.max())) for v in recorded]
    span = [min(b, high) - max(a, low) for a, b in reached]
    if not span or max(span) <= 0:
        return Finding(name, words, "not run", False)
    a, b = reached[int(np.argmax(span))]
    widest = f"from {a:.3g} to {b:.3g} {unit}".rstrip()
    return Finding(name, words, widest, max(span) >= 0.9 * (high - low))


def _excites(
    name: str, channel: str, unit: str, run: Log, logs: Sequence[Log], band: tuple[float, float]
) -> Finding:
    """The widest part of a band [Hz] in which a log's input has enough of the planned power."""
    words = f"{channel}, {band[0]:.3g} to {band[1]:.3g} Hz"
    edges = np.geomspace(*band, _PARTS + 1)
    least = _ENOUGH * _power(run, channel, unit, edges)
    parts = [part for log in logs for part in stretches(_power(log, channel, unit, edges) >= least)]
    if not parts:
        return Finding(name, words, "not excited", False)
    low, high = (float(edges[end]) for end in max(parts, key=np.ptp))
    # A part in a thousand: the ends are computed by powers of a ratio and may be off by rounding.
    covers = low <= 1.001 * band[0] and high >= 0.999 * band[1]
    return Finding(name, words, f"excited from {low:.3g} to {high:.3g} Hz", covers)


def _power(log: Log, channel: str, unit: str, edges: np.ndarray) -> np.ndarray:
    """Mean square of a channel between frequencies; zero where the samples do not reach."""
    values, steps = log.values(channel, unit), np.diff(log.time)
    step = float(np.median(steps))
    # The transform needs even steps: the input is held between samples, as the plan means it.
    even = np.arange(log.time[0], log.time[-1] + 0.5 * step, step)
    held = values[np.clip(np.searchsorted(log.time, even + 1e-9, side="right") - 1, 0, None)]
    lines = np.abs(np.fft.rfft(held - held.mean())) ** 2 / held.size**2
    total = np.concatenate([[0.0], np.cumsum(lines)])
    frequency = np.fft.rfftfreq(held.size, step)
    ends = np.searchsorted(frequency, edges * (1.0 + 1e-9))
    return np.diff(total[ends])

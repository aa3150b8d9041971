"""What a set of a user's logs is made of: tables, the truth, and the plant's integration."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from reference import whole_runs as wr

import diffthrust as dft

Array = np.ndarray


@dataclass(frozen=True)
class Hidden:
    """Something that the plant has and the model lacks.

    Attributes:
        what: in words, for the report.
        names: effects of the catalogue that name it; empty where none does.
        ports: where a law or a remaining structure may rightly be placed.
        signals: regular expressions; one must match the signal on which it is said to depend.
        parameters: true numbers, by the effect's parameter.
        required: whether a diagnosis must name it; else it may.
    """

    what: str
    names: frozenset[str] = frozenset()
    ports: frozenset[str] = frozenset()
    signals: tuple[str, ...] = ()
    parameters: Mapping[str, float] = field(default_factory=dict)
    required: bool = True


@dataclass(frozen=True)
class UserSet:
    """Logs, the model as the user would write it, and the truth.

    Attributes:
        files: the logs as CSV files, by name.
        says: regular expressions, each of which the summary, the notes or the doubts must match.
        never: regular expressions that none of them may match.
        within: parameters of the model with their true values and the relative error allowed.
        systems: the equations as given and with all that is hidden, for a plain least squares.
        truth: the true values of the second of these systems, in its own units.
        noise: standard deviation of each channel's sensor, in the units of `runs`.
        starts: the true states at which the logs begin, training logs first.
        close: the unseen error with what was found may be so many times that of the true
            structure, fitted; ``None`` where only names count.
        ruled: channels that are ruled by something in no equation.
        rate: samples a second to which the user brings the logs before a diagnosis; as they are
            where ``None``.
    """

    kind: str
    seed: int
    train: tuple[dft.Log, ...]
    unseen: tuple[dft.Log, ...]
    model: dft.Model
    hidden: tuple[Hidden, ...]
    systems: tuple[wr.System, wr.System]
    truth: Mapping[str, float]
    noise: Mapping[str, float]
    starts: tuple[Mapping[str, float], ...]
    files: Mapping[str, str] = field(default_factory=dict, repr=False)
    says: tuple[str, ...] = ()
    never: tuple[str, ...] = ()
    within: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    close: float | None = None
    blanked: Callable[[wr.Run], wr.Run] = lambda run: run
    per_log: bool = False
    ruled: frozenset[str] = frozenset()
    rate: float | None = None

    def diagnosed(self) -> tuple[list[dft.Log], list[dft.Log]]:
        """The training and the unseen logs as the user gives them to a diagnosis."""
        logs = self.train, self.unseen
        if self.rate is None:
            return tuple([*some] for some in logs)
        return tuple([log.resampled(self.rate) for log in some] for some in logs)

    def runs(self) -> tuple[list[wr.Run], list[wr.Run]]:
        """The logs as plain arrays."""
        return tuple(
            [self.blanked(wr.Run.of(log)) for log in logs] for logs in (self.train, self.unseen)
        )

    def begun(self) -> tuple[list[wr.Run], list[wr.Run]]:
        """The same, each begun at its true states."""
        train, unseen = self.runs()
        runs = [wr.replace(r, initial=x) for r, x in zip(train + unseen, self.starts, strict=True)]
        return runs[: len(train)], runs[len(train) :]

    def from_truth(self) -> dict[str, float]:
        """Of the unseen logs the errors of the truth from its true start, to those of the sensors.

        About 1 by channel, where nothing random acts on the plant: a model can do no better.
        """
        _, runs = self.begun()
        measured = wr.spreads(self.systems[1], runs)
        errors = wr.errors(self.systems[1], runs, self.truth)
        return {c: errors[c] * measured[c] / self.noise[c] for c in measured}

    def write(self, folder: Path) -> None:
        """Write the CSV files, to look at them as a new user would."""
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in self.files.items():
            (folder / name).write_text(text)


def csv_text(columns: Mapping[str, Array], digits: Mapping[str, int]) -> str:
    """A table as a logger writes it; an empty cell where there is no sample."""
    rows = [",".join(columns)]
    texts = []
    for name, values in columns.items():
        form = f"{{:.{digits.get(name, 4)}f}}"
        texts.append(["" if np.isnan(v) else form.format(v) for v in values])
    rows += [",".join(row) for row in zip(*texts, strict=True)]
    return "\n".join(rows) + "\n"


def read(
    tables: Sequence[Mapping[str, Array]], digits: Mapping[str, int], **columns: Any
) -> tuple[list[dft.Log], dict[str, str]]:
    """Write tables to CSV files and read them again, as a user of the package does."""
    texts = {f"log{k + 1}.csv": csv_text(table, digits) for k, table in enumerate(tables)}
    with tempfile.TemporaryDirectory() as folder:
        for name, text in texts.items():
            Path(folder, name).write_text(text)
        logs = [dft.read_log(Path(folder, name), **columns) for name in texts]
    return logs, texts


def integrate(
    rates: Callable[[float, Array], Array], start: Sequence[float], time: Array, step: float
) -> Array:
    """States at ``time``, by the classical Runge-Kutta method in steps of at most ``step``.

    The last stage looks just ahead of the end of a step, where an input is still held.
    """
    x = np.array(start, float)
    out = np.empty((len(time), len(x)))
    out[0] = x
    for k in range(len(time) - 1):
        span = time[k + 1] - time[k]
        count = max(int(np.ceil(span / step - 1e-9)), 1)
        h = span / count
        for m in range(count):
            t = time[k] + m * h
            a = rates(t, x)
            b = rates(t + 0.5 * h, x + 0.5 * h * a)
            c = rates(t + 0.5 * h, x + 0.5 * h * b)
            d = rates(t + 0.9999 * h, x + h * c)
            x = x + h / 6.0 * (a + 2.0 * b + 2.0 * c + d)
        out[k + 1] = x
    return out


def steps(rng: np.random.Generator, time: Array, low: float, high: float, dwell: float) -> Array:
    """Levels drawn between two ends, each held for about ``dwell`` seconds."""
    out, t = np.empty(len(time)), time[0]
    while t <= time[-1]:
        end = t + dwell * rng.uniform(0.5, 1.5)
        out[(time >= t) & (time < end)] = rng.uniform(low, high)
        t = end
    return out


def wander(rng: np.random.Generator, time: Array, std: float, memory: float) -> Array:
    """A random signal of a standard deviation and a memory [s]."""
    out = np.empty(len(time))
    out[0] = rng.standard_normal()
    for k, dt in enumerate(np.diff(time)):
        keep = np.exp(-dt / memory)
        out[k + 1] = keep * out[k] + np.sqrt(1 - keep**2) * rng.standard_normal()
    return std * out


def sampled(values: Array, every: int, first: int = 0) -> Array:
    """A channel that is read at every n-th row only; the other cells are empty."""
    out = np.full(len(values), np.nan)
    out[first::every] = values[first::every]
    return out

"""The stretches of long logs on which effects are tried.

A trial costs as much as the samples that it passes, and what 20 000 measurements do not show takes
less than 0.3 % off the squared one-step errors: an effect is worth its price from a likelihood
ratio of some 20 to 50 on, and takes that over the number of measurements. So of long logs a window
each is passed: that which tells most of an unknown law of any of its signals. The law has a number
for each part of the signal's range; its information is how many samples lie there, and the window
is that of the largest determinant (D-optimal: Fedorov 1972). Fits to whole runs are of all samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from diffthrust._support.words import joined
from diffthrust.models._base.model import Model
from diffthrust.simulation._record import Record, are_tables, bind
from diffthrust.simulation._runs import Run

_MOST = 20_000
"""Numerics: measurements that are passed in trials, over all training logs. Lower: boats of
the bench, of 14 400, are cut. Higher: of a vehicle with eight thrusters and
ten sensors, twice 300 s at 10 Hz, each step of a search takes a second."""
_PARTS = 12
"""Numerics: parts of a signal's range, as many as a dead band or a knee need to show."""
_SHIFTS = 4
"""Numerics: a window is tried at every quarter of its length."""

_TOLD = 3
"""Display: windows that the note names."""


def trial_windows(model: Model, runs: Sequence[Run]) -> tuple[Record, ...]:
    """The records of trials: those of the runs, or where these are long a window of each.

    A window begins in the states of its run.
    """
    records = tuple(run.record for run in runs)
    sizes = np.array([_measurements(record) for record in records], float)
    if sizes.sum() <= _MOST or are_tables(records):
        return records
    shares = _shares(sizes, _MOST)
    windows = tuple(
        run.record if share >= size else _window(model, run, share / size)
        for run, size, share in zip(runs, sizes, shares, strict=True)
    )
    every, read = _channels(records), _channels(windows)
    return windows if every == read else records


def window_note(windows: Sequence[Record], records: Sequence[Record]) -> tuple[str, ...]:
    """What the windows are, in words; nothing where whole logs are passed."""
    pairs = zip(windows, records, strict=True)
    cut = [window for window, record in pairs if len(window) < len(record)]
    if not cut:
        return ()
    places = [f"{w.name}: {w.time[0]:.4g} to {w.time[-1]:.4g} s" for w in cut[:_TOLD]]
    if len(cut) > _TOLD:
        places.append(f"parts of {len(cut) - _TOLD} more logs")
    passed, every = (sum(map(_measurements, of)) for of in (windows, records))
    return (
        f"Effects were tried on {passed} of {every} measurements, where the signals cover most of "
        f"their ranges ({joined(places)}). The fits of the stages and their errors are of all.",
    )


def _measurements(record: Record) -> int:
    return sum(int(np.isfinite(values).sum()) for values in record.measured.values())


def _channels(records: Sequence[Record]) -> set[str]:
    """The channels that are read anywhere: a sensor may have worked for a part of a log alone."""
    return {n for record in records for n, v in record.measured.items() if np.isfinite(v).any()}


def _shares(sizes: np.ndarray, most: float) -> np.ndarray:
    """What each log is passed of: all of the short ones, and of the others as much of each."""
    level, left = 0.0, most
    for place, size in enumerate(np.sort(sizes)):
        level = left / (sizes.size - place)
        if size > level:
            break
        left -= size
    return np.minimum(sizes, level)


def _window(model: Model, run: Run, share: float) -> Record:
    """The window of a run's log that tells most, of this share of its length."""
    log = run.log
    size = max(2, round(share * len(log)))
    starts = np.arange(0, len(log) - size + 1, max(1, size // _SHIFTS))
    series = (*log.inputs.values(), *log.measured.values())
    information = sum(_information(values, starts, size) for values in series)
    first = int(starts[np.argmax(information)])
    part = slice(first, first + size)
    cut = log.replaced(
        time=log.time[part],
        inputs={name: values[part] for name, values in log.inputs.items()},
        measured={name: values[part] for name, values in log.measured.items()},
        # in a part of the log another value is the largest, and would be taken for a rail
        rails=dict.fromkeys(log.measured, (-np.inf, np.inf)),
        censored=frozenset(),
    )
    (record,) = bind(model, [cut])
    states = {name: run.signals[name][first] for name in model.states if name in run.signals}
    begun = {name: float(value) for name, value in states.items() if np.isfinite(value)}
    return replace(record, start={**begun, **record.start})


def _information(values: np.ndarray, starts: np.ndarray, size: int) -> np.ndarray:
    """Log determinant of a law's information in each window, with a number for each part."""
    finite = np.isfinite(values)
    low, high = np.quantile(values[finite], (0.01, 0.99)) if finite.any() else (0.0, 0.0)
    if not high > low:
        return np.zeros(starts.size)
    inner = np.linspace(low, high, _PARTS + 1)[1:-1]
    parts = np.where(finite, np.digitize(values, inner), _PARTS)
    seen = np.cumsum(parts[:, None] == np.arange(_PARTS), axis=0)
    seen = np.concatenate([np.zeros((1, _PARTS), int), seen])
    return np.log1p(seen[starts + size] - seen[starts]).sum(axis=1)

"""Sizes of found effects that change: from some instant on, or above a level of some signal.

The slopes of whole runs by a parameter, zero up to the level, are what a change of it there adds,
as far as runs follow at once. Beside such slopes all free parameters are fitted to the errors of
the training logs; the unseen logs decide. Nothing is simulated but each parameter moved a little.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from diffthrust.diagnosis._explained_share import BeforeAfter, Worth, explained_share
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.estimation._result import Estimate, Fit
from diffthrust.logs._written import Size
from diffthrust.simulation._runs import Run, runs_over, with_steps

_STEP = 1e-4
"""Numerics: share of a parameter, or of its scale, over which slopes are differences."""
_LEVELS = 40
"""Numerics: levels that are tried over the range of a signal, and once more about the best."""
_EXTREMES = 0.05
"""Numerics: share of the samples that each side of a level has at least: what a few peaks do is
told by a limit or a curve."""
TIME = "time"
"""The signal of a change in time [s], from the start of each log."""


@dataclass(frozen=True)
class ChangedSize:
    """A parameter of an added effect that changes at an instant, or at a level of a signal.

    Args:
        parameter: its full name.
        signal: an input, state or output of the model, or "time" from the start of a log.
        level: of the signal, in the model's unit; a time in [s].
        before: its estimate up to the level, without a standard error.
        after: beyond it.
        worth: the share of the squared error over whole unseen runs that the change removes.
        shown: the level in the unit of the logs.
    """

    parameter: str
    signal: str
    level: float
    before: Estimate
    after: Estimate
    worth: Worth
    shown: Size

    def to_json(self) -> dict[str, Any]:
        """As plain data."""
        return {
            "parameter": self.parameter,
            "signal": self.signal,
            "level": self.level,
            "before": self.before.value,
            "after": self.after.value,
            "unit": self.after.unit,
            "worth": self.worth.to_json(),
        }


class _Slopes(NamedTuple):
    """Of one log and channel: errors and slopes ``(P, T)`` over the scale, and all signals."""

    log: int
    channel: str
    signals: Mapping[str, np.ndarray]
    measured: np.ndarray
    errors: np.ndarray
    slopes: np.ndarray


class _Change(NamedTuple):
    """A change of the parameter at a place among all, above a level of a signal."""

    place: int
    signal: str
    level: float


def changed_size(
    fit: Fit, added: Sequence[str], training: Sequence[Run], unseen: Sequence[Run]
) -> ChangedSize | None:
    """The change of an added effect that most of the errors over whole runs are, if any.

    Args:
        fit: of the last stage.
        added: names of its effects.
        training: its runs over the training logs.
        unseen: the same over the unseen ones. Without any nothing is said: of 60 single logs under
            random forces of 10 s, 9 seemed to change.
    """
    names = [name for name, estimate in fit.parameters.items() if not estimate.fixed]
    places = [i for i, name in enumerate(names) if name.rpartition(".")[0] in added]
    if not (places and unseen):
        return None
    fitted = _slopes(fit, names, training)
    levels = {signal: _levels(fitted, signal) for signal in _shared(fitted)}
    first = _best(fitted, [_Change(i, n, at) for i in places for n in levels for at in levels[n]])
    near = _neighbours(levels[first.signal], first.level)
    change = _best(fitted, [first._replace(level=at) for at in near])
    step = _step(fitted, change)
    worth = _worth(_slopes(fit, names, unseen), change, step)
    if not worth.low > SETTINGS.verdict.changed_share:
        return None
    place, signal, level = change
    name, estimate = names[place], fit.parameters[names[place]]
    before, after = (
        replace(estimate, value=float(estimate.value + moved), std_error=None)
        for moved in (step[place], step[place] + step[-1])
    )
    run = training[0]
    unit = run.units.get(signal, "s")
    shown = Size(float(run.shown.values(signal, level, unit)), run.shown.unit(signal, unit))
    return ChangedSize(name, signal, level, before, after, worth, shown)


def _shared(rows: Sequence[_Slopes]) -> list[str]:
    """The signals of all rows; time first, for of equal changes the first is told."""
    others = set.intersection(*(set(row.signals) for row in rows)) - {TIME}
    return [TIME, *sorted(others)]


def _levels(rows: Sequence[_Slopes], signal: str) -> np.ndarray:
    """The levels of a signal at which a change is tried."""
    values = np.concatenate([row.signals[signal] for row in rows])
    if signal == TIME:
        return np.linspace(0.0, values.max(), _LEVELS + 2)[1:-1]
    shares = np.linspace(_EXTREMES, 1.0 - _EXTREMES, _LEVELS)
    levels = np.unique(np.quantile(values[np.isfinite(values)], shares))
    return levels if levels.size > 1 else levels[:0]


def _neighbours(levels: np.ndarray, level: float) -> np.ndarray:
    """Finer levels, from the one before a level to the one after it."""
    k = int(np.argmin(np.abs(levels - level)))
    return np.linspace(levels[max(k - 1, 0)], levels[min(k + 1, levels.size - 1)], _LEVELS)


def _slopes(fit: Fit, names: Sequence[str], runs: Sequence[Run]) -> list[_Slopes]:
    """Errors and slopes of every measured channel of every log, over the channel's error.

    With as many integrator steps for all as the log takes that needs most: between runs of a
    thruster with 1 and with 4 of them slopes were off by their own size.
    """
    substeps = max(run.substeps for run in runs)
    runs = with_steps(fit.model, runs, substeps)
    moved = [_moved(fit, name, runs) for name in names]
    rows = []
    for k, run in enumerate(runs):
        signals = {**run.signals, TIME: run.time - run.time[0]}
        for channel, trace in run.channels.items():
            if channel not in fit.train.channels:  # unseen logs may measure more
                continue
            scale = fit.train.channels[channel].rmse or 1.0
            slopes = [(more[k].channels[channel].modelled - trace.modelled) / by
                      for more, by in moved]  # fmt: skip
            rows.append(
                _Slopes(k, channel, signals, trace.measured / scale, trace.residual / scale,
                        np.array(slopes) / scale)
            )  # fmt: skip
    return rows


def _moved(fit: Fit, name: str, runs: Sequence[Run]) -> tuple[tuple[Run, ...], float]:
    """The runs with a parameter moved a little, and by how much."""
    declared, value = fit.model.parameters[name], fit.parameters[name].value
    by = _STEP * (abs(value) or declared.scale)
    by = by if value + by <= declared.limits[1] else -by
    model = fit.model.replace({name: value + by})
    again = runs_over(
        model,
        [run.record for run in runs],
        initial=[run.start for run in runs],
        substeps=runs[0].substeps,
    )
    return again, by


def _columns(row: _Slopes, change: _Change) -> np.ndarray:
    """The slopes, and those of a change above a level, ``(P + 1, T)``."""
    above = row.signals[change.signal] > change.level
    return np.concatenate([row.slopes, row.slopes[change.place : change.place + 1] * above])


def _step(rows: Sequence[_Slopes], change: _Change) -> np.ndarray:
    """The step of all parameters, and the change, that leave least of the errors."""
    errors = np.concatenate([row.errors for row in rows])
    columns = np.concatenate([_columns(row, change) for row in rows], axis=1)
    seen = np.isfinite(errors) & np.isfinite(columns).all(axis=0)
    size = np.linalg.norm(columns[:, seen], axis=1)
    size[size == 0] = 1.0
    step = np.linalg.lstsq((columns[:, seen] / size[:, None]).T, errors[seen], rcond=1e-9)[0]
    return step / size


def _after(row: _Slopes, change: _Change, step: np.ndarray) -> np.ndarray:
    return row.errors - step @ _columns(row, change)


def _best(rows: Sequence[_Slopes], changes: Sequence[_Change]) -> _Change:
    """The change that leaves least of the squares; the first of equal ones."""

    def remaining(change: _Change) -> float:
        step = _step(rows, change)
        return sum(float(np.nansum(_after(row, change, step) ** 2)) for row in rows)

    return min(changes, key=remaining)


def _worth(rows: Sequence[_Slopes], change: _Change, step: np.ndarray) -> Worth:
    """The share of the squared errors that a change removes."""
    logs: dict[int, dict[str, BeforeAfter]] = {}
    for row in rows:
        after = _after(row, change, step)
        logs.setdefault(row.log, {})[row.channel] = BeforeAfter(row.measured, row.errors, after)
    return explained_share([*logs.values()])

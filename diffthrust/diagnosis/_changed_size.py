"""Sizes of found effects that change: from some instant on, or above a level of some signal.

The slopes of whole runs by a parameter, zero up to the level, are what a change of it there adds,
as far as runs follow at once. Beside such slopes all free parameters are fitted to the errors of
the training logs; the unseen logs decide. Nothing is simulated but each parameter moved a little.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from diffthrust.diagnosis._explained_share import BeforeAfter, Worth, explained_share
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.estimation._estimate import Estimate
from diffthrust.estimation._result import Fit
from diffthrust.logs._written import Size
from diffthrust.simulation._record import are_tables
from diffthrust.simulation._runs import Run, runs_over, shown_of, with_steps

_STEP = 1e-4
"""Numerics: share of a parameter, or of its scale, over which slopes are differences."""
_EXTREMES = 0.05
"""Numerics: share of the samples that each side of a level has at least: what a few peaks do is
told by a limit or a curve."""
_INDEPENDENT = 1e-6
"""Numerics: share of a slope's square that the other parameters must leave to tell it from them."""
_AS_WELL = 0.98
"""Display: a change in time is told if it removes this share of what a level of a signal does: on
logs that all ramp a command up, time and command are nearly the same."""
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
    """The change of an effect of a stage that most of the errors over whole runs are, if any.

    Without unseen logs nothing is said: of 60 single logs under random forces of 10 s, 9 seemed to
    change.
    """
    names = [name for name, estimate in fit.parameters.items() if not estimate.fixed]
    places = [i for i, name in enumerate(names) if name.rpartition(".")[0] in added]
    if not (places and unseen):
        return None
    fitted, held = _slopes(fit, names, training), _slopes(fit, names, unseen)
    timeless = are_tables(run.record for run in (*training, *unseen))
    change = _best(fitted, places, _shared([*fitted, *held], fit.model.angles, timeless))
    if change is None:
        return None
    step = _step(fitted, change)
    worth = _worth(held, change, step)
    if not worth.low > SETTINGS.verdict.changed_share:
        return None
    place, signal, level = change
    name, estimate = names[place], fit.parameters[names[place]]
    before, after = (
        replace(estimate, value=float(estimate.value + moved), std_error=None)
        for moved in (step[place], step[place] + step[-1])
    )
    shown = _shown(training, signal, level)
    return ChangedSize(name, signal, level, before, after, worth, shown)


def _shown(runs: Sequence[Run], signal: str, level: float) -> Size:
    """A level in the unit of the logs; of a channel that they count the other way, as modelled."""
    units, unit = shown_of(runs), runs[0].units.get(signal, "s")
    low, high = units.values(signal, [level, level + 1e-6 * (1.0 + abs(level))], unit)
    return Size(float(low), units.unit(signal, unit)) if high > low else Size(level, unit)


def _shared(rows: Sequence[_Slopes], angles: Collection[str], timeless: bool) -> list[str]:
    """The signals of all rows, without angles: the heading of a boat that circles is a clock.

    Of static tables without the time.
    """
    others = set.intersection(*(set(row.signals) for row in rows)) - {TIME, *angles}
    return [*[TIME][timeless:], *sorted(others)]


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


def _best(rows: Sequence[_Slopes], places: Sequence[int], signals: Sequence[str]) -> _Change | None:
    """The change that leaves least of the squares; one in time unless another does clearly better.

    Of all levels between two samples at once: beside the other slopes, what a change removes is the
    square of its product with the errors that these leave, over what they leave of its own square;
    both are sums over the samples above the level.
    """
    errors = np.concatenate([row.errors for row in rows])
    slopes = np.concatenate([row.slopes for row in rows], axis=1)
    series = {n: np.concatenate([row.signals[n] for row in rows]) for n in signals}
    seen = np.isfinite([errors, *slopes, *series.values()]).all(axis=0)
    errors, slopes = errors[seen], slopes[:, seen]
    length = np.linalg.norm(slopes, axis=1)
    columns, sizes, _ = np.linalg.svd((slopes[length > 0] / length[length > 0, None]).T, False)
    basis = columns[:, sizes > _INDEPENDENT].T
    errors = errors - (basis @ errors) @ basis
    changes: list[tuple[float, _Change]] = []
    for signal, values in series.items():
        order = np.argsort(values[seen], kind="stable")
        ordered, least = values[seen][order], int(_EXTREMES * order.size)
        splits = np.flatnonzero(np.diff(ordered) > 0)
        splits = splits[(splits >= least) & (splits < order.size - least)]
        if not splits.size:
            continue
        for place in places:
            above = slopes[place, order]
            products = above * np.stack([errors[order], above, *basis[:, order]])
            sums = (products.sum(axis=1, keepdims=True) - products.cumsum(axis=1))[:, splits]
            own = sums[1] - np.sum(sums[2:] ** 2, axis=0)
            apart = own > _INDEPENDENT * np.sum(above**2)
            removed = np.where(apart, sums[0] ** 2 / np.where(apart, own, 1.0), 0.0)
            k = splits[np.argmax(removed)]
            level = 0.5 * float(ordered[k] + ordered[k + 1])
            changes.append((float(removed.max()), _Change(place, signal, level)))
    most = max((removed for removed, _ in changes), default=0.0)
    as_well = [pair for pair in changes if pair[1].signal == TIME and pair[0] >= _AS_WELL * most]
    return max(as_well or changes, key=lambda pair: pair[0])[1] if most > 0 else None


def _worth(rows: Sequence[_Slopes], change: _Change, step: np.ndarray) -> Worth:
    """The share of the squared errors that a change removes."""
    logs: dict[int, dict[str, BeforeAfter]] = {}
    for row in rows:
        after = row.errors - step @ _columns(row, change)
        logs.setdefault(row.log, {})[row.channel] = BeforeAfter(row.measured, row.errors, after)
    return explained_share([*logs.values()])

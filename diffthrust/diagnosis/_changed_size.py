"""Sizes of found effects that change in time: an inflow that takes more from some instant on.

The slopes of whole runs by a parameter, zero until an instant, are what a change of it then adds,
as far as runs follow at once. Beside such slopes all free parameters are fitted to the errors of
the training logs; the unseen logs decide. Nothing is simulated but each parameter moved a little.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from diffthrust.diagnosis._explained_share import BeforeAfter, Worth, explained_share
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.estimation._result import Estimate, Fit
from diffthrust.simulation._runs import Run, runs_over, with_steps

_STEP = 1e-4
"""Numerics: share of a parameter, or of its scale, over which slopes are differences."""
_INSTANTS = 40
"""Numerics: instants that are tried over a log, and once more about the best."""


@dataclass(frozen=True)
class ChangedSize:
    """A parameter of an added effect that changes at an instant.

    Args:
        parameter: its full name.
        instant: from the start of a log [s].
        before: its estimate until then, without a standard error.
        after: from then on.
        worth: the share of the squared error over whole unseen runs that the change removes.
    """

    parameter: str
    instant: float
    before: Estimate
    after: Estimate
    worth: Worth

    def to_json(self) -> dict[str, Any]:
        """As plain data."""
        return {
            "parameter": self.parameter,
            "instant": self.instant,
            "before": self.before.value,
            "after": self.after.value,
            "unit": self.after.unit,
            "worth": self.worth.to_json(),
        }


class _Slopes(NamedTuple):
    """Of one log and channel: the time [s], errors, and slopes ``(P, T)``, all over the scale."""

    log: int
    channel: str
    time: np.ndarray
    measured: np.ndarray
    errors: np.ndarray
    slopes: np.ndarray


def changed_size(
    fit: Fit, added: Sequence[str], training: Sequence[Run], unseen: Sequence[Run]
) -> ChangedSize | None:
    """The change in time of an added effect that most of the errors over whole runs are, if any.

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
    last = max(float(row.time[-1]) for row in fitted)
    place, at = _best(fitted, places, np.linspace(0.0, last, _INSTANTS + 2)[1:-1])
    near = last / _INSTANTS
    place, instant = _best(fitted, [place], np.linspace(at - near, at + near, _INSTANTS))
    step = _step(fitted, place, instant)
    worth = _worth(_slopes(fit, names, unseen), place, instant, step)
    if not worth.low > SETTINGS.verdict.changed_share:
        return None
    name, estimate = names[place], fit.parameters[names[place]]
    before, after = (
        replace(estimate, value=float(estimate.value + moved), std_error=None)
        for moved in (step[place], step[place] + step[-1])
    )
    return ChangedSize(name, instant, before, after, worth)


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
        for channel, trace in run.channels.items():
            if channel not in fit.train.channels:  # unseen logs may measure more
                continue
            scale = fit.train.channels[channel].rmse or 1.0
            slopes = [(more[k].channels[channel].modelled - trace.modelled) / by
                      for more, by in moved]  # fmt: skip
            rows.append(
                _Slopes(k, channel, run.time - run.time[0], trace.measured / scale,
                        trace.residual / scale, np.array(slopes) / scale)
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


def _columns(row: _Slopes, place: int, instant: float) -> np.ndarray:
    """The slopes, and those of a change at an instant, ``(P + 1, T)``."""
    return np.concatenate([row.slopes, row.slopes[place : place + 1] * (row.time > instant)])


def _step(rows: Sequence[_Slopes], place: int, instant: float) -> np.ndarray:
    """The step of all parameters, and the change, that leave least of the errors."""
    errors = np.concatenate([row.errors for row in rows])
    columns = np.concatenate([_columns(row, place, instant) for row in rows], axis=1)
    seen = np.isfinite(errors) & np.isfinite(columns).all(axis=0)
    size = np.linalg.norm(columns[:, seen], axis=1)
    size[size == 0] = 1.0
    step = np.linalg.lstsq((columns[:, seen] / size[:, None]).T, errors[seen], rcond=1e-9)[0]
    return step / size


def _after(row: _Slopes, place: int, instant: float, step: np.ndarray) -> np.ndarray:
    return row.errors - step @ _columns(row, place, instant)


def _best(
    rows: Sequence[_Slopes], places: Sequence[int], instants: np.ndarray
) -> tuple[int, float]:
    """The parameter and the instant of the change that leaves least of the squares."""

    def remaining(place: int, instant: float) -> float:
        step = _step(rows, place, instant)
        return sum(float(np.nansum(_after(row, place, instant, step) ** 2)) for row in rows)

    changes = [(place, float(instant)) for place in places for instant in instants]
    return min(changes, key=lambda change: remaining(*change))


def _worth(rows: Sequence[_Slopes], place: int, instant: float, step: np.ndarray) -> Worth:
    """The share of the squared errors that a change removes."""
    logs: dict[int, dict[str, BeforeAfter]] = {}
    for row in rows:
        after = _after(row, place, instant, step)
        logs.setdefault(row.log, {})[row.channel] = BeforeAfter(row.measured, row.errors, after)
    return explained_share([*logs.values()])

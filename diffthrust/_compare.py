"""A model held against logs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from diffthrust._channels import listing
from diffthrust._errors import InputError
from diffthrust._log import Log
from diffthrust._metrics import Errors, errors, unwrapped
from diffthrust._model import Model
from diffthrust._simulate import simulate

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from diffthrust._result import Fit


@dataclass(frozen=True)
class Trace:
    """One channel of one run: measured and modelled, ``(n,)`` each, in ``unit``."""

    measured: np.ndarray
    modelled: np.ndarray
    residual: np.ndarray
    unit: str


@dataclass(frozen=True)
class Run:
    """One log with the simulation over the whole of it."""

    name: str
    time: np.ndarray
    channels: Mapping[str, Trace]
    errors: Errors


@dataclass(frozen=True)
class Comparison:
    """A model held against logs.

    Args:
        model: the model.
        runs: one for each log, simulated over its whole length.
        errors: errors by channel, pooled over the runs.
    """

    model: Model
    runs: tuple[Run, ...]
    errors: Errors

    def plot(self, runs: Sequence[str] | None = None) -> Figure:
        """Measured and modelled on top, residual below, for each channel.

        Args:
            runs: names of the runs to show; all by default.

        Raises:
            InputError: a run that does not exist.
        """
        from diffthrust._plots import comparison_figure

        known = [run.name for run in self.runs]
        unknown = [name for name in runs or () if name not in known]
        if unknown:
            raise InputError(
                f"The comparison has no run {listing(unknown)}; it has {listing(known)}.",
                "Correct the name.",
            )
        shown = self.runs if runs is None else tuple(r for r in self.runs if r.name in runs)
        return comparison_figure(Comparison(self.model, shown, self.errors))

    def report(self) -> str:
        """The errors as a table, for people."""
        from diffthrust._display import comparison_table, rendered

        return rendered(comparison_table(self))

    def to_json(self) -> dict[str, Any]:
        """Errors, pooled and by run, as plain data."""
        return {
            "schema": 1,
            "model": self.model.name,
            "effects": [effect.name for effect in self.model.effects],
            "errors": self.errors.to_json(),
            "runs": [{"name": run.name, **run.errors.to_json()} for run in self.runs],
        }


def compare(
    fit: Fit | Model,
    logs: Log | Sequence[Log],
    *,
    initial: Sequence[Mapping[str, float]] | None = None,
    substeps: int | None = None,
) -> Comparison:
    """Hold a model against logs: simulate each whole run and compare it with the measurement.

    Args:
        fit: a fit, or a model at its present parameter values.
        logs: one or several logs.
        initial: initial states for each log; by default measured states start from their first
            measurement.
        substeps: integrator steps per sample; chosen for each log where ``None``.

    Returns:
        A `Comparison`: errors, and a figure by ``.plot()``.

    Raises:
        InputError: a log without a channel that the model needs or puts out.

    Example:
        >>> dft.compare(fit, unseen).errors.nrmse
        0.041
    """
    model = fit if isinstance(fit, Model) else fit.model
    logs = (logs,) if isinstance(logs, Log) else tuple(logs)
    starts = [{}] * len(logs) if initial is None else initial
    if isinstance(starts, Mapping) or len(starts) != len(logs):
        raise InputError(
            f"initial: expected a list with initial states for each of {len(logs)} logs.",
            "Give initial=[{'speed': 1.0}, ...].",
        )
    runs = tuple(_run(model, log, start, substeps) for log, start in zip(logs, starts, strict=True))
    if not any(run.channels for run in runs):
        raise InputError(
            f"No log measures an output of '{model.name}', which puts out "
            f"{listing(model.outputs)}.",
            "Map a column to one of these channels.",
        )
    return Comparison(model, runs, _pooled(runs))


def _run(model: Model, log: Log, start: Mapping[str, float], substeps: int | None) -> Run:
    modelled = simulate(model, log, initial=start, substeps=substeps)
    channels = {}
    for name, unit in model.outputs.items():
        if name not in log.measured:
            continue
        ours = np.abs(modelled[name]) if name in log.unsigned else modelled[name]
        theirs = log.values(name, unit)
        rest = theirs - ours
        if name in model.angles:
            rest -= 2 * np.pi * np.round(rest / (2 * np.pi))
            theirs = unwrapped(theirs)
            ours = theirs - rest
        channels[name] = Trace(theirs, ours, rest, unit)
    found = errors({n: [(t.measured, t.residual)] for n, t in channels.items()})
    return Run(log.name, log.time, channels, found)


def _pooled(runs: Sequence[Run]) -> Errors:
    pairs: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
    for run in runs:
        for name, trace in run.channels.items():
            pairs.setdefault(name, []).append((trace.measured, trace.residual))
    return errors(pairs)

"""Models whose runs part from each other: why a fit of whole runs did not end well."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from diffthrust.estimation._status import Status
from diffthrust.models._base.model import Model
from diffthrust.simulation._fixed_step import simulate_fixed
from diffthrust.simulation._runs import Run

_SMALL = 1e-8
"""What initial states are moved by, as a share of the range that the state has in the run."""
_LARGE = 1e4
"""Runs that part by more are those of an unstable model: one that only adds up (a position, a
heading) parts by as much as the run is long, and rounding of 1e-12 then stays unseen."""


def unstable_advice(status: Status, model: Model, runs: Sequence[Run], corrects: bool) -> str:
    """What to add to the message of a fit that may not be used, where the model is unstable.

    Simulated over whole runs such a model forgets nothing: the last digits of its initial states
    and parameters decide where a run ends, the likelihood has ridges that no search follows, and
    the rank that is left of it is that of rounding. Predictions from sample to sample do not have
    that; the fit does not go over to them by itself, for their standard errors claim other things.

    Args:
        status: of the fit.
        model: at the optimum.
        runs: over its training logs.
        corrects: whether the fit predicted from sample to sample.
    """
    measured = any(set(run.channels) & set(model.all_states) for run in runs)
    if status.ok or corrects or not measured:
        return ""
    parted = [(_parted(model, run), run.name) for run in runs if not run.failure]
    times, name = max(parted, default=(0.0, ""))
    if times < _LARGE:
        return ""
    return (
        f" The model is unstable: over {name} a small difference at the start grows {times:.0e} "
        "times as large, so that whole runs hardly tell its parameters. Predict each sample from "
        "the ones before it: likelihood='innovations'."
    )


def _parted(model: Model, run: Run) -> float:
    """How many times larger a small difference of the initial states becomes."""
    states = {n: run.signals[n] for n in model.all_states if n in run.signals}
    sizes = {n: float(np.ptp(x)) or 1.0 for n, x in states.items()}
    begin = {n: float(x[0]) + _SMALL * sizes[n] for n, x in states.items()}
    moved = simulate_fixed(model, run.record, begin, run.substeps)
    apart = [np.max(np.abs(moved[n] - x)) / (_SMALL * sizes[n]) for n, x in states.items()]
    return float(max(apart, default=0.0))

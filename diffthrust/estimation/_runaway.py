"""Parameters that run away: values without an upper end that the logs of a fit would tell.

A drag so large that the boat never sways explains a sway that nothing else explains by a boat that
does not sway; a thousand times as much does so as well. The search stops where its integrator
steps end, and the number says nothing but that.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from diffthrust._support.correlation import lag_one
from diffthrust._support.later import Later
from diffthrust._support.words import joined, number
from diffthrust.estimation._result import Fit
from diffthrust.models._base.model import Model
from diffthrust.models._base.parameter import Parameter
from diffthrust.simulation._runs import Run, pooled_errors, runs_over
from diffthrust.soundness._doubt import Doubt

FAR = 10.0
"""A value so many times the first guess may have run away. Lower: guesses that were merely poor are
looked at, which costs a simulation each. Higher: values that have just begun to run are not."""
FURTHER = 3.0
"""What the value is multiplied by. A parameter that is bounded by its logs, to a tenth of itself,
errs by much more there; a larger factor needs as many more integrator steps."""
AS_LITTLE = 1.02
"""Error with the larger value, to that at the optimum, that people call no larger. Lower: 150
samples do not tell a rate of 9 per second from larger ones, and err by 0.7 % more. Higher: of few
samples the likelihood below tells nothing, and the sentence would be none of theirs."""
UNTOLD = 2.0
"""Logarithm of the likelihood ratio up to which the logs do not tell the larger value: 95 %, of one
parameter. Samples count by how far errors are correlated: BlueBoat's sway (0.95) has a fortieth."""

VERY_FAR = 1e3
"""A value so many times the first guess is doubted, however well the logs tell it. Lower: guesses
within the two decades over which starts are drawn are doubted. Higher: of a channel in mN that was
declared in N, whose factor the parameter takes on, nothing is said."""


def with_runaways(fit: Fit, runs: Sequence[Run], *, doubts: bool) -> Fit:
    """The fit with what is to be said of parameters that ran away.

    Args:
        fit: the fit, whose ``guess`` is where it began.
        runs: of its model over the training logs.
        doubts: whether values far beyond the guess are doubted; else they have their notes only.
    """
    fit = replace(fit, notes=(*runaway_notes(fit, runs), *fit.notes))
    far = [name for name, value in _suspects(fit, VERY_FAR)] if doubts else []
    if not far:
        return fit
    added, others = [_doubt_on(name, fit) for name in far], fit.doubts
    pointer = f" But {joined(far)} ran very far from the first guess: look at the doubts."
    return replace(fit, message=fit.message + pointer, doubts=Later(lambda: (*others, *added)))


def _doubt_on(name: str, fit: Fit) -> Doubt:
    value, unit = fit.parameters[name].value, f" {fit.parameters[name].unit}".rstrip()
    return Doubt(
        name,
        "runaway",
        f"it began at {number(fit.guess[name])} and ended at {number(value)}{unit}, more than "
        f"{VERY_FAR:g} times as far from zero.",
        "look at the units and scales of the channels, whose mistakes a parameter takes on; if the "
        f'value is right, begin there: model.replace({{"{name}": {value:.3g}}}).',
    )


def runaway_notes(fit: Fit, runs: Sequence[Run]) -> tuple[str, ...]:
    """A sentence with a mend for each parameter that ran away.

    Args:
        fit: the fit, whose ``guess`` is where it began.
        runs: of its model over the training logs.
    """
    suspects = [
        (name, value)
        for name, value in _suspects(fit, FAR)
        if _within(FURTHER * value, fit.model.parameters[name])
    ]
    if not suspects or not np.isfinite(fit.train.nrmse):
        return ()
    error, samples = _error(fit, fit.model, runs), _independent(runs)
    notes = []
    for name, value in suspects:
        further = _error(fit, fit.model.replace({name: FURTHER * value}), runs)
        ratio = further / error
        if ratio <= AS_LITTLE and samples * math.log(ratio) <= UNTOLD:
            unit = f" {fit.parameters[name].unit}".rstrip()
            notes.append(
                f"{name} runs away: from {number(fit.guess[name])} to {number(value)}{unit}, and "
                f"{FURTHER:g} times as much errs as little. These logs do not bound it: hold it at "
                f'what you know of it, model.replace({{"{name}": ...}}).fix("{name}"), give it an '
                "upper bound, or fit logs that excite what it acts on."
            )
    return tuple(notes)


def _suspects(fit: Fit, times: float) -> Iterator[tuple[str, float]]:
    """Free parameters, away from their bounds, at so many times where they began."""
    for name in fit.free:
        estimate, parameter = fit.parameters[name], fit.model.parameters[name]
        size = max(abs(fit.guess[name]), abs(parameter.null or 0.0))
        if size > 0 and not estimate.at_bound and abs(estimate.value) >= times * size:
            yield name, estimate.value


def _within(value: float, parameter: Parameter) -> bool:
    low, high = parameter.limits
    return low <= value <= high


def _error(fit: Fit, model: Model, runs: Sequence[Run]) -> float:
    """NRMSE over the training logs, with the integrator steps that a larger value needs."""
    records, substeps = [run.record for run in runs], math.ceil(FURTHER) * fit.substeps
    return pooled_errors(runs_over(model, records, initial=fit.initial, substeps=substeps)).nrmse


def _independent(runs: Sequence[Run]) -> float:
    """How many independent samples the errors of the runs are worth."""
    count = 0.0
    for name in dict.fromkeys(name for run in runs for name in run.channels):
        errors = [run.channels[name].residual for run in runs if name in run.channels]
        lag = max(lag_one(errors), 0.0)
        count += sum(np.isfinite(e).sum() for e in errors) * (1.0 - lag) / (1.0 + lag)
    return count

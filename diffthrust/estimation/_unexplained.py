"""What a fit does not explain, what its user may look at first, and parameters that run away.

These have values without an upper end that the logs of a fit would tell. A drag so large that the
boat never sways explains a sway that nothing else explains by a boat that does not sway; a thousand
times as much does so as well. The search stops where its integrator steps end, and the number says
nothing but that.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from diffthrust._support.correlation import lag_one
from diffthrust._support.later import Later
from diffthrust._support.words import joined, number, percent
from diffthrust.estimation._result import Fit
from diffthrust.estimation._wiring import wiring_doubts
from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model
from diffthrust.simulation._errors import Errors
from diffthrust.simulation._runs import Run, pooled_errors, runs_over
from diffthrust.soundness._doubt import Doubt
from diffthrust.soundness._doubts import doubts as doubts_of
from diffthrust.soundness._record import jumps
from diffthrust.soundness._times import late_readings

_LITTLE = 0.36
"""A channel of whose variance less is explained is not described by the model: an NRMSE of 0.8, a
fit of a fifth."""


def little_explained(errors: Errors) -> dict[str, str]:
    """Channels of whose variance a fit explains less than `_LITTLE`, and the share."""
    shares = {name: 1.0 - e.nrmse**2 for name, e in errors.channels.items()}
    return {name: percent(max(share, 0.0)) for name, share in shares.items() if share < _LITTLE}


def hint_at(little: Mapping[str, str]) -> str:
    """What to add to the message of a fit that explains little of some channels."""
    words = joined([f"{share} of the variance of {name}" for name, share in little.items()])
    return f" But it explains {words}: look at the doubts first." if little else ""


def doubts_about(
    little: Mapping[str, str], runs: Sequence[Run], model: Model, given: Model, logs: Sequence[Log]
) -> tuple[Doubt, ...]:
    """The doubts of a fit: on its logs, the unseen ones too, and on channels it hardly explains.

    ``runs`` are those over its training logs; none where they failed. Commands are held against the
    model as ``given``: where one of two thrusters with numbers of their own is turned, the fit of
    these ends at gains of 1e-14 and 7e15.
    """
    wired = (*wiring_doubts(given, runs),)
    turning, on_logs = (*_turning(model, runs),), doubts_of(logs, model)
    if wired:
        # their errors look like more: of eight thrusters with two of them exchanged the heading
        # "came late by a varying time", too, or the position did not move as the model's does
        return (*turning, *wired, *on_logs)
    doubts = (*turning, *late_readings(runs), *on_logs)
    return (*doubts, *silent_doubts(little, doubts, model, runs))


def silent_doubts(
    little: Mapping[str, str], doubts: Sequence[Doubt], model: Model, runs: Sequence[Run]
) -> tuple[Doubt, ...]:
    """Doubts on channels that a fit hardly explains, and that no other doubt names."""
    held = "".join(_held_against(model, runs)) if little else ""
    doubted = {word.strip(".,:;") for doubt in doubts for word in str(doubt).split()}
    return tuple(
        Doubt(
            name,
            "silent",
            f"the fit explains {share} of the variance of {name}: it does not move as the model's "
            "does.",
            f"look at dft.compare(fit, logs).plot(), at the sign, unit and column of {name} and "
            f"of the inputs, and at what dft.diagnose(fit, logs) finds missing.{held}",
        )
        for name, share in little.items()
        if name not in doubted
    )


def _turning(model: Model, runs: Sequence[Run]) -> Iterator[Doubt]:
    """Doubts on angles that jump by a full turn, of which the model's class does not say so."""
    for name, unit in model.outputs.items():
        for run in runs:
            if name in model.angles or name not in run.channels:
                continue
            measured = run.channels[name].measured
            if unit and jumps(measured[np.isfinite(measured)]) == unit:  # "" where none does
                yield Doubt(
                    name,
                    "unit",
                    f"{run.name}: {name} jumps by a full turn, 360 degrees, from one sample to the "
                    f"next, and {type(model).__name__} compares it as a plain number.",
                    f"name it in the class of the model: angles = ({name!r},); then {name} is "
                    "compared modulo a full turn.",
                )
                break


PUSHED = 0.5
"""Mean of a force, in its standard deviations, from which on it pushes one way. Lower: a dozen
levels drawn about zero have 0.3 by chance."""
NOWHERE = 0.3
"""Mean speed, in its standard deviations, up to which a vehicle comes back to where it was. Lower:
dives that end deeper than they begin (0.2). Higher: boats that follow such a force, if slowly."""
_WINDOWS = 50
"""Of a log, over which the rates of a measured position are taken: between samples it is noise."""
_SPEEDS = ("velocity", "surge")
"""Speeds along what a force pushes."""


def _held_against(model: Model, runs: Sequence[Run]) -> Iterator[str]:
    """A hint for forces that push one way on average while the vehicle goes nowhere.

    A heave axis whose thrust holds against the buoyancy has no drag and no mass that explain it: a
    fit ends at a mass of 22 t for 26 kg, which does not move at all.
    """
    port = next((name for name in ("force", "surge_force") if name in model.ports), "")
    speed = next((name for name in _SPEEDS if name in model.states), "")
    if not (port and speed):
        return
    speeds = np.concatenate([_speed(run, speed) for run in runs])
    if not speeds.size or abs(speeds.mean()) > NOWHERE * speeds.std():
        return
    mend = f'model + dft.effects.Formula("{port}", "push", push="N")'
    mend = 'model + "buoyancy"' if port == "force" else mend
    for name, unit in model.inputs.items():
        force = np.concatenate([run.log.inputs[name] for run in runs])
        if unit == "N" and abs(force.mean()) > PUSHED * force.std():
            yield (
                f" {name} is {number(float(force.mean()), 3)} N on average, and {speed} none: "
                "something constant (buoyancy, weight, a slope, a tare) may hold against it; add "
                f"it by {mend}."
            )


def _speed(run: Run, speed: str) -> np.ndarray:
    """The measured speed; that of the measured position where the speed is not measured."""
    if speed in run.channels:
        measured = run.channels[speed].measured
        return measured[np.isfinite(measured)]
    if speed != "velocity" or "position" not in run.channels:
        return np.zeros(0)
    position = run.channels["position"].measured
    seen = np.flatnonzero(np.isfinite(position))
    seen = seen[:: max(1, seen.size // _WINDOWS)]
    return np.diff(position[seen]) / np.diff(run.time[seen])


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

HOPELESS = 1e5
"""A value so many times the first guess is none: with an inertia of 6e5 kg m^2, begun at 1.25, the
thrusters of a Kingfisher move nothing, and what else was found stood in for them. Lower: of a
tanker's 1569 kg m^2, begun at 1.25, nothing would be believed. Higher: nothing is caught."""

MASSES = ("kg", "kg m^2")
"""Units of what can be weighed or worked out: of ten runs of a Kingfisher under its autopilot,
begun at 31 kg, 991 kg are well told, and stand in for whatever else holds it back."""

MOST_OF = 0.5
"""Power of a parameter with which another follows it that grew for the same reason. Of a tanker's
model masses and dampings follow its inertia with 0.72 to 0.83, the exponent of the force with 0.25.
Lower: what merely answers is told to grow with it. Higher: the dampings are not."""
SOMEWHAT = 1.5
"""What a scale is multiplied by that several parameters share. That tanker's masses grew by so much
once the wind was added; three times as much, along a straight valley, leaves the bent one."""


def with_runaways(fit: Fit, runs: Sequence[Run], *, doubts: bool) -> Fit:
    """The fit with notes on parameters that ran away from its ``guess``, where it began.

    The ``runs`` are those of its model over the training logs. With ``doubts`` values far beyond
    the guess are doubted; else they have their notes only.
    """
    unbounded = runaway_notes(fit, runs)
    far = [name for name, value in _suspects(fit, VERY_FAR)] if doubts else []
    heavy = _heavy(fit, {*unbounded, *far})
    fit = replace(fit, notes=(*unbounded.values(), *heavy, *fit.notes))
    if not far:
        return fit
    added, doubted, others = [], set(), fit.doubts
    for name in far:
        if name not in doubted:
            shared = _sharing(fit, name)
            added.append(_doubt_on(name, shared, fit, runs))
            doubted.update(shared)
    pointer = f" But {joined(far)} ran very far from the first guess: look at the doubts."
    together = Later(lambda: _beside(others, added))
    return replace(fit, message=fit.message + pointer, doubts=together)


def _beside(others: Sequence[Doubt], runaways: Sequence[Doubt]) -> Sequence[Doubt]:
    """All doubts; those on parameters only where no channel moves against the others.

    With two of eight commands exchanged an inertia ran to 1e6 kg m^2: it is to be fitted again, not
    to be held.
    """
    return others if any(doubt.contrary for doubt in others) else (*others, *runaways)


def _doubt_on(name: str, shared: Sequence[str], fit: Fit, runs: Sequence[Run]) -> Doubt:
    """The doubt on a parameter, or on the scale that it shares with others."""
    value, unit = fit.parameters[name].value, f" {fit.parameters[name].unit}".rstrip()
    start, end = number(fit.guess[name]), f"{number(value)}{unit}"
    if len(shared) == 1:
        evidence = f"it began at {start} and ended at {end}, more than {VERY_FAR:g} times as far"
        return Doubt(name, "runaway", f"{evidence} from zero.", _mend({name: value}))
    grew = f"{joined(shared)} grew together, {name} from {start} to {end}: they share one scale"
    larger = fit.model.replace(_along(fit, name, SOMEWHAT))
    if _error(fit, larger, runs) <= AS_LITTLE * _error(fit, fit.model, runs):
        return Doubt(
            name,
            "runaway",
            f"{grew}, which these logs do not tell well. {SOMEWHAT:g} times as much errs as little "
            "where the other parameters follow.",
            f'hold one of them at what you know of it, model.replace({{"{shared[0]}": ...}})'
            f'.fix("{shared[0]}"), or fit logs that tell the others from it.',
        )
    return Doubt(name, "runaway", f"{grew}.", _mend({n: fit.parameters[n].value for n in shared}))


def _mend(values: Mapping[str, float]) -> str:
    begun = ", ".join(f'"{name}": {value:.3g}' for name, value in values.items())
    return (
        "look at the units and scales of the channels, whose mistakes a parameter takes on; if the "
        f"value is right, begin there: model.replace({{{begun}}})."
    )


def _sharing(fit: Fit, name: str) -> tuple[str, ...]:
    """The parameters that grew with one that ran very far, itself among them."""
    followers = {n for n, power in _powers(fit, name).items() if power >= MOST_OF}
    grown = {n for n, _ in _suspects(fit, FAR)}
    return tuple(n for n in fit.free if n == name or n in followers & grown)


def _powers(fit: Fit, name: str) -> dict[str, float]:
    """With which power of a parameter each other one follows it, where it errs least."""
    at = fit.free.index(name)
    value = [fit.parameters[n].value for n in fit.free]
    row = fit.covariance[at] / fit.covariance[at, at]
    powers = {n: row[k] * value[at] / value[k] for k, n in enumerate(fit.free) if value[k] != 0}
    with np.errstate(over="ignore"):  # of three samples, whose covariance is rounding
        return {n: float(p) for n, p in powers.items() if np.isfinite(np.float_power(SOMEWHAT, p))}


def _along(fit: Fit, name: str, times: float) -> dict[str, float]:
    """The values of all parameters where one is so many times as large, within their bounds."""
    values = {n: fit.parameters[n].value * times**power for n, power in _powers(fit, name).items()}
    ends = {n: fit.model.parameters[n].limits for n in values}
    return {n: min(max(value, ends[n][0]), ends[n][1]) for n, value in values.items()}


def runaway_notes(fit: Fit, runs: Sequence[Run]) -> dict[str, str]:
    """A sentence with a mend for each parameter that ran away, by its name."""
    ends = {name: p.limits for name, p in fit.model.parameters.items()}
    suspects = [
        (name, value)
        for name, value in _suspects(fit, FAR)
        if ends[name][0] <= FURTHER * value <= ends[name][1]
    ]
    if not suspects or not np.isfinite(fit.train.nrmse):
        return {}
    error, samples = _error(fit, fit.model, runs), _independent(runs)
    notes = {}
    for name, value in suspects:
        further = _error(fit, fit.model.replace({name: FURTHER * value}), runs)
        ratio = further / error
        if ratio <= AS_LITTLE and samples * math.log(ratio) <= UNTOLD:
            unit = f" {fit.parameters[name].unit}".rstrip()
            notes[name] = (
                f"{name} runs away: from {number(fit.guess[name])} to {number(value)}{unit}, and "
                f"{FURTHER:g} times as much errs as little. These logs do not bound it: hold it at "
                f'what you know of it, model.replace({{"{name}": ...}}).fix("{name}"), give it an '
                "upper bound, or fit logs that excite what it acts on."
            )
    return notes


def _heavy(fit: Fit, said: Collection[str]) -> Iterator[str]:
    """A sentence on masses that are many times what they began with, but for those said already."""
    grown = {n: fit.parameters[n].unit for n, _ in _suspects(fit, FAR) if n not in said}
    names = [name for unit in MASSES for name in grown if grown[name] == unit]
    if names:
        times = [number(fit.parameters[name].value / fit.guess[name], 2) for name in names]
        held = f'model.replace({{"{names[0]}": ...}}).fix("{names[0]}")'
        yield (
            f"{joined(names)} ended at {joined(times)} times where the fit began, and may stand in "
            "for what is missing, which dft.diagnose(fit, logs) may name. Hold what was weighed or "
            f"worked out: {held}."
        )


def farthest_runaway(fit: Fit, guess: Mapping[str, float]) -> tuple[str, float] | None:
    """The parameter that ran away by so much that nothing a fit says is to be believed; its value.

    From the ``guess``, where the parameters in question began: other fits may have gone before.
    """
    began = replace(fit, guess={**fit.guess, **guess})
    far = [each for each in _suspects(began, HOPELESS) if each[0] in guess]
    return max(far, key=lambda each: abs(each[1]) / max(abs(guess[each[0]]), 1e-300), default=None)


def _suspects(fit: Fit, times: float) -> Iterator[tuple[str, float]]:
    """Free parameters, away from their bounds, at so many times where they began.

    The mean of what differs by log is bound by the values: it is not where the logs begin.
    """
    for name in (name for name in fit.free if name not in fit.per_log):
        estimate, parameter = fit.parameters[name], fit.model.parameters[name]
        size = max(abs(fit.guess[name]), abs(parameter.null or 0.0))
        # a logarithm without an upper bound is stopped fifteen decades up: the inertia of a
        # BlueBoat whose sides are exchanged ended there, at 2e15 kg m^2
        bounded = estimate.at_bound and math.isfinite(parameter.limits[int(estimate.value > 0)])
        if size > 0 and not bounded and abs(estimate.value) >= times * size:
            yield name, estimate.value


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

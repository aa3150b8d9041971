"""What a fit does not explain, and what its user may look at first."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from diffthrust._support.words import joined, number, percent
from diffthrust.estimation._wiring import wiring_doubts
from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model
from diffthrust.simulation._errors import Errors
from diffthrust.simulation._runs import Run
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

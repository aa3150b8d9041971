"""What came of a closed loop: its signals, its log, and how well it followed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.figures import showing
from diffthrust.control._assembly import LoopAssembly
from diffthrust.control._plant import driven
from diffthrust.control._recorded import RunSignals, bounded
from diffthrust.logs._log import Log

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Tracking(NamedTuple):
    """How well a reference was followed, in the unit of the channel that followed.

    Args:
        rms: root mean square of the error.
        largest: the largest error.
        relative: ``rms`` over the standard deviation of the reference; NaN where it is constant.

    Example:
        >>> run.tracking(start=5.0)._fields
        ('rms', 'largest', 'relative')
    """

    rms: float
    largest: float
    relative: float


@dataclass(frozen=True, eq=False, repr=False)
class LoopRun(RunSignals):
    """A closed loop's run.

    Args:
        loop: what was run.
        time: recorded samples [s], ``(n,)``; up to where the loop ran away.
        signals: every signal at these samples, ``(n,)`` each: ``reference``, ``error`` (of what
            is, not of what was measured), ``wanted_thrust``, ``command`` (as it is sent; a log's
            input), ``motor_command`` (after faults and the effects on it), outputs and states by
            name, memories such as ``compensator.load_estimate``, ``measured.CHANNEL``.
        units: their units.
        diverged: the time [s] at which a signal was no longer finite, or larger than any that
            can be meant; ``None`` where the loop stayed bounded.

    Example:
        >>> sorted(run.units)[:3]
        ['command', 'error', 'measured.position']
        >>> run.tracking(start=5.0).rms < 0.1
        True
        >>> run.log.inputs.keys(), run.vehicle_log.inputs.keys()
        (dict_keys(['command', 'inflow']), dict_keys(['thrust']))
        >>> figure = run.plot()
    """

    loop: LoopAssembly
    time: np.ndarray
    signals: Mapping[str, np.ndarray]
    units: Mapping[str, str]
    diverged: float | None

    @cached_property
    def log(self) -> Log:
        """The run as a recorded experiment on the thruster.

        Inputs: ``command`` as it was sent, held between samples; ``inflow`` (the vehicle's
        velocity) where there is a vehicle; constant ones. Measured: what sensors report, with
        noise, of thruster and vehicle. Everything that reads a log reads this one.
        """
        thruster = self.loop.thruster
        inputs = {driven(thruster): self["command"]}
        inputs |= {n: np.full(self.time.size, float(v)) for n, v in self.loop.given.items()}
        if "velocity" in self.signals and "inflow" in thruster.optional_inputs:
            inputs["inflow"] = self["velocity"]
        units = {**thruster.inputs, **thruster.optional_inputs, **self.units}
        measured = self._measured()
        return Log(
            time=self.time,
            inputs=inputs,
            measured=measured,
            units={name: units[name] for name in (*inputs, *measured) if name in units},
            hold={name: "linear" if name == "inflow" else "zero" for name in inputs},
            name="loop",
            notes=self.notes_of(type(self.loop.controller).__name__),
        )

    @cached_property
    def vehicle_log(self) -> Log:
        """The run as a recorded experiment on the vehicle: its input is the thrust as it was.

        Raises:
            InputError: the loop has no vehicle.
        """
        vehicle = self.loop.vehicle
        if vehicle is None:
            raise InputError("The loop has no vehicle.", "Use run.log.")
        measured = {n: v for n, v in self._measured().items() if n in vehicle.outputs}
        return Log(
            time=self.time,
            inputs={"thrust": self["thrust"]},
            measured=measured,
            units={name: self.units[name] for name in ("thrust", *measured)},
            hold="linear",
            name="loop",
            notes=self.notes_of(type(self.loop.controller).__name__),
        )

    def _measured(self) -> dict[str, np.ndarray]:
        kind = "measured."
        return {n.removeprefix(kind): v for n, v in self.signals.items() if n.startswith(kind)}

    def tracking(self, start: float | None = None, stop: float | None = None) -> Tracking:
        """The error from one time to another.

        Args:
            start: when the transient counts as over [s]; by default a third of the run.
            stop: the end [s]; by default that of the run.

        Raises:
            InputError: no sample lies between them.
        """
        within = self.within("tracking", start, stop)
        error, size = self["error"][within], float(np.std(self["reference"][within]))
        rms = float(np.sqrt(np.mean(error**2)))
        # a constant reference leaves a standard deviation of rounding
        relative = rms / size if size > 1e-12 * (1.0 + rms) else float("nan")
        return Tracking(rms, float(np.max(np.abs(error))), relative)

    @showing
    def plot(self) -> Figure:
        """Reference and position, error, thrust, command and estimates over time."""
        from diffthrust.control._figures import run_figure

        return run_figure(self, self.loop, self.units)


def run_of(
    loop: LoopAssembly, rows: Mapping[str, np.ndarray], signals: Mapping[str, np.ndarray]
) -> LoopRun:
    """The run, cut where it ran away.

    Raises:
        InputError: it ran away before a second sample.
    """
    of = loop.controller.of
    signals = dict(signals)
    if loop.controller.gives != "thrust":
        del signals["wanted_thrust"]
    with np.errstate(invalid="ignore"):
        signals = {"reference": rows["wanted"], "error": rows["wanted"] - signals[of], **signals}
    time, signals, diverged = bounded(
        rows["time"],
        signals,
        "Look at the units of the gains, the rate of the controller and substeps.",
    )
    return LoopRun(loop, time, signals, _units(loop, signals), diverged)


def _units(loop: LoopAssembly, signals: Mapping[str, np.ndarray]) -> dict[str, str]:
    models = [model for model in (loop.thruster, loop.vehicle) if model is not None]
    units = {n: u for m in models for n, u in {**m.all_states, **m.outputs}.items()}
    units |= dict.fromkeys(("reference", "error"), units.get(loop.controller.of, ""))
    command = loop.thruster.inputs[driven(loop.thruster)]
    units |= {"command": command, "motor_command": command, "wanted_thrust": "N"}
    for name, block in (("controller", loop.controller), ("compensator", loop.compensator)):
        units |= {f"{name}.{n}": u for n, u in (block.states if block else {}).items()}
    return {name: units.get(name.removeprefix("measured."), "") for name in signals}

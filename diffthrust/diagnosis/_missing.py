"""What the errors of a model still depend on, as data: missing signals, remaining structure."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from diffthrust._support.results import Brief
from diffthrust._support.words import humanize, joined, number
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.logs._written import ShownUnits
from diffthrust.models._base.effect import Effect
from diffthrust.models._base.model import Model


@dataclass(frozen=True)
class SignalForm:
    """A signal on which something may depend: one of the model, its rate, or its recent past.

    Args:
        name: an input, a state, or "time", which begins with each log.
        rate: its rate of change.
        past: its mean over about so many seconds [s] up to now.
        wave: waves along it, so long each, in its unit.
        unit: of a wave's length.
        after: the effects through which an input has gone before, in words.

    Example:
        >>> str(SignalForm("speed", rate=True)), str(SignalForm("command", past=2.0))
        ('d(speed)/dt', 'the last 2 s of command')
    """

    name: str
    rate: bool = False
    past: float | None = None
    wave: float | None = None
    unit: str = ""
    after: str = field(default="", compare=False)

    def __str__(self) -> str:
        return f"{self._words}{self.after}"

    @property
    def _words(self) -> str:
        if self.wave is not None:
            return f"{self.name}, repeating every {number(self.wave, 2)} {self.unit}".rstrip()
        if self.past is not None:
            return f"the last {self.past:.2g} s of {self.name}"
        return f"d({self.name})/dt" if self.rate else self.name


def after_effects(model: Model, effects: Iterable[Effect], signals: Collection[str]) -> str:
    """Through which effects inputs have gone before they are what the model reads, in words.

    With the thrusters of a BlueBoat exchanged a curve of left_force is one of the logged
    right_force, and was checked against the other: " (after swapped thrusters)". Effects on
    channels act on readings, not on states.
    """
    inputs = ({*signals} & {*model.inputs, *model.optional_inputs}) - {*model.states}
    names = [humanize(effect.name) for effect in effects if {*effect.ports} & inputs]
    return f" (after {joined(names)})" if names else ""


@dataclass(frozen=True, repr=False)
class Missing(Brief):
    """The signal that is missing at one port, estimated without assuming its form.

    Args:
        port: the port; ``unit`` that of the signal there.
        runs: for each training log the time stamps, the signal and its standard error, ``(T,)``.
        signal: the model's signal on which it depends most, ``None`` where on none.
        dependence_unit: the unit of that signal.
        share: share of the missing signal's variance that the dependence explains.
        gain: likelihood ratio of the dependence; 0 without one.
        p_value: of the test that it depends on nothing, allowing for all signals tried.
        curve: its mean as a function of that signal: abscissa, mean and standard error, each
            ``(K,)``; empty without a dependence.
        logs: names of the training logs.
    """

    port: str
    unit: str
    runs: tuple[tuple[np.ndarray, np.ndarray, np.ndarray], ...] = field(repr=False)
    signal: SignalForm | None
    dependence_unit: str
    share: float
    p_value: float
    curve: tuple[np.ndarray, np.ndarray, np.ndarray] = field(repr=False)
    logs: tuple[str, ...] = ()
    gain: float = 0.0

    @property
    def depends_on(self) -> str | None:
        """The signal on which it depends most, in words."""
        return None if self.signal is None else str(self.signal)

    @property
    def size(self) -> float:
        """Root mean square of the signal over all logs."""
        return float(np.sqrt(np.mean(np.concatenate([run[1] for run in self.runs]) ** 2)))

    @property
    def error(self) -> float:
        """Root mean square of its standard error; NaN where it is not known."""
        return float(np.sqrt(np.mean(np.concatenate([run[2] for run in self.runs]) ** 2)))

    @property
    def shows(self) -> bool:
        """Whether it depends on a signal, or is clearly larger than its error.

        A signal of no size is none: what acts there reaches no measurement.
        """
        return self.signal is not None or (
            self.size > 0 and not self.size < SETTINGS.structure.signal_over_error * self.error
        )

    def shown(self, model: Model, units: ShownUnits) -> Missing:
        """The same in the units for people: of the output that the port's unit is that of."""
        outputs = (name for name, unit in model.outputs.items() if unit == self.unit)
        per, unit = units.size(next(outputs, ""), 1.0, self.unit)
        runs = tuple((time, per * signal, per * error) for time, signal, error in self.runs)
        over, mean, error = self.curve
        under = self.dependence_unit
        if self.signal is not None and self.signal.rate:
            size, name = units.size(self.signal.name, 1.0, under.removesuffix("/s"))
            over, under = size * over, f"{name}/s"
        elif self.signal is not None:
            over = units.values(self.signal.name, over, under)
            under = units.unit(self.signal.name, under)
        curve = over, per * mean, per * error
        return replace(self, unit=unit, runs=runs, dependence_unit=under, curve=curve)


@dataclass(frozen=True)
class Remaining:
    """Structure that none of the effects tried explains.

    Args:
        port: where it enters.
        signal: the signal on which it depends.
        share: share of the squared one-step errors at that place that it explains.
        manner: whether something is added there, or what is there is scaled.
        gain: likelihood ratio that a function of the signal promises.
    """

    port: str
    signal: SignalForm
    share: float
    manner: Literal["adds", "scales"] = "adds"
    gain: float = float("nan")

    @property
    def depends_on(self) -> str:
        """The signal on which it depends, in words."""
        return str(self.signal)

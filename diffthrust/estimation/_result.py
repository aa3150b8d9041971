"""The result of a fit, and its report."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.files import plain
from diffthrust._support.later import Later
from diffthrust._support.report import (
    Line,
    Outcome,
    Report,
    Rows,
    Section,
    Styled,
    closing_section,
    notes,
)
from diffthrust._support.results import Result
from diffthrust._support.saved_file import write_saved
from diffthrust._support.words import number
from diffthrust.estimation._arguments import WORDS
from diffthrust.estimation._estimate import Estimate, noise_rows, parameter_rows
from diffthrust.estimation._origin import Origin, closing
from diffthrust.estimation._per_log import PerLog, per_log_section
from diffthrust.estimation._status import Checks, Status
from diffthrust.export._export import ExportTo, exported
from diffthrust.export._source import Exported, ExportSource
from diffthrust.export._trace import read_inputs
from diffthrust.logs._identity import LogIdentity
from diffthrust.logs._log import Log
from diffthrust.logs._written import ShownUnits, Written
from diffthrust.models._base.model import Model
from diffthrust.simulation._errors import Errors
from diffthrust.soundness._doubt import Doubt

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, repr=False)
class Fit(Result):
    """The result of a fit.

    Args:
        model: the model at the estimated parameters.
        parameters: an `Estimate` for each parameter, by full name.
        covariance: of the parameters in ``free``, ``(k, k)``, in their units; NaN where undefined.
        free: names of the rows of the covariance.
        status: what may be claimed.
        message: why, in a sentence.
        checks: the figures behind the status.
        noise: standard deviation of each measured channel's noise, given or estimated; of an
            "innovations" fit that of the one-step prediction's error.
        train: errors on the training logs, each simulated over its whole length.
        holdout: the same on unseen logs, or ``None``.
        log_likelihood: of the training logs, with any priors, without constants of the noise law:
            comparable between models on the same logs, not between losses.
        initial: estimated initial states of each training log, and its numbers ``per_log``.
        horizon: length [s] of the segments of the last stage; ``None`` for whole runs.
        likelihood: "simulation" or "innovations".
        loss: "gaussian" or "student_t".
        noise_model: "white" or "ar1".
        disturbance: gains and memories of the random forces and of lasting sensor errors, by name,
            estimated with the parameters of an "innovations" fit, or the correlation of "ar1"
            noise from one step to the next; ``None`` otherwise.
        substeps: integrator steps per sample that were used.
        held: initial states were taken as measured, not estimated.
        limits: by channel the size of a large one-step error, for an "innovations" fit with
            ``loss="student_t"``; ``None`` otherwise.
        reach: errors of more than so many times these sizes correct the states no further.
        guess: the values from which the search began, by full name.
        notes: what the user should know besides.
        ranges: the smallest and largest value of each input in the training logs, in the model's
            units.
        hold: how each input ran between the samples, "zero" or "linear".
        written: how the training logs wrote each channel that the model reads or gives.
        origin: when and with which versions it was made, and of which logs.
        correlation: the notes that say why standard errors, and all that follows from them, are
            too small.
        coarse: the note that says that the optimum needs finer integrator steps than it has.
        doubts: what in the logs is probably not what its name, unit or clock says
            (`diffthrust.soundness.doubts`), channels of which the fit explains little, and
            parameters that ran very far from where they began. They are looked for at the first
            look at any of them.
        per_log: mean, width and the value of each training log of the parameters that differ by
            log, by full name.
        doubts_sought: whether the logs are looked at for doubts.
        logs: the training logs, then the unseen ones, for `plot`; empty for a fit from a file or
            from another process.

    Example:
        >>> fit.status.value, fit.status.ok, fit.free
        ('converged', True, ('alpha', 'beta', 'ct'))
        >>> fit.parameters["alpha"].unit, fit.covariance.shape
        ('1/rad', (3, 3))
        >>> fit.train.nrmse < 0.05, fit.holdout.nrmse < 0.05
        (True, True)
        >>> print(fit.report().splitlines()[0][:40])
        thruster
    """

    model: Model
    parameters: Mapping[str, Estimate]
    covariance: np.ndarray = field(repr=False)
    free: tuple[str, ...]
    status: Status
    message: str
    checks: Checks
    noise: Mapping[str, float]
    train: Errors
    holdout: Errors | None
    log_likelihood: float
    initial: tuple[Mapping[str, float], ...] = field(repr=False)
    horizon: float | None
    substeps: int
    notes: tuple[str, ...]
    likelihood: str = "simulation"
    loss: str = "gaussian"
    noise_model: str = "white"
    disturbance: Mapping[str, Estimate] | None = field(default=None, repr=False)
    held: bool = False
    limits: Mapping[str, float] | None = field(default=None, repr=False)
    reach: float = 1.0
    guess: Mapping[str, float] = field(default_factory=dict, repr=False)
    origin: Origin | None = field(default=None, repr=False)
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict, repr=False)
    hold: Mapping[str, str] = field(default_factory=dict, repr=False)
    written: Mapping[str, Written] = field(default_factory=dict, repr=False)
    correlation: tuple[str, ...] = field(default=(), repr=False)
    coarse: tuple[str, ...] = field(default=(), repr=False)
    doubts: tuple[Doubt, ...] | Later[Doubt] = field(default=(), repr=False)
    doubts_sought: bool = True
    per_log: Mapping[str, PerLog] = field(default_factory=dict, repr=False)
    logs: tuple[Log, ...] = field(default=(), repr=False, compare=False, metadata={"saved": False})

    def __getstate__(self) -> dict[str, Any]:
        # Worker processes send thousands of fits back, whose logs the caller has.
        return {**vars(self), "logs": ()}

    @property
    def data(self) -> tuple[LogIdentity, ...]:
        """The training logs, by name, length and hash.

        Example:
            >>> fit.data[0].name, fit.data[0].samples
            ('run1.csv', 240)
        """
        return self.origin.train if self.origin else ()

    def own_numbers(self, log: Log) -> dict[str, float]:
        """The parameters that differ by log of a training log; none for a log it did not see.

        Example:
            >>> fit.own_numbers(log)  # of a model whose numbers are the same in all logs
            {}
        """
        marks = [identity.sha256 for identity in self.data]
        if not self.per_log or log.sha256 not in marks:
            return {}
        numbers = self.initial[marks.index(log.sha256)]
        return {name: numbers[name] for name in self.per_log}

    @property
    def noise_of_runs(self) -> Mapping[str, float]:
        """Standard deviation of the errors of whole runs by channel, as far as the fit tells.

        That of the sensors; of an innovations fit none, for random forces add to it in a run.

        Example:
            >>> fit.noise_of_runs == fit.noise
            True
        """
        return {} if self.disturbance is not None else self.noise

    @property
    def begins_freely(self) -> bool:
        """Whether initial states were estimated that a sensor tells of.

        Example:
            >>> fit.begins_freely  # where the speed begins was estimated
            True
        """
        return any(name in self.train.channels for states in self.initial for name in states)

    @property
    def options(self) -> dict[str, Any]:
        """The arguments of `fit` that lead to the same likelihood.

        The horizon only if it is one: a fit of whole runs may have come there by segments.

        Example:
            >>> fit.options["likelihood"]
            'simulation'
            >>> again = dft.fit(fit.model, log, starts=1, **fit.options)
        """
        arguments: dict[str, Any] = {name: getattr(self, name) for name in WORDS}
        if self.horizon is not None:
            arguments["horizon"] = self.horizon
        if not self.begins_freely:
            arguments["initial"] = "measured"
        elif self.horizon is not None and not self.held:
            arguments["initial"] = "estimate"
        return arguments

    def _line(self) -> str:
        if self.status is Status.SIMULATION_FAILED:
            return f"{self.model}: {self.status}. {self.message}"
        unseen = f", {self.holdout.nrmse:.3g} on unseen ones" if self.holdout else ""
        return f"{self.model}: {self.status}, NRMSE {self.train.nrmse:.3g} on training logs{unseen}"

    def _report(self) -> Report:
        status = Styled(self.status.value, "good" if self.status.ok else "bad")
        return Report(
            Section(
                "",
                Styled(str(self.model), "strong"),
                *doubt_lines(self.doubts),
                Outcome("Status", status, self.message),
            ),
            Section("", parameter_rows(self.parameters)),
            per_log_section(self.per_log),
            Section("", noise_rows(self.disturbance or {})),
            Section(
                "",
                error_rows([("training", self.train), ("unseen", self.holdout)]),
                *notes(self.notes),
            ),
            closing_section(closing(self.origin, self.model)),
        )

    def plot(self, logs: Log | Sequence[Log] | None = None) -> Figure:
        """Measured and modelled on top, residual below, for each channel of each log.

        Args:
            logs: the logs to show; by default the unseen ones, or those of the training where
                there were none.

        Raises:
            InputError: the fit was loaded from a file, or comes from another process, and no logs
                are given.

        Example:
            >>> fit.plot().savefig("unseen.png")
        """
        # A comparison draws it; it is above this layer, and reached by the door of the package.
        from diffthrust import compare

        logs = logs if logs is not None else self.logs[len(self.data) :] or self.logs
        if not logs:
            raise InputError(
                "A fit from a file or from another process has no logs to draw.",
                "Give them: fit.plot(logs).",
            )
        return compare(self, logs).plot()

    def save(self, path: Path | str) -> None:
        """Write the fit to a JSON file from which `load` makes it again, to the last digit.

        Args:
            path: the file to write, ending in ``.json``.

        Raises:
            InputError: another ending, a folder that cannot be written to, or a model of your own
                with an argument that cannot be written down.

        Example:
            >>> fit.save("run1.fit.json")
            >>> dft.load("run1.fit.json").status
            <Status.CONVERGED: 'converged'>
        """
        write_saved(path, "fit", self.origin, self)

    def export(
        self,
        to: ExportTo,
        path: Path | str | None = None,
        *,
        limits: tuple[float, float] | None = None,
    ) -> Exported:
        """Take the fitted model with its effects to another program.

        Args:
            to: "python" (a module that needs nothing but ``math``) or "c" (a C99 header), each
                with a ``reset`` and a ``step`` that give what `simulate` gives; "lut" (a table of
                force and command in the steady state, as CSV or as a C header, by the ending of
                ``path``); "gz" (gz-sim), "uuv" (uuv_simulator) or "stonefish": the thruster as
                these describe it, or each thruster of a craft with its place.
            path: the file to write, or ``None``. Names inside begin with its name.
            limits: lowest and highest command of the table, and of the simulators' thrusters, in
                the unit of the logs; by default as in the training logs.

        Returns:
            An `Exported`: ``text``, and ``notes`` on what the target cannot express.

        Raises:
            InputError: an unknown target, another ending of the file, a failed fit, an operation of
                the model without a translation, or a model that the target has no place for.

        Example:
            >>> fit.export("c", "thruster.h").notes
            ()
        """
        from diffthrust import __version__

        if self.status is Status.SIMULATION_FAILED:
            raise InputError(
                f"This fit failed, so that there is nothing to export. {self.message}",
                "Fit again, from other values or with narrower bounds.",
            )
        errors = {n: e.std_error for n, e in self.parameters.items() if e.std_error is not None}
        source = ExportSource(
            self.model,
            read_inputs(self.model, self.ranges),
            ranges=self.ranges,
            linear=tuple(name for name, hold in self.hold.items() if hold == "linear"),
            substeps=self.substeps,
            errors=errors,
            provenance=(
                f"Fit: {self.status}. {self.message}",
                *(self.origin.sentences if self.origin else ()),
            ),
            version=__version__,
            units=ShownUnits((self.written,)),
        )
        result = exported(source, to, path, limits)
        if self.status.ok:
            return result
        return replace(result, notes=(f"The fit is {self.status}: {self.message}", *result.notes))

    def to_json(self) -> dict[str, Any]:
        """The fit as plain data, in the form that ``diffthrust fit --json`` writes.

        Example:
            >>> list(fit.to_json())[:5]
            ['schema', 'model', 'effects', 'status', 'parameters']
        """
        written = {
            "schema": 1,
            "model": self.model.name,
            "effects": [effect.name for effect in self.model.effects],
            "status": self.status.value,
            "parameters": {name: e.to_json() for name, e in self.parameters.items()},
            "train": self.train.to_json(),
            "holdout": self.holdout.to_json() if self.holdout else None,
            "checks": dict(vars(self.checks)),
            "doubts": [doubt.to_json() for doubt in self.doubts],
        }
        if self.per_log:
            written["per_log"] = {name: by.to_json() for name, by in self.per_log.items()}
        return plain(written)


def doubt_lines(doubts: Iterable[Doubt]) -> Iterator[Line]:
    """What to look at before anything else; mostly nothing."""
    for doubt in doubts:
        name = Styled(f"Doubt: {doubt.channel} ({doubt.kind}): ", "doubtful")
        yield Line((name, f"{doubt.evidence}\nMend: {doubt.mend}"))


def error_rows(errors: Iterable[tuple[str, Errors | None]]) -> Rows:
    """Errors by log and channel, and over all channels."""
    headings = ("Logs", "Channel", "RMSE", "Unit", "NRMSE", "Fit %", "Samples")
    blocks = tuple(tuple(_channel_rows(logs, e)) for logs, e in errors if e is not None)
    return Rows(headings, blocks, numbers=(2, 4, 5, 6))


def _channel_rows(logs: str, errors: Errors) -> Iterator[tuple[str, ...]]:
    for name, e in errors.channels.items():
        # + 0.0 turns -0.0 into 0.0
        percent = f"{round(e.fit_percent, 1) + 0.0:.1f}" if math.isfinite(e.fit_percent) else "-"
        size, unit = _error_cell(e.shown.value), e.shown.unit
        yield logs, name, size, unit, _error_cell(e.nrmse), percent, str(e.samples)
    if len(errors.channels) > 1:
        total = (logs, "all", "", "", _error_cell(errors.nrmse), "", "")
        yield tuple(Styled(cell, "strong") for cell in total)


def _error_cell(value: float) -> str:
    """An error as text; ``-`` where the simulation failed."""
    return number(value) if math.isfinite(value) else "-"

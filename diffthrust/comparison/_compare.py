"""A model held against logs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.figures import showing
from diffthrust._support.files import plain
from diffthrust._support.names import listing
from diffthrust._support.report import Bullets, Report, Section, Styled, closing_section
from diffthrust._support.results import Result
from diffthrust.comparison._agreement import Agreement, agreement, hints, outstanding
from diffthrust.comparison._derived_signals import signals_of, units_of
from diffthrust.comparison._regimes import Regime, worst_regimes
from diffthrust.comparison._residual_tests import (
    NoiseAdvice,
    ResidualTests,
    noise_advice,
    residual_tests,
)
from diffthrust.estimation._arguments import LIKELIHOODS
from diffthrust.estimation._origin import Origin, closing, origin_of, taken_part
from diffthrust.estimation._result import error_rows
from diffthrust.estimation._status import Status
from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model
from diffthrust.simulation._errors import Errors, errors
from diffthrust.simulation._record import are_tables, bind
from diffthrust.simulation._runs import (
    Run,
    failures,
    pooled_errors,
    runs_over,
    shown_of,
    start_notes,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from diffthrust.estimation._result import Fit

_TELLING = 50
"""Fewer samples do not distinguish laws of noise."""


@dataclass(frozen=True, repr=False)
class Comparison(Result):
    """A model held against logs.

    Args:
        model: the model.
        runs: one for each log, simulated over its whole length: its ``log``, ``channels`` (measured
            and modelled), ``errors`` and ``signals``.
        errors: errors by channel, pooled over the runs.
        fit: the fit that the model is from, if it is from one.
        origin: when and with which versions it was made, and of which logs.

    What takes longer is worked out when it is first asked for: ``tests`` of the residuals, the
    ``regimes`` in which the error sits, the ``agreement`` of measured and modelled, and ``hints``
    on channels that do not mean what their names say.

    Example:
        >>> comparison = dft.compare(fit, unseen)
        >>> list(comparison.errors.channels), comparison.errors.nrmse < 0.05
        (['speed', 'thrust'], True)
        >>> comparison.failures, comparison.hints, comparison.outstanding, comparison.regimes
        ((), (), (), ())
        >>> sorted(comparison.tests), comparison.agreement["speed"].correlation > 0.99
        (['speed', 'thrust'], True)
        >>> comparison.noise_advice.noise_model, comparison.noise_advice.loss
        ('white', 'gaussian')
        >>> for heading, sentences in comparison.findings:
        ...     print(heading)
        Where the error sits (inputs as recorded, other signals as modelled)
        Is the residual noise?
        >>> comparison.tabular, comparison.one_step is None  # of fits with likelihood="innovations"
        (False, True)
        >>> print(comparison.closing[1])
        Logs: run2.csv ...
        >>> list(comparison.to_json())[:5]
        ['schema', 'model', 'effects', 'failures', 'errors']
        >>> comparison.plot().savefig("unseen.png")
        >>> residuals = comparison.plot_residuals()
    """

    model: Model
    runs: tuple[Run, ...]
    errors: Errors
    fit: Fit | None = field(default=None, repr=False)
    origin: Origin | None = field(default=None, repr=False)

    @cached_property
    def one_step(self) -> Errors | None:
        """Errors of predicting each sample from all earlier ones, by an "innovations" fit.

        ``None`` for any other.

        Raises:
            InputError: no run measures a state.
        """
        if self.fit is None or self.fit.disturbance is None:
            return None
        from diffthrust.estimation._rebuild import one_step

        substeps = max(run.substeps for run in self.runs)
        predicted = one_step(self.fit, [run.record for run in self.runs], substeps)
        pairs: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
        for run, rests in zip(self.runs, predicted, strict=True):
            for name, residual in rests.items():
                pairs.setdefault(name, []).append((run.channels[name].measured, residual))
        return errors(pairs, self.model.outputs, shown_of(self.runs))

    @cached_property
    def tests(self) -> Mapping[str, ResidualTests]:
        """Whiteness of the residual of each channel, and its correlation with the signals.

        Empty for tables of readings, whose order means nothing.
        """
        if self.tabular:
            return {}
        by_channel = {
            name: residual_tests(
                name,
                [run.shown_channels[name].residual for run in runs],
                [signals_of(self.model, run) for run in runs],
                step=float(np.median(np.concatenate([np.diff(run.time) for run in runs]))),
                unit=runs[0].shown_channels[name].unit,
            )
            for name, runs in self._having.items()
        }
        return {name: tests for name, tests in by_channel.items() if tests is not None}

    @property
    def _having(self) -> dict[str, list[Run]]:
        """The runs that have each channel."""
        return {n: [r for r in self.runs if n in r.channels] for n in self.errors.channels}

    @cached_property
    def regimes(self) -> tuple[Regime, ...]:
        """Where the squared error of each channel gathers; at most two regimes a channel.

        Over all channels, noise alone gets a regime named in at most 5 % of comparisons.
        """
        regimes: list[Regime] = []
        for name, runs in self._having.items():
            regimes += worst_regimes(
                name,
                [run.channels[name].residual for run in runs],
                [None if self.tabular else run.time for run in runs],
                [signals_of(self.model, run) for run in runs],
                units_of(runs[0]),
                plain=self.model.angles,
                inputs=runs[0].record.inputs,
                channels=len(self.errors.channels),
            )
        return tuple(regimes)

    @cached_property
    def agreement(self) -> Mapping[str, Agreement]:
        """How each measured channel follows the modelled one: correlation, gain and lag."""
        pairs = ((name, agreement(self.model, self.runs, name)) for name in self.errors.channels)
        return {name: a for name, a in pairs if a is not None}

    @cached_property
    def hints(self) -> tuple[str, ...]:
        """Sentences on channels that may not mean what their names say; mostly none."""
        return hints(self.model, self.runs, self.agreement.values())

    @cached_property
    def outstanding(self) -> tuple[str, ...]:
        """Sentences on runs whose errors stand out from those of the others; mostly none."""
        return tuple(entry.sentence for entry in outstanding(self.runs))

    @property
    def failures(self) -> tuple[str, ...]:
        """For each run that left the finite numbers when, and by which state; mostly none."""
        return failures(self.runs)

    @cached_property
    def noise_advice(self) -> NoiseAdvice | None:
        """Which noise the residuals look like, as arguments of `fit`.

        ``None`` for tables of readings, for runs too short to tell, and where a simulation failed.
        """
        samples = sum(e.samples for e in self.errors.channels.values())
        if self.tabular or self.failures or samples < _TELLING:
            return None
        return noise_advice(
            {n: [run.channels[n].residual for run in runs] for n, runs in self._having.items()},
            {n: [run.time for run in runs] for n, runs in self._having.items()},
        )

    @property
    def tabular(self) -> bool:
        """Whether the logs are tables of readings, without a time of their own."""
        return are_tables(run.record for run in self.runs)

    @showing
    def plot(self, runs: Sequence[str] | None = None) -> Figure:
        """Measured and modelled on top, residual below, for each channel.

        Args:
            runs: names of the runs to show; all by default.

        Raises:
            InputError: a run that does not exist.
        """
        from diffthrust.comparison._figures import comparison_figure

        names = [run.name for run in self.runs]
        unknown = [name for name in runs or () if name not in names]
        if unknown:
            raise InputError(
                f"The comparison has no run {listing(unknown)}; it has {listing(names)}.",
                "Correct the name.",
            )
        shown = self.runs if runs is None else tuple(r for r in self.runs if r.name in runs)
        return comparison_figure(self.model, shown)

    @showing
    def plot_residuals(self) -> Figure:
        """For each channel the residual with its worst regime, and its correlations.

        One row for each channel: the residual against time with the regime shaded, against the
        signal of the regime, its autocorrelation, and its correlation with the signal to which it
        is most related.
        """
        from diffthrust.comparison._figures import residual_figure

        return residual_figure(
            self.model, self.runs, list(self.errors.channels), self.regimes, self.tests
        )

    @property
    def findings(self) -> list[tuple[str, list[str]]]:
        """What was found besides errors: headings with their sentences; none is empty."""
        regimes = [regime.sentence for regime in self.regimes]
        if not regimes and not self.tabular and not self.failures:
            regimes = ["No regime stands out from what chance would give."]
        noise = [tests.sentence for tests in self.tests.values()]
        fit, advice = self.fit, self.noise_advice
        followed = fit and (
            LIKELIHOODS[fit.likelihood].corrects
            or (advice and (fit.noise_model, fit.loss) == (advice.noise_model, advice.loss))
        )
        if advice and not followed:
            noise.append(advice.sentence)
        doubts = [str(doubt) for doubt in fit.doubts] if fit else []
        parts = [
            (Status.SIMULATION_FAILED.value, list(self.failures)),
            ("Doubts about the logs of the fit", doubts),
            ("What does not fit together", [*self.hints, *self.outstanding]),
            ("Initial states", list(start_notes(self.model, self.runs))),
            ("Where the error sits (inputs as recorded, other signals as modelled)", regimes),
            ("Is the residual noise?", noise),
        ]
        return [(heading, sentences) for heading, sentences in parts if sentences]

    @property
    def closing(self) -> tuple[str, ...]:
        """The last lines of the report: date, versions, hashes, and which logs the fit knew."""
        lines = closing(self.origin, self.model)
        if self.origin and self.fit and self.fit.origin:
            return (*lines, taken_part(self.fit.origin, self.origin.train))
        return lines

    def _line(self) -> str:
        if self.failures:
            return f"{self.model}: {Status.SIMULATION_FAILED}. {self.failures[0]}"
        each = ", ".join(f"{name} {e.nrmse:.3g}" for name, e in self.errors.channels.items())
        count = f"{len(self.runs)} log{'s' if len(self.runs) > 1 else ''}"
        return f"{self.model} on {count}: NRMSE {self.errors.nrmse:.3g} ({each})"

    def _report(self) -> Report:
        return comparison_report(self)

    def to_json(self) -> dict[str, Any]:
        """Errors, pooled and by run, regimes, residual tests and hints as plain data."""
        written = {
            "schema": 1,
            "model": self.model.name,
            "effects": [effect.name for effect in self.model.effects],
            "failures": list(self.failures),
            "errors": self.errors.to_json(),
            "runs": [{"name": run.name, **run.errors.to_json()} for run in self.runs],
            "regimes": [regime.to_json() for regime in self.regimes],
            "tests": {name: tests.to_json() for name, tests in self.tests.items()},
            "agreement": {name: a.to_json() for name, a in self.agreement.items()},
            "hints": [*self.hints, *self.outstanding],
            "noise": self.noise_advice.to_json() if self.noise_advice else None,
            "doubts": [doubt.to_json() for doubt in self.fit.doubts] if self.fit else [],
        }
        return plain(written)


def comparison_report(comparison: Comparison, title: str = "") -> Report:
    """Errors of each run and pooled over the runs, then what was found, in sentences."""
    heading = f"{comparison.model}{f', {title}' if title else ''}"
    errors = [(run.name, run.errors) for run in comparison.runs]
    if len(errors) > 1:
        errors.append(("all runs", comparison.errors))
    return Report(
        Section("", Styled(heading, "strong"), error_rows(errors)),
        *(Section(name, Bullets(sentences)) for name, sentences in comparison.findings),
        closing_section(comparison.closing),
    )


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
            measurement. States that are not measured start where the run errs least, unless the
            model's `initial` gives them by free parameters; a note tells which. Parameters that
            differ by log are those of the fit in its own logs, and in others are estimated from
            their first part.
        substeps: integrator steps per sample; chosen for each log where ``None``.

    Returns:
        A `Comparison`: errors, residual tests, the regimes in which the error sits, and figures by
        ``.plot()`` and ``.plot_residuals()``.

    Raises:
        InputError: a log without a channel that the model needs or puts out, or of a sample or two.

    Example:
        >>> dft.compare(fit, unseen).errors.nrmse < 0.05
        True
    """
    model = fit if isinstance(fit, Model) else fit.model
    logs = (logs,) if isinstance(logs, Log) else tuple(logs)
    if not isinstance(fit, Model) and initial is None:
        initial = [fit.own_numbers(log) for log in logs]
    noise = None if isinstance(fit, Model) else fit.noise_of_runs
    runs = runs_over(model, bind(model, logs), initial=initial, substeps=substeps, noise=noise)
    return comparison_of(fit, runs)


def comparison_of(fit: Fit | Model, runs: tuple[Run, ...]) -> Comparison:
    """The comparison of a fit, or of a model, whose whole runs exist already."""
    model, source = (fit, None) if isinstance(fit, Model) else (fit.model, fit)
    origin = origin_of([run.record.log for run in runs])
    return Comparison(model, runs, pooled_errors(runs), source, origin)

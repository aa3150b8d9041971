"""The predictive band of a log, and its coverage of the measurements."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np

from diffthrust._support._running.programs import program
from diffthrust._support.errors import InputError
from diffthrust._support.figures import showing
from diffthrust._support.names import listing
from diffthrust._support.progress import ProgressOption, progressing, reporter
from diffthrust._support.report import Report
from diffthrust._support.results import Result
from diffthrust._support.validation import whole_number
from diffthrust._support.words import percent
from diffthrust.estimation._arguments import LIKELIHOODS, LOSSES
from diffthrust.estimation._observer import (
    Correction,
    Limits,
    Observer,
    is_memory,
    limited,
    observer_of,
)
from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model
from diffthrust.models._base.signals import Signals
from diffthrust.simulation._record import Record, bind
from diffthrust.simulation._step_size import sufficient_steps
from diffthrust.simulation._trajectory import Grid, Key, march, read_out, trajectory
from diffthrust.uncertainty._prediction.band import Band, band_of
from diffthrust.uncertainty._prediction.draws import Draws, draws_of
from diffthrust.uncertainty._tables import prediction_report

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SHORT = 0.05
"""A band covers too little if the share inside is below its level by more than this."""


@dataclass(frozen=True, repr=False)
class Prediction(Result):
    """Prediction of a log by a fit or a posterior, compared with the measurements.

    Args:
        log: name of the log.
        time: time stamps [s], ``(T,)``.
        level: probability of the bands.
        channels: a `Band` for each measured channel.
        draws: number of parameter draws.
        kind: "posterior" or "covariance": source of the draws.
        random_forces: the band with noise includes the random forces of an "innovations" fit.
        notes: remarks for the user.

    Example:
        >>> band = dft.predict(fit, fit, unseen, draws=50)
        >>> sorted(band.coverage), band.level
        (['speed', 'thrust'], 0.95)
        >>> print(band.sentence[:30])
        run2.csv: the 95 % band holds
        >>> list(band.to_json())
        ['log', 'level', 'draws', 'channels']
        >>> figure = band.plot()
    """

    log: str
    time: np.ndarray = field(repr=False)
    level: float
    channels: Mapping[str, Band]
    draws: int
    kind: str
    random_forces: bool = False
    notes: tuple[str, ...] = ()

    @property
    def coverage(self) -> dict[str, float]:
        """Share of the measured samples inside the band, by channel."""
        return {name: band.coverage for name, band in self.channels.items()}

    @property
    def sentence(self) -> str:
        """The coverage in words, and the meaning of a low coverage."""
        held = ", ".join(f"{percent(share)} of {name}" for name, share in self.coverage.items())
        text = f"{self.log}: the {percent(self.level)} band holds {held}."
        low = [n for n, share in self.coverage.items() if share < self.level - _SHORT]
        high = [n for n, share in self.coverage.items() if share > 0.5 * (1 + self.level)]
        if low:
            why = (
                "the random forces are larger, or last longer, than it estimated"
                if self.random_forces
                else "its errors last from sample to sample, as random forces and drifting sensors "
                "make them"
            )
            return (
                f"{text} That is too few for {' and '.join(low)}: something is missing from the "
                f"model, or {why}. The intervals of the parameters are then too narrow as well."
            )
        if high:
            return (
                f"{text} That is more than asked for {' and '.join(high)}: these errors are "
                "smaller than those of the training logs."
            )
        # nor less: of a thruster's, of which two effects were missing, it held 92 and 94 %
        return f"{text} That is as many as asked for; a model that lacks something may do as well."

    def _report(self) -> Report:
        return prediction_report(self.channels, self.level, self.sentence, self.notes)

    def _line(self) -> str:
        return self.sentence

    def to_json(self) -> dict[str, Any]:
        """Coverage and number of samples by channel as plain data."""
        channels = {
            name: {"coverage": band.coverage, "samples": band.samples}
            for name, band in self.channels.items()
        }
        return {"log": self.log, "level": self.level, "draws": self.draws, "channels": channels}

    @showing
    def plot(self) -> Figure:
        """Plot measured points, median and both bands, by channel."""
        from diffthrust.uncertainty._prediction.figures import prediction_figure

        return prediction_figure(self.log, self.time, self.channels, self.level, self.random_forces)


@progressing
def predict(
    source: Any,
    model: Any,
    log: Log | None = None,
    *,
    level: float = 0.95,
    draws: int = 200,
    seed: int = 0,
    substeps: int | None = None,
    progress: ProgressOption = None,
) -> Prediction:
    """The predictive band of a log's measurements, and its coverage.

    The log is simulated with draws of the parameters. The band without noise reflects only their
    uncertainty. The band with noise adds measurement noise of the level on the training logs.
    Measured states start from their first measurement, plus or minus its noise.

    For a fit with ``likelihood="innovations"`` the band with noise includes the estimated random
    forces and lasting sensor errors: the innovations form is simulated forward with drawn errors.
    The band without noise includes none of these. Gains and memories have no error in a fit and
    keep their values; a posterior draws them too. The band of any other fit contains no random
    forces: under turbulence it is too narrow, as its coverage shows.

    Args:
        source: a `Fit`, or a posterior from `sample`.
        model: the sampled fit or model; may be omitted if the source is a fit:
            ``dft.predict(fit, log)``.
        log: the log, preferably one not used in the fit.
        level: probability of the bands: equal tails, pointwise.
        draws: number of parameter draws; it limits the precision of the bands' ends.
        seed: of the draws.
        substeps: integrator steps per sample; chosen automatically if ``None``.
        progress: True for a bar, or a function of a message and the share done.

    Returns:
        A `Prediction`; see ``.sentence``, ``.coverage`` and ``.plot()``.

    Raises:
        InputError: the posterior is empty, parameters belong to another model, or the log cannot be
            simulated or measures no output of the model.

    Example:
        >>> band = dft.predict(post, fit, unseen, draws=50)
        >>> band.coverage["speed"] > 0.8
        True
    """
    if isinstance(model, Log) and log is None:
        model, log = None, model
    if not isinstance(log, Log):
        raise InputError(
            f"predict: expected a log, found {type(log).__name__}.",
            "Write dft.predict(posterior, fit, log), one log at a time.",
        )
    if substeps is not None:
        whole_number("substeps", substeps)
    report = reporter(progress)
    report("drawing parameters", 0.0)
    drawn = draws_of(source, model, count=draws, seed=seed, level=level)
    (record,) = bind(drawn.model, [log.counted], compared=False)
    channels = [*record.measured]
    if not channels:
        raise InputError(
            f"{log.name}: no output of '{drawn.model.name}' is measured: expected one of "
            f"{listing(drawn.model.outputs)}, found {listing(log.measured)}.",
            "Map a column to one of these channels.",
        )
    drawn, notes = _with_noise(drawn, record, channels)
    if substeps is None:
        # the step is chosen once, at the median draw: each number of substeps is a program to
        # compile
        middle = {n: float(np.median(v)) for n, v in drawn.values.items()}
        substeps = sufficient_steps(drawn.model.replace(middle), record).substeps
    # a stream apart from that of the draws of the parameters
    rng = np.random.default_rng([seed, 1])
    report("simulating the draws", 0.2)
    means = _mean_runs(drawn, record, channels, substeps, rng)
    report("simulating their noise", 0.6)
    random = LIKELIHOODS[drawn.likelihood].corrects
    noisy = _random_runs(drawn, record, channels, substeps, rng) if random else {}
    bands = {c: band_of(drawn, record, c, means[c], noisy.get(c), level) for c in channels}
    report("done", 1.0)
    return Prediction(
        log=log.name,
        time=log.time,
        level=level,
        channels=bands,
        draws=len(drawn),
        kind=drawn.kind,
        random_forces=random,
        notes=(*drawn.notes, *notes),
    )


def _with_noise(drawn: Draws, record: Record, channels: list[str]) -> tuple[Draws, list[str]]:
    """Add noise levels stated in the log, with a note on channels without a known level."""
    levels = {c: record.noise[c] for c in channels if c not in drawn.noise}
    stated = {c: np.full(len(drawn), s) for c, s in levels.items() if s is not None}
    lacking = [c for c, s in levels.items() if s is None]
    if len(lacking) == len(channels):
        raise InputError(
            f"predict: the noise of {listing(lacking)} is not known: the posterior has no 'sigma'.",
            "Give the fit in place of the model, or a log with its noise.",
        )
    notes = [
        f"{c}: its noise is not known, as no training log measured it; none is added."
        for c in lacking
    ]
    return replace(drawn, noise={**drawn.noise, **stated}), notes


_BATCH = 8
"""Simulations per batch; more do not fit the processor's cache."""


def _mean_runs(
    draws: Draws, record: Record, channels: Sequence[str], substeps: int, rng: np.random.Generator
) -> dict[str, np.ndarray]:
    """The outputs over a record by draw, without noise: ``(n, T)`` each.

    Measured states start from their first measurement plus a draw of its noise.
    """
    grid, time, inputs = _arranged(draws.model, record, substeps)
    numbers = _held(draws.values), time, inputs, _starts(draws, record, rng)
    outputs = _runs(Key(draws.model), grid, tuple(channels), *numbers)
    return {name: np.asarray(value)[:, record.original] for name, value in outputs.items()}


def _random_runs(
    draws: Draws, record: Record, channels: Sequence[str], substeps: int, rng: np.random.Generator
) -> dict[str, np.ndarray]:
    """Measurements predicted by an "innovations" fit: ``(n, T)`` by channel with known noise.

    The innovations form is simulated forward: errors are drawn, and correct the states by the
    estimated gains, as the errors of a recorded log would. This reproduces random forces and
    lasting sensor errors as in the training logs (Ljung 1999, section 7.3).
    """
    model = draws.model
    grid, time, inputs = _arranged(model, record, substeps)
    measured = tuple(c for c in model.outputs if c in draws.noise)
    remembering = {port for effect in model.effects if effect.memory for port in effect.ports}
    observer = observer_of(model, record, measured, remembering)
    nuisance = {
        n: draws.nuisance.get(n, np.full(len(draws), p.value if is_memory(n) else 0.0))
        for n, p in observer.parameters(record.duration, record.step).items()
    }
    law = LOSSES[draws.loss].draws(rng, (len(draws), len(measured), time.size))
    sigma = np.stack([draws.noise[c] for c in measured], axis=1)
    clip, reach = (draws.fit.limits or {}, draws.fit.reach) if draws.fit else ({}, 1.0)
    noisy = _random(
        Key(model),
        grid,
        observer,
        _held({**draws.values, **nuisance}),
        time,
        inputs,
        _starts(draws, record, rng),
        jnp.asarray(sigma[:, :, None] * law),
        jnp.asarray(np.array([c in record.unsigned for c in measured], bool)),
        Limits(*_floats([clip.get(c, np.inf) for c in measured], reach)),
    )
    return {c: np.asarray(noisy[c])[:, record.original] for c in measured if c in channels}


def _floats(*values: Any) -> tuple[Any, ...]:
    return tuple(jnp.asarray(np.asarray(value, float)) for value in values)


def _held(values: Mapping[str, np.ndarray]) -> dict[str, Any]:
    return dict(zip(values, _floats(*values.values()), strict=True))


def _arranged(model: Model, record: Record, substeps: int) -> tuple[Grid, Any, dict[str, Any]]:
    series = record.inputs_for(model)
    grid = Grid(record.holds(series), substeps, uniform=record.even)
    return grid, jnp.asarray(record.time), {n: jnp.asarray(v) for n, v in series.items()}


def _starts(draws: Draws, record: Record, rng: np.random.Generator) -> dict[str, Any]:
    """First measurements with noise; none for an unsigned sensor, which may be at rest."""
    begin = {}
    for name, value in record.start.items():
        sigma = draws.noise.get(name, np.zeros(len(draws)))
        error = 0.0 if name in record.unsigned else sigma * rng.standard_normal(len(draws))
        begin[name] = jnp.asarray(np.full(len(draws), value) + error)
    return begin


@program(3)
def _runs(
    key: Key, grid: Grid, channels: tuple[str, ...], values: Any, time: Any, inputs: Any, start: Any
) -> Any:
    def run(each: Any) -> Any:
        model = key.model.bind(each[0])
        outputs, _ = trajectory(model, grid, time, inputs, each[1], {})
        return {c: outputs[c] for c in channels}

    return jax.lax.map(run, (values, start), batch_size=_BATCH)


class _Driven(Correction):
    """An observer run forward: the drawn errors are passed in place of measurements."""

    def error(self, channel: str, modelled: Any, measured: Any, colour: Any) -> Any:
        """The drawn error."""
        return jnp.where(jnp.isnan(measured), 0.0, measured)


@program(3)
def _random(
    key: Key,
    grid: Grid,
    observer: Observer,
    values: Any,
    time: Any,
    inputs: Any,
    start: Any,
    errors: Any,
    unsigned: Any,
    limits: Limits,
) -> Any:
    def run(each: Any) -> Any:
        values, begin, error = each
        model = key.model.bind(values)
        run = _Driven(observer, model, values, time, error, unsigned, limits)
        series, path = march(model, grid, time, inputs, begin, {}, run)
        signals = {**series, "time": time}
        ahead = read_out(model, Signals({**path, **signals}))
        corrected = run.correct(path, signals, run.rows)
        after = read_out(model, Signals({**corrected, **signals}))
        out = {}
        for i, c in enumerate(observer.channels):
            if c in observer.fed:
                out[c] = ahead[c] + path[f"colour.{c}"] + error[i]
                continue
            gain, kept = values[f"noise.{c}.colour"], run.rows[f"colour.{c}"]
            out[c] = after[c] + _coloured(error[i], gain, kept, run.limit[i])
        return out

    return jax.lax.map(run, (values, start, errors), batch_size=_BATCH)


def _coloured(errors: Any, gain: Any, kept: Any, limit: Any) -> Any:
    """A sensor's autocorrelated error, from its innovations."""

    def body(colour: Any, x: Any) -> tuple[Any, Any]:
        e, keep = x
        return keep * (colour + gain * limited(e, limit)), colour + e

    return jax.lax.scan(body, jnp.zeros(()), (errors, kept))[1]

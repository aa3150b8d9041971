"""Is the integration step fine enough? Answered by halving it."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model
from diffthrust.simulation._record import Record, bind
from diffthrust.simulation._trajectory import simulate_fixed

MOST_SUBSTEPS = 32
_TOLERANCE = 0.01
"""Integration error allowed, as a share of the sensor noise: it then changes nothing in a fit."""

_SHARE = 1 / 3
"""What counts as noise of an error that remains. On the BlueBoat as published, whose yaw rate errs
by 90 times its sensor noise, 32 steps a sample were taken where 8 change a thousandth of the error;
all that followed took four times as long."""


_OF_SPREAD = 0.01
"""What counts as noise where a log measures nothing, as a share of an output's spread.
Origin: chosen, so that the tolerance allows a ten-thousandth of the spread, which no plot shows.
With one step a sample the thrust of a planned run left the finite numbers where the water in a duct
was fast."""


class CoarseStepWarning(UserWarning):
    """The integration step is too coarse for the model at these parameters.

    Example:
        >>> import warnings
        >>> with warnings.catch_warnings():
        ...     warnings.simplefilter("error", dft.simulation.CoarseStepWarning)
        ...     modelled = dft.simulate(dft.Thruster(), log)
    """


@np.errstate(over="ignore", invalid="ignore")  # numbers of wrong units are reported elsewhere
def sensor_noise(values: np.ndarray) -> float:
    """Standard deviation of the sample-to-sample noise of a measured channel.

    From the second differences, which remove level and trend: the median of their size over the
    factor for Gaussian noise. At least a ten-thousandth of the channel's own spread, so that
    noise-free and coarsely quantised channels have a scale too.
    """
    valid = values[np.isfinite(values)]
    if valid.size < 3:
        return float(np.ptp(valid)) or 1.0
    bends = np.abs(np.diff(valid, 2))
    middle = [(bends.size - 1) // 2, bends.size // 2]  # NumPy's median takes five times as long
    # 0.6745 and the root of six: the median of |x| of a Gaussian, and its second differences
    level = np.partition(bends, middle)[middle].mean() / 0.6745 / np.sqrt(6.0)
    rounding = 1e-9 * np.max(np.abs(valid))  # a constant channel has neither noise nor spread
    return float(max(level, 1e-4 * np.std(valid), rounding)) or 1.0


def step_error(
    model: Model, log: Log, substeps: int = 1, *, initial: Mapping[str, float] | None = None
) -> dict[str, float]:
    """Integration error of each measured output, as a share of its sensor noise.

    The error is the root mean square difference to a simulation with half the step, over the
    sensor noise (the log's own figure, or `sensor_noise`; a hundredth of each output's spread where
    the log measures nothing); infinite where either is not finite.

    Args:
        model: the model at the parameters in question.
        log: the log that gives time base, inputs and measured channels.
        substeps: integrator steps per sample.
        initial: initial states, as for `simulate`.

    Returns:
        Channel name to error over noise.

    Example:
        >>> errors = dft.simulation.step_error(fit.model, log)
        >>> errors["speed"] < 0.01
        True
    """
    (record,) = bind(model, [log], compared=False)
    coarse = simulate_fixed(model, record, initial, substeps)
    fine = simulate_fixed(model, record, initial, 2 * substeps)
    return _errors(coarse, fine, noise_levels(record) or _spreads(model, fine))


def choose_substeps(
    model: Model,
    log: Log,
    *,
    initial: Mapping[str, float] | None = None,
    tolerance: float = _TOLERANCE,
    warn: bool = True,
) -> int:
    """The fewest integrator steps per sample that keep the error below the sensor noise.

    Where the log measures nothing, a hundredth of an output's spread stands for its sensor noise.

    Args:
        model: the model at the parameters in question.
        log: the log.
        initial: initial states, as for `simulate`.
        tolerance: the error allowed, as a share of the sensor noise.
        warn: say so where even the finest grid is too coarse.

    Returns:
        1, 2, 4, ... up to 32; 1 for a model without states.

    Example:
        >>> dft.simulation.choose_substeps(fit.model, log, tolerance=0.01)
        1
    """
    (record,) = bind(model, [log], compared=False)
    choose = sufficient_steps if warn else fewest_steps
    return choose(model, record, initial, tolerance=tolerance).substeps


class StepChoice(NamedTuple):
    """The fewest integrator steps per sample that are fine enough, or `MOST_SUBSTEPS`.

    Args:
        substeps: steps per sample.
        errors: the integration error that remains, by channel, over its sensor noise, or what
            stands for it where nothing is measured.
        simulated: the simulation with these steps; ``None`` where none was needed to choose them.
    """

    substeps: int
    errors: dict[str, float]
    simulated: Mapping[str, np.ndarray] | None = None


def fewest_steps(
    model: Model,
    record: Record,
    initial: Mapping[str, float] | None,
    existing: Mapping[int, Mapping[str, np.ndarray]] | None = None,
    *,
    tolerance: float = _TOLERANCE,
    residual: Mapping[str, float] | None = None,
) -> StepChoice:
    """As `choose_substeps`, with the errors that remain and the simulation that was made for it.

    ``existing`` are simulations that were made already, by their steps per sample. ``residual`` is
    by how much the model errs, by channel (root mean square): where this is far above the sensor
    noise, steps that change a third of a hundredth of it are fine enough.
    """
    if not model.all_states or len(record.original) < 2:
        return StepChoice(1, {})

    def simulated(substeps: int) -> Mapping[str, np.ndarray]:
        if existing and substeps in existing:
            return existing[substeps]
        return simulate_fixed(model, record, initial, substeps)

    substeps, coarse = 1, simulated(1)
    noise = noise_levels(record)
    for name, remaining in (residual or {}).items():
        if np.isfinite(remaining) and name in noise:
            noise[name] = max(noise[name], _SHARE * remaining)
    while True:
        fine = simulated(2 * substeps)
        errors = _errors(coarse, fine, noise or _spreads(model, fine))
        # The error of the coarse one, by comparison with half the step: of order four, the fine one
        # errs by a sixteenth of it.
        if max(errors.values(), default=0.0) <= tolerance or substeps >= MOST_SUBSTEPS:
            return StepChoice(substeps, errors, coarse)
        substeps, coarse = 2 * substeps, fine


def sufficient_steps(
    model: Model,
    record: Record,
    initial: Mapping[str, float] | None = None,
    *,
    tolerance: float = _TOLERANCE,
) -> StepChoice:
    """As `fewest_steps`, with a `CoarseStepWarning` where even the finest ones are too coarse."""
    choice = fewest_steps(model, record, initial, tolerance=tolerance)
    warn_if_coarse(record, choice, tolerance)
    return choice


def warn_if_coarse(record: Record, choice: StepChoice, tolerance: float = _TOLERANCE) -> None:
    """Give a `CoarseStepWarning` where even the finest steps are too coarse.

    Not where nothing is measured and the simulation overflows: that is told by itself.
    """
    error = max(choice.errors.values(), default=0.0)
    if error > tolerance and (record.measured or np.isfinite(error)):
        worst = max(choice.errors, key=lambda name: choice.errors[name])
        measured = bool(noise_levels(record))
        of, unit = ("the sensor noise", 1.0) if measured else ("its spread", _OF_SPREAD)
        warnings.warn(
            f"{record.name}: with {choice.substeps} integrator steps per sample the error of "
            f"'{worst}' is still {unit * error:.2g} of {of} (allowed: {unit * tolerance:g}). "
            "The model is too fast for the log's sample rate at these parameters.",
            CoarseStepWarning,
            stacklevel=4,
        )


def simulate_chosen(
    model: Model, record: Record, initial: Mapping[str, float] | None, choice: StepChoice
) -> dict[str, np.ndarray]:
    """The simulation with chosen steps: that by which they were chosen, if there is one."""
    if choice.simulated is not None:
        return dict(choice.simulated)
    return simulate_fixed(model, record, initial, choice.substeps)


def noise_levels(record: Record) -> dict[str, float]:
    """The noise of each measured output: as the log states it, or by `sensor_noise`.

    Not of one that is read once, at the start.
    """
    read = {n: y for n, y in record.observed.items() if np.isfinite(y).sum() > 1}
    return {n: record.noise[n] or sensor_noise(y) for n, y in read.items()}


def _spreads(model: Model, fine: Mapping[str, np.ndarray]) -> dict[str, float]:
    """What counts as noise of each output that is not zero, where a log measures none."""
    spreads = {}
    for name in model.outputs:
        with np.errstate(over="ignore", invalid="ignore"):  # no number is an error as well
            largest = float(np.max(np.abs(fine[name])))
            spreads[name] = _OF_SPREAD * max(float(np.std(fine[name])), 1e-4 * largest)
    return {name: spread for name, spread in spreads.items() if spread != 0}


def _errors(
    coarse: Mapping[str, np.ndarray], fine: Mapping[str, np.ndarray], noise: Mapping[str, float]
) -> dict[str, float]:
    """Root mean square difference of two simulations over the noise of each channel."""
    errors = {}
    for name, level in noise.items():
        with np.errstate(over="ignore", invalid="ignore"):
            error = np.sqrt(np.mean((coarse[name] - fine[name]) ** 2)) / level
        errors[name] = float(error) if np.isfinite(error) else float("inf")
    return errors

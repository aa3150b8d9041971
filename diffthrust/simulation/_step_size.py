"""Is the integration step fine enough? Answered by halving it."""

from __future__ import annotations

import warnings
from collections.abc import Mapping

import numpy as np

from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model
from diffthrust.simulation._fixed_step import simulate_fixed

MOST_SUBSTEPS = 32


class CoarseStepWarning(UserWarning):
    """The integration step is too coarse for the model at these parameters.

    Example:
        >>> import warnings
        >>> with warnings.catch_warnings():
        ...     warnings.simplefilter("error", dft.CoarseStepWarning)
        ...     found = dft.simulate(dft.Thruster(), log)
    """


@np.errstate(over="ignore", invalid="ignore")  # numbers of wrong units are told
def sensor_noise(values: np.ndarray) -> float:
    """Standard deviation of the sample-to-sample noise of a measured channel.

    From the second differences, which remove level and trend: the median of their size over the
    factor for Gaussian noise. At least a ten-thousandth of the channel's own spread, so that
    noise-free and coarsely quantised channels have a scale too.
    """
    seen = values[np.isfinite(values)]
    if seen.size < 3:
        return float(np.ptp(seen)) or 1.0
    bends = np.abs(np.diff(seen, 2))
    middle = [(bends.size - 1) // 2, bends.size // 2]  # NumPy's median takes five times as long
    rough = np.partition(bends, middle)[middle].mean() / 0.6745 / np.sqrt(6.0)
    rounding = 1e-9 * np.max(np.abs(seen))  # a constant channel has neither noise nor spread
    return float(max(rough, 1e-4 * np.std(seen), rounding)) or 1.0


def step_error(
    model: Model, log: Log, substeps: int = 1, *, initial: Mapping[str, float] | None = None
) -> dict[str, float]:
    """Integration error of each measured output, as a share of its sensor noise.

    The error is the root mean square difference to a simulation with half the step, over the
    sensor noise (the log's own figure, or `sensor_noise`); infinite where either is not finite.

    Args:
        model: the model at the parameters in question.
        log: the log that gives grid, inputs and measured channels.
        substeps: integrator steps per sample.
        initial: initial states, as for `simulate`.

    Returns:
        Channel name to error over noise.

    Example:
        >>> errors = dft.simulation.step_error(fit.model, log)
        >>> errors["speed"] < 0.01
        True
    """
    coarse = simulate_fixed(model, log, initial, substeps)
    return _beside_half_the_step(model, log, substeps, initial, coarse)


def _beside_half_the_step(
    model: Model,
    log: Log,
    substeps: int,
    initial: Mapping[str, float] | None,
    coarse: Mapping[str, np.ndarray],
) -> dict[str, float]:
    fine = simulate_fixed(model, log, initial, 2 * substeps)
    errors = {}
    for name, unit in model.outputs.items():
        if name not in log.measured:
            continue
        noise = log.noise_in(name, unit) or sensor_noise(log.values(name, unit))
        with np.errstate(over="ignore", invalid="ignore"):
            error = np.sqrt(np.mean((coarse[name] - fine[name]) ** 2)) / noise
        errors[name] = float(error) if np.isfinite(error) else float("inf")
    return errors


def choose_substeps(
    model: Model,
    log: Log,
    *,
    initial: Mapping[str, float] | None = None,
    tolerance: float = 0.01,
    warn: bool = True,
) -> int:
    """The fewest integrator steps per sample that keep the error below the sensor noise.

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
    substeps, errors = fewest_steps(model, log, initial, tolerance=tolerance)
    if max(errors.values(), default=0.0) > tolerance and warn:
        worst = max(errors, key=lambda name: errors[name])
        warnings.warn(
            f"{log.name}: with {substeps} integrator steps per sample the error of '{worst}' is "
            f"still {errors[worst]:.2g} of the sensor noise (allowed: {tolerance:g}). The model is "
            "too fast for the log's sample rate at these parameters.",
            CoarseStepWarning,
            stacklevel=2,
        )
    return substeps


def fewest_steps(
    model: Model,
    log: Log,
    initial: Mapping[str, float] | None,
    first: Mapping[str, np.ndarray] | None = None,
    *,
    tolerance: float = 0.01,
) -> tuple[int, dict[str, float]]:
    """As `choose_substeps`, with the errors that are left.

    ``first`` is the simulation with one step per sample, where it is known already.
    """
    if not model.all_states or len(log) < 2 or not any(n in log.measured for n in model.outputs):
        return 1, {}
    if first is None:
        errors = step_error(model, log, 1, initial=initial)
    else:
        errors = _beside_half_the_step(model, log, 1, initial, first)
    substeps = 1
    while max(errors.values()) > tolerance and substeps < MOST_SUBSTEPS:
        substeps *= 2
        errors = step_error(model, log, substeps, initial=initial)
    return substeps, errors

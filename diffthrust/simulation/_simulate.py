"""Simulation of a model over a log."""

from __future__ import annotations

import warnings
from collections.abc import Mapping

import numpy as np

from diffthrust.logs._log import Log
from diffthrust.logs._written import ShownUnits
from diffthrust.models._base.model import Model
from diffthrust.simulation._record import bind
from diffthrust.simulation._runs import SimulationFailedWarning, overflow
from diffthrust.simulation._step_size import StepChoice, simulate_chosen, sufficient_steps


def simulate(
    model: Model,
    log: Log,
    *,
    initial: Mapping[str, float] | None = None,
    substeps: int | None = None,
    in_units: bool = False,
) -> dict[str, np.ndarray]:
    """Simulate a model with the inputs of a log.

    Args:
        model: the model, with its effects.
        log: inputs and time stamps; its measurements are used for the initial state only.
        initial: initial states by name, in the model's units. By default measured states start
            from their first measurement, all others from the model's own initial state.
        substeps: integrator steps per sample; ``None`` chooses them (see `choose_substeps`).
        in_units: give channels of the log as it was written, in rpm or kgf, instead of in SI.

    Returns:
        Outputs and states by name at the log's time stamps, ``(n,)`` each, in the model's units,
        which are SI.
        Where they leave the finite numbers a `SimulationFailedWarning` says when and which.

    Raises:
        InputError: the log lacks an input, or a unit has the wrong dimension.

    Example:
        >>> dft.simulate(dft.Thruster(), log)["thrust"].shape
        (240,)
    """
    written = log.written
    if substeps is not None:  # other outputs, in whatever unit, only serve to choose the step
        starting = {*model.states, *model.start_outputs}
        kept = {name: values for name, values in log.measured.items() if name in starting}
        log = log.replaced(measured=kept)
    (record,) = bind(model, [log], compared=False)
    if substeps is None:
        choice = sufficient_steps(model, record, initial)
    else:
        choice = StepChoice(substeps, {})
    modelled = simulate_chosen(model, record, initial, choice)
    if failure := overflow(model, record, modelled):
        warnings.warn(failure, SimulationFailedWarning, stacklevel=2)
    if not in_units:
        return modelled
    display, units = ShownUnits([written]), {**model.all_states, **model.outputs}
    return {n: display.values(n, numbers, units.get(n, "")) for n, numbers in modelled.items()}

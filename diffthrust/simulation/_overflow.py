"""Where a simulation, or its error, leaves the finite numbers."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from diffthrust.models._base.model import Model
from diffthrust.simulation._record import Record


class SimulationFailedWarning(RuntimeWarning):
    """A simulation left the finite numbers.

    Example:
        >>> issubclass(dft.simulation.SimulationFailedWarning, Warning)
        True
    """


def overflow(model: Model, record: Record, modelled: Mapping[str, np.ndarray]) -> str:
    """A sentence on when and by which state a simulation left the finite numbers; empty if not."""
    units = {**model.all_states, **model.outputs}
    first = {n: int(np.argmin(np.isfinite(modelled[n]))) for n in units if n in modelled}
    # argmin of booleans is 0 both where the first sample fails and where none does: the sample
    # itself decides.
    lost = {n: k for n, k in first.items() if not np.isfinite(modelled[n][k])}
    if not lost:
        return ""
    name = min(lost, key=lambda n: lost[n])  # states come before outputs, which follow from them
    k, series = lost[name], modelled[name]
    shown = [name] if name in model.all_states and k else []
    at = k - 1 if shown else k
    shown = shown or [n for n in model.all_states if n in modelled and n != name]
    values = [f"{n} {modelled[n][at]:.4g} {units[n]}".rstrip() for n in shown]
    when = f" ({'one sample earlier ' * (at < k)}{', '.join(values)})" if values else ""
    return (
        f"{record.name}: the simulation leaves the finite numbers at t = {record.log.time[k]:.6g} "
        f"s, where the {'state' if name in model.all_states else 'output'} '{name}' is "
        f"{'no number' if np.isnan(series[k]) else 'infinite'}{when}."
    )


def too_large(model: Model, record: Record, modelled: Mapping[str, np.ndarray]) -> str:
    """A sentence on a channel of finite numbers too large to be squared; empty if none."""
    for name, unit in model.outputs.items():
        if name not in record.measured:
            continue
        measured = np.abs(record.observed[name])
        with np.errstate(over="ignore", invalid="ignore"):
            if np.isfinite(np.nansum(measured**2) + np.sum(modelled[name] ** 2)):
                continue
        return (
            f"{record.name}: numbers of {name} are too large to be squared: measured up to "
            f"{np.nanmax(measured):.4g} {unit}, simulated up to "
            f"{np.max(np.abs(modelled[name])):.4g} {unit}. Is its unit right?"
        )
    return ""

"""Where a simulation, or its error, leaves the finite numbers."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model


class SimulationFailedWarning(RuntimeWarning):
    """A simulation left the finite numbers.

    Example:
        >>> issubclass(dft.simulation.SimulationFailedWarning, Warning)
        True
    """


def overflow(model: Model, log: Log, modelled: Mapping[str, np.ndarray]) -> str:
    """A sentence on when and by which state a simulation left the finite numbers; empty if not.

    Args:
        model: that was simulated.
        log: over which.
        modelled: states and outputs, ``(n,)`` each.
    """
    units = {**model.all_states, **model.outputs}
    found = {n: int(np.argmin(np.isfinite(modelled[n]))) for n in units if n in modelled}
    lost = {n: k for n, k in found.items() if not np.isfinite(modelled[n][k])}
    if not lost:
        return ""
    name = min(lost, key=lambda n: lost[n])  # states before outputs, which follow them
    k, here = lost[name], modelled[name]
    known = [name] if name in model.all_states and k else []
    at = k - 1 if known else k
    known = known or [n for n in model.all_states if n in modelled and n != name]
    beside = [f"{n} {modelled[n][at]:.4g} {units[n]}".rstrip() for n in known]
    when = f" ({'one sample earlier ' * (at < k)}{', '.join(beside)})" if beside else ""
    return (
        f"{log.name}: the simulation leaves the finite numbers at t = {log.time[k]:.6g} s, where "
        f"the {'state' if name in model.all_states else 'output'} '{name}' is "
        f"{'no number' if np.isnan(here[k]) else 'infinite'}{when}."
    )


def too_large(model: Model, log: Log, modelled: Mapping[str, np.ndarray]) -> str:
    """A sentence on a channel of finite numbers that are too large to be squared; empty if none.

    Args:
        model: that was simulated.
        log: over which.
        modelled: its outputs, ``(n,)`` each.
    """
    for name, unit in model.outputs.items():
        if name not in log.measured:
            continue
        theirs = np.abs(log.values(name, unit))
        with np.errstate(over="ignore", invalid="ignore"):
            if np.isfinite(np.nansum(theirs**2) + np.sum(modelled[name] ** 2)):
                continue
        return (
            f"{log.name}: numbers of {name} are too large to be squared: measured up to "
            f"{np.nanmax(theirs):.4g} {unit}, simulated up to "
            f"{np.max(np.abs(modelled[name])):.4g} {unit}. Is its unit right?"
        )
    return ""

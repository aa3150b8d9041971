"""Physical quantities of a thruster from its fitted parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from diffthrust._support.errors import InputError
from diffthrust.estimation._result import Fit
from diffthrust.estimation._status import Status
from diffthrust.models._base.model import Model
from diffthrust.models._base.quadratic_load import QuadraticLoad


@dataclass(frozen=True)
class Quantity:
    """A derived quantity: value and standard error in ``unit``.

    ``std_error`` is ``None`` where a parameter that the quantity depends on has none.

    Example:
        >>> gain = dft.uncertainty.derived(
        ...     fit, lambda p: {"gain": p["beta"] / p["alpha"]}, {"gain": "V"}
        ... )
        >>> gain["gain"].unit, gain["gain"].std_error > 0
        ('V', True)
    """

    value: float
    std_error: float | None
    unit: str

    def __str__(self) -> str:
        error = "" if self.std_error is None else f" ± {self.std_error:.2g}"
        return f"{self.value:.4g}{error} {self.unit}".rstrip()


def physical(
    fit: Fit, *, pitch: float, area: float, density: float = 1000.0
) -> dict[str, Quantity]:
    """Efficiency, involved water volume and torque constant of a fitted thruster.

        efficiency      = sqrt(ct / (density area pitch^2))
        volume          = area efficiency pitch / (2 alpha)
        torque_constant = beta density volume efficiency^2 pitch^2

    Errors are propagated to first order through the covariance of the fit. The three follow from
    three parameters, so nothing checks them against each other: the paper's own figures for the
    Jason thruster give an efficiency of 0.19 to 0.20 from its ct, and 0.22 in its text.

    Args:
        fit: a fit of the `Thruster`.
        pitch: pitch of the propeller [m/rad].
        area: area of the duct [m^2].
        density: of the water [kg/m^3].

    Returns:
        "efficiency" [-], "volume" [m^3] and "torque_constant" [N m/V, or N m by another unit of
        the command; of a torque a number, near 1 where all sizes are right].

    Raises:
        InputError: not a thruster, a failed fit, or a size that is not positive.

    Source: Yoerger, Cooke & Slotine 1990, section II B.

    Example:
        >>> result = dft.uncertainty.physical(fit, pitch=0.101, area=0.0527)
        >>> sorted(result)
        ['efficiency', 'torque_constant', 'volume']
    """
    check_sizes("physical", pitch, area, density)
    torque_driven("physical", fit.model)
    if fit.status is Status.SIMULATION_FAILED:
        raise InputError("physical: the fit failed.", "Fit again; see fit.message.")

    def quantities(p: Mapping[str, Any]) -> dict[str, Any]:
        return duct_quantities(torque_driven("physical", fit.model, p), pitch, area, density)

    return derived(fit, quantities, physical_units(fit.model))


def physical_units(model: Model) -> dict[str, str]:
    """Units of what `duct_quantities` gives; the torque is that by the unit of the command.

    Of a command that is a torque itself the constant is a number, near 1 where all sizes are right.
    """
    unit = model.inputs.get("command", "V")
    torque = {"effort": "N m per full effort", "N m": ""}.get(unit, f"N m/{unit}")
    return {"efficiency": "", "volume": "m^3", "torque_constant": torque}


def duct_quantities(
    thruster: QuadraticLoad, pitch: float, area: float, density: float
) -> dict[str, Any]:
    """The closed forms of `physical`, of numbers or of arrays of draws."""
    efficiency = jnp.sqrt(thruster.thrust_gain / (density * area * pitch**2))
    volume = area * efficiency * pitch / (2.0 * thruster.load)
    torque = thruster.drive_gain * density * volume * efficiency**2 * pitch**2
    return {"efficiency": efficiency, "volume": volume, "torque_constant": torque}


def check_sizes(where: str, pitch: float, area: float, density: float) -> None:
    """Raise `InputError` for a size of the duct or the water that is not positive."""
    for name, size in {"pitch": pitch, "area": area, "density": density}.items():
        if not (np.isfinite(size) and size > 0):
            raise InputError(f"{where}: expected a positive {name}, found {size!r}.", "Correct it.")


def torque_driven(
    where: str, model: Model, values: Mapping[str, Any] | None = None
) -> QuadraticLoad:
    """The torque against a quadratic load that a model is, at these values of its parameters."""
    thruster = model.bind(values or {}).quadratic_load
    if thruster is None:
        raise InputError(
            f"{where}: the command of the model '{model}' drives no torque against a quadratic "
            "load; these quantities are those of the torque-driven thruster.",
            "Give a fit of dft.Thruster().",
        )
    return thruster


def derived(
    fit: Fit, function: Callable[[Mapping[str, Any]], Mapping[str, Any]], units: Mapping[str, str]
) -> dict[str, Quantity]:
    """Functions of the parameters of a fit, with errors propagated to first order.

    Args:
        fit: a fit.
        function: from parameter values by full name to quantities by name; differentiable.
        units: the unit of each quantity.

    Example:
        >>> gain = lambda p: {"gain": p["beta"] / p["alpha"]}
        >>> result = dft.uncertainty.derived(fit, gain, {"gain": "1/(V s^2)"})
        >>> result["gain"].unit
        '1/(V s^2)'
    """
    values = {name: jnp.asarray(e.value) for name, e in fit.parameters.items()}
    slopes = jax.jacfwd(function)(values)
    uncertain = [name for name, e in fit.parameters.items() if not e.fixed]
    rows = {name: i for i, name in enumerate(fit.free)}
    out = {}
    for name, value in function(values).items():
        slope = {n: float(slopes[name][n]) for n in uncertain if float(slopes[name][n]) != 0.0}
        variance = sum(
            da * db * fit.covariance[rows[a], rows[b]] if {a, b} <= rows.keys() else np.nan
            for a, da in slope.items()
            for b, db in slope.items()
        )
        error = float(np.sqrt(variance)) if np.isfinite(variance) else None
        out[name] = Quantity(float(value), error, units.get(name, ""))
    return out

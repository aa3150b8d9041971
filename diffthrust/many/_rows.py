"""Results as table rows, one column per quantity."""

from __future__ import annotations

from typing import Any

from diffthrust.comparison._compare import Comparison
from diffthrust.estimation._result import Fit


def row_of(result: Any) -> dict[str, Any]:
    """The columns of a fit or a comparison; empty for other results."""
    if isinstance(result, Fit):
        numbers = estimates_of(result)
        values = {name: value for name, (value, _) in numbers.items()}
        spread = {f"{name}_std_error": error for name, (_, error) in numbers.items()}
        return {**fit_row(result), **values, **spread}
    if isinstance(result, Comparison):
        errors = result.errors
        by_channel = {f"{name}_rmse": error.rmse for name, error in errors.channels.items()}
        return {"model": result.model.name, "nrmse": errors.nrmse, **by_channel}
    return {}


def column_units(result: Any) -> dict[str, str]:
    """The units of the columns of `row_of`, where they have one."""
    units = {}
    if isinstance(result, Fit):
        for name, e in result.parameters.items():
            units |= {name: e.unit, f"{name}_std_error": e.unit}
    if isinstance(result, Comparison):
        units = {f"{name}_rmse": error.unit for name, error in result.errors.channels.items()}
    return {name: unit for name, unit in units.items() if unit}


def fit_row(fit: Fit) -> dict[str, Any]:
    """The columns of a fit, except for its parameters."""
    return {
        "model": fit.model.name,
        "effects": ", ".join(effect.name for effect in fit.model.effects),
        "fit_status": fit.status.value,
        "train_nrmse": fit.train.nrmse,
        "holdout_nrmse": fit.holdout.nrmse if fit.holdout else None,
        "notes": "\n".join(fit.notes),
    }


def estimates_of(fit: Fit) -> dict[str, tuple[float, float | None]]:
    """Value and standard error of each parameter."""
    return {name: (e.value, e.std_error) for name, e in fit.parameters.items()}

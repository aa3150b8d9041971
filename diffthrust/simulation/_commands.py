"""In which of its units a model is commanded by some logs."""

from __future__ import annotations

from collections.abc import Sequence

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust.logs._log import Log
from diffthrust.logs._units import same_quantity
from diffthrust.models._base.model import Model


def command_kind(model: Model, unit: str) -> str:
    """The unit of the model's command that measures the same as ``unit``; its own if none does.

    Its own comes first: a thruster whose numbers are for revolutions a second was taken for one in
    rad/s, by which logs keep them, and thrust 39 times as much.
    """
    kinds = (model.command, *model.commands)
    same = (kind for kind in kinds if unit and kind and same_quantity(unit, kind))
    return next(same, model.command)


def adopted(model: Model, logs: Sequence[Log]) -> Model:
    """The model with its command in the unit in which the logs have it.

    Its numbers stay as they are: they are a first guess for whoever fits it. To be called before
    the logs are bound, for a record has its inputs in the units of one model.
    """
    # Checked before `bind`: with the command in two units, one of the logs would be converted
    # silently.
    kinds = {
        command_kind(model, log.units[name]): log.name
        for log in logs
        for name in model.commanded
        if name in log.inputs
    }
    if len(kinds) > 1:
        units = listing(f"{unit} in {name}" for unit, name in kinds.items())
        raise InputError(
            f"The logs command the model '{model.name}' in different units: {units}.",
            "Give all of them in one, or fit them apart.",
        )
    for unit in kinds:
        if unit != model.command:
            _check_free(model, unit)
            return model.commanded_in(unit)
    return model


def _check_free(model: Model, unit: str) -> None:
    """Raise InputError where a fixed number or a prior was given for another unit of the command.

    A free number is only a first guess and may be of the wrong size; a fixed one or a prior would
    go into the result.
    """
    changed = model.commanded_in(unit).parameters
    for name, p in model.parameters.items():
        if (p.fixed or p.prior is not None) and p.value != p.null and changed[name].unit != p.unit:
            raise InputError(
                f"{model}: {name} is held or has a prior, in {p.unit or 'no unit'}, but the log "
                f"gives the command as {unit!r}, where it is in {changed[name].unit or 'no unit'}.",
                f"Make the model with command={unit!r}, and give {name} in that unit.",
            )

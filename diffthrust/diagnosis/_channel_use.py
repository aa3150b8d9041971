"""Which models the channels of some logs can feed, and for which channels a model has no use."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from functools import partial

from diffthrust._support.errors import InputError
from diffthrust._support.words import humanize, joined
from diffthrust.logs._log import Log
from diffthrust.models import MODELS, Vessel
from diffthrust.models._base.effect import Effect, catalogue
from diffthrust.models._base.model import Model
from diffthrust.simulation._commands import adopted
from diffthrust.simulation._linearise import enters
from diffthrust.simulation._record import Record, bind


def base_models() -> tuple[Model, ...]:
    """The models of the library as they are made without arguments, and a vessel of two forces."""
    return (*(cls() for cls in MODELS.values()), Vessel(drive="twin"))


def models_fed_by(logs: Sequence[Log]) -> tuple[Model, ...]:
    """The models of the library of which the logs have every input and measure an output.

    Each has its command in the unit of the logs.

    Example:
        >>> inputs, measured = {"command": [0.0, 0.5, 1.0]}, {"speed": [0.0, 90.0, 200.0]}
        >>> units = {"command": "effort", "speed": "rad/s"}
        >>> log = dft.Log([0.0, 0.1, 0.2], inputs=inputs, measured=measured, units=units)
        >>> [model.name for model in models_fed_by([log])]
        ['thruster', 'speed_loop_thruster']
    """
    named = (
        model
        for model in base_models()
        if all({*model.inputs} <= {*log.inputs} for log in logs)
        and any({*model.outputs} & {*log.measured} for log in logs)
    )
    return tuple(model for model in map(partial(_commanded, logs=logs), named) if model)


def _commanded(model: Model, logs: Sequence[Log]) -> Model | None:
    """A model with its command in the unit of the logs; ``None`` where theirs are of other kinds.

    A speed in m/s is no speed of a shaft, and an effort no voltage of a motor.
    """
    try:
        model = adopted(model, logs)
        bind(model, logs)
    except InputError:
        return None
    return model


def unused_channels(model: Model, records: Sequence[Record]) -> dict[str, str]:
    """The channels of the logs that neither the model nor a known effect reads in it.

    Args:
        model: the model, with its effects.
        records: all of them, training and unseen.

    Returns:
        By channel, which effects and models do have a use for it, in words.

    Example:
        >>> from diffthrust.simulation._record import bind
        >>> inputs = {"command": [0.0, 0.5, 1.0], "supply_voltage": [15.0, 14.0, 13.0]}
        >>> measured = {"speed": [0.0, 90.0, 200.0]}
        >>> log = dft.Log([0.0, 0.1, 0.2], inputs=inputs, measured=measured)
        >>> model = dft.SpeedLoopThruster(command="V")
        >>> list(unused_channels(model, bind(model, [log])))
        ['supply_voltage']
    """
    acting = [effect for effect in _others(model) if _acts_in(effect, model)]
    read = {*model.inputs, *model.states}
    for effect in (*model.effects, *acting):
        read |= {*effect.needs, *effect.reads, *effect.ports}
    fed = list(dict.fromkeys(name for record in records for name in record.inputs))
    unread = [
        name for name in fed if name not in read and not _in_equations(name, model, acting, fed)
    ]
    measured = dict.fromkeys(name for record in records for name in record.log.measured)
    unread += [n for n in measured if n not in model.outputs and n not in model.states]
    return {name: _use_elsewhere(name, model) for name in unread}


def unused_notes(model: Model, unused: Mapping[str, str]) -> tuple[str, ...]:
    """A sentence for each unused channel.

    Example:
        >>> unused_notes(dft.Vessel(), {"roll": "no model or effect of the library knows it"})[0]
        "The logs have 'roll', and neither the vessel nor a known effect reads it there: no model or
        effect of the library knows it."
    """
    return tuple(
        f"The logs have '{name}', and neither the {humanize(model.name)} nor a known effect reads "
        f"it there: {use}."
        for name, use in unused.items()
    )


def _others(model: Model) -> list[Effect]:
    """The effects of the catalogue that could be added to a model by their names."""
    taken = {*(effect.name for effect in model.effects), *model.parameters}
    return [cls() for name, cls in catalogue().items() if name not in taken]


def _acts_in(effect: Effect, model: Model) -> bool:
    """Whether a model has all places at which an effect acts, and takes the channels it needs."""
    channels = {*model.inputs, *model.optional_inputs}
    places = {*model.ports, *channels, *model.outputs}
    return {*effect.ports} <= places and {*effect.needs} <= channels


def _in_equations(
    name: str, model: Model, effects: Sequence[Effect], inputs: Collection[str]
) -> bool:
    """Whether an input enters the equations of a model with some effects.

    So it shows what they read without declaring it, as the wind on a vessel reads a vane.
    """
    whole = model + [effect for effect in effects if {*effect.needs} <= {*inputs}]
    return enters(name, whole, inputs)


def _use_elsewhere(name: str, model: Model) -> str:
    """Which effects and models of the library read a channel or compare with it."""
    models = [other for other in base_models() if type(other) is not type(model)]
    channels = [other for other in models if name in {**other.inputs, **other.outputs}]
    readers = [effect for effect in _others(model) if name in effect.needs]
    uses = [
        f"{effect.name} reads it, which acts at '{joined(effect.ports)}' of {joined(homes, 'or')}"
        for effect in readers
        if (homes := [other.name for other in models if _acts_in(effect, other)])
    ]
    if channels:
        uses.append(f"it is a channel of {joined((m.name for m in channels), 'or')}")
    return "; ".join(uses) or "no model or effect of the library knows it"

"""Restore models and effects from saved files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from diffthrust._support.errors import InputError
from diffthrust._support.lossless import Decoder
from diffthrust._support.names import listing
from diffthrust.actuators import ACTUATORS
from diffthrust.bodies import BODIES
from diffthrust.models import MODELS
from diffthrust.models._base.component import Component
from diffthrust.models._base.effect import Effect
from diffthrust.models._base.made_effect import MADE_EFFECTS
from diffthrust.models._base.model import Model
from diffthrust.models._base.parameter import Parameter
from diffthrust.models._base.registry import catalogue
from diffthrust.models._craft.craft import Craft
from diffthrust.sensors import SENSORS

_C = TypeVar("_C", bound=Component)


def restore_model(decoder: Decoder, plain: dict[str, Any], classes: Sequence[type]) -> Model:
    """Restore a model with its effects from what `Model.as_plain` gave.

    ``classes`` are the user's own that may be used.
    """
    model = restore_component(Model, decoder, plain, classes)
    for described in plain["effects"]:
        effect = restore_component(Effect, decoder, described, classes)
        if isinstance(model, Craft) and "members" in described:
            effect = model.placed(effect, *described["members"])
        model = model + effect
    return model


def restore_component(
    base: type[_C], decoder: Decoder, plain: dict[str, Any], classes: Sequence[type]
) -> _C:
    """Restore a model without effects, or an effect, from the output of `Component.as_plain`."""
    name, what = plain["name"], base.__name__.lower()
    cls = _class_of(base, plain, classes)
    # Arguments shape a class (its options, its formula), parameters have their saved values: both
    # are needed to restore it.
    arguments = {key: _restored(value) for key, value in plain["arguments"].items()}
    parts = plain.get("parts", {}).items()
    component = cls.made_of(
        arguments, {k: restore_component(Component, decoder, p, classes) for k, p in parts}
    )
    saved = {
        key: decoder.decoded(Parameter, described) for key, described in plain["parameters"].items()
    }
    differing = sorted(set(saved) ^ set(component._parameters))
    if differing:
        raise InputError(
            f"The {what} '{name}' was saved with the parameters {listing(saved)}; its "
            f"class {cls.__name__} has {listing(component._parameters)} now.",
            "Fit again with the current class, or load with the class as it was saved.",
        )
    return component._copy(_parameters=saved, **{key: p.value for key, p in saved.items()})


def _class_of(base: type, plain: dict[str, Any], classes: Sequence[type]) -> Any:
    name, origin = plain["name"], plain["own"]
    parts = {**BODIES, **ACTUATORS, **SENSORS}
    by_name: Mapping[str, Any] = (
        {**catalogue(), **MADE_EFFECTS} if base is Effect else {**MODELS, **parts, "craft": Craft}
    )
    candidates: list[Any] = [*classes, *by_name.values()]  # also of installed packages
    if origin is None:
        if name in by_name:
            return by_name[name]
        raise InputError(
            f"The {base.__name__.lower()} '{name}' is not known to this version of diffthrust.",
            "Load it with the version that it was saved with; the file names that.",
        )
    for cls in candidates:
        # A class that the user passes counts by its name alone: scripts are loaded under a module
        # name with a hash of their text, which differs from that of the saving process.
        named = issubclass(cls, base) and cls.__qualname__ == origin["class"]
        if named and (cls in classes or cls.__module__ == origin["module"]):
            return cls
    where = f" ({origin['file']})" if origin["file"] else ""
    word = f"'{origin['file'] or 'script.py'}:{origin['class']}'"
    raise InputError(
        f"The {base.__name__.lower()} '{name}' is of a class of your own, {origin['class']} in "
        f"{origin['module']}{where}; loading runs no code that you did not ask for.",
        f"Give the class, or the script that defines it: dft.load(path, "
        f"classes=[{origin['class']}]) or classes=[{word}]; on the command line trust its folder, "
        f"--trust {Path(origin['file']).parent if origin['file'] else 'DIR'}.",
    )


def _restored(value: Any, described: bool = False) -> Any:
    """Undo JSON: lists become tuples, and "inf" in a parameter becomes a number."""
    if isinstance(value, dict):
        return {key: _restored(each, True) for key, each in value.items()}
    if isinstance(value, list):
        return tuple(_restored(each, described) for each in value)
    return float(value) if described and value in ("inf", "-inf") else value

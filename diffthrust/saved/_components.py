"""Models and effects made of what a file tells of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

from diffthrust._support.errors import InputError
from diffthrust._support.lossless import Decoder
from diffthrust._support.names import listing
from diffthrust.models import MODELS
from diffthrust.models._base.component import Component
from diffthrust.models._base.effect import Effect
from diffthrust.models._base.made_effect import MADE_EFFECTS
from diffthrust.models._base.model import Model
from diffthrust.models._base.parameter import Parameter
from diffthrust.models._base.registry import catalogue

_C = TypeVar("_C", bound=Component)


def model_made(decoder: Decoder, plain: dict[str, Any], own: Sequence[type]) -> Model:
    """The model that `Model.as_plain` tells of, with its effects.

    Args:
        decoder: reads the parameters.
        plain: what was told.
        own: classes of the user's own, of which it may be made.

    Raises:
        InputError: a class that is not there, or is another one by now.
    """
    model = component_made(Model, decoder, plain, own)
    for effect in plain["effects"]:
        model = model + component_made(Effect, decoder, effect, own)
    return model


def component_made(
    base: type[_C], decoder: Decoder, plain: dict[str, Any], own: Sequence[type]
) -> _C:
    """The model without its effects, or the effect, that `Component.as_plain` tells of."""
    name, what = plain["name"], base.__name__.lower()
    cls = _class_of(base, plain, own)
    thing = cls(**{key: _restored(value) for key, value in plain["arguments"].items()})
    saved = {
        key: decoder.decoded(Parameter, described) for key, described in plain["parameters"].items()
    }
    differing = sorted(set(saved) ^ set(thing._parameters))
    if differing:
        raise InputError(
            f"The {what} '{name}' was saved with the parameters {listing(saved)}; its "
            f"class {cls.__name__} has {listing(thing._parameters)} now.",
            "Fit again with the class as it is, or load with the one that it was.",
        )
    return thing._copy(_parameters=saved, **{key: p.value for key, p in saved.items()})


def _class_of(base: type, plain: dict[str, Any], own: Sequence[type]) -> Any:
    name, told = plain["name"], plain["own"]
    known: Mapping[str, Any] = MODELS if base is Model else {**catalogue(), **MADE_EFFECTS}
    candidates: list[Any] = [*own, *known.values()]  # those of installed packages are known too
    if told is None:
        if name in known:
            return known[name]
        raise InputError(
            f"The {base.__name__.lower()} '{name}' is not known to this version of diffthrust.",
            "Load it with the version that it was saved with; the file names that.",
        )
    for cls in candidates:
        named = issubclass(cls, base) and cls.__qualname__ == told["class"]
        if named and (cls in own or cls.__module__ == told["module"]):
            return cls
    where = f" ({told['file']})" if told["file"] else ""
    word = f"'{told['file'] or 'script.py'}:{told['class']}'"
    raise InputError(
        f"The {base.__name__.lower()} '{name}' is of a class of your own, {told['class']} in "
        f"{told['module']}{where}; loading runs no code that you did not ask for.",
        f"Give the class, or the script that defines it: dft.load(path, classes=[{told['class']}]) "
        f"or classes=[{word}].",
    )


def _restored(value: Any, described: bool = False) -> Any:
    """What JSON made a list was a tuple; in a description of a parameter, "inf" is a number."""
    if isinstance(value, dict):
        return {key: _restored(each, True) for key, each in value.items()}
    if isinstance(value, list):
        return tuple(_restored(each, described) for each in value)
    return float(value) if described and value in ("inf", "-inf") else value

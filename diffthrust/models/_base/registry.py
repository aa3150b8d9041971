"""The catalogue of effects: those of the library, and those of installed packages."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from importlib import import_module
from importlib.metadata import entry_points

from diffthrust._support.errors import InputError
from diffthrust._support.names import nearby
from diffthrust.models._base.effect import EFFECTS, Effect

_GROUP = "diffthrust.effects"
"""Packages offer effects of their own by entry points of this group, each naming a class.

It is also the name of the folder whose import registers the library's own: as text, for what is
registered must not be known here, and a model must find it by name even where nobody has touched
that folder yet."""


@lru_cache(maxsize=1)
def catalogue() -> Mapping[str, type[Effect]]:
    """All known effects by name: the library's in the order of its files, then packages'."""
    import_module(_GROUP)
    # sorted, since the order of registration follows what happens to be imported first
    classes = dict(sorted(EFFECTS.items(), key=lambda e: (e[1].__module__, e[1].__qualname__)))
    for point in entry_points(group=_GROUP):
        cls = point.load()
        if not (isinstance(cls, type) and issubclass(cls, Effect)):
            raise InputError(
                f"The entry point '{point.name}' of {_GROUP} gives {cls!r}, which is no effect.",
                "Let it name a class derived from diffthrust.Effect.",
            )
        if cls.name in classes:
            raise InputError(
                f"The entry point '{point.name}' of {_GROUP} gives an effect '{cls.name}', a name "
                "that is taken.",
                "Rename the effect, or remove the package.",
            )
        classes[cls.name] = cls
    return classes


def effect_named(name: str) -> Effect:
    """The effect of a canonical name, as its class declares it."""
    classes = catalogue()
    if name not in classes:
        raise InputError(
            f"the effect {name!r} is not known; {nearby(name, classes)}.",
            "Correct the name ('diffthrust effects' lists all); an effect of your own is added as "
            "an object: model + MyEffect().",
        )
    return classes[name]()

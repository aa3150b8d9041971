"""Models and effects by the names that spec files use."""

from __future__ import annotations

import importlib.util
import inspect
import traceback
from collections.abc import Mapping
from functools import lru_cache
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

from diffthrust._channels import listing, nearest
from diffthrust._effect import Effect
from diffthrust._errors import InputError
from diffthrust._model import Model

GROUP = "diffthrust.effects"
"""Packages offer effects of their own by entry points of this group, each naming a class."""


@lru_cache(maxsize=1)
def catalogue() -> Mapping[str, type[Effect]]:
    """All known effects by name: the library's, and those of installed packages.

    Raises:
        InputError: an entry point that is not an effect, or one with a name that is taken.
    """
    from diffthrust.effects import EFFECTS

    found = dict(EFFECTS)
    for point in entry_points(group=GROUP):
        cls = point.load()
        if not (isinstance(cls, type) and issubclass(cls, Effect)):
            raise InputError(
                f"The entry point '{point.name}' of {GROUP} gives {cls!r}, which is no effect.",
                "Let it name a class derived from diffthrust.Effect.",
            )
        if cls.name in found:
            raise InputError(
                f"The entry point '{point.name}' of {GROUP} gives an effect '{cls.name}', a name "
                "that is taken.",
                "Rename the effect, or remove the package.",
            )
        found[cls.name] = cls
    return found


def model_class(word: str, folder: Path) -> type[Model]:
    """The class of a model: a name of the catalogue, or ``script.py:Class`` of the user's own."""
    from diffthrust.models import MODELS

    return _class(word, folder, Model, MODELS, "model")


def effect_class(word: str, folder: Path) -> type[Effect]:
    """The class of an effect: a canonical name, or ``script.py:Class`` of the user's own."""
    return _class(word, folder, Effect, catalogue(), "effect")


def named(word: str) -> Effect:
    """The effect of a canonical name, or of ``script.py:Class``, as its class declares it.

    Raises:
        InputError: there is none of that name.
    """
    return effect_class(word, Path())()


def made(cls: type[Model], options: Mapping[str, Any]) -> Model:
    """The model with these options of its constructor.

    Raises:
        InputError: an option that the model does not have.
    """
    known = [
        name
        for name, p in inspect.signature(cls.__init__).parameters.items()
        if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY) and name != "self"
    ]
    for name in options:
        if name not in known:
            near = nearest(name, known)
            raise InputError(
                f"the model '{cls.name}' has no option {name!r}{'; ' + near if near else ''}; "
                f"it has {listing(known)}.",
                "Correct or remove the option; values of parameters belong under [parameters].",
            )
    return cls(**options)


def _class(word: str, folder: Path, base: type, known: Mapping[str, type], what: str) -> Any:
    script, colon, name = word.rpartition(":")
    if colon and script.endswith(".py"):
        found = getattr(_script((folder / script).resolve()), name, None)
        if isinstance(found, type) and issubclass(found, base):
            return found
        raise InputError(
            f"expected the class {name!r} of a {base.__name__} in {script}, found none.",
            f"Define class {name}(dft.{base.__name__}) there.",
        )
    if word in known:
        return known[word]
    near = nearest(word, known)
    raise InputError(
        f"the {what} {word!r} is not known{'; ' + near if near else ''}; "
        f"there are {listing(known)}.",
        f"Correct the name; {'an' if what == 'effect' else 'a'} {what} of your own is named as "
        f"'script.py:Class'.",
    )


@lru_cache(maxsize=64)
def _script(path: Path) -> ModuleType:
    """Run a user's script as a module, once."""
    described = importlib.util.spec_from_file_location(f"_user_{path.stem}", path)
    if described is None or described.loader is None or not path.is_file():
        raise InputError(f"{path}: expected a Python script, found none.", "Correct the path.")
    module = importlib.util.module_from_spec(described)
    try:
        described.loader.exec_module(module)
    except Exception as error:
        lines = [
            f.lineno for f in traceback.extract_tb(error.__traceback__) if f.filename == str(path)
        ]
        lines = lines or [getattr(error, "lineno", None)]
        raise InputError(
            f"{path.name}, line {lines[-1]}: the script fails with {type(error).__name__}: {error}",
            "Mend the script; it must run on its own.",
        ) from error
    return module

"""The effects of a spec file: names, scripts, and tables such as ``{ formula = "...", ... }``."""

from __future__ import annotations

import inspect
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing, nearest
from diffthrust.effects import Formula
from diffthrust.models._base.effect import Effect
from diffthrust.models._base.made_effect import MADE_EFFECTS, MadeEffect
from diffthrust.specs._scripts import check_place, effect_class


def effect_of(entry: str | Mapping[str, Any], folder: Path, trust: Sequence[Path | str]) -> Effect:
    """The effect of an entry under ``effects``: a name, a ``script.py:Class``, or a table.

    Example:
        >>> effect_of({"formula": "-a * speed", "port": "shaft", "a": "rad/s^2"}, Path(), ())
        Formula(port='shaft', expression='-a * speed', name='formula', a=0)
    """
    if isinstance(entry, Mapping):
        return _made_of(entry)
    check_place(entry, folder, trust)
    return effect_class(entry, folder)()


def _made_of(table: Mapping[str, Any]) -> Effect:
    words = [word for word in MADE_EFFECTS if word in table]
    if len(words) != 1:
        near = next(filter(None, (nearest(key, MADE_EFFECTS) for key in table)), "")
        raise InputError(
            f"expected one of the keys {listing(MADE_EFFECTS)} in a table of an effect, found "
            f"{listing(table)}{'; ' + near if near else ''}.",
            f"Write {_EXAMPLE}.",
        )
    cls: type[MadeEffect] = MADE_EFFECTS[words[0]]
    arguments = {key: value for key, value in table.items() if key != words[0]}
    if cls.main in arguments:
        raise InputError(
            f"{words[0]}: the key {cls.main!r} is not known; {words[0]!r} stands for it.",
            "Remove it.",
        )
    arguments[cls.main] = table[words[0]]
    try:
        # Bound before the call, so that a TypeError raised inside the class is not taken for a
        # wrong key.
        inspect.signature(cls).bind(**arguments)
    except TypeError as error:
        raise InputError(f"{words[0]}: {error}.", f"Write {_EXAMPLE}.") from None
    return cls(**arguments)


_EXAMPLE = f'{{ {Formula.name} = "-a * speed", port = "shaft", a = "rad/s^2", name = "drag" }}'

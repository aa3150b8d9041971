"""Models and effects by their names in spec files, including users' scripts."""

from __future__ import annotations

import inspect
import os
import sys
import traceback
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from hashlib import sha256
from pathlib import Path
from types import ModuleType
from typing import Any

from diffthrust._support.errors import Defect, InputError, os_errors_as, refused
from diffthrust._support.files import PathLike, oddity
from diffthrust._support.names import listing, nearby, nearest
from diffthrust.effects import Formula
from diffthrust.models import MODELS
from diffthrust.models._base.component import Component
from diffthrust.models._base.effect import Effect, catalogue
from diffthrust.models._base.made_effect import MADE_EFFECTS, MadeEffect
from diffthrust.models._base.model import Model

_USERS = "_user_"
"""Prefix of the module names of users' scripts."""
_EXAMPLE = f'{{ {Formula.name} = "-a * speed", port = "shaft", a = "rad/s^2", name = "drag" }}'


def model_class(word: str, folder: Path) -> type[Model]:
    """The class of a model: a name of the catalogue, or ``script.py:Class``."""
    return _class(word, folder, Model, MODELS, "model")


def effect_class(word: str, folder: Path) -> type[Effect]:
    """The class of an effect: a name of the catalogue, or ``script.py:Class``."""
    return _class(word, folder, Effect, catalogue(), "effect")


def own_class(word: str, folder: Path) -> type[Component]:
    """The user's model or effect named by ``script.py:Class``."""
    if script_file(word, folder) is None:
        raise InputError(
            f"expected a class or 'script.py:Class', found {word!r}.",
            "Give the class, or the path of its script and its name.",
        )
    return _class(word, folder, Component, {}, "class")


def model_with(cls: type[Model], options: Mapping[str, Any]) -> Model:
    """Construct a model with options."""
    names = [
        name
        for name, p in inspect.signature(cls.__init__).parameters.items()
        if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY) and name != "self"
    ]
    for name in options:
        if name not in names:
            raise InputError(
                f"the model '{cls.name}' has no option {name!r}{nearest(name, names, '; ')}; "
                f"it has {listing(names)}.",
                "Correct or remove the option; values of parameters belong under [parameters].",
            )
    return cls(**options)


def script_file(word: str, folder: Path) -> Path | None:
    """The script of ``script.py:Class``; ``None`` for a name of the catalogue."""
    script, colon, _ = word.rpartition(":")
    return folder / script if colon and script.endswith(".py") else None


def trusted_folders(trust: PathLike | Iterable[PathLike]) -> tuple[str, ...]:
    """The folders of a keyword ``trust``, absolute: processes may work in another folder."""
    listed = [trust] if isinstance(trust, str | os.PathLike) else trust
    return tuple(str(Path(place).absolute()) for place in listed)


def check_place(word: str, folder: Path, trust: Iterable[Path | str] = ()) -> None:
    """Refuse a script outside the spec's folder and outside the trusted folders.

    A user who inspects a spec sees the files beside it; a script from elsewhere may run unseen.
    """
    script = script_file(word, folder)
    if script is None:
        return
    # Links are followed first: one beside the spec may lead anywhere.
    real = script.resolve()
    if not any(real.is_relative_to(Path(place).resolve()) for place in (folder, *trust)):
        raise InputError(
            f"the script {word.rpartition(':')[0]!r} lies outside the folder of the spec, in "
            f"{real.parent}, and is not run.",
            "Read it; then trust its folder (--trust DIR, in Python trust=DIR), or put it beside "
            "the spec.",
        )


def effect_of(entry: str | Mapping[str, Any], folder: Path, trust: Sequence[Path | str]) -> Effect:
    """The effect of an entry under ``effects``: a name, a ``script.py:Class``, or a table."""
    if isinstance(entry, Mapping):
        return _made_of(entry)
    check_place(entry, folder, trust)
    return effect_class(entry, folder)()


def _made_of(table: Mapping[str, Any]) -> Effect:
    words = [word for word in MADE_EFFECTS if word in table]
    if len(words) != 1:
        near = next(filter(None, (nearest(key, MADE_EFFECTS, "; ") for key in table)), "")
        raise InputError(
            f"expected one of the keys {listing(MADE_EFFECTS)} in a table of an effect, found "
            f"{listing(table)}{near}.",
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


def error_in_script(error: BaseException) -> InputError | None:
    """The message for an exception raised in a user's script, with its innermost line; or None."""
    way = traceback.walk_tb(error.__traceback__)
    lines = [(f, n) for f, n in way if str(f.f_globals.get("__name__")).startswith(_USERS)]
    if not lines:
        return None
    frame, line = lines[-1]
    where = f"{Path(frame.f_code.co_filename).name}, line {line}, in {frame.f_code.co_name}"
    return InputError(
        f"{where}: the script fails with {type(error).__name__}: {error}", "Mend the script."
    )


def as_input_error(error: Exception, command: str) -> InputError:
    """Any error as a problem with its mend: of the input, a script, the system, or a defect.

    The mend of a defect names the command with which the user can raise it again.
    """
    if isinstance(error, InputError):
        return error
    if in_script := error_in_script(error):
        return in_script
    if isinstance(error, OSError):
        return InputError(*refused(error))
    return Defect(
        f"A defect of diffthrust, not of your input: {type(error).__name__}: {error}",
        f"Please report it, with what DIFFTHRUST_DEBUG=1 {command} prints.",
    )


def _class(word: str, folder: Path, base: type, classes: Mapping[str, type], what: str) -> Any:
    if script := script_file(word, folder):
        name = word.rpartition(":")[2]
        defined = vars(_script(script.resolve())).get(name)  # no __getattr__ of the script runs
        if isinstance(defined, type) and issubclass(defined, base):
            return defined
        raise InputError(
            f"expected the class {name!r} of a {base.__name__} in {word.rpartition(':')[0]}, "
            "found none.",
            f"Define class {name}(dft.{base.__name__}) there.",
        )
    if word in classes:
        return classes[word]
    raise InputError(
        f"the {what} {word!r} is not known; {nearby(word, classes)}.",
        f"Correct the name; {'an' if what == 'effect' else 'a'} {what} of your own is named as "
        f"'script.py:Class'.",
    )


def _script(path: Path) -> ModuleType:
    """The module of a user's script, from its current text."""
    if what := oddity(path):
        raise InputError(f"{path}: expected a Python script, found {what}.", "Correct the path.")
    with os_errors_as(f"{path}: expected a Python script, found none", "Correct the path."):
        source = path.read_bytes()
    return _executed(path, source)


@lru_cache(maxsize=64)
def _executed(path: Path, source: bytes) -> ModuleType:
    """Execute a script's text, not the cached bytecode in its folder, which may be older.

    Anything the script raises becomes an InputError, even SystemExit: a script that calls
    ``sys.exit(0)`` would end a command with the status of success.
    """
    # The hash of the text makes an edited script a new module: classes of the old one stay valid in
    # results that hold them.
    module = ModuleType(f"{_USERS}{path.stem}_{sha256(source).hexdigest()[:12]}")
    module.__file__ = str(path)
    sys.modules[module.__name__] = module  # dataclasses look up their module there
    try:
        exec(compile(source, str(path), "exec"), module.__dict__)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        del sys.modules[module.__name__]
        lines = [
            f.lineno for f in traceback.extract_tb(error.__traceback__) if f.filename == str(path)
        ]
        lines = lines or [getattr(error, "lineno", None) or 1]
        raise InputError(
            f"{path.name}, line {lines[-1]}: the script fails with {type(error).__name__}: {error}",
            "Mend the script; it must run on its own, to its end.",
        ) from error
    return module

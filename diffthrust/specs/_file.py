"""The text of a spec file becomes its keys, and messages for what it may not hold."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError

from diffthrust._support.errors import InputError
from diffthrust._support.files import oddity
from diffthrust._support.names import listing, nearest, shortly
from diffthrust.logs._kinds import is_log, kind_of
from diffthrust.specs._extent import check_extent, check_keys, too_deep, too_long
from diffthrust.specs._lines import line_of
from diffthrust.specs._parts import ExpectedNumber, ParameterPart, SpecFile

NAME = "fit.toml"
"""The name of a spec file inside a folder."""


def read_spec_text(path: Path) -> str:
    """The text of a spec file, line ends untouched.

    Raises:
        InputError: there is no such file, it is a log, no file at all, or not UTF-8 text.
    """
    if what := oddity(path):
        raise InputError(
            f"{path}: expected a spec file (TOML), found {what}.", "Name the file of a spec."
        )
    if path.is_file() and is_log(path) and not _is_toml(path):
        raise InputError(
            f"{path}: expected a spec file (TOML), found a log ({kind_of(path).article}).",
            _look(path),
        )
    try:
        return path.read_bytes().decode("utf-8")
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: expected text in UTF-8, found the byte {error.object[error.start]:#04x} "
            f"at position {error.start}.",
            "Save the file as UTF-8.",
        ) from None
    except OSError as error:
        folder = path.parent
        inside = sorted(folder.iterdir()) if path.name == NAME and folder.is_dir() else []
        others = any(file.suffix.lower() == ".toml" for file in inside)
        if not others and any(map(is_log, inside)):
            raise InputError(
                f"{folder}: expected a {NAME} in this folder, found logs alone.", _look(folder)
            ) from None
        raise InputError(
            f"{path}: the spec file cannot be read ({error.strerror or error}).",
            f"Name a TOML file, or a folder that holds a {NAME}.",
        ) from None


def _is_toml(path: Path) -> bool:
    if path.suffix.lower() == ".toml":
        return True
    try:
        return bool(tomllib.loads(path.read_text("utf-8")))
    except (ValueError, RecursionError):  # of TOML and of UTF-8
        return False


def _look(path: Path) -> str:
    return (
        f"Have a spec drafted, read it, then fit: diffthrust look {path} --spec {NAME}, then "
        f"diffthrust fit {NAME}."
    )


def parse_toml(text: str, file: Path | str) -> dict[str, Any]:
    """The tables of a TOML text.

    Raises:
        InputError: the text is not TOML, or no sane one; the message names file, line and column.
    """
    check_keys(text, file)
    try:
        tables = tomllib.loads(text.removeprefix("\ufeff"))
        check_extent(tables, text, file)
        return tables
    except RecursionError:
        raise too_deep(text, file) from None
    except tomllib.TOMLDecodeError as error:
        said = str(error)
        at = re.search(r"\(at (?:line (\d+), column (\d+)|end of document)\)", said)
        line = at[1] if at and at[1] else str(len(text.splitlines()))
        column = f", column {at[2]}" if at and at[2] else ""
        what = said[: at.start()].strip() if at else said
        raise InputError(
            f"{file}, line {line}{column}: this is not TOML: {what[:1].lower()}{what[1:]}.",
            'Correct the line; text is written "in quotes", lists as [1, 2], tables as [logs].',
        ) from None
    except InputError:
        raise
    except ValueError:  # of Python, which reads no integer of some thousand digits
        raise too_long(text, file) from None


def parse_spec(text: str, file: Path | str) -> SpecFile:
    """A spec out of its text.

    Raises:
        InputError: a key is unknown, missing, or holds something else than expected.
    """
    data = parse_toml(text, file)
    _dotted(data)
    try:
        return SpecFile.model_validate(data)
    except ValidationError as error:
        problems = error.errors()
    # a misspelt key is reported twice, as unknown and as missing: the first says more
    problems.sort(key=lambda problem: problem["type"] != "extra_forbidden")
    raise _refusal(problems[0], text, file, len(problems) - 1)


def _dotted(data: dict[str, Any]) -> None:
    """Read ``effect.parameter = ...``, which TOML nests, as one name."""
    effects = data.get("effects", [])
    effects = [effects] if isinstance(effects, str | dict) else effects
    effects = effects if isinstance(effects, list) else []
    called = [e.get("name", "") if isinstance(e, dict) else e for e in effects]
    names = {str(word).rpartition(":")[2] for word in called}
    for holder in (data, data.get("expected")):
        tables = holder.get("parameters") if isinstance(holder, dict) else None
        if not isinstance(tables, dict):
            continue
        fields = {*ParameterPart.model_fields, *ExpectedNumber.model_fields}
        for name, table in list(tables.items()):
            nested = isinstance(table, dict) and table and not fields & set(table)
            if nested and (name in names or all(isinstance(v, dict) for v in table.values())):
                del tables[name]
                tables.update({f"{name}.{key}": value for key, value in table.items()})


def _refusal(problem: Mapping[str, Any], text: str, file: Path | str, more: int) -> InputError:
    members = ("str", "bool", "int", "float", "TimePart")  # of a union, not keys
    loc = tuple(p for p in problem["loc"] if not str(p).startswith("function-"))
    loc = tuple(p for k, p in enumerate(loc) if k < 2 or p not in members)
    where = line_of(text, file, loc)
    parent, key = loc[:-1], str(loc[-1]) if loc else ""
    also = f" ({more} more after this one.)" if more else ""
    table = f"[{'.'.join(map(str, parent))}]" if parent else "the top of the file"
    if problem["type"] == "extra_forbidden":
        known = _keys(parent)
        near = nearest(key, known)
        return InputError(
            f"{where}: the key {key!r} is not known in {table}{'; ' + near if near else ''}.{also}",
            f"Correct the key; known there are {listing(known)}.",
        )
    if problem["type"] == "missing":
        example = f"[{key}]" if not parent and key in ("logs", "channels") else f"{key} = ..."
        return InputError(
            f"{where}: expected the key {key!r} in {table}, found none.{also}",
            f"Add {example} to {table}." if parent or "=" in example else f"Add {example}.",
        )
    said = problem["msg"].removeprefix("Value error, ").removeprefix("Input should be ")
    said = said.replace("a valid ", "a ").replace("dictionary", "table")
    said = re.sub(r" or instance of \w+$", "", said)
    return InputError(
        f"{where}: expected {said[:1].lower()}{said[1:]}, found {shortly(problem['input'])}.{also}",
        f"Correct {'.'.join(map(str, loc))}.",
    )


def _keys(loc: Sequence[Any]) -> list[str]:
    """The keys that the table at a path may have."""
    here: Any = SpecFile
    for part in loc:
        if isinstance(here, type) and issubclass(here, BaseModel):
            here = here.model_fields[str(part)].annotation
        else:
            here = get_args(here)[-1]
        while get_origin(here) in (Annotated, Union, UnionType):
            here = next(a for a in get_args(here) if a is not type(None))
    return list(here.model_fields) if hasattr(here, "model_fields") else []

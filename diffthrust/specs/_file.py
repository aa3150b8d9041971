"""Parse the text of a spec file; every invalid key gets a message with its line."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, NamedTuple, TypeVar, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError

from diffthrust._support.errors import InputError
from diffthrust._support.files import oddity
from diffthrust._support.names import listing, nearest, short_repr
from diffthrust.effects import EFFECTS
from diffthrust.logs._kinds import is_log, kind_of
from diffthrust.specs._parts import ChannelPart, ExpectedNumber, ParameterPart, SpecFile

P = TypeVar("P", bound=BaseModel)
NAME = "fit.toml"
"""The name of a spec file inside a folder."""


def read_spec_text(path: Path) -> str:
    """The text of a spec file, line ends untouched."""
    if what := oddity(path):
        raise InputError(
            f"{path}: expected a spec file (TOML), found {what}.", "Name the file of a spec."
        )
    # "diffthrust fit run1.csv": a common first call, answered by the way to a spec.
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
        has_spec = any(file.suffix.lower() == ".toml" for file in inside)
        if not has_spec and any(map(is_log, inside)):
            raise InputError(
                f"{folder}: expected a {NAME} in this folder, found only logs.", _look(folder)
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
    except (ValueError, RecursionError):  # invalid TOML or UTF-8
        return False


def _look(path: Path) -> str:
    return (
        f"Have a spec drafted, read it, then fit: diffthrust look {path} --spec {NAME}, then "
        f"diffthrust fit {NAME}."
    )


def parse_toml(text: str, file: Path | str) -> dict[str, Any]:
    """The tables of a TOML text."""
    if _DOTTED.search(text):  # a key of many dots, which takes tomllib minutes
        raise _too_deep(text, file)
    try:
        tables = tomllib.loads(text.removeprefix("\ufeff"))
        _check_extent(tables, text, file)
        return tables
    except RecursionError:
        raise _too_deep(text, file) from None
    except tomllib.TOMLDecodeError as error:
        message = str(error)
        # tomllib states the place only within its message (attributes came with Python 3.14).
        at = re.search(r"\(at (?:line (\d+), column (\d+)|end of document)\)", message)
        line = at[1] if at and at[1] else str(len(text.splitlines()))
        column = f", column {at[2]}" if at and at[2] else ""
        what = message[: at.start()].strip() if at else message
        if what == "Cannot overwrite a value":  # as after adding a key of the drafted file again
            raise InputError(
                f"{file}, line {line}: this key is already in the file.",
                "Keep one of the two lines.",
            ) from None
        raise InputError(
            f"{file}, line {line}{column}: this is not TOML: {what[:1].lower()}{what[1:]}.",
            'Correct the line; text is written "in quotes", lists as [1, 2], tables as [logs].',
        ) from None
    except InputError:
        raise
    except ValueError:  # raised by Python for an integer of thousands of digits
        raise _too_long(text, file) from None


def parse_spec(text: str, file: Path | str) -> SpecFile:
    """Parse a spec."""
    data = parse_toml(text, file)
    _dotted(data)
    return validated(SpecFile, data, text, file)


def validated(kind: type[P], data: Mapping[str, Any], text: str, file: Path | str) -> P:
    """The tables of a TOML text as a part of a spec file."""
    try:
        return kind.model_validate(data)
    except ValidationError as error:
        problems = error.errors()
    # A misspelt key is reported twice, as unknown and as missing: show the first.
    problems.sort(key=lambda problem: problem["type"] != "extra_forbidden")
    raise _refusal(problems[0], text, file, len(problems) - 1)


def _dotted(data: dict[str, Any]) -> None:
    """Flatten ``effect.parameter = ...``, which TOML nests, to one name."""
    effects = data.get("effects", [])
    effects = [effects] if isinstance(effects, str | dict) else effects
    effects = effects if isinstance(effects, list) else []
    called = [e.get("name", "") if isinstance(e, dict) else e for e in effects]
    names = {*EFFECTS, *(str(word).rpartition(":")[2] for word in called)}
    channels = data.get("channels")
    if isinstance(channels, dict):  # [channels.port.command] is the channel "port.command"
        for name, table in list(channels.items()):
            if isinstance(table, dict) and table and not {*ChannelPart.model_fields} & {*table}:
                del channels[name]
                channels |= {f"{name}.{key}": value for key, value in table.items()}
    for holder in (data, data.get("expected")):
        tables = holder.get("parameters") if isinstance(holder, dict) else None
        if not isinstance(tables, dict):
            continue
        fields = {*ParameterPart.model_fields, *ExpectedNumber.model_fields}
        for name, table in list(tables.items()):
            # actuator_lag.time_constant = 0.2 parses as a table: a table without any key of a
            # parameter is the name of an effect.
            nested = isinstance(table, dict) and table and not fields & set(table)
            if nested and (name in names or all(isinstance(v, dict) for v in table.values())):
                del tables[name]
                tables.update({f"{name}.{key}": value for key, value in table.items()})


def _refusal(problem: Mapping[str, Any], text: str, file: Path | str, more: int) -> InputError:
    members = ("str", "bool", "int", "float", "TimePart")  # members of a union, not keys
    loc = tuple(p for p in problem["loc"] if not str(p).startswith("function-"))
    # Below the second level, since a channel or a parameter may itself be called "float".
    loc = tuple(p for k, p in enumerate(loc) if k < 2 or p not in members)
    # in the file the tables of thrusters stand below [thrusters] itself
    written = (*loc[:1], *loc[2:]) if loc[:2] == ("thrusters", "each") else loc
    where = line_of(text, file, written)
    parent, key = loc[:-1], str(loc[-1]) if loc else ""
    also = f" ({more} more after this one.)" if more else ""
    table = f"[{'.'.join(map(str, written[:-1]))}]" if parent else "the top of the file"
    if problem["type"] == "extra_forbidden":
        keys = _keys(parent)
        quantity = key == "unit" and parent[:1] == ("parameters",)
        return InputError(
            f"{where}: the key {key!r} is not known in {table}{nearest(key, keys, '; ')}.{also}",
            'Write the unit with the number: value = "25 us".'
            if quantity
            else f"Correct the key; known there are {listing(keys)}.",
        )
    if problem["type"] == "missing":
        example = f"[{key}]" if not parent and key in ("logs", "channels") else f"{key} = ..."
        return InputError(
            f"{where}: expected the key {key!r} in {table}, found none.{also}",
            f"Add {example} to {table}." if parent or "=" in example else f"Add {example}.",
        )
    message = problem["msg"].removeprefix("Value error, ").removeprefix("Input should be ")
    message = (
        message.replace("a valid integer", "an integer")
        .replace("a valid ", "a ")
        .replace("dictionary", "table")
    )
    if problem["type"] == "too_short":
        message = f"at least {problem['ctx']['min_length']} entry"
    message = re.sub(r" or instance of \w+$", "", message)
    path = ".".join(map(str, written))
    mend = f"Correct {path}."
    if problem["type"] == "model_type":
        needed = [f"{name} = ..." for name in _keys(loc, needed=True)]
        keys = ", ".join(needed) or listing(_keys(loc))
        mend = f"Write the table [{path}] with {keys}."
        if isinstance(loc[-1], int):  # one of a list
            mend = f"Write {{ {keys} }} in its place."
    return InputError(
        f"{where}: expected {message[:1].lower()}{message[1:]}, found "
        f"{short_repr(problem['input'])}.{also}",
        mend,
    )


def _keys(loc: Sequence[Any], *, needed: bool = False) -> list[str]:
    """The valid keys of the table at a path, or those of them that are ``needed``."""
    here: Any = SpecFile
    for name in loc:
        if isinstance(here, type) and issubclass(here, BaseModel):
            here = here.model_fields[str(name)].annotation
        else:
            # The type of the values of dict[str, ...], behind the user's own name.
            here = get_args(here)[-1]
        while get_origin(here) in (Annotated, Union, UnionType):
            here = next(a for a in get_args(here) if a is not type(None))
    fields = here.model_fields if hasattr(here, "model_fields") else {}
    return [name for name, field in fields.items() if field.is_required() or not needed]


_DEEPEST = 50
_BITS = 64
"""TOML promises integers of 64 bits; Python converts much longer ones in quadratic time."""
_LONG = re.compile(r"[0-9a-fA-F_]{17,}")

_DOTTED = re.compile(r"(?:\.[ \t]{0,9}[\w\"'-]{1,99}[ \t]{0,9}){50}")


def _check_extent(tables: Mapping[str, Any], text: str, file: Path | str) -> None:
    level: list[Any] = [tables]
    # By levels, not by recursion, which the depth that is checked here would exhaust.
    for _ in range(_DEEPEST):
        holders = [each for each in level if isinstance(each, dict | list)]
        level = [x for each in holders for x in (each.values() if isinstance(each, dict) else each)]
        if any(isinstance(each, int) and each.bit_length() > _BITS for each in level):
            raise _too_long(text, file)
    if level:
        raise _too_deep(text, file)


def _too_deep(text: str, file: Path | str) -> InputError:
    lines = text.splitlines()
    counts = [sum(map(line.count, "[{.")) for line in lines]
    return InputError(
        f"{file}, line {counts.index(max(counts)) + 1}: expected tables and lists nested at most "
        f"{_DEEPEST} deep, found more.",
        "Remove the brackets or dots.",
    )


def _too_long(text: str, file: Path | str) -> InputError:
    lengths = [max(map(len, _LONG.findall(line)), default=0) for line in text.splitlines()]
    return InputError(
        f"{file}, line {lengths.index(max(lengths)) + 1}: expected integers of at most {_BITS} "
        "bits, found one of more.",
        "Correct the number.",
    )


def line_of(text: str, file: Path | str, loc: Iterable[Any]) -> str:
    """The place of a key: file, line if it can be found, and the path of the key.

    The text is searched line by line, since Python's TOML parser keeps no line numbers.
    """
    path = tuple(str(key) for key in loc if not isinstance(key, int))
    line, best, table = 0, 0, ()
    for number, row in enumerate(text.splitlines(), 1):
        if header := re.match(r"\s*\[+([^\[\]]+)\]+\s*(#.*)?$", row):
            table = _split(header[1])
            here = table
        elif pair := re.match(r"\s*([\w\-.\"' ]+?)\s*=", row):
            here = (*table, *_split(pair[1]))
        else:
            continue
        joined, shared = ".".join(here), ".".join(path)
        if (shared == joined or shared.startswith(f"{joined}.")) and len(here) > best:
            line, best = number, len(here)
    # A missing key gets the line of its table, the longest part of its path that was found.
    at = f", line {line}" if line else ""
    return f"{file}{at}, {'.'.join(path)}" if path else f"{file}"


def _split(dotted: str) -> tuple[str, ...]:
    return tuple(a or b or c for a, b, c in re.findall(r'"([^"]*)"|\'([^\']*)\'|([^.\s]+)', dotted))


class SpecText(NamedTuple):
    """The text of a spec file, for errors that say where in it they are."""

    text: str
    path: Path

    def error(self, loc: Iterable[Any], problem: str, mend: str) -> InputError:
        """An error that begins with the place of a key."""
        return InputError(f"{line_of(self.text, self.path, loc)}: {problem}", mend)

    @contextmanager
    def at(self, *loc: Any) -> Iterator[None]:
        """Within it, errors of what a key says begin with the key's place."""
        try:
            yield
        except InputError as error:
            raise self.error(loc, error.problem, error.mend) from None

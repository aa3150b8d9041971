"""The page of a spec file's keys, from the models that check them."""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Sequence
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from generated import table
from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from diffthrust.specs import _parts

TABLES = {
    "The top of the file": _parts.SpecFile,
    "[logs]": _parts.LogsPart,
    "time, where it is a table": _parts.TimePart,
    "leave_out": _parts.LeaveOutPart,
    "[channels.NAME]": _parts.ChannelPart,
    "pwm": _parts.PWMPart,
    "[thrusters]": _parts.ThrustersPart,
    "[thrusters.NAME]": _parts.ThrusterPart,
    "[sensors.NAME]": _parts.SensorPart,
    "[parameters]": _parts.ParameterPart,
    "prior": _parts.PriorPart,
    "[fit]": _parts.FitPart,
    "[expected]": _parts.ExpectedPart,
    "Numbers of [expected]": _parts.ExpectedNumber,
}


def spec_page() -> str:
    """Each table of a spec file with its keys."""
    lines = [
        "# Keys of spec files",
        "A spec file is TOML. Paths are relative to it; a key that is not known is refused, and "
        "the nearest known one named. {py:func}`dft.load_spec <diffthrust.load_spec>` reads it.",
    ]
    for heading, model in TABLES.items():
        text = " ".join((inspect.getdoc(model) or "").split())
        lines += [f"## {heading}", text, table(("key", "type", "default", "meaning"), _rows(model))]
    return "\n\n".join(lines)


def meanings(model: type[BaseModel]) -> dict[str, str]:
    """What stands below each key in the source."""
    body = ast.parse(inspect.getsource(model)).body[0]
    assert isinstance(body, ast.ClassDef)
    found: dict[str, str] = {}
    for key, following in zip(body.body, body.body[1:], strict=False):
        if isinstance(key, ast.AnnAssign) and isinstance(key.target, ast.Name):
            constant = getattr(getattr(following, "value", None), "value", None)
            found[key.target.id] = constant if isinstance(constant, str) else ""
    return found


def _rows(model: type[BaseModel]) -> list[tuple[str, str, str, str]]:
    meaning_of = meanings(model)
    rows = []
    for name, field in model.model_fields.items():
        limits = " ".join(_limit(m) for m in field.metadata)
        words = _words(field.metadata)
        kind = f"{_quoted(words) if words else _kind(field.annotation)} {limits}".strip()
        meaning = re.sub(r"``(.+?)``", r"`\1`", meaning_of.get(name, ""))
        rows.append((f"`{name}`", kind, _default(field), meaning))
    return rows


def _words(metadata: Sequence[Any]) -> tuple[str, ...]:
    """The words of a key that takes those of a registry."""
    checks = [getattr(item, "func", None) for item in metadata]
    return next((c.words for c in checks if isinstance(c, _parts.RegisteredWord)), ())


def _quoted(words: Sequence[str]) -> str:
    return " or ".join(f'`"{word}"`' for word in words)


def _limit(given: Any) -> str:
    words = {"ge": "at least", "gt": "above", "le": "at most", "min_length": "at least"}
    return " ".join(
        f"{text} {getattr(given, key)}" + (" of them" if key == "min_length" else "")
        for key, text in words.items()
        if getattr(given, key, None) is not None
    )


def _default(field: Any) -> str:
    if field.default is PydanticUndefined:
        return "must be given"
    if field.default is None:
        return ""
    if isinstance(field.default, BaseModel):
        given = field.default.model_dump(exclude_defaults=True)
        return "`" + ", ".join(f"{k} = {v!r}" for k, v in given.items()) + "`" if given else ""
    return (
        f"`{field.default!r}`".replace("'", '"').replace("True", "true").replace("False", "false")
    )


def _kind(kind: Any) -> str:
    """A type in the words of TOML."""
    origin, inner = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return _kind(inner[0])
    if origin in (Union, UnionType):
        return " or ".join(_kind(one) for one in inner if one is not type(None))
    if origin is Literal:
        return _quoted(inner)
    if origin is list:
        return f"list of {_kind(inner[0])}"
    if origin is dict:
        return f"table of {_kind(inner[1])}"
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return "table"
    words = {str: "text", float: "number", int: "whole number", bool: "true or false", Any: "any"}
    return words.get(kind, str(kind))

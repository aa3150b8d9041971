"""Saved results: plain data in the types of JSON and back, and their files, whole or refused.

The annotation of a field decides how its data are read, never the data themselves: no content of a
file can choose a class or run code.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import MISSING, fields, is_dataclass
from enum import Enum
from hashlib import sha256
from numbers import Integral, Real
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, NamedTuple, Union, get_args, get_origin, get_type_hints

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.files import ending, write_whole

SCHEMAS = {"fit": 1, "diagnosis": 2}
"""The layout that files of each kind are written in.

It is raised where a field is renamed, moved or changes its meaning, not where one with a default is
added: so a change of diagnoses does not make saved fits unreadable.
"""
_AGAIN = {
    "fit": "Fit the logs again, and save the result: dft.fit(model, logs).save(path).",
    "diagnosis": "Diagnose the logs again, and save the result: dft.diagnose(model, logs)"
    ".save(path). Saved fits still load.",
}
"""How a result is made again whose file has an earlier layout."""


def write_saved(path: Path | str, kind: str, origin: Any, result: Any) -> None:
    """Write a result of some kind ("fit") so that it can be read back to the last digit.

    The origin comes first, where a person looks; long arrays come last, each once and on one line;
    a hash of everything else reveals changes. The result's own field ``origin`` is left out.
    """
    path = Path(path)
    ending(path, ".json")
    arrays: dict[str, Any] = {}
    written = encoded(result, arrays)
    written.pop("origin", None)
    head = encoded(origin, arrays)
    document = {"schema": SCHEMAS.get(kind, 1), "kind": kind, "origin": head, "result": written}
    document["sha256"] = _hash({**document, "arrays": arrays})
    lines = (f'  "{name}": {json.dumps(array)}' for name, array in arrays.items())
    table = ",\n".join(lines)
    # The arrays are appended as text, one line each: a generic indenter puts every number on a
    # line.
    text = f'{_text(document)[:-2]},\n "arrays": {{\n{table}\n }}\n}}\n'
    write_whole(path, text.encode())


def _text(data: Any, depth: int = 0) -> str:
    """JSON with a line for each field; numbers and words of a list stand on one line."""
    inner = data.values() if isinstance(data, dict) else data
    if (
        not isinstance(data, dict | list)
        or not data
        or (isinstance(data, list) and not any(isinstance(each, dict | list) for each in inner))
    ):
        return json.dumps(data, allow_nan=False)
    parts = [_text(each, depth + 1) for each in inner]
    if isinstance(data, dict):
        parts = [f"{json.dumps(key)}: {piece}" for key, piece in zip(data, parts, strict=True)]
    opening, closing = "{}" if isinstance(data, dict) else "[]"
    line = "\n" + " " * depth
    return f"{opening}{line} {f',{line} '.join(parts)}{line}{closing}"


def read_saved(path: Path | str) -> dict[str, Any]:
    """The document in a file that `write_saved` has written, or `InputError`."""
    path = Path(path)
    mend = "Save the result again, or take a copy of the file as it was written."
    try:
        data = json.loads(path.read_bytes().decode("utf-8"))
    except FileNotFoundError:
        raise InputError(
            f"{path}: expected a saved result, found no such file.", "Correct the name."
        ) from None
    except OSError as error:
        raise InputError(
            f"{path}: the file cannot be read ({error.strerror or error}).", "Name a file."
        ) from None
    except (ValueError, RecursionError) as error:  # JSON or UTF-8
        raise InputError(
            f"{path}: expected a saved result, found a file that is cut off, damaged or of "
            f"another kind ({error}).",
            mend,
        ) from None
    if not isinstance(data, dict) or not {"schema", "kind"} <= set(data):
        raise InputError(
            f"{path}: expected a saved result, found other JSON. What --json writes are figures "
            "for other programs; a fit cannot be made of them.",
            "Save with fit.save(path), diag.save(path) or --save.",
        )
    _check_schema(path, data)
    # Hashed as data with sorted keys, not as bytes: a reformatted file is still the same result.
    mark = data.pop("sha256", None)
    if mark != _hash(data):
        raise InputError(
            f"{path}: its content is not what was saved: it does not agree with its hash. The "
            "file was edited or damaged.",
            mend,
        )
    return data


def _check_schema(path: Path, data: Mapping[str, Any]) -> None:
    """Raise `InputError` for a file in another layout than this version reads."""
    schema, kind = data["schema"], str(data["kind"])
    current = SCHEMAS.get(kind, 1)
    if schema == current:
        return
    written = f"{path}: a {kind} in layout {schema!r}, saved by diffthrust {version_of(data)}"
    if isinstance(schema, int) and schema < current:
        raise InputError(
            f"{written}: an earlier layout. This version reads layout {current} of a {kind}, and "
            "does not convert earlier ones.",
            _AGAIN[kind],
        )
    raise InputError(
        f"{written}; expected layout {current}, or an earlier one that this version reads.",
        "Update diffthrust, or save the result with this version.",
    )


def version_of(document: Mapping[str, Any]) -> str:
    """The version of the library that wrote a document, as far as that can be read."""
    library = (document.get("origin") or {}).get("library") or {}
    return str(library.get("diffthrust", "unknown"))


def _hash(document: Mapping[str, Any]) -> str:
    text = json.dumps(document, sort_keys=True, separators=(",", ":"))
    return sha256(text.encode()).hexdigest()


_INLINE = 36
"""Numbers of an array that stand where it is used; longer ones stand once in a table of arrays."""
_WORDS = {"nan": math.nan, "inf": math.inf, "-inf": -math.inf}
"""Spellings of the numbers that JSON does not have."""


def encoded(value: Any, arrays: dict[str, Any]) -> Any:
    """A value as plain data; ``arrays`` receives long arrays, each once, by their hash.

    A value is made of numbers, words, arrays, enumerations and data classes; anything else offers
    itself as such by ``as_plain()``.
    """
    # The order matters: an Enum may also be a str, a bool is an Integral, and a NumPy scalar offers
    # __array__; each must meet its own branch first.
    if isinstance(value, Enum):
        return encoded(value.value, arrays)
    if value is None or isinstance(value, bool | str):
        return value
    if hasattr(value, "as_plain"):
        return encoded(value.as_plain(), arrays)
    if hasattr(value, "__array__"):
        return _encoded_array(np.asarray(value), arrays)
    if isinstance(value, Integral):
        return int(value)
    if isinstance(value, Real):
        return _written(float(value))
    if is_dataclass(value) and not isinstance(value, type):
        kept = [f.name for f in fields(value) if f.metadata.get("saved", True)]
        return {name: encoded(getattr(value, name), arrays) for name in kept}
    if isinstance(value, tuple) and hasattr(value, "_asdict"):
        return encoded(value._asdict(), arrays)  # pyright: ignore[reportAttributeAccessIssue]
    if isinstance(value, Mapping):
        if all(isinstance(key, str) for key in value):
            return {str(key): encoded(each, arrays) for key, each in value.items()}
        # JSON has only strings for keys: others (tuples, numbers) become pairs.
        return [[encoded(key, arrays), encoded(each, arrays)] for key, each in value.items()]
    if isinstance(value, frozenset | set):
        return encoded(sorted(value), arrays)
    if isinstance(value, list | tuple):
        return [encoded(each, arrays) for each in value]
    raise InputError(
        f"Expected numbers, words or arrays to save, found {type(value).__name__}: {value!r:.80}.",
        "Keep it out of what is saved, or give its class a method as_plain().",
    )


def _written(number: float) -> float | str:
    return number if math.isfinite(number) else str(number)


def _encoded_array(array: np.ndarray, arrays: dict[str, Any]) -> Any:
    if array.ndim == 0:
        return encoded(array.item(), arrays)
    # Numbers inline are read back as float64; an array of another type (int, bool) keeps its type
    # only in the table.
    usual = array.dtype == np.float64
    values = [_written(x) if usual else x for x in array.ravel().tolist()]
    if usual and 0 < array.size <= _INLINE:
        return np.array(values, object).reshape(array.shape).tolist()
    content = {"type": array.dtype.name, "shape": list(array.shape), "values": values}
    name = sha256(repr(content).encode()).hexdigest()[:16]
    arrays[name] = content
    return {"array": name}


class Decoder(NamedTuple):
    """Makes values of plain data: of long ``arrays`` by name, of classes by their ``makers``."""

    arrays: Mapping[str, Any]
    makers: Mapping[type, Callable[[Decoder, Any], Any]]
    names: Mapping[str, Any]

    def decoded(self, kind: Any, data: Any) -> Any:
        """The value that plain data represent, of the given kind (a type, as annotated)."""
        kind = NoneType if kind is None else kind
        base, inner = get_origin(kind) or kind, get_args(kind)
        if base in (Union, UnionType):
            return self._one_of(inner, data)
        if base is Literal:
            return _expect(data in inner, data, f"one of {inner}")
        if not isinstance(base, type):
            raise ValueError(f"the kind {kind!r} cannot be read")
        makers = [make for made, make in self.makers.items() if issubclass(base, made)]
        if makers:
            return makers[0](self, data)
        if base in (float, int, bool, str, NoneType):
            return _scalar(base, data)
        if issubclass(base, np.ndarray):
            return self._array(data)
        if issubclass(base, Enum):
            return base(data)
        if is_dataclass(base) or hasattr(base, "_fields"):
            return base(**self.fields_of(base, data))
        if issubclass(base, tuple) and inner[-1:] != (...,):
            pairs = zip(inner, _expect(type(data) is list, data, "a list"), strict=True)
            return tuple(self.decoded(kind, each) for kind, each in pairs)
        if issubclass(base, tuple | list | frozenset):
            each_of = _expect(type(data) is list, data, "a list")
            return base(self.decoded(inner[0], each) for each in each_of)
        if issubclass(base, Mapping):
            items = data.items() if isinstance(data, dict) else data
            return {self.decoded(inner[0], k): self.decoded(inner[1], v) for k, v in items}
        raise ValueError(f"the kind {kind!r} cannot be read")

    def fields_of(self, cls: type, data: Any) -> dict[str, Any]:
        """The fields of a class, by its annotations; those with defaults may be absent."""
        hints = get_type_hints(cls, localns=dict(self.names))
        if is_dataclass(cls):
            hints = {f.name: hints[f.name] for f in fields(cls)}
            needed = {f.name for f in fields(cls) if f.default is f.default_factory is MISSING}
        else:
            needed = set(hints)
        _expect(isinstance(data, dict), data, f"the fields of {cls.__name__}")
        unknown, absent = set(data) - set(hints), needed - set(data)
        if unknown or absent:
            what = f"unknown {sorted(unknown)}" if unknown else f"without {sorted(absent)}"
            raise ValueError(f"{cls.__name__} {what}")
        return {name: self.decoded(hints[name], each) for name, each in data.items()}

    def _one_of(self, kinds: tuple[Any, ...], data: Any) -> Any:
        if data is None and NoneType in kinds:
            return None
        problems = []
        # "nan" is a number, too; in a field `float | str` it is a word: str comes first.
        for kind in sorted((k for k in kinds if k is not NoneType), key=lambda k: k is not str):
            try:
                return self.decoded(kind, data)
            except (ValueError, TypeError, KeyError) as error:
                problems.append(str(error))
        raise ValueError("; ".join(problems))

    def _array(self, data: Any) -> np.ndarray:
        if isinstance(data, dict):
            content = self.arrays[data["array"]]
            kind, values = np.dtype(content["type"]), content["values"]
            if kind == np.float64:
                values = [_scalar(float, x) for x in values]
            return np.array(values, kind).reshape(content["shape"])
        return np.array(_numbers(data), np.float64)


def _numbers(data: Any) -> Any:
    return [_numbers(x) for x in data] if isinstance(data, list) else _scalar(float, data)


def _scalar(kind: type, data: Any) -> Any:
    if kind is float and isinstance(data, str):
        return _WORDS[_expect(data in _WORDS, data, "a number")]
    if kind is float and type(data) is int:  # a field `float` may hold an int: it stays one
        return data
    return _expect(type(data) is kind, data, f"a {kind.__name__}")


def _expect(right: bool, data: Any, expected: str) -> Any:
    if not right:
        raise ValueError(f"expected {expected}, found {data!r:.60}")
    return data

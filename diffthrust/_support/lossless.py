"""Results as plain data, in the types of JSON, and back again to the last digit.

The annotation of a field decides how its data are read, never the data themselves: no content of a
file can choose a class or run code.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import MISSING, fields, is_dataclass
from enum import Enum
from hashlib import sha256
from numbers import Integral, Real
from types import NoneType, UnionType
from typing import Any, Literal, NamedTuple, Union, get_args, get_origin, get_type_hints

import numpy as np

from diffthrust._support.errors import InputError

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

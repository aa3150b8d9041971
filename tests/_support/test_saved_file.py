"""Plain data and back: nothing is lost, and nothing in the data chooses what is made of it."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from enum import Enum, StrEnum
from typing import Literal, NamedTuple

import hypothesis.extra.numpy as arrays_of
import hypothesis.strategies as st
import numpy as np
import pytest
from exact_bits import bits
from hypothesis import given, settings

from diffthrust import InputError
from diffthrust._support.saved_file import Decoder, encoded  # private: what files are made of


class Colour(Enum):
    RED = "red"


class Word(StrEnum):
    ONE = "one"


class Pair(NamedTuple):
    name: str
    value: float


@dataclass(frozen=True)
class Inner:
    value: float | None
    words: tuple[str, ...] = ()


@dataclass(frozen=True)
class Whole:
    number: float
    count: int
    right: bool
    array: np.ndarray
    inner: Inner | None
    pairs: tuple[Pair, ...]
    by_name: dict[str, float]
    by_pair: dict[tuple[str, str], float]
    mixed: tuple[str, float, None]
    kept: frozenset[str]
    kind: Literal["a", "b"]
    colour: Colour
    word: Word
    either: float | str
    later: float = 0.0
    more: tuple[tuple[np.ndarray, np.ndarray], ...] = field(default=())


NUMBERS = st.floats(allow_nan=True, allow_infinity=True)
TEXTS = st.text(max_size=5)
ARRAYS = arrays_of.arrays(
    st.sampled_from([np.float64, np.int64, np.bool_]),
    arrays_of.array_shapes(min_dims=1, max_dims=3, min_side=0, max_side=9),
)
WHOLES = st.builds(
    Whole,
    number=NUMBERS,
    count=st.integers(),
    right=st.booleans(),
    array=ARRAYS,
    inner=st.none() | st.builds(Inner, value=st.none() | NUMBERS, words=st.lists(TEXTS).map(tuple)),
    pairs=st.lists(st.builds(Pair, TEXTS, NUMBERS), max_size=3).map(tuple),
    by_name=st.dictionaries(TEXTS, NUMBERS, max_size=3),
    by_pair=st.dictionaries(st.tuples(TEXTS, TEXTS), NUMBERS, max_size=3),
    mixed=st.tuples(TEXTS, NUMBERS, st.none()),
    kept=st.frozensets(TEXTS, max_size=3),
    kind=st.sampled_from(["a", "b"]),
    colour=st.just(Colour.RED),
    word=st.just(Word.ONE),
    either=st.floats(allow_nan=False, allow_infinity=False) | TEXTS,
    more=st.lists(st.tuples(ARRAYS, ARRAYS), max_size=2).map(tuple),
)


@pytest.mark.thorough
@settings(max_examples=150, deadline=None, derandomize=True)
@given(WHOLES)
def test_what_is_written_is_read_to_the_last_bit(whole):
    arrays = {}
    text = json.dumps([encoded(whole, arrays), arrays], allow_nan=False)
    data, table = json.loads(text)
    assert bits(Decoder(table, {}, {}).decoded(Whole, data)) == bits(whole)


def test_long_arrays_stand_once():
    arrays = {}
    long = np.linspace(0, 1, 100)
    told = encoded([long, {"again": long.copy()}, long[:3]], arrays)
    assert len(arrays) == 1
    assert told[0] == told[1]["again"]
    assert told[2] == [0.0, long[1], long[2]]


@pytest.mark.parametrize(
    ("kind", "data"),
    [
        (float, "1.0"),
        (float, True),
        (int, 1.0),
        (str, 1),
        (bool, 1),
        (Colour, "blue"),
        (Literal["a"], "b"),
        (Inner, {"value": 1.0, "more": 2}),
        (Inner, {"words": []}),
        (Inner, [1.0]),
        (tuple[str, float], ["a"]),
        (tuple[float, ...], {"a": 1.0}),
        (float | None, "nil"),
    ],
)
def test_data_of_another_kind_are_refused(kind, data):
    with pytest.raises(ValueError, match=r"\w"):
        Decoder({}, {}, {}).decoded(kind, data)


def test_absent_fields_with_defaults_get_them():
    assert Decoder({}, {}, {}).decoded(Inner, {"value": 1.5}) == Inner(1.5)


def test_what_cannot_be_written_is_refused():
    with pytest.raises(InputError, match="found function"):
        encoded({"a": bits}, {})

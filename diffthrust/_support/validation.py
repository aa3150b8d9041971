"""Checks of numbers, with one sentence that states what was expected."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Collection
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from diffthrust._support.errors import InputError, Place
from diffthrust._support.names import listing, nearest, short_repr
from diffthrust._support.words import joined

_OTHER_KINDS = {
    "U": ("of text", "convert it: numpy.asarray(values, dtype=float)."),
    "M": ("of dates", "give seconds since the start, or the table to dft.Log.from_dataframe."),
    "m": ("of durations", "give seconds: values / numpy.timedelta64(1, 's')."),
}
"""Kinds of arrays that new users bring, in words, and how they become numbers."""


def finite(
    where: str,
    value: Any,
    right: Callable[[float], bool],
    expected: str,
    mend: str = "Correct it.",
) -> float:
    """A finite number that meets a condition, or `InputError`."""
    try:
        # float() takes True for 1 and "nan" for a number; both are mistakes in a place for numbers
        number = math.nan if isinstance(value, bool | str) else float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number) or not right(number):
        raise InputError(f"{where}: expected {expected}, found {value!r}.", mend)
    return number


def whole_number(
    where: str, value: Any, least: int = 1, most: int | None = None, mend: str = "Correct it."
) -> int:
    """A whole number that is neither too small nor too large, or `InputError`."""
    try:
        number = None if isinstance(value, bool) else operator.index(value)
    except TypeError:
        number = None
    if number is None or number < least:
        raise InputError(
            f"{where}: expected a whole number of at least {least}, found {short_repr(value)}.",
            mend,
        )
    if most is not None and number > most:
        raise InputError(f"{where}: expected at most {most}, found {short_repr(value)}.", mend)
    return number


def check_known(
    name: Any,
    names: Collection[str],
    lacking: str,
    *,
    present: str = "it has",
    mend: str = "Correct the name.",
) -> None:
    """Raise `InputError` for a name that is not among these: "LACKING 'ctt'; it has 'ct'."."""
    if name not in names:
        near = nearest(str(name), names)
        hint = f" ({near})" if near else ""
        raise InputError(f"{lacking} {name!r}{hint}; {present} {listing(names)}.", mend)


def check_word(where: str, word: Any, *words: str) -> None:
    """Raise `InputError` for a word that is not among these."""
    if word not in words:
        listed = joined(map(repr, words), "or")
        raise InputError(f"{where}: expected {listed}, found {word!r}.", "Correct it.")


def finite_row(values: Any) -> np.ndarray | None:
    """Finite numbers in one row, a single one too, as an array; ``None`` for anything else."""
    try:
        row = np.atleast_1d(np.asarray(values, float))
    except (TypeError, ValueError):
        return None
    return row if row.ndim == 1 and row.size and np.isfinite(row).all() else None


def numeric_vector(values: ArrayLike, where: Place | str) -> np.ndarray:
    """Copy numbers into a new float64 array, ``(n,)``; ``where`` names the place for a message."""
    try:
        array = np.asarray(values)
    except Exception:  # ragged lists, or an object with a failing __array__
        array = np.empty(0, dtype=object)
    if array.dtype.kind == "O" and array.ndim == 1 and array.size:  # Decimal, or None for missing
        with suppress(TypeError, ValueError, OverflowError):
            array = np.array([np.nan if v is None else float(v) for v in array])
    if array.ndim != 1 or array.dtype.kind not in "biuf":
        kind, mend = _OTHER_KINDS.get(
            array.dtype.kind if array.ndim == 1 else "",
            (f"type {array.dtype}", "give a list or a one-dimensional array of real numbers."),
        )
        raise InputError.at(
            where,
            f"expected numbers in one dimension, found an array of shape {array.shape} and {kind}.",
            mend,
        )
    return np.array(array, dtype=np.float64)

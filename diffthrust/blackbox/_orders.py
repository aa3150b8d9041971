"""Orders of black-box models as users write them."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from typing import Any

from diffthrust._support.errors import InputError
from diffthrust.blackbox._prediction_error import Shape
from diffthrust.blackbox._records import Channels

Orders = Sequence[int | Sequence[int]]
"""A number for each name; nb and delay may be tuples by input."""
_LEAST = {"na": 0, "nb": 1, "nc": 0, "nf": 0, "delay": 0, "order": 1}


def shape_of(what: str, orders: Orders, names: Sequence[str], channels: Channels) -> Shape:
    """The coefficients for given orders, one for each name of ``("na", "nb", "delay")``."""
    if not isinstance(orders, Sequence) or len(orders) != len(names):
        raise InputError(
            f"{what}, orders: expected ({', '.join(names)}), found {orders!r}.",
            f"Write orders=({', '.join('1' if n in ('delay', 'nc') else '2' for n in names)}).",
        )
    numbers_by_name: dict[str, Any] = dict(zip(names, orders, strict=True))
    count = len(channels.inputs)
    by_input = {}
    for name in ("nb", "delay"):
        value = numbers_by_name.pop(name)
        several = isinstance(value, Sequence) and not isinstance(value, str)
        values = list(value) if several else [value] * count
        if len(values) != count:
            raise InputError(
                f"{what}, orders: expected {name} once or for each of {count} inputs, found "
                f"{value!r}.",
                "Correct it.",
            )
        by_input[name] = [check_integer(what, name, v) for v in values]
    numbers = {name: check_integer(what, name, value) for name, value in numbers_by_name.items()}
    nb, delay = by_input["nb"], by_input["delay"]
    if channels.offset:
        # an offset is one more input that is always 1: it needs one coefficient and no delay
        nb, delay = [*nb, 1], [*delay, 0]
    tied = "nf" in numbers
    na = numbers["nf"] if tied else numbers["na"]
    return Shape(na, tuple(nb), numbers.get("nc", 0), tuple(delay), tied)


def check_integer(what: str, name: str, value: Any) -> int:
    """Check an integer against the least value of its name."""
    try:
        number = operator.index(value)
    except TypeError:
        number = -1
    # True passes operator.index as 1
    if isinstance(value, bool) or number < _LEAST[name]:
        raise InputError(
            f"{what}, {name}: expected a whole number, {_LEAST[name]} or more, found {value!r}.",
            "Correct it.",
        )
    return number

"""What users are handed: short where Python shows it, tables in notebooks, all of it by report."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from rich.console import RenderableType

_NAMED = 4
"""So many names are listed before "and so many more"."""
_LONGEST = 40
"""Longer texts are left to those who ask for them."""


class Brief:
    """Something whose `repr` takes a line, whatever it holds."""

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self._line()})"

    def _line(self) -> str:
        """What the line says; of a dataclass its fields, arrays by their shape."""
        shown = [f for f in fields(self) if f.repr]  # pyright: ignore[reportArgumentType]
        return ", ".join(f"{f.name}={_brief(getattr(self, f.name))}" for f in shown)


class Result(Brief, ABC):
    """The outcome of some work, told in one way to terminals and notebooks."""

    @abstractmethod
    def _told(self) -> RenderableType:
        """All there is to tell."""

    def report(self) -> str:
        """What there is to tell, as text for people."""
        from diffthrust._support.tables import rendered

        return rendered(self._told())

    def _repr_html_(self) -> str:
        from diffthrust._support.tables import html

        return html(self._told())


def _brief(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, str):
        return repr(value if len(value) <= _LONGEST else value[: _LONGEST - 3] + "...")
    if isinstance(value, np.ndarray):
        return f"array{value.shape}"
    if isinstance(value, Mapping) or (
        isinstance(value, tuple) and all(isinstance(one, str) for one in value)
    ):
        more = [f"and {len(value) - _NAMED} more"] * (len(value) > _NAMED)
        named = ", ".join([*(f"{name}" for name in list(value)[:_NAMED]), *more])
        return f"({named})" if isinstance(value, tuple) else f"{{{named}}}"
    if isinstance(value, tuple | list) and not hasattr(value, "_fields"):
        return f"{len(value)} {type(value[0]).__name__}" if value else "()"
    if value is None or isinstance(value, bool | int | np.number):
        return str(value)
    return str(value) if type(value).__str__ is not object.__str__ else type(value).__name__

"""Results: a line where Python shows them, tables in notebooks, and a full report."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from diffthrust._support.report import Report

_NAMED = 4
"""Names that are listed before "and 7 more"."""
_LONGEST = 40
"""Characters of a text in a `repr`; longer ones are cut."""


class Brief:
    """Something whose `repr` takes a line, whatever it holds."""

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self._line()})"

    def _line(self) -> str:
        """The content of the line: the fields of a dataclass, arrays by their shape."""
        visible = [f for f in fields(self) if f.repr]  # pyright: ignore[reportArgumentType]
        return ", ".join(f"{f.name}={_brief(getattr(self, f.name))}" for f in visible)


class Result(Brief, ABC):
    """The outcome of some work, with the same report on terminals, notebooks and pages."""

    @abstractmethod
    def _report(self) -> Report:
        """All tables and sentences, as data."""

    def report(self) -> str:
        """All tables and sentences, as text for people."""
        from diffthrust._support.tables import report_text

        return report_text(self._report())

    def _repr_html_(self) -> str:
        from diffthrust._support.page import notebook_html

        return notebook_html(self._report())


def report_of(result: Result) -> Report:
    """The report of a result, for functions that combine several."""
    return result._report()


def _brief(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, str):
        return repr(value if len(value) <= _LONGEST else value[: _LONGEST - 3] + "...")
    if isinstance(value, np.ndarray):
        return f"array{value.shape}"
    if isinstance(value, Mapping) or (
        isinstance(value, tuple) and all(isinstance(name, str) for name in value)
    ):
        more = [f"and {len(value) - _NAMED} more"] * (len(value) > _NAMED)
        named = ", ".join([*(f"{name}" for name in list(value)[:_NAMED]), *more])
        return f"({named})" if isinstance(value, tuple) else f"{{{named}}}"
    if isinstance(value, tuple | list) and not hasattr(value, "_fields"):
        return f"{len(value)} {type(value[0]).__name__}" if value else "()"
    if value is None or isinstance(value, bool | int | np.number):
        return str(value)
    return str(value) if type(value).__str__ is not object.__str__ else type(value).__name__

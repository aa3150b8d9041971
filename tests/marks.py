"""Marks that keep the tests at each change short."""

from collections.abc import Collection, Iterable
from typing import Any

import pytest


def slow_but(kept: Collection[str], cases: Iterable[Any]) -> list[Any]:
    """Parameters of a test, of which only those named in ``kept`` run at each change.

    A case is a name, or a tuple that begins with one.
    """

    def kind(case: Any) -> str:
        return case if isinstance(case, str) else case[0]

    def marked(case: Any) -> Any:
        values = (case,) if isinstance(case, str) else case
        return pytest.param(*values, marks=pytest.mark.slow)

    return [case if kind(case) in kept else marked(case) for case in cases]

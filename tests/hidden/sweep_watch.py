"""Settings that note which decisions they make, and settings put in the place of the usual ones."""

from __future__ import annotations

import importlib
import math
import pkgutil
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import fields, replace
from typing import Any

import diffthrust.diagnosis
from diffthrust.diagnosis._settings import SETTINGS, Settings  # private: what is swept

Nearest = list[Any]
Decisions = dict[str, list[Nearest | None]]
"""For each setting the nearest value below and above it at which a comparison would have come out
otherwise, each with the function that compared; ``None`` where no comparison lies on that side."""


class Watched(float):
    """A setting that notes at which value of itself each comparison would come out otherwise.

    Sums and products with numbers stay watched: they are ``slope * setting + offset``.
    """

    __array_ufunc__ = None  # so that NumPy's scalars leave comparisons to this class

    def __new__(
        cls,
        setting: float,
        note: Callable[[float], None],
        slope: float = 1.0,
        offset: float = 0.0,
    ) -> Watched:
        value = setting if (slope, offset) == (1.0, 0.0) else slope * setting + offset
        watched = super().__new__(cls, value)
        watched.setting, watched.note = setting, note
        watched.slope, watched.offset = slope, offset
        return watched

    def _moved(self, slope: float, offset: float) -> Watched:
        return Watched(self.setting, self.note, slope, offset)

    def __neg__(self) -> Watched:
        return self._moved(-self.slope, -self.offset)

    def __mul__(self, factor: float) -> Watched:
        return self._moved(self.slope * float(factor), self.offset * float(factor))

    def __add__(self, term: float) -> Watched:
        return self._moved(self.slope, self.offset + float(term))

    def __sub__(self, term: float) -> Watched:
        return self._moved(self.slope, self.offset - float(term))

    def __rsub__(self, term: float) -> Watched:
        return self._moved(-self.slope, float(term) - self.offset)

    def __truediv__(self, divisor: float) -> Watched:
        return self * (1.0 / divisor)

    __rmul__, __radd__ = __mul__, __add__

    def _noted(self, other: float) -> float:
        if self.slope and math.isfinite(other):
            self.note((float(other) - self.offset) / self.slope)
        return float(self)

    def __lt__(self, other: float) -> bool:
        return self._noted(other) < float(other)

    def __le__(self, other: float) -> bool:
        return self._noted(other) <= float(other)

    def __gt__(self, other: float) -> bool:
        return self._noted(other) > float(other)

    def __ge__(self, other: float) -> bool:
        return self._noted(other) >= float(other)


def named(settings: Settings) -> dict[str, float]:
    """All settings by their names, `step.field`."""
    return {
        f"{step.name}.{field.name}": getattr(getattr(settings, step.name), field.name)
        for step in fields(settings)
        for field in fields(getattr(settings, step.name))
    }


def changed(**values: float) -> Settings:
    """The usual settings with some of them changed, by names with a double underscore for the dot.

    Example:
        >>> changed(admission__least_bic_gain=6.0).admission.least_bic_gain
        6.0
    """
    settings = SETTINGS
    for name, value in values.items():
        step, field = name.split("__")
        group = replace(getattr(settings, step), **{field: value})
        settings = replace(settings, **{step: group})
    return settings


@contextmanager
def using(settings: Settings) -> Iterator[None]:
    """All of a diagnosis with other settings, in this process."""
    folder = diffthrust.diagnosis
    for module in pkgutil.walk_packages(folder.__path__, f"{folder.__name__}."):
        importlib.import_module(module.name)
    users = [
        module
        for name, module in list(sys.modules.items())
        if name.startswith(folder.__name__) and "SETTINGS" in vars(module)
    ]
    for module in users:
        vars(module)["SETTINGS"] = settings
    try:
        yield
    finally:
        for module in users:
            vars(module)["SETTINGS"] = SETTINGS


@contextmanager
def watching() -> Iterator[Decisions]:
    """The decisions that a diagnosis makes by its settings; whole numbers are not watched."""
    decisions: Decisions = {}
    lock = threading.Lock()  # trials run side by side

    def watched(name: str, setting: float) -> Watched:
        def note(critical: float) -> None:
            side = int(critical > setting)
            frame = sys._getframe(3)  # beyond note, _noted and the comparison
            with lock:
                nearest = decisions.setdefault(name, [None, None])
                held = nearest[side]
                if held is None or abs(critical - setting) < abs(held[0] - setting):
                    nearest[side] = [critical, frame.f_code.co_name]

        return Watched(setting, note)

    values = {
        name.replace(".", "__"): watched(name, value)
        for name, value in named(SETTINGS).items()
        if isinstance(value, float)
    }
    with using(changed(**values)):
        yield decisions

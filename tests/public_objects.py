"""What the package offers: every public function, class, method and property."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from types import ModuleType
from typing import Any

import diffthrust as dft


@dataclass(frozen=True)
class PublicObject:
    """A function, class, method or property: by the name that a user writes."""

    name: str
    thing: Any
    owner: str = ""
    """The class that it belongs to."""

    @property
    def doc(self) -> str:
        return inspect.getdoc(self.thing) or ""


def modules() -> list[ModuleType]:
    """The door, the folders behind it, and the papers."""
    folders = [getattr(dft, name) for name in dft.__all__]
    papers = [dft.papers.aras, dft.papers.siramdasu, dft.papers.yoerger]
    return [dft, *filter(inspect.ismodule, folders), *papers]


@cache
def public_objects() -> tuple[PublicObject, ...]:
    """Each once, by the shortest name."""
    return tuple(_found())


def _found() -> Iterator[PublicObject]:
    seen: set[int] = set()
    for module in modules():
        place = module.__name__.replace("diffthrust", "dft", 1)
        for name in getattr(module, "__all__", None) or vars(module):
            thing = getattr(module, name)
            ours = getattr(thing, "__module__", "").startswith("diffthrust")
            if name.startswith("_") or id(thing) in seen or not (ours and callable(thing)):
                continue
            seen.add(id(thing))
            yield PublicObject(f"{place}.{name}", thing)
            if inspect.isclass(thing):
                yield from _members(f"{place}.{name}", thing)


def _members(owner: str, cls: type) -> Iterator[PublicObject]:
    for name, raw in vars(cls).items():
        inner = raw.fget if isinstance(raw, property) else raw
        inner = getattr(inner, "func", getattr(inner, "__func__", inner))
        if not name.startswith("_") and inspect.isfunction(inner):
            yield PublicObject(f"{owner}.{name}", inspect.unwrap(inner), owner)


def shown_by_class(one: PublicObject) -> bool:
    """Whether a member is shown in the example of its class, or is told by a class above it."""
    name = one.name.rpartition(".")[2]
    cls = next(o for o in public_objects() if o.name == one.owner).thing
    told = any(
        (inspect.getdoc(vars(base).get(name)) or "") and ">>>" in (inspect.getdoc(base) or "")
        for base in cls.__mro__[1:-1]
        if name in vars(base)
    )
    return told or f".{name}" in (inspect.getdoc(cls) or "").partition("Example:")[2]

"""A sequence that is worked out when somebody looks at it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from threading import RLock
from typing import Any, Generic, TypeVar

Item = TypeVar("Item")


class Later(Sequence[Item], Generic[Item]):
    """The items that a function gives, asked for once, at the first look at any of them.

    It is used as the tuple of these items, which it becomes in files and other processes.
    """

    def __init__(self, work: Callable[[], Iterable[Item]]) -> None:
        self._work: Callable[[], Iterable[Item]] | None = work
        self._worked_out: tuple[Item, ...] = ()
        self._lock = RLock()

    @property
    def _items(self) -> tuple[Item, ...]:
        with self._lock:
            if self._work is not None:
                self._worked_out = tuple(self._work())
                self._work = None  # with what it holds
            return self._worked_out

    def __len__(self) -> int:
        return len(self._items)

    def __getitem__(self, index: Any) -> Any:
        return self._items[index]

    def __add__(self, other: tuple[Any, ...]) -> tuple[Any, ...]:
        return (*self._items, *other)

    def __radd__(self, other: tuple[Any, ...]) -> tuple[Any, ...]:
        return (*other, *self._items)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Later | tuple) and self._items == tuple(other)

    def __hash__(self) -> int:
        return hash(self._items)

    def __repr__(self) -> str:
        return repr(self._items)

    def as_plain(self) -> tuple[Item, ...]:
        """The items, to be saved."""
        return self._items

    def __reduce__(self) -> tuple[Any, ...]:
        return tuple, (self._items,)

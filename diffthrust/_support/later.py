"""A sequence that is worked out when somebody looks at it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import cached_property
from typing import Any, Generic, TypeVar

Item = TypeVar("Item")


class Later(Sequence[Item], Generic[Item]):
    """The items that a function gives, asked for once, at the first look at any of them.

    Args:
        work: gives the items.

    Example:
        >>> later = Later(lambda: print("works") or [1, 2])
        >>> len(later), later == (1, 2)
        works
        (2, True)
    """

    def __init__(self, work: Callable[[], Iterable[Item]]) -> None:
        self._work = work

    @cached_property
    def items(self) -> tuple[Item, ...]:
        """The items."""
        items = tuple(self._work())
        del self._work  # and what it holds
        return items

    def __len__(self) -> int:
        return len(self.items)

    def __getitem__(self, index: Any) -> Any:
        return self.items[index]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Later | tuple) and self.items == tuple(other)

    def __hash__(self) -> int:
        return hash(self.items)

    def __repr__(self) -> str:
        return repr(self.items)

    def as_plain(self) -> tuple[Item, ...]:
        """The items, to be saved."""
        return self.items

    def __reduce__(self) -> tuple[Any, ...]:
        return tuple, (self.items,)

"""Compiled programs; those used most recently are kept.

JAX keeps what it has compiled for as long as the function lives. In a process that works on one
model after another, programs would fill its memory and finally its table of memory maps: Linux
allows 65 530, and beyond them the process ends with a segmentation fault.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from functools import lru_cache, wraps
from typing import Any

import jax

from diffthrust._support._running.cache import enable_compilation_cache

KEPT = 48
"""Programs; each has some hundred memory maps and one to ten megabytes."""


# Before anything compiles: JAX looks once whether there is a cache. A first diagnosis of a process
# is half compilation, in a script as on the command line.
enable_compilation_cache()


class Programs:
    """The programs of a function, one for its first arguments and the shapes of the others.

    Args:
        function: of arguments that fix the code, hashable, and of pytrees of numbers.
        static: how many arguments fix the code.

    Attributes:
        traces: how often it was traced, and so compiled.
    """

    def __init__(self, function: Callable[..., Any], static: int) -> None:
        wraps(function)(self)
        self.function, self.static, self.traces = function, static, 0

    def __call__(self, *arguments: Any) -> Any:
        """The function's result; the last arguments are numbers."""
        static, numbers = arguments[: self.static], arguments[self.static :]
        leaves, tree = jax.tree.flatten(numbers)
        return _kept(self, static, tree, tuple(map(_shape, leaves)))(*numbers)


def program(static: int) -> Callable[[Callable[..., Any]], Programs]:
    """A decorator that makes `Programs` whose first ``static`` arguments fix the code."""
    return lambda function: Programs(function, static)


@lru_cache(maxsize=KEPT)
def _kept(
    program: Programs, static: tuple[Hashable, ...], tree: Any, shapes: tuple[Hashable, ...]
) -> Callable[..., Any]:
    @wraps(program.function)
    def traced(*numbers: Any) -> Any:
        program.traces += 1
        return program.function(*static, *numbers)

    # A new function for each program: dropping it from the cache frees what JAX compiled for it,
    # which a shared jitted function would keep for all shapes.
    return jax.jit(traced)


def _shape(leaf: Any) -> Hashable:
    return getattr(leaf, "shape", ()), getattr(leaf, "dtype", type(leaf))

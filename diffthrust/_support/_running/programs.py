"""Compiled programs; those used most recently are kept.

JAX keeps what it has compiled for as long as the function lives. In a process that works on one
model after another, programs would fill its memory and finally its table of memory maps: Linux
allows 65 530, and beyond them the process ends with a segmentation fault.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Sequence
from functools import cache, lru_cache, partial, wraps
from threading import Lock, RLock
from typing import Any, NamedTuple

import jax
from jax.core import Tracer

from diffthrust._support._running.cache import enable_compilation_cache
from diffthrust._support._running.digest import NoDigest, default_device, digest, environment
from diffthrust._support._running.stored import Jit, program_store

KEPT = 48
"""Programs; each has some hundred memory maps and one to ten megabytes."""

_OPTIONS = {"xla_cpu_parallel_codegen_split_count": 1, "xla_backend_optimization_level": 1}
"""Options for XLA: by default it shares out some seventy kernels among 32 modules, each of which
passes the compiler at a price. A trial's program compiled in 12.2 s of processor time with them,
in 10.4 with one; the kernel that takes half of it is a module of its own in any case. The highest
level of optimisation took 8.6 s for what the first does in 5.1, and a pass 14 ms for 13."""

_QUICK_OPTIONS = {**_OPTIONS, "xla_backend_optimization_level": 0}
"""For programs that run a few times: the slopes of a trial compile in 2.8 s for 5.5, and run in
0.11 s for 0.03; a search for optima, which runs for minutes, would be four times as slow."""

_QUICK = 300_000
"""Numerics: numbers that a program works on beyond which it runs long enough to be optimised. Over
20 000 a pass took 3 ms longer, some 300 of a diagnosis 0.7 s, and a dozen compiled in 12 s less."""

_SETTINGS = "jax_enable_x64", "jax_default_matmul_precision"
"""Of JAX, that change what is traced."""

# Before anything compiles: JAX looks once whether there is a cache. A first diagnosis of a process
# is half compilation, in a script as on the command line.
enable_compilation_cache()


class Programs:
    """The programs of a function, one for its first arguments and the shapes of the others.

    Its first ``static`` arguments fix the code and are hashable, the others are pytrees of numbers.
    ``quick_compile`` is for what runs so few times that to compile counts more than to run.
    """

    def __init__(
        self, function: Callable[..., Any], static: int, *, quick_compile: bool = False
    ) -> None:
        wraps(function)(self)
        self.function, self.static, self.traces = function, static, 0
        self.quick_compile = quick_compile

    def __call__(self, *arguments: Any) -> Any:
        """The function's result; the last arguments are numbers."""
        static, numbers = arguments[: self.static], arguments[self.static :]
        leaves, tree = jax.tree.flatten(numbers)
        if any(isinstance(leaf, Tracer) for leaf in leaves):  # part of another program
            return self.function(*arguments)
        with _choosing:
            code = _kept(self, static, tree, tuple(map(_shape, leaves)))
        return code(*leaves)


def program(
    static: int, *, quick_compile: bool = False
) -> Callable[[Callable[..., Any]], Programs]:
    """A decorator that makes `Programs` whose first ``static`` arguments fix the code."""
    return lambda function: Programs(function, static, quick_compile=quick_compile)


@cache
def _understood(quick: bool) -> dict[str, Any] | None:
    """The options for XLA on a CPU; none where this version, or another device, has others."""
    options = _QUICK_OPTIONS if quick else _OPTIONS
    if default_device().platform != "cpu":
        return None
    try:
        jax.jit(lambda: 0, compiler_options=options).lower().compile()
    except Exception:  # of a class that has changed its place between versions of JAX
        return None
    return options


@lru_cache(maxsize=KEPT)
def _kept(
    program: Programs, static: tuple[Hashable, ...], tree: Any, shapes: tuple[_Shape, ...]
) -> Callable[..., Any]:
    @wraps(program.function)
    def traced(*leaves: Any) -> Any:
        program.traces += 1
        return program.function(*static, *jax.tree.unflatten(tree, leaves))

    # A new function for each program: dropping it from the cache frees what JAX compiled for it,
    # which a shared jitted function would keep for all shapes.
    size = sum(math.prod(shape.shape) for shape in shapes)
    quick = program.quick_compile and size <= _QUICK
    compiled = partial(jax.jit, compiler_options=_understood(quick))
    code = program.function, static, tree
    return _MadeOnce(lambda: _stored(traced, code, shapes, compiled) or compiled(traced))


class _MadeOnce:
    """Code that is traced and compiled by the first of the threads that run it.

    Two that began together did both twice: a fleet's runs on a busy machine.
    """

    def __init__(self, make: Callable[[], Callable[..., Any]]) -> None:
        self._make, self._first = make, RLock()
        self._code: Callable[..., Any] | None = None

    def __call__(self, *leaves: Any) -> Any:
        if self._code is None:
            with self._first:
                if self._code is None:
                    code = self._make()
                    result = code(*leaves)
                    self._code = code
                    return result
        return self._code(*leaves)


_choosing = Lock()


def _stored(
    traced: Callable[..., Any], code: tuple[Any, ...], shapes: Sequence[_Shape], compiled: Jit
) -> Callable[..., Any] | None:
    """The program as it is on disk, stored if it was not; none where there is no way to do so."""
    store = program_store()
    here = None, (1, default_device().platform)
    if store is None or any(shape.devices not in here for shape in shapes):
        return None
    try:
        settings = [jax.config.values[name] for name in _SETTINGS]
        key = digest(environment(), settings, code, shapes)
    except NoDigest:
        return None
    like = [shape.like() for shape in shapes]
    return store.load(key, compiled) or store.save(key, traced, like, compiled)


class _Shape(NamedTuple):
    """What of a leaf fixes the code: shape, type, and on how many devices of what kind it is."""

    shape: tuple[int, ...]
    dtype: Any
    devices: tuple[int, str] | None = None

    def like(self) -> Any:
        if isinstance(self.dtype, type) and issubclass(self.dtype, (bool, int, float, complex)):
            return self.dtype()  # a Python number, which adapts to the type of what it meets
        return jax.ShapeDtypeStruct(self.shape, self.dtype)


def _shape(leaf: Any) -> _Shape:
    sharding = getattr(leaf, "sharding", None)
    devices = None
    if sharding is not None:
        devices = sharding.num_devices, next(iter(sharding.device_set)).platform
    return _Shape(getattr(leaf, "shape", ()), getattr(leaf, "dtype", type(leaf)), devices)

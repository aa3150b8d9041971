"""A digest of what fixes compiled code, the same in every process.

A program on disk is found by it, so two things of equal digest must compile to equal code. What the
package defines is fixed by its sources, and goes in by name; so do Python's own modules, and those
packages that compile. What a user defines goes in as code: the instructions and constants of a
function, and whatever it reaches, its closure, the globals that it names, methods, base classes.
What cannot be followed so far has no digest, and its programs stay in memory.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache, partial
from importlib.metadata import version
from pathlib import Path
from types import BuiltinFunctionType, CodeType, FunctionType, MethodType, ModuleType
from typing import Any

import jax
import numpy as np

_PACKAGE = __name__.split(".")[0]
_COMPILING = ("jax", "jaxlib", "numpy", "equinox", "lineax", "optimistix")
"""Installed packages whose versions go into the environment's digest."""


class NoDigest(Exception):
    """An object whose influence on compiled code cannot be followed."""


def digest(*things: Any) -> str:
    """Hexadecimal digest of things that fix compiled code; `NoDigest` if one cannot be followed."""
    try:
        return _Digest().of(things)
    except RecursionError as error:  # a list that holds itself
        raise NoDigest("what refers to itself") from error
    except ValueError as error:  # a closure over a name that has no value yet
        raise NoDigest(str(error)) from error


@cache
def environment() -> str:
    """Digest of the sources of the package, and of what compiles: versions and device."""
    root = Path(__file__).parents[2]
    sources = hashlib.sha256()
    for path in sorted(root.rglob("*.py")):
        sources.update(str(path.relative_to(root)).encode() + b"\0" + path.read_bytes() + b"\0")
    device = default_device()
    versions = [version(name) for name in _COMPILING]
    return digest(sources.hexdigest(), sys.version, versions, device.platform, device.device_kind)


@cache
def default_device() -> Any:
    """The device on which programs run: the processor, unless the user has chosen another."""
    return next(iter(jax.numpy.zeros(()).devices()))


class _Digest:
    """One walk; classes, functions and modules met before go in by their order: cycles end."""

    def __init__(self) -> None:
        self._hash = hashlib.sha256()
        self._met: dict[int, tuple[int, Any]] = {}  # an id is only unique while the object lives

    def of(self, thing: Any) -> str:
        self._add(thing)
        return self._hash.hexdigest()

    def _mark(self, *words: str) -> None:
        self._hash.update("\0".join(words).encode() + b"\1")

    def _all(self, kind: str, things: Iterable[Any]) -> None:
        things = list(things)
        self._mark(kind, str(len(things)))
        for thing in things:
            self._add(thing)

    def _add(self, thing: Any) -> None:
        if thing is None or isinstance(thing, (bool, int, float, complex, str, bytes)):
            self._mark(type(thing).__name__, repr(thing))
        elif isinstance(thing, Enum):
            self._all("enum", (type(thing), thing.name))
        elif isinstance(thing, (type, FunctionType, ModuleType)):
            if id(thing) in self._met:
                self._mark("again", str(self._met[id(thing)][0]))
            else:
                self._met[id(thing)] = len(self._met), thing
                self._code_of(thing)
        else:
            self._compound(thing)

    def _compound(self, thing: Any) -> None:
        if isinstance(thing, (np.ndarray, np.generic, jax.Array)):
            values = np.asarray(thing)
            if values.dtype.hasobject:
                raise NoDigest(f"an array of objects: {thing!r:.60}")
            self._mark("array", str(values.dtype), str(values.shape), values.tobytes().hex())
        elif isinstance(thing, CodeType):
            self._code(thing)
        elif isinstance(thing, jax.tree_util.PyTreeDef):
            self._tree(thing)
        elif kind := next((kind for kind in _PARTS if isinstance(thing, kind)), None):
            self._all(kind.__name__, _PARTS[kind](thing))
        elif isinstance(getattr(thing, "__wrapped__", None), FunctionType):  # `Programs`
            self._all("wrapper", (type(thing), thing.__wrapped__))
        elif is_dataclass(thing):
            values = [getattr(thing, f.name) for f in fields(thing) if f.compare]
            self._all("dataclass", (type(thing), *values))
        else:
            raise NoDigest(f"{type(thing).__module__}.{type(thing).__qualname__}")

    def _code_of(self, thing: Any) -> None:
        if isinstance(thing, type):
            self._class(thing)
        elif isinstance(thing, FunctionType):
            self._function(thing)
        else:
            self._module(thing)

    def _tree(self, tree: Any) -> None:
        node = tree.node_data()
        self._all("tree", (tree.num_leaves, *(node or ())))
        for child in tree.children():
            self._tree(child)

    def _class(self, cls: type) -> None:
        self._mark("class", cls.__module__, cls.__qualname__)
        if _fixed(cls.__module__) and _is_named(cls, cls.__module__):
            return
        for base in cls.__bases__:
            self._add(base)
        for name, member in sorted(vars(cls).items()):
            if name not in _NOT_CODE and not _is_slot(member):
                self._mark("member", name)
                self._add(member)

    def _function(self, function: Any) -> None:
        module = function.__globals__.get("__name__", "")  # a wrapper bears another's __module__
        self._mark("function", module, function.__qualname__)
        cells = [cell.cell_contents for cell in function.__closure__ or ()]
        if not (_fixed(module) and _is_named(function, module)):
            self._code(function.__code__)
        if not _fixed(module):
            for name in sorted(_names(function.__code__)):
                if name in function.__globals__:
                    self._mark("global", name)
                    self._add(function.__globals__[name])
        self._all("bound", (cells, function.__defaults__, function.__kwdefaults__))

    def _code(self, code: CodeType) -> None:
        self._mark("code", code.co_code.hex(), *code.co_names, "|", *code.co_varnames)
        self._mark("free", *code.co_freevars, "|", *code.co_cellvars)
        self._all("constants", code.co_consts)

    def _module(self, module: ModuleType) -> None:
        self._mark("module", module.__name__)
        if _fixed(module.__name__):
            return
        for name, member in sorted(vars(module).items()):
            if not name.startswith("__"):
                self._mark("member", name)
                self._add(member)


_PARTS: dict[type, Callable[[Any], Iterable[Any]]] = {
    np.dtype: lambda dtype: (str(dtype),),
    BuiltinFunctionType: lambda f: (f.__module__, f.__qualname__, f.__self__),
    MethodType: lambda method: (method.__func__, method.__self__),
    partial: lambda call: (call.func, call.args, call.keywords),
    tuple: lambda sequence: (type(sequence), *sequence),
    list: lambda sequence: (type(sequence), *sequence),
    set: lambda members: sorted(map(digest, members)),
    frozenset: lambda members: sorted(map(digest, members)),
    # an order of insertion may fix an order of summation
    Mapping: lambda mapping: (x for item in mapping.items() for x in item),
    staticmethod: lambda wrapped: (wrapped.__func__,),
    classmethod: lambda wrapped: (wrapped.__func__,),
    property: lambda p: (p.fget, p.fset, p.fdel),
}
"""What an object of a kind consists of, as far as code depends on it."""
_NOT_CODE = frozenset({
    "__dict__", "__weakref__", "__doc__", "__module__", "__annotations__", "__abstractmethods__",
    "_abc_impl", "__firstlineno__", "__static_attributes__", "__dataclass_fields__",
})  # fmt: skip


def _is_slot(member: Any) -> bool:
    return type(member).__name__ in ("member_descriptor", "getset_descriptor", "wrapper_descriptor")


def _names(code: CodeType) -> set[str]:
    """Names that a function and those within it look up; attributes are among them, harmlessly."""
    inner = (_names(c) for c in code.co_consts if isinstance(c, CodeType))
    return set(code.co_names).union(*inner)


def _is_named(thing: Any, module: str) -> bool:
    """Whether its name leads to it: two lambdas, or classes made by a function, share a name."""
    target = sys.modules.get(module)
    for part in thing.__qualname__.split("."):
        target = getattr(target, part, None)
    return target is thing


def _fixed(module: str) -> bool:
    """Whether the code of a module is fixed by versions that the environment's digest holds.

    Any other may be a script that changes from run to run, installed or not.
    """
    top = module.split(".")[0]
    if top in (_PACKAGE, *_COMPILING):
        return True
    return top != "__main__" and (top == "builtins" or top in sys.stdlib_module_names)

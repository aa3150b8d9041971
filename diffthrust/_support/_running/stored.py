"""Traced programs on disk, as StableHLO, so that no process traces what another has traced.

Tracing and lowering a diagnosis took some 20 s of processor time in every process, also where the
compiled code came from JAX's cache. A stored program is read, compiled (or found in that cache),
and gives the same to the last bit: where programs are stored, a new one runs as it is stored.

A file holds a line of JSON (the named tuples among the results, a checksum) and what
``jax.export`` serialises. A file that is torn, or of an older form, counts as absent.
"""

from __future__ import annotations

import gc
import hashlib
import json
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import cache
from importlib import import_module
from pathlib import Path
from threading import Lock
from typing import Any

import jax
from jax import export

from diffthrust._support.errors import InputError
from diffthrust._support.files import write_whole

Jit = Callable[[Callable[..., Any]], Callable[..., Any]]
"""`jax.jit` with the options with which a program is compiled."""

_FOREIGN = "custom calls whose targets have no compatibility guarantees"
"""By what JAX's error tells foreign code, which has no class of its own."""
_FORM = "diffthrust program 1"
LARGEST = 200_000_000
"""Bytes of all traced programs; a diagnosis stores some 5 MB. Those read longest ago go first."""
_PROGRAM = ".program"


class ProgramStore:
    """Traced programs, in a folder within that of JAX's compilation cache.

    What JAX has compiled stays in the folder around it, and is never deleted here: where a user
    has chosen that folder, it may hold the code of other projects.
    """

    def __init__(self, folder: Path, largest: float = LARGEST) -> None:
        self.folder, self.largest = folder, largest
        self._programs = folder / "programs"
        self._unchecked = largest  # bytes written since the size was looked at last

    def load(self, key: str, compiled: Jit = jax.jit) -> Callable[..., Any] | None:
        """The program of a key as a function of arrays; none where it is not there."""
        path = self._path(key)
        try:
            head, _, body = path.read_bytes().partition(b"\n")
            about = json.loads(head)
            if about["form"] != _FORM or hashlib.sha256(body).hexdigest() != about["sum"]:
                return None
            _register([_named(name) for name in about["classes"]])
            exported = export.deserialize(bytearray(body))
        except (OSError, ValueError, KeyError, TypeError, ImportError, AttributeError):
            return None
        with suppress(OSError):  # read last now
            os.utime(path)
        return compiled(_called(exported))

    def save(
        self,
        key: str,
        function: Callable[..., Any],
        arguments: Sequence[Any],
        compiled: Jit = jax.jit,
    ) -> Callable[..., Any]:
        """Store a function for arguments of some shapes, and give the program that is stored.

        Returns:
            The function as it is, compiled, where it cannot be stored: it calls back into Python,
            its result is made of other than tuples, lists and dictionaries, or the disk is full.
        """
        jitted: Any = compiled(function)
        with _uncollected():
            jitted.trace(*arguments)  # errors of a model come from here, as without a store
        try:
            with _uncollected():
                exported = export.export(jitted)(*arguments)
        except NotImplementedError:
            # the trace above went through, so this is JAX, which does not export what calls back
            # into Python (a user's model with a pure_callback) and cannot be asked beforehand; the
            # program runs unstored, and what else may be wrong comes up there
            return jitted
        except ValueError as error:
            # nor what calls foreign code; any other mistake would leave all programs unstored
            if _FOREIGN not in str(error):
                raise
            return jitted
        content = _content(exported)
        if content is None:
            return jitted
        # no room, or another thread stores the same at this moment: the program runs all the same
        with suppress(InputError, OSError):
            self._programs.mkdir(parents=True, exist_ok=True)
            write_whole(self._path(key), content)
            self._unchecked += len(content)
        if self._unchecked > self.largest / 10:
            self._unchecked = 0
            self.shrink(self.largest)
        return compiled(_called(exported))

    def shrink(self, largest: float = 0) -> None:
        """Delete the files that were used longest ago until the others take no more than this."""
        files = self.files()
        size = sum(size for _, _, size in files)
        for path, _, own in files:
            if size <= largest:
                return
            with suppress(OSError):
                path.unlink()
            size -= own

    def files(self) -> list[tuple[Path, float, int]]:
        """Path, time of the last use, and size of each file, those used longest ago first."""
        files = []
        for path in self._programs.glob(f"*{_PROGRAM}*"):  # with what an ended process left there
            with suppress(OSError):  # another process may have deleted it
                about = path.stat()
                files.append((path, about.st_mtime, about.st_size))
        return sorted(files, key=lambda file: file[1])

    def _path(self, key: str) -> Path:
        return self._programs / f"{key}{_PROGRAM}"


@contextmanager
def _uncollected() -> Iterator[None]:
    """Without Python's garbage collector, which looks through all that a trace has made so far.

    It took a third of the time: a boat's programs were traced and lowered in 4.3 s for 6.8.
    """
    on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if on:  # of two threads the one that turned it off turns it on
            gc.enable()


def _content(exported: export.Exported) -> bytes | None:
    """What is written of a program; none if a class of its results cannot be."""
    classes = _classes(exported.out_tree)
    try:
        _register(classes)
        body = bytes(exported.serialize())
    except ValueError:
        return None
    names = [f"{cls.__module__}:{cls.__qualname__}" for cls in classes]
    about = {"form": _FORM, "classes": names, "sum": hashlib.sha256(body).hexdigest()}
    return json.dumps(about).encode() + b"\n" + body


def _called(exported: export.Exported) -> Callable[..., Any]:
    def run(*leaves: Any) -> Any:
        return exported.call(*leaves)

    run.__name__ = exported.fun_name  # by which profiles and JAX's cache list it
    return run


def program_store() -> ProgramStore | None:
    """The store beside JAX's cache of compiled code; none where that is off."""
    folder = jax.config.values["jax_compilation_cache_dir"]
    if not folder or "://" in folder:  # not in a bucket
        return None
    return _store_in(folder)


@cache
def _store_in(folder: str) -> ProgramStore:
    return ProgramStore(Path(folder))


def _classes(tree: Any) -> list[type]:
    """The named tuples in a structure, each once."""
    node = tree.node_data()
    own = [node[0]] if node and issubclass(node[0], tuple) and node[0] is not tuple else []
    return list(dict.fromkeys([*own, *(c for child in tree.children() for c in _classes(child))]))


_registered: set[type] = set()
_registering = Lock()


def _register(classes: Sequence[type]) -> None:
    with _registering:  # JAX refuses a class that another thread has registered
        for cls in classes:
            if cls not in _registered:
                name = f"{cls.__module__}:{cls.__qualname__}"
                export.register_namedtuple_serialization(cls, serialized_name=name)
                _registered.add(cls)


def _named(name: str) -> type:
    """A named tuple of the package; a file must not make anything else be imported."""
    module, _, qualname = name.partition(":")
    if module.split(".")[0] != __name__.split(".")[0]:
        raise ValueError(f"{name} is not of the package")
    target: Any = sys.modules.get(module) or import_module(module)
    for part in qualname.split("."):
        target = getattr(target, part)
    return target

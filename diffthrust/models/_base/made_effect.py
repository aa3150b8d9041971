"""Effects whose name, port and parameters are given where they are made, not by a class."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from diffthrust._support.errors import InputError
from diffthrust.models._base.effect import Effect
from diffthrust.models._base.parameter import Parameter

ARRIVING = "value"
"""The name of what arrives at the port, in expressions."""


class MadeEffect(Effect):
    """An effect of which each object has a name, a port and parameters of its own.

    Several of one class stand in one model under different names. A subclass has in ``name`` the
    word by which spec files ask for it (objects are called so by default), in ``main`` the
    argument that this word gives there, in ``options`` whatever else chooses its equations, and
    its constructor ends with `_make`.
    """

    told = ()
    library: ClassVar[dict[str, type[MadeEffect]]] = {}  # pyright: ignore[reportIncompatibleVariableOverride]
    options = ("name", "port")
    main: ClassVar[str] = ""
    given: Mapping[str, Any] = {}
    """Parameters as they were asked for, as plain data; see `described.plain`."""

    def _make(
        self, name: str, port: str, declared: Mapping[str, Parameter], reads: tuple[str, ...] = ()
    ) -> None:
        """Take name, port, parameters, and the signals that are read.

        Raises:
            InputError: a name that is none, or that of something else of an effect.
        """
        word = type(self).name
        for what, given in (("name", name), ("port", port), *(("parameter", n) for n in declared)):
            if not (isinstance(given, str) and given.isascii() and given.isidentifier()):
                raise InputError(
                    f"{word}: expected a {what} made of letters, digits and underscores, "
                    f"found {given!r:.60}.",
                    "Write it like the names of Python: tip_loss.",
                )
        for parameter in declared:
            if hasattr(type(self), parameter) or parameter in ("expression", "value", "time"):
                raise InputError(
                    f"{word} '{name}': a parameter cannot be called {parameter!r}, which means "
                    "something else here.",
                    f"Call it {parameter}_0, say.",
                )
        self._set(name=name, port=port, ports=(port,), reads=reads, declared=dict(declared))
        super().__init__()

    @property
    def arguments(self) -> dict[str, Any]:
        """The arguments that it was made with, parameters as they were asked for."""
        return {**super().arguments, **self.given}

    def as_table(self) -> dict[str, Any]:
        """The entry of a spec file's effects that asks for it."""
        told = self.arguments
        return {type(self).name: told.pop(self.main), **told}

    def __repr__(self) -> str:
        told = [f"{n}={argument!r}" for n, argument in super().arguments.items()]
        told += [f"{n}={getattr(self, n):.4g}" for n in self._parameters]
        return f"{type(self).__name__}({', '.join(told)})"


MADE_EFFECTS = MadeEffect.library
"""The library's classes of such effects, by the words of spec files."""

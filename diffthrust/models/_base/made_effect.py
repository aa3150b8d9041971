"""Effects whose name, port and parameters are given where they are made, not by a class."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from inspect import get_annotations
from typing import Any, ClassVar

from diffthrust._support.errors import InputError
from diffthrust._support.names import nearest
from diffthrust.models._base.effect import Effect
from diffthrust.models._base.parameter import Parameter
from diffthrust.models._base.signals import Signal, Signals

ARRIVING = "value"
"""The name of what arrives at the port, in expressions."""
_MEANT = (ARRIVING, "time")
"""What arrives at a port, and a signal that every model has."""


class MadeEffect(Effect):
    """An effect whose objects each have a name, a port and parameters of its own.

    Several of one class stand in one model under different names. A subclass has in ``name`` the
    word by which spec files ask for it (objects are called so by default), in ``main`` the
    argument that this word gives there, in ``options`` name, port and whatever else chooses its
    equations, and its constructor ends with `_make`.
    """

    required: ClassVar[tuple[str, ...]] = ()
    library: ClassVar[dict[str, type[MadeEffect]]] = {}  # pyright: ignore[reportIncompatibleVariableOverride]
    options: ClassVar[tuple[str, ...]] = ("name", "port")
    main: ClassVar[str] = ""
    given: Mapping[str, Any] = {}
    """Parameters as they were asked for, as plain data; see `plain_description`."""

    def _make(
        self, name: str, port: str, declared: Mapping[str, Parameter], reads: tuple[str, ...] = ()
    ) -> None:
        """Take name, port, parameters, and the signals that are read."""
        for what, value in (("name", name), ("port", port)):
            self._check_word(what, value)
        self._set(name=name, port=port, ports=(port,), reads=reads, declared=dict(declared))
        super().__init__()

    def _check_parameters(self, names: Iterable[str], symbols: Iterable[str], text: str) -> None:
        """Raise `InputError` for a parameter that an expression does not have, or cannot have."""
        word, symbols = type(self).name, tuple(symbols)
        for name in names:
            if name not in symbols:
                near = nearest(name, symbols)
                raise InputError(
                    f"{word}: the parameter {name!r} does not occur in {text!r}"
                    f"{'; ' + near if near else ''}.",
                    "Correct the name, or remove it.",
                )
            self._check_word("parameter", name)
            taken = hasattr(type(self), name) or name in get_annotations(type(self))
            if taken or name in _MEANT or name.startswith("_"):
                raise InputError(
                    f"{word}: a parameter cannot be called {name!r}, which means something else.",
                    "Give it another name.",
                )

    def _named(self, value: Signal, s: Signals) -> Callable[[str], Any]:
        """What a name in an expression stands for, where a value arrives beside these signals."""

        def named(name: str) -> Any:
            if name == ARRIVING:
                return value
            return getattr(self if name in self.given else s, name)

        return named

    def _check_word(self, what: str, value: object) -> None:
        # a port may be that of a part of a craft: "imu.yaw_rate"
        parts = value.split(".") if isinstance(value, str) and what == "port" else [value]
        if not all(isinstance(p, str) and p.isascii() and p.isidentifier() for p in parts):
            raise InputError(
                f"{type(self).name}: expected a {what} made of letters, digits and underscores, "
                f"found {value!r:.60}.",
                "Write it like the names of Python: tip_loss.",
            )

    @property
    def arguments(self) -> dict[str, Any]:
        """The arguments that it was made with, parameters as they were asked for."""
        return {**super().arguments, **self.given}

    def as_table(self) -> dict[str, Any]:
        """The entry of a spec file's effects that asks for it."""
        table = self.arguments
        return {type(self).name: table.pop(self.main), **table}

    def __repr__(self) -> str:
        arguments = [f"{n}={argument!r}" for n, argument in super().arguments.items()]
        arguments += [f"{n}={getattr(self, n):.4g}" for n in self._parameters]
        return f"{type(self).__name__}({', '.join(arguments)})"


MADE_EFFECTS = MadeEffect.library
"""The library's classes of such effects, by the words of spec files."""

"""Models that push a craft and are seldom used by themselves."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ClassVar

from diffthrust._support.errors import InputError
from diffthrust.models._base.component import Component
from diffthrust.models._base.model import Model
from diffthrust.models._base.parameter import Parameter
from diffthrust.models._base.signals import Signal, Signals


class Actuator(Model):
    """A model with an output ``thrust``, which crafts find by its name: not listed with systems."""

    library: ClassVar[dict[str, type[Actuator]]] = {}  # pyright: ignore[reportIncompatibleVariableOverride]


ACTUATORS = Actuator.library
"""The library's actuators that are no systems by themselves, by name."""


class Steered(Actuator):
    """An actuator around the model of a thruster: its channels, ports and parameters, and more.

    A subclass declares what it adds, in ``inputs``, ``states``, ``outputs`` and ``ports`` as any
    model does, and calls the thruster's equations by `_bound_thruster`.
    """

    thruster: Model

    def __init__(self, thruster: Model, *, command: str = "", **parameters: float | Parameter):
        if not isinstance(thruster, Model) or "thrust" not in thruster.outputs:
            raise InputError(
                f"{type(self).__name__}: expected a model of a thruster, found {thruster!r:.60}.",
                "Give one with an output 'thrust': dft.Thruster().",
            )
        cls = type(self)
        channels = {
            kind: {**getattr(thruster, kind), **getattr(cls, kind)}
            for kind in ("inputs", "optional_inputs", "states", "outputs", "ports")
        }
        fastest, slowest = zip(cls.time_scales, thruster.time_scales, strict=True)
        self._set(
            thruster=thruster._copy(effects=()),
            **channels,
            time_scales=(min(fastest), max(slowest)),
            commands=thruster.commands,
            commanded=thruster.commanded,
            declared={**thruster._parameters, **cls.declared},
        )
        super().__init__(command=command or thruster.command, **parameters)
        self._set(effects=thruster.effects)

    def commanded_in(self, unit: str) -> Any:
        """With the thruster's command in another unit; see `Model.commanded_in`."""
        converted = super().commanded_in(unit)
        if not unit:
            return converted
        names = self.thruster._parameters
        present = {k: self._parameters[k] for k in names} if self._parameters else names
        thruster = self.thruster._with_parameters(present).commanded_in(unit)
        changed = {**converted._parameters, **thruster._parameters}
        values = {k: changed[k].value for k in names}  # its own are as in the converted one
        return converted._copy(thruster=thruster, _parameters=changed, **values)

    def settled(self, s: Signals) -> Mapping[str, Signal | float]:
        """As the thruster does."""
        return self._bound_thruster().settled(s)

    def _bound_thruster(self) -> Model:
        """The thruster that reads the present values."""
        return self.thruster._bound({k: getattr(self, k) for k in self.thruster._parameters})

    @property
    def structure(self) -> tuple[Any, ...]:
        """What fixes the compiled code: its own, and the thruster's."""
        return (*super().structure, self.thruster.structure)

    @property
    def arguments(self) -> dict[str, Any]:
        """The arguments that it was made with; the thruster stands in ``as_plain``."""
        return {"command": self.command}

    @property
    def parts(self) -> dict[str, Component]:
        """The thruster."""
        return {"thruster": self.thruster}

    def as_code(self, written: Callable[[Component], str]) -> str:
        """The line that makes it around its thruster."""
        cls = type(self)
        place = "" if self.own else "dft.actuators."
        usual = cls(self.thruster).command
        command = "" if self.command == usual else f", command={self.command!r}"
        return f"{place}{cls.__name__}({written(self.thruster)}{command})"

"""A thruster without dynamics."""

from collections.abc import Mapping
from typing import ClassVar, Self

import jax.numpy as jnp

from diffthrust.models._base.actuator import Actuator
from diffthrust.models._base.component import registered
from diffthrust.models._base.effect import Ports
from diffthrust.models._base.parameter import Parameter, parameter
from diffthrust.models._base.power_law import power_law
from diffthrust.models._base.signals import RatesAndOutputs, Signals


@registered
class StaticThruster(Actuator):
    """A curve from the command, or from the measured speed of the propeller, to the thrust.

        thrust = gain * sign(command) |command|^exponent,  times reverse where command < 0

    For thrusters that follow far faster than the craft moves. The command is an effort, a measured
    thrust ("N", whose gain is held at 1), a speed ("rad/s", "rev/s", whose exponent is held at 2),
    or a voltage; what is given stays as given. ``reverse`` is held at 1: free it for a propeller
    that is weaker astern.
    Source: Fossen 2021, section 9.2 (thrust by the square of the propeller's speed).

    Example:
        >>> dft.actuators.StaticThruster(command="N").parameters["gain"].fixed
        True
        >>> list(dft.actuators.StaticThruster().parameters)
        ['gain', 'exponent', 'reverse']
    """

    name = "static_thruster"
    options: ClassVar[tuple[str, ...]] = ("command",)
    inputs: ClassVar[Mapping[str, str]] = {"command": "effort"}
    outputs: ClassVar[Mapping[str, str]] = {"thrust": "N"}
    ports: ClassVar[Mapping[str, str]] = {"propeller": "thrust of the propeller [N]"}
    commands: tuple[str, ...] = ("effort", "N", "rad/s", "rev/s", "V")
    commanded: tuple[str, ...] = ("command",)
    time_scales: ClassVar[tuple[float, float]] = (0.02, 100.0)

    gain: float = parameter(40.0, "N/{command}", bounds=(0, None), doc="thrust at a command of 1")
    exponent: float = parameter(1.0, bounds=(0.05, 4.0), transform="log", doc="of the curve")
    reverse: float = parameter(1.0, bounds=(0, None), fixed=True, size=0.5, doc="astern to ahead")

    def __init__(self, *, command: str = "", **parameters: float | Parameter) -> None:
        super().__init__(command=command, **parameters)
        # what a unit implies is for numbers that nobody gives: a curve that was measured was freed
        self._set(**vars(self.replace(parameters)))

    def commanded_in(self, unit: str) -> Self:
        """The curve of a command in another unit; see `Model.commanded_in`."""
        converted, before = super().commanded_in(unit), self.command or "effort"
        if converted.command == before:
            return converted
        squared, force = unit in ("rad/s", "rev/s"), unit == "N"
        exponent = {"value": 2.0 if squared else 1.0, "fixed": squared or force}
        gain = {"value": 1.0, "fixed": True} if force else {"fixed": False}
        return converted.replace(exponent=exponent, gain=gain)

    def equations(self, s: Signals, port: Ports) -> RatesAndOutputs:
        """Fossen 2021, section 9.2."""
        thrust = self.gain * power_law(s.command, self.exponent)
        thrust = thrust * jnp.where(s.command < 0, self.reverse, 1.0)
        return {}, {"thrust": port("propeller", thrust)}

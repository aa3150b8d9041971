"""What pushes a craft besides the thrusters of dft.models."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Self

import jax.numpy as jnp

from diffthrust._support.errors import InputError
from diffthrust.models._base.component import Component, registered
from diffthrust.models._base.effect import Ports
from diffthrust.models._base.model import Model
from diffthrust.models._base.parameter import Parameter, parameter
from diffthrust.models._base.signals import RatesAndOutputs, Relaxing, Signal, Signals, power_law


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
        return self._bound_thruster().settled(s)

    def _bound_thruster(self) -> Model:
        """The thruster that reads the present values."""
        return self.thruster._bound({k: getattr(self, k) for k in self.thruster._parameters})

    @property
    def structure(self) -> tuple[Any, ...]:
        return (*super().structure, self.thruster.structure)

    @property
    def arguments(self) -> dict[str, Any]:
        """The arguments that it was made with; the thruster stands in ``as_plain``."""
        return {"command": self.command}

    @property
    def parts(self) -> dict[str, Component]:
        return {"thruster": self.thruster}

    def as_code(self, written: Callable[[Component], str]) -> str:
        cls = type(self)
        place = "" if self.own else "dft.actuators."
        usual = cls(self.thruster).command
        command = "" if self.command == usual else f", command={self.command!r}"
        return f"{place}{cls.__name__}({written(self.thruster)}{command})"


@registered
class Azimuth(Steered):
    """A thruster on a vertical axis, which turns to an angle.

        d(azimuth)/dt = difference of angle and azimuth, the short way, / slew_time
        thrust, side_thrust = force * (cos azimuth, sin azimuth)

    The angle [rad] is clockwise from above, from where the thruster points on the craft: at a
    quarter turn it pushes to starboard. Where the log has the measured ``azimuth`` as an input, the
    force follows it and ``angle`` is not needed.
    Source: Fossen 2021, section 9.3 (azimuth thrusters), with a lag of first order.

    Args:
        thruster: the model of the thruster.
        command: the unit of its command; as the thruster has it else.
        **parameters: values by name, ``slew_time`` [s] among them.

    Example:
        >>> bow = dft.actuators.Azimuth(dft.Thruster(), slew_time=1.0)
        >>> bow.inputs, list(bow.parameters)
        ({'command': 'V', 'angle': 'rad'}, ['alpha', 'beta', 'ct', 'slew_time'])
    """

    name = "azimuth"
    options = ("command",)
    inputs = {"angle": "rad"}
    optional_inputs = {"azimuth": "rad"}
    states = {"azimuth": "rad"}
    outputs = {"azimuth": "rad", "side_thrust": "N"}
    ports = {
        "pointing": "angle at which the thruster aims [rad]",
        "turning": "rate at which the thruster turns [rad/s]",
        "azimuth_force": "force of the thruster along its axis [N]",
    }
    angles = ("azimuth",)
    time_scales = (0.05, 60.0)

    slew_time: float = parameter(1.0, "s", bounds=(0, None), doc="of the turn to the angle")

    def equations(self, s: Signals, port: Ports) -> RatesAndOutputs:
        rates, outputs = self._bound_thruster().equations(s, port)
        force = port("azimuth_force", outputs["thrust"])
        cos, sin = jnp.cos(s.azimuth), jnp.sin(s.azimuth)
        directed = {"thrust": force * cos, "side_thrust": force * sin, "azimuth": s.azimuth}
        turning: dict[str, Any] = {}
        if "angle" in s:
            behind = port("pointing", s.angle) - s.azimuth
            short_way = jnp.arctan2(jnp.sin(behind), jnp.cos(behind))
            rate = port("turning", short_way / self.slew_time)
            turning = {"azimuth": Relaxing(rate, 1.0 / self.slew_time)}
        return {**rates, **turning}, {**outputs, **directed}

    def initial(self, s: Signals) -> Mapping[str, Any]:
        begin = dict(self._bound_thruster().initial(s))
        return {**begin, "azimuth": s.angle} if "angle" in s else begin


@registered
class HingedPropeller(Actuator):
    """An outboard propeller that is turned by a rudder servo: the drive of `Vessel`.

        force = gain * sign(propeller_speed) |propeller_speed|^exponent
        thrust, side_thrust = force * (cos rudder_angle, sin rudder_angle)

    A positive angle pushes the stern to starboard, and so the bow to port. With ``gain`` held at 1
    masses and dampings of the body are ratios to it, as in the paper.
    Source: Siramdasu & Fahimi 2013, equations (1) to (5).

    Example:
        >>> stern = dft.actuators.HingedPropeller(exponent=0.27)
        >>> stern.inputs
        {'propeller_speed': 'rev/s', 'rudder_angle': 'rad'}
    """

    name = "hinged_propeller"
    options = ("command",)
    inputs = {"propeller_speed": "rev/s", "rudder_angle": "rad"}
    outputs = {"thrust": "N", "side_thrust": "N"}
    ports = {
        "revolutions": "speed at which the propeller turns [rev/s]",
        "rudder": "angle at which the propeller stands [rad]",
        "drive": "force of the propeller along its axis [N]",
    }
    commands = ("rev/s", "effort")
    commanded = ("propeller_speed",)

    gain: float = parameter(
        1.0, "N/{propeller_speed}", bounds=(0, None), fixed=True, doc="force at a speed of 1"
    )
    exponent: float = parameter(0.27, bounds=(0.05, 4.0), transform="log", doc="of the speed")

    def equations(self, s: Signals, port: Ports) -> RatesAndOutputs:
        n = port("revolutions", s.propeller_speed)
        angle = port("rudder", s.rudder_angle)
        force = port("drive", self.gain * power_law(n, self.exponent))
        return {}, {"thrust": force * jnp.cos(angle), "side_thrust": force * jnp.sin(angle)}


@registered
class RudderPropeller(Steered):
    """A thruster that points ahead, and a rudder in its race.

    With T the thrust of the propeller and u [m/s] the speed of the craft through the water there,
    the rudder at the angle a takes the force

        normal = (race * max(T, 0) + free_stream * u |u|) * sin a
        thrust = T - normal * sin a,     side_thrust = normal * cos a

    across its blade. A positive angle pushes the stern to starboard. Astern, the race does not
    reach the rudder. Source: Fossen 2021, section 9.5 (rudder in the propeller's slipstream).

    Args:
        thruster: the model of the propeller.
        command: the unit of its command; as the thruster has it else.
        **parameters: values by name.

    Example:
        >>> stern = dft.actuators.RudderPropeller(dft.SpeedLoopThruster())
        >>> stern.inputs
        {'command': 'effort', 'rudder_angle': 'rad'}
    """

    name = "rudder_propeller"
    options = ("command",)
    inputs = {"rudder_angle": "rad"}
    optional_inputs = {"inflow": "m/s"}
    feels = ("inflow",)
    outputs = {"side_thrust": "N"}
    ports = {
        "rudder": "angle at which the rudder stands [rad]",
        "rudder_force": "force across the blade of the rudder [N]",
    }

    race: float = parameter(0.8, bounds=(0, None), doc="rudder force per thrust")
    free_stream: float = parameter(
        2.0, "N s^2/m^2", bounds=(0, None), null=0.0, size=5.0, doc="rudder force by the way"
    )

    def equations(self, s: Signals, port: Ports) -> RatesAndOutputs:
        rates, outputs = self._bound_thruster().equations(s, port)
        thrust = outputs["thrust"]
        angle = port("rudder", s.rudder_angle)
        u = s.inflow if "inflow" in s else 0.0 * thrust
        lift = self.race * jnp.maximum(thrust, 0.0) + self.free_stream * u * jnp.abs(u)
        normal = port("rudder_force", lift * jnp.sin(angle))
        directed = {
            "thrust": thrust - normal * jnp.sin(angle),
            "side_thrust": normal * jnp.cos(angle),
        }
        return rates, {**outputs, **directed}


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
    options = ("command",)
    inputs = {"command": "effort"}
    outputs = {"thrust": "N"}
    ports = {"propeller": "thrust of the propeller [N]"}
    commands = ("effort", "N", "rad/s", "rev/s", "V")
    commanded = ("command",)
    time_scales = (0.02, 100.0)

    gain: float = parameter(40.0, "N/{command}", bounds=(0, None), doc="thrust at a command of 1")
    exponent: float = parameter(1.0, bounds=(0.05, 4.0), transform="log", doc="of the curve")
    reverse: float = parameter(1.0, bounds=(0, None), fixed=True, size=0.5, doc="astern to ahead")

    def __init__(self, *, command: str = "", **parameters: float | Parameter) -> None:
        super().__init__(command=command, **parameters)
        # what a unit implies is for numbers that nobody gives: a curve that was measured was freed
        self._set(**vars(self.replace(parameters)))

    def commanded_in(self, unit: str) -> Self:
        converted, before = super().commanded_in(unit), self.command or "effort"
        if converted.command == before:
            return converted
        squared, force = unit in ("rad/s", "rev/s"), unit == "N"
        exponent = {"value": 2.0 if squared else 1.0, "fixed": squared or force}
        gain = {"value": 1.0, "fixed": True} if force else {"fixed": False}
        return converted.replace(exponent=exponent, gain=gain)

    def equations(self, s: Signals, port: Ports) -> RatesAndOutputs:
        thrust = self.gain * power_law(s.command, self.exponent)
        thrust = thrust * jnp.where(s.command < 0, self.reverse, 1.0)
        return {}, {"thrust": port("propeller", thrust)}

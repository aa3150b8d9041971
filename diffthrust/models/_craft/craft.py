"""A body with actuators placed on it, as vehicles are built."""

from __future__ import annotations

from collections.abc import Callable, Collection, Hashable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Self

from diffthrust._support.errors import InputError
from diffthrust._support.figures import showing
from diffthrust._support.report import Report
from diffthrust.models._base.component import Component, Mounted
from diffthrust.models._base.effect import Effect, Ports, effect_named
from diffthrust.models._base.model import Model
from diffthrust.models._base.signals import RatesAndOutputs, Signal, Signals
from diffthrust.models._craft.actuators import PUSH, TOLD, Actuators, past, wrench
from diffthrust.models._craft.body import Body, check_body, merged, sorted_parts
from diffthrust.models._craft.figures import craft_figure, laid_out, layout_report
from diffthrust.models._craft.placed import Placed, PortsUnder, place_of, signals_under
from diffthrust.models._craft.sensor import Sensor, Sensors
from diffthrust.models._craft.six import Six

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_FORCES = ("thrust", "side_thrust")
"""Outputs of an actuator that are its force: all of what a weak one gives is less."""


class Craft(Model):
    """A body with thrusters placed on it: every thruster behind its own name.

    An actuator ``port`` has its channels ``port.command``, ``port.speed``, ``port.thrust``, its
    ports ``port.propeller``, and ``port.push``, the force with which it pushes the craft, and its
    parameters ``port.gain``; its place ``port.x``, ``port.y``, ``port.z`` [m] is held, and may be
    freed. Several that share their numbers have those of the first, and ``strength`` of each, its
    force beside theirs, held at 1. The speed of the water past an actuator is known from the motion
    of the body: effects that read ``inflow`` need no measurement of it. So it is with sensors:
    ``gps.north`` is a reading of ``gps``, ``gps.x`` its place.

    Effects are added to the body (``craft + "wind"``), to one actuator (``craft + ("port",
    "command_delay")``, or ``craft + "port.command_delay"``), or to all that share their numbers
    (``craft + "command_delay"``), with one set of numbers for all of them.

    Without a sensor of force, logs tell masses and dampings only beside the thrust: a fit names
    that direction. Hold a mass that was weighed (``craft.replace(m11={"value": 36.0, "fixed":
    True})``), or the strength of a thruster that was measured.

    Source: Fossen 2021, chapters 6 and 9 (M v' + C(v) v + D(v) v + g = B u); the equations of body
    and actuators are their own.

    Args:
        body: what moves: one of ``dft.bodies``.
        share: groups of actuators, each with one set of numbers.
        command: the unit of the commands, where all actuators have a choice; as they have it else.
        **parts: actuators, each a model at its place: ``dft.Thruster().at((-0.3, 0.2, 0))``, and
            sensors: one of ``dft.sensors``, at the origin or at its place.

    Raises:
        InputError: something else than a body, or an actuator or sensor at its place, a name that
            is taken, or a group of different models.

    Example:
        >>> thruster = dft.SpeedLoopThruster()
        >>> boat = dft.Craft(
        ...     dft.bodies.Planar(),
        ...     port=thruster.at((-0.35, -0.285, 0)),
        ...     starboard=thruster.at((-0.35, 0.285, 0)),
        ...     share=[("port", "starboard")],
        ... )
        >>> boat.inputs, boat.groups()
        ({'port.command': 'effort', 'starboard.command': 'effort'}, (('port', 'starboard'),))
        >>> list(boat.parts)
        ['body', 'port', 'starboard']
        >>> print(boat + "command_deadband" + ("port", "command_delay"))
        craft + command_deadband + port.command_delay
    """

    name = "craft"
    options = ("command",)

    body: Body
    actuators: Actuators
    sensors: Sensors
    share: tuple[tuple[str, ...], ...]

    def __init__(
        self,
        body: Body,
        *,
        share: Sequence[Sequence[str]] = (),
        command: str = "",
        **parts: Mounted[Any] | Sensor,
    ) -> None:
        check_body(body)
        mounted, sensors = sorted_parts(parts, body)
        bare = {n: replace(m, model=m.model._copy(effects=())) for n, m in mounted.items()}
        actuators = Actuators(bare, share)
        self._set(body=body, actuators=actuators, sensors=sensors, share=actuators.share)
        self._set(**merged(body, actuators, sensors), effects=())
        units = {m.model.command for m in bare.values() if m.model.commands}
        super().__init__(command=command or (*units, "")[0] if self.commands else "")
        effects = [
            actuators.placed(effect, actuators.group_of(name), str(self))
            for name, m in mounted.items()
            if name == actuators.owner(name)
            for effect in m.model.effects
        ]
        self._set(effects=tuple(self._fitted_in(effect) for effect in effects))

    # -- its parts by their names ------------------------------------------------------------------

    def groups(self) -> tuple[tuple[str, ...], ...]:
        """The actuators by their numbers: those that share them together, others alone."""
        return self.actuators.groups()

    def actuator(self, name: str) -> Model:
        """The model of one actuator by itself, with its present numbers and without effects.

        Raises:
            InputError: there is none of that name.

        Example:
            >>> boat = dft.Craft(dft.bodies.Planar(), bow=dft.Thruster(ct=0.03).at((1, 0, 0)))
            >>> boat.actuator("bow").ct
            0.03
        """
        return self.actuators.alone(name, self._present)

    def with_sensors(self, **sensors: Mounted[Any] | Sensor) -> Self:
        """The craft with more sensors, or with others in the place of those of the same names.

        Args:
            **sensors: each of ``dft.sensors``, at the origin or at its place.

        Raises:
            InputError: no sensor, or a name that is taken.

        Example:
            >>> rov = dft.layouts.BLUEROV2.craft().with_sensors(dvl=dft.sensors.DVL(frame="FLU"))
            >>> list(rov.outputs)[-3:]
            ['dvl.surge', 'dvl.sway', 'dvl.heave']
        """
        mounts = {**self.sensors, **sensors}
        for name in sensors:
            if name in self.actuators:
                raise InputError(
                    f"Craft: the sensor '{name}' has the name of an actuator.", "Rename it."
                )
        made = type(self)(
            self.body, share=self.share, command=self.command, **self.actuators, **mounts
        )
        kept = {
            n: self._present(n)
            for n in made._parameters
            if n in self._parameters and n.partition(".")[0] not in sensors
        }
        return made._with_parameters({**made._parameters, **kept})._copy(effects=self.effects)

    def commanded_in(self, unit: str) -> Self:
        converted = super().commanded_in(unit)
        if not unit:
            return converted
        actuators, changed = self.actuators.commanded_in(unit, self._present)
        parameters = {**converted._parameters, **changed}
        return converted._with_parameters(parameters)._copy(actuators=actuators)

    # -- the equations -----------------------------------------------------------------------------

    def equations(self, s: Signals, port: Ports) -> RatesAndOutputs:
        """Fossen 2021, equation 6.1 with 9.1: the body under the forces of its actuators."""
        body = self.body._bound({k: getattr(self, k) for k in self.body._parameters})
        water, forces = body.motion(s, port), Six()
        rates: dict[str, Any] = {}
        outputs: dict[str, Any] = {}
        for name, mounted in self.actuators.items():
            place = place_of(name, vars(self))
            of_part = signals_under(s, name)
            if mounted.model.feels or port.hears(name):
                of_part = past(of_part, water.at(place), mounted.pointing)
                port.tell(**{f"{name}.{k}": of_part[k] for k in TOLD})
            part_rates, part_outputs = self._bound_part(name).equations(
                of_part, PortsUnder(port, name)
            )
            if len(self.actuators.group_of(name)) > 1:
                strength = getattr(self, f"{name}.strength")
                weaker = {k: strength * part_outputs[k] for k in _FORCES if k in part_outputs}
                part_outputs = {**part_outputs, **weaker}
            thrust = port(f"{name}.{PUSH}", part_outputs["thrust"])
            side = part_outputs.get("side_thrust")
            # without one at its place, a parameter of that name is the model's own
            no_torque = mounted.reaction is None
            reaction = None if no_torque else getattr(self, f"{name}.reaction")
            force, moment = wrench(mounted.pointing, thrust, side, reaction)
            forces = forces.pushed(force, place, moment)
            rates |= {f"{name}.{k}": v for k, v in part_rates.items()}
            outputs |= {f"{name}.{k}": v for k, v in part_outputs.items()}
        body_rates, body_outputs = body.equations(s, port, water, forces)
        if self.sensors:
            outputs |= self.sensors.readings(body.kinematics(s, body_rates), vars(self))
        return {**body_rates, **rates}, {**body_outputs, **outputs}

    def _bound_part(self, name: str) -> Model:
        """The model of an actuator that reads the craft's (possibly traced) values."""
        model, owner = self.actuators[name].model, self.actuators.owner(name)
        return model._bound({k: getattr(self, f"{owner}.{k}") for k in model._parameters})

    def initial(self, s: Signals) -> Mapping[str, Signal | float]:
        """Where states begin that nothing gives: actuators as settled by their first commands."""
        begin = dict(self.body.initial(s))
        for name in self.actuators:
            part, first = self._bound_part(name), signals_under(s, name)
            at_first = {**part.settled(first), **part.initial(first)}
            begin |= {f"{name}.{k}": v for k, v in at_first.items()}
        return begin

    def start_from(self, first: Mapping[str, Any]) -> Mapping[str, Any]:
        """States at the start that follow from measured outputs: as the body says.

        It is told the attitude that the first readings of a sensor give.
        """
        return self.body.start_from(self.sensors.with_attitude(first))

    def _telling(self, channels: Collection[str]) -> tuple[str, ...]:
        """The angles of the body, or what one of the sensors reads of the attitude."""
        body = self.body
        if names := body._telling(channels):
            return names
        # a body of one's own may take numbers only; one that tilts needs more than the yaw
        least = 1 if type(body).start_from is Body.start_from else 2
        if least == 2 and not body._telling(body.start_outputs):
            return ()
        return self.sensors.telling(channels, least)

    # -- effects -----------------------------------------------------------------------------------

    def __add__(self, other: Any) -> Self:
        if isinstance(other, tuple) and other and other[0] in self.actuators:
            if len(other) != 2:
                raise InputError(
                    f"{self}: expected an actuator and one effect, found {len(other)} entries.",
                    'Write craft + ("port", "actuator_lag").',
                )
            return self + self.placed(other[1], other[0])
        if isinstance(other, str):
            member, _, effect = other.rpartition(".")
            return self + self.placed(effect if member else other, *([member] if member else []))
        if isinstance(other, Effect) and not isinstance(other, Placed):
            return super().__add__(self.placed(other))
        return super().__add__(other)

    def placed(self, effect: Effect | str, *members: str) -> Effect:
        """An effect where it acts on the craft.

        Args:
            effect: the effect, or its name.
            *members: one actuator, or several that share their numbers; by default all that do, or
                the body where it acts there.

        Raises:
            InputError: nothing, or more than one group of actuators, has a place for it.

        Example:
            >>> boat = dft.Craft(dft.bodies.Planar(), bow=dft.Thruster().at((1, 0, 0)))
            >>> boat.placed("actuator_lag", "bow").ports
            ('bow.drive',)
            >>> boat.placed("wind").ports
            ('surge_force', 'sway_force', 'yaw_moment')
        """
        if isinstance(effect, str):
            effect = effect_named(effect)
        if not members and self._has_ports_of(effect):
            return effect
        return self.actuators.placed(effect, members, str(self))

    def placements(self, effect: Effect) -> Iterator[Effect]:
        """Everywhere that an effect can act: all of a group, then each of its actuators.

        Example:
            >>> pair = {n: dft.Thruster().at((0, y, 0)) for n, y in (("a", -1), ("b", 1))}
            >>> boat = dft.Craft(dft.bodies.Planar(), **pair, share=["ab"])
            >>> [placed.name for placed in boat.placements(dft.effects.ActuatorLag())]
            ['actuator_lag', 'a.actuator_lag', 'b.actuator_lag']
        """
        if self._has_ports_of(effect):
            return iter((effect,))
        return self.actuators.placements(effect)

    def _has_ports_of(self, effect: Effect) -> bool:
        return all(port in {*self.ports, *self.channel_units} for port in effect.ports)

    def constant_words(self, name: str, fixed: float, wanted: float) -> str:
        """A strength that logs want to be another, in words."""
        member, _, what = name.rpartition(".")
        if what != "strength":
            return ""
        return self.actuators.strength_words(member, fixed, wanted)

    # -- its layout --------------------------------------------------------------------------------

    @showing
    def plot(self) -> Figure:
        """Draw the craft from above and from the side: places, directions, the centre of mass.

        Example:
            >>> len(dft.layouts.BLUEROV2_HEAVY.craft().plot().axes)
            2
        """
        body = self.body._parameters
        centre = tuple(getattr(self, n) if n in body else 0.0 for n in ("x_g", "y_g", "z_g"))
        return craft_figure(str(self), laid_out(self.actuators, self.sensors, vars(self)), centre)

    def layout_report(self) -> Report:
        """Actuators with their places and directions, and sensors with theirs, as a table.

        Example:
            >>> report = dft.layouts.OTTER.craft().layout_report()
            >>> type(report).__name__
            'Report'
        """
        return layout_report(self.body.name, laid_out(self.actuators, self.sensors, vars(self)))

    # -- what it is made of, as data ---------------------------------------------------------------

    @property
    def structure(self) -> tuple[Hashable, ...]:
        """What fixes the compiled code: body, actuators and directions, and who shares numbers."""
        parts = (
            (name, m.model.structure, m.pointing, m.reaction is None)
            for name, m in self.actuators.items()
        )
        sensors = ((name, m.model.structure) for name, m in self.sensors.items())
        shape = (self.body.structure, tuple(parts), tuple(sensors), self.share)
        return (*super().structure, *shape)

    @property
    def arguments(self) -> dict[str, Any]:
        """The arguments that it was made with, as data; body and models stand in ``as_plain``."""
        mounts = {
            name: {"place": m.place, "pointing": m.pointing, "reaction": m.reaction}
            for name, m in {**self.actuators, **self.sensors}.items()
        }
        return {"share": self.share, "command": self.command, "mounts": mounts}

    @property
    def own(self) -> bool:
        """Whether it is of a class of the user's own."""
        return type(self) is not Craft

    @property
    def parts(self) -> dict[str, Component]:
        """Body, actuators and sensors by name."""
        mounts = {**self.actuators, **self.sensors}
        return {"body": self.body, **{name: m.model for name, m in mounts.items()}}

    @classmethod
    def made_of(cls, arguments: Mapping[str, Any], parts: Mapping[str, Any]) -> Self:
        """The craft of a body and models, with the places among the arguments."""
        mounts = arguments["mounts"]
        placed = {name: Mounted(parts[name], **mount) for name, mount in mounts.items()}
        remaining = {name: value for name, value in arguments.items() if name != "mounts"}
        return cls(parts["body"], **{**remaining, **placed})

    def as_code(self, written: Callable[[Component], str]) -> str:
        lines = [written(self.body)]
        for name, m in self.actuators.items():
            more = "" if m.pointing == (1.0, 0.0, 0.0) else f", pointing={m.pointing}"
            more += "" if m.reaction is None else f", reaction={m.reaction}"
            lines.append(f"{name}={written(m.model)}.at({m.place}{more})")
        for name, m in self.sensors.items():
            place = f".at({m.place})" if any(m.place) else ""
            lines.append(f"{name}={written(m.model)}{place}")
        if self.share:
            lines.append(f"share={[*self.share]}")
        inner = "".join(f"\n    {line}," for line in lines)
        return f"{'' if self.own else 'dft.'}{type(self).__name__}({inner}\n)"

    def __repr__(self) -> str:
        mounts = {**self.actuators, **self.sensors}
        parts = ", ".join(f"{n}={type(m.model).__name__}" for n, m in mounts.items())
        described = f"Craft({type(self.body).__name__}" + (f", {parts})" if parts else ")")
        return " + ".join([described, *(repr(effect) for effect in self.effects)])

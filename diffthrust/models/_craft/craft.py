"""A body with actuators placed on it, as vehicles are built."""

from __future__ import annotations

from collections.abc import Callable, Collection, Hashable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar, Self

import jax.numpy as jnp

from diffthrust._support.errors import InputError
from diffthrust._support.figures import showing
from diffthrust._support.names import listing, nearest
from diffthrust._support.report import Report, Rows, Section
from diffthrust._support.words import joined, number, percent
from diffthrust.models._base.component import Component
from diffthrust.models._base.effect import Effect, Ports
from diffthrust.models._base.model import Model
from diffthrust.models._base.mounted import Mounted
from diffthrust.models._base.parameter import Parameter
from diffthrust.models._base.registry import effect_named
from diffthrust.models._base.signals import RatesAndOutputs, Signal, Signals
from diffthrust.models._craft.body import Body
from diffthrust.models._craft.checks import check_body, groups_of, sorted_parts
from diffthrust.models._craft.kinematics import QUATERNION, Kinematics
from diffthrust.models._craft.merged import PUSH, PUSH_WORDS, merged_channels
from diffthrust.models._craft.placed import Placed
from diffthrust.models._craft.scope import PortsUnder, lifted, signals_under
from diffthrust.models._craft.sensor import Sensor
from diffthrust.models._craft.six import Six, Triple, cross, dot, lessened, scaled, times

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TOLD = ("inflow", "crossflow")
"""What the craft works out for each actuator: the speed of the water past it, along its axis in the
direction in which it pushes the craft, and across [m/s]."""
_GEOMETRY = ("x", "y", "z")
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
        >>> boat.inputs
        {'port.command': 'effort', 'starboard.command': 'effort'}
        >>> print(boat + "command_deadband" + ("port", "command_delay"))
        craft + command_deadband + port.command_delay
    """

    name = "craft"
    options: ClassVar[tuple[str, ...]] = ("command",)

    body: Body
    actuators: Mapping[str, Mounted[Model]]
    sensors: Mapping[str, Mounted[Sensor]]
    share: tuple[tuple[str, ...], ...]
    inputs: Mapping[str, str]  # pyright: ignore[reportIncompatibleVariableOverride]
    optional_inputs: Mapping[str, str]  # pyright: ignore[reportIncompatibleVariableOverride]
    states: Mapping[str, str]  # pyright: ignore[reportIncompatibleVariableOverride]
    outputs: Mapping[str, str]  # pyright: ignore[reportIncompatibleVariableOverride]
    ports: Mapping[str, str]  # pyright: ignore[reportIncompatibleVariableOverride]
    angles: tuple[str, ...]  # pyright: ignore[reportIncompatibleVariableOverride]
    time_scales: tuple[float, float]  # pyright: ignore[reportIncompatibleVariableOverride]
    horizon: float | None  # pyright: ignore[reportIncompatibleVariableOverride]

    def __init__(
        self,
        body: Body,
        *,
        share: Sequence[Sequence[str]] = (),
        command: str = "",
        **parts: Mounted[Any] | Sensor,
    ) -> None:
        check_body(body)
        actuators, sensors = sorted_parts(parts, body)
        bare = {n: replace(m, model=_without_effects(m.model)) for n, m in actuators.items()}
        groups = groups_of(bare, share)
        self._set(body=body, actuators=bare, sensors=sensors, share=groups)
        models = {name: mounted.model for name, mounted in bare.items()}
        carried = {name: mounted.model for name, mounted in sensors.items()}
        self._set(**merged_channels(body, models, carried), declared=self._declared(), effects=())
        units = {m.model.command for m in bare.values() if m.model.commands}
        super().__init__(command=command or (*units, "")[0] if self.commands else "")
        effects = [
            self._on(effect, self._group_of(name))
            for name, mounted in actuators.items()
            if name == self._owner(name)
            for effect in mounted.model.effects
        ]
        self._set(effects=tuple(self._fitted_in(effect) for effect in effects))

    # -- its parts by their names ------------------------------------------------------------------

    def _declared(self) -> dict[str, Parameter]:
        """All parameters as the parts have them, and the places."""
        named = dict(self.body._parameters)
        for name, mounted in self.actuators.items():
            if name == self._owner(name):
                signals = _signals(mounted.model)
                for k, p in mounted.model._parameters.items():
                    named[f"{name}.{k}"] = lifted(p, name, signals)
            if len(self._group_of(name)) > 1:
                named[f"{name}.strength"] = Parameter(
                    1.0, bounds=(None, None), fixed=True, size=1.0, doc="force beside its like"
                )
            named |= _place_of(name, mounted.place)
            if mounted.reaction is not None:
                named[f"{name}.reaction"] = Parameter(
                    mounted.reaction, "m", fixed=True, size=0.02, doc="torque per thrust"
                )
        for name, sensor in self.sensors.items():
            named |= {f"{name}.{k}": p for k, p in sensor.model._parameters.items()}
            named |= _place_of(name, sensor.place) if sensor.model.placed else {}
        return named

    def _group_of(self, name: str) -> tuple[str, ...]:
        """The actuators with the numbers of one."""
        return next((group for group in self.share if name in group), (name,))

    def _place(self, name: str) -> Triple:
        """Where a part is."""
        x, y, z = (getattr(self, f"{name}.{axis}") for axis in _GEOMETRY)
        return x, y, z

    def _owner(self, name: str) -> str:
        """The actuator after which the numbers of one are called."""
        return self._group_of(name)[0]

    def groups(self) -> tuple[tuple[str, ...], ...]:
        """The actuators by their numbers: those that share them together, others alone.

        Example:
            >>> thruster = dft.Thruster()
            >>> places = {"a": thruster.at((0, -1, 0)), "b": thruster.at((0, 1, 0))}
            >>> dft.Craft(dft.bodies.Planar(), **places, share=["ab"]).groups()
            (('a', 'b'),)
        """
        return tuple(dict.fromkeys(self._group_of(name) for name in self.actuators))

    def actuator(self, name: str) -> Model:
        """The model of one actuator by itself, with its present numbers and without effects.

        Raises:
            InputError: there is none of that name.

        Example:
            >>> boat = dft.Craft(dft.bodies.Planar(), bow=dft.Thruster(ct=0.03).at((1, 0, 0)))
            >>> boat.actuator("bow").ct
            0.03
        """
        self._check_name(name)
        model, owner = self.actuators[name].model, self._owner(name)
        named = {}
        for k, p in model._parameters.items():
            full = f"{owner}.{k}"
            now = self._parameters[full].with_value(getattr(self, full))
            named[k] = replace(now, unit=p.unit, pattern=p.pattern, probes=p.probes)
        return model._copy(_parameters=named, **{k: p.value for k, p in named.items()})

    def _check_name(self, name: str) -> None:
        if name not in self.actuators:
            near = nearest(name, self.actuators)
            raise InputError(
                f"The craft has no actuator '{name}'{f' ({near})' if near else ''}; "
                f"it has {listing(self.actuators)}.",
                "Correct the name.",
            )

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
        present = self._parameters
        own = {n: p.with_value(getattr(self, n)) for n, p in present.items()}
        kept = {
            n: own[n] for n in made._parameters if n in own and n.partition(".")[0] not in sensors
        }
        values = {n: p.value for n, p in kept.items()}
        return made._copy(_parameters={**made._parameters, **kept}, effects=self.effects, **values)

    def commanded_in(self, unit: str) -> Self:
        """The craft with all commands in another unit; see `Model.commanded_in`."""
        converted = super().commanded_in(unit)
        if not unit:
            return converted
        named, actuators = dict(converted._parameters), dict(self.actuators)
        for name, mounted in self.actuators.items():
            model = mounted.model
            if not model.commands:
                continue
            actuators[name] = replace(mounted, model=model.commanded_in(unit))
            if name == self._owner(name):
                changed = self.actuator(name).commanded_in(unit)._parameters
                signals = _signals(model)
                named |= {f"{name}.{k}": lifted(p, name, signals) for k, p in changed.items()}
        values = {k: p.value for k, p in named.items()}
        return converted._copy(actuators=actuators, _parameters=named, **values)

    # -- the equations -----------------------------------------------------------------------------

    def equations(self, s: Signals, port: Ports) -> RatesAndOutputs:
        """Fossen 2021, equation 6.1 with 9.1: the body under the forces of its actuators."""
        body = self.body._bound({k: getattr(self, k) for k in self.body._parameters})
        water, forces = body.motion(s, port), Six()
        rates: dict[str, Any] = {}
        outputs: dict[str, Any] = {}
        for name, mounted in self.actuators.items():
            place = self._place(name)
            of_part = signals_under(s, name)
            if mounted.model.feels or port.hears(name):
                of_part = _past(of_part, water.at(place), mounted.pointing)
                port.tell(**{f"{name}.{k}": of_part[k] for k in TOLD})
            part_rates, part_outputs = self._bound_part(name).equations(
                of_part, PortsUnder(port, name)
            )
            if len(self._group_of(name)) > 1:
                strength = getattr(self, f"{name}.strength")
                weaker = {k: strength * part_outputs[k] for k in _FORCES if k in part_outputs}
                part_outputs = {**part_outputs, **weaker}
            thrust = port(f"{name}.{PUSH}", part_outputs["thrust"])
            force, moment = self._wrench(name, thrust, part_outputs)
            forces = forces.pushed(force, place, moment)
            rates |= {f"{name}.{k}": v for k, v in part_rates.items()}
            outputs |= {f"{name}.{k}": v for k, v in part_outputs.items()}
        body_rates, body_outputs = body.equations(s, port, water, forces)
        if self.sensors:
            outputs |= self._readings(body.kinematics(s, body_rates))
        return {**body_rates, **rates}, {**body_outputs, **outputs}

    def _readings(self, moving: Kinematics) -> dict[str, Signal]:
        """What the sensors read while the craft moves so."""
        readings = {}
        for name, mounted in self.sensors.items():
            values = {k: getattr(self, f"{name}.{k}") for k in mounted.model._parameters}
            at_place = moving.at(self._place(name)) if mounted.model.placed else moving
            read = mounted.model._bound(values).read(at_place)
            readings |= {f"{name}.{k}": v for k, v in read.items()}
        return readings

    def _bound_part(self, name: str) -> Model:
        """The model of an actuator that reads the craft's (possibly traced) values."""
        model, owner = self.actuators[name].model, self._owner(name)
        return model._bound({k: getattr(self, f"{owner}.{k}") for k in model._parameters})

    def _wrench(
        self, name: str, thrust: Signal, outputs: Mapping[str, Signal]
    ) -> tuple[Triple, Triple]:
        """Force and moment of an actuator, by its direction."""
        mounted = self.actuators[name]
        force = scaled(thrust, mounted.pointing)
        if "side_thrust" in outputs:
            across = cross((0.0, 0.0, 1.0), mounted.pointing)
            side = scaled(outputs["side_thrust"], across)
            force = (force[0] + side[0], force[1] + side[1], force[2])
        if mounted.reaction is None:
            return force, (0.0, 0.0, 0.0)
        torque = times(getattr(self, f"{name}.reaction"), thrust)
        return force, scaled(torque, mounted.pointing)

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
        for name, mounted in self.sensors.items():
            prefix = f"{name}."
            short = {n.removeprefix(prefix): v for n, v in first.items() if n.startswith(prefix)}
            if (q := mounted.model.attitude_from(short)) is not None:
                first = {**dict(zip(QUATERNION, q, strict=True)), **first}
        return self.body.start_from(first)

    def _telling(self, channels: Collection[str]) -> tuple[str, ...]:
        """The angles of the body, or what one of the sensors reads of the attitude."""
        body = self.body
        if names := body._telling(channels):
            return names
        # a body of one's own may take numbers only; one that tilts needs more than the yaw
        least = 1 if type(body).start_from is Body.start_from else 2
        if least == 2 and not body._telling(body.start_outputs):
            return ()
        for name, mounted in self.sensors.items():
            prefix = f"{name}."
            short = [n.removeprefix(prefix) for n in channels if n.startswith(prefix)]
            read = mounted.model._telling(short)
            if len(read) >= least:
                return tuple(prefix + each for each in read)
        return ()

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
        for name in members:
            self._check_name(name)
        if members:
            return self._on(effect, members)
        if all(port in {*self.ports, *self.channel_units} for port in effect.ports):
            return effect
        places = [group for group in self.groups() if self._takes(effect, group[0])]
        places = [group for group in places if len(group) > 1] or places
        if len(places) == 1:
            return self._on(effect, places[0])
        if not places:
            return effect  # which is refused with the ports that there are
        raise InputError(
            f"{self}: the effect '{effect.name}' can act on "
            f"{joined(' and '.join(group) for group in places)}, which do not share their numbers.",
            f'Say where: craft + ("{places[0][0]}", "{effect.name}").',
        )

    def placements(self, effect: Effect) -> Iterator[Effect]:
        """Everywhere that an effect can act: all of a group, then each of its actuators.

        Example:
            >>> pair = {n: dft.Thruster().at((0, y, 0)) for n, y in (("a", -1), ("b", 1))}
            >>> boat = dft.Craft(dft.bodies.Planar(), **pair, share=["ab"])
            >>> [placed.name for placed in boat.placements(dft.effects.ActuatorLag())]
            ['actuator_lag', 'a.actuator_lag', 'b.actuator_lag']
        """
        if all(port in {*self.ports, *self.channel_units} for port in effect.ports):
            yield effect
            return
        groups = [group for group in self.groups() if self._takes(effect, group[0])]
        for group in groups:
            yield self._on(effect, group)
        for group in groups:
            if len(group) > 1:
                yield from (self._on(effect, (name,)) for name in group)

    def constant_words(self, name: str, fixed: float, wanted: float) -> str:
        """A strength that logs want to be another, in words."""
        member, _, what = name.rpartition(".")
        if what != "strength":
            return ""
        if wanted < 0:
            return f"{member} pushes the other way: turn its direction, or the sign of its command"
        share = wanted / fixed - 1.0
        change = f"{percent(abs(share))} {'more' if share > 0 else 'less'}"
        group = [other for other in self._group_of(member) if other != member]
        return (
            f"{member} gives {change} thrust than {group[0] if len(group) == 1 else 'the others'}"
        )

    def _takes(self, effect: Effect, name: str) -> bool:
        model = self.actuators[name].model
        return all(port in {*model.ports, *model.channel_units, PUSH} for port in effect.ports)

    def _on(self, effect: Effect, members: Sequence[str]) -> Placed:
        """An effect on some actuators of one group."""
        members = tuple(members)
        model = _with_push(self.actuators[members[0]].model)
        groups = {self._group_of(name) for name in members}
        if len(groups) > 1:
            raise InputError(
                f"{self}: {listing(members)} do not share their numbers.",
                f"Add the effect '{effect.name}' to each.",
            )
        fitted = (model + effect).effects[-1]
        sharing = [group for group in self.share if self._takes(effect, group[0])]
        if len(members) == 1:
            name = f"{members[0]}.{effect.name}"
        elif members == sharing[0] and len(sharing) == 1:
            name = effect.name
        else:
            between = "and" if len(members) == 2 else "to"
            name = f"{members[0]}_{between}_{members[-1]}.{effect.name}"
        return Placed(fitted, members, name, _signals(model), TOLD)

    @showing
    def plot(self) -> Figure:
        """Draw the craft from above and from the side: places, directions, the centre of mass.

        Example:
            >>> len(dft.layouts.BLUEROV2_HEAVY.craft().plot().axes)
            2
        """
        from diffthrust.models._craft.figures import Drawn, craft_figure

        drawn = [
            Drawn(name, self._place(name), mounted.pointing, "side_thrust" in mounted.model.outputs)
            for name, mounted in self.actuators.items()
        ]
        sensors = (name for name, mounted in self.sensors.items() if mounted.model.placed)
        drawn += [Drawn(name, self._place(name), None) for name in sensors]
        body = self.body._parameters
        centre = tuple(getattr(self, n) if n in body else 0.0 for n in ("x_g", "y_g", "z_g"))
        return craft_figure(str(self), drawn, centre)

    def layout_report(self) -> Report:
        """Actuators with their places and directions, and sensors with theirs, as a table.

        Example:
            >>> report = dft.layouts.OTTER.craft().layout_report()
            >>> type(report).__name__
            'Report'
        """
        rows = []
        for name, mounted in self.actuators.items():
            place = (number(each, 3) for each in self._place(name))
            pointing = ", ".join(f"{each:.3g}" for each in mounted.pointing)
            command = ", ".join(unit or "-" for unit in mounted.model.inputs.values())
            owner = self._owner(name)
            numbers = "its own" if owner == name else f"like {owner}"
            rows.append((name, str(mounted.model), *place, pointing, command, numbers, ""))
        for name, mounted in self.sensors.items():
            sensor = mounted.model
            place = map(number, self._place(name), (3, 3, 3)) if sensor.placed else ("", "", "")
            rows.append((name, sensor.name, *place, "", "", "", sensor.frame))
        headings = (
            *("Part", "Model", "Ahead [m]", "Starboard [m]", "Down [m]", "Pushes"),
            *("Command", "Numbers", "Axes"),
        )
        shown = slice(None if self.sensors else -1)
        rows = [row[shown] for row in rows]
        title = f"Craft of the body '{self.body.name}'"
        return Report(Section("", title, Rows.of(headings[shown], rows, numbers=(2, 3, 4))))

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
        """Body, actuators and sensors by name.

        Example:
            >>> list(dft.Craft(dft.bodies.Axis(), aft=dft.Thruster().at((-1, 0, 0))).parts)
            ['body', 'aft']
        """
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
        """The call that makes it."""
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


def _signals(model: Model) -> frozenset[str]:
    """Names that belong to an actuator: its channels, states and ports."""
    return frozenset({*model.channel_units, *model.states, *model.ports, PUSH, *TOLD})


def _place_of(name: str, place: Triple) -> dict[str, Parameter]:
    """The place of a part, held."""
    return {
        f"{name}.{axis}": Parameter(value, "m", fixed=True, size=0.3, doc="place")
        for axis, value in zip(_GEOMETRY, place, strict=True)
    }


def _past(s: Signals, velocity: Triple, pointing: Triple) -> Signals:
    """The signals of an actuator, with the water that moves past it where no log gives it."""
    axial = dot(velocity, pointing)
    across = lessened(velocity, scaled(axial, pointing))
    # the root has no derivative at rest: a micrometre per second stands in for it
    past = {"inflow": axial, "crossflow": jnp.sqrt(dot(across, across) + 1e-12)}
    # 0.0 * time: what a body does not have is a plain number, and effects of a log read series
    return s.also({k: v + 0.0 * s["time"] for k, v in past.items() if k not in s})


def _without_effects(model: Model) -> Model:
    return model._copy(effects=())


def _with_push(model: Model) -> Model:
    """A model with what it has on a craft: the port of its force, and the water past it."""
    optional = {**dict.fromkeys(TOLD, "m/s"), **model.optional_inputs}
    return model._copy(ports={**model.ports, PUSH: PUSH_WORDS}, optional_inputs=optional)

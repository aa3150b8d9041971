"""Models: states, inputs, outputs, parameters and ports of a system."""

from __future__ import annotations

import contextlib
from collections.abc import Collection, Hashable, Iterable, Mapping, Sequence
from typing import Any, ClassVar, Self, TypeVar

from jax.typing import ArrayLike

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust._support.report import Report, Section
from diffthrust._support.validation import check_known
from diffthrust.models._base.component import Component, Mounted, changed
from diffthrust.models._base.effect import Effect, Ports, effect_named, reported_at
from diffthrust.models._base.made_effect import MadeEffect
from diffthrust.models._base.parameter import Parameter, parameter_rows
from diffthrust.models._base.quadratic_load import QuadraticLoad
from diffthrust.models._base.signals import RatesAndOutputs, Signal, Signals

C = TypeVar("C", bound=Component)


class Model(Component):
    """A short piece of physics with named ports.

    A subclass names its ``inputs``, ``optional_inputs``, ``states``, ``outputs`` (each a mapping
    from name to unit) and ``ports`` (name to one line of description), declares its parameters,
    and implements `equations`. A state that has the name of an output is measured by that output.
    An input that has the name of a state replaces it: the state is then prescribed by the log.
    Outputs named in ``angles`` are compared modulo a full turn.

    ``time_scales`` gives the fastest and the slowest time constant [s] that a log must be able to
    show; logs that cannot (milliseconds declared as seconds, or the reverse) are refused.
    ``horizon`` is the length [s] of the segments from which long runs are fitted by default, or
    ``None``. ``commands`` are the units in which the inputs named in ``commanded`` may be given:
    a model that lists them takes one as ``command="effort"``, and `fit` takes
    what the logs have.

    Effects are added with ``+`` and removed with ``- "name"``.

    Example:
        >>> model = dft.Thruster(alpha=0.04) + dft.effects.CommandDeadband()
        >>> print(model, "|", model - "command_deadband")
        thruster + command_deadband | thruster
        >>> model.inputs, model.states, model.channel_units["thrust"]
        ({'command': 'V'}, {'speed': 'rad/s'}, 'N')
        >>> held = model.fix("ct").bind({"alpha": 0.05})
        >>> held.alpha, held.parameters["ct"].fixed, held.free("ct").structure == model.structure
        (0.05, True, True)
        >>> list(model.as_plain())
        ['name', 'own', 'arguments', 'parameters', 'effects']
        >>> model.replace(ct={"per_log": True}).per_log, model.initial(dft.models.Signals({}))
        (('ct',), {})
        >>> [effect.name for effect in model.placements(dft.effects.ActuatorLag())]
        ['actuator_lag']
    """

    library: ClassVar[dict[str, type[Model]]] = {}
    inputs: ClassVar[Mapping[str, str]] = {}
    optional_inputs: ClassVar[Mapping[str, str]] = {}
    states: ClassVar[Mapping[str, str]] = {}
    outputs: ClassVar[Mapping[str, str]] = {}
    ports: ClassVar[Mapping[str, str]] = {}
    angles: ClassVar[tuple[str, ...]] = ()
    time_scales: ClassVar[tuple[float, float]] = (0.0, float("inf"))
    horizon: ClassVar[float | None] = None
    commands: tuple[str, ...] = ()
    commanded: tuple[str, ...] = ()

    feels: ClassVar[tuple[str, ...]] = ()
    """What its equations read of the water that passes it on a craft: "inflow", "crossflow"."""

    start_outputs: tuple[str, ...] = ()
    """Outputs from whose first measurements states follow; see `start_from`."""

    quaternions: tuple[tuple[str, ...], ...] = ()
    """Outputs that are unit quaternions, by their four names: with all signs turned they mean the
    same, and logs turn them as they like."""

    command: str = ""
    effects: tuple[Effect, ...] = ()

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        channels = {*cls.inputs, *cls.optional_inputs, *cls.outputs}
        twice = [name for name in cls.ports if name in channels]
        if twice:  # an effect there would act on the series and again in the equations
            raise InputError(
                f"Model {cls.__name__}: the port {listing(twice)} has the name of an input or "
                "output; effects of that name act on the recorded channel.",
                "Give the port another name.",
            )
        if "equations" in vars(cls) and "quadratic_load" not in vars(cls):
            # closed forms of a parent need not hold for other equations: a subclass of Thruster
            # with changed ones would otherwise get its formulas silently
            type.__setattr__(cls, "quadratic_load", Model.quadratic_load)

    def __init__(self, *, command: str = "", **parameters: float | Parameter) -> None:
        super().__init__(**parameters)
        self._set(**vars(self.commanded_in(command or next(iter(self.commands), ""))))

    def commanded_in(self, unit: str) -> Self:
        """The model whose command is given in another unit; its numbers stay as they are.

        Args:
            unit: one of ``commands``, such as ``"effort"``: 1 at full effort.

        Raises:
            InputError: a unit in which this model is not commanded.

        Example:
            >>> dft.Thruster().commanded_in("effort").parameters["beta"].unit
            'rad/s^2 per full effort'
        """
        if unit not in self.commands and (unit or self.commands):
            expected = listing(self.commands) if self.commands else "the unit that it names itself"
            raise InputError(
                f"{type(self).__name__}: expected a command in {expected}, found {unit!r}.",
                "Name one of these units.",
            )
        inputs = {**self.inputs, **dict.fromkeys(self.commanded, unit)} if unit else self.inputs
        converted = self._copy(inputs=inputs, command=unit)
        effects = tuple(map(converted._with_its_units, self.effects))
        return converted._with_its_units(converted)._copy(effects=effects)

    def _with_its_units(self, component: C) -> C:
        """The model, or an effect of it, with the units that follow those of this model."""
        return component._in_units(self.channel_units)

    @property
    def channel_units(self) -> dict[str, str]:
        """The unit of each input and output."""
        return {**self.outputs, **self.optional_inputs, **self.inputs}

    def equations(self, s: Signals, port: Ports) -> RatesAndOutputs:
        """The physics, written once: ``(rates, outputs)`` from the signals.

        It is evaluated with numbers inside the integration and with whole arrays for the outputs,
        so it may use only elementwise operations (``jnp.where`` rather than ``if``).

        Example:
            >>> s = dft.models.Signals({"command": 1.0, "speed": 10.0})
            >>> rates, outputs = dft.Thruster().equations(s, dft.models.Ports((), s))
            >>> round(float(rates["speed"]), 2)
            38.3
        """
        raise InputError(
            f"Model '{self.name}' has no equations.",
            "Define def equations(self, s, port): return {state: rate}, {output: value}.",
        )

    @property
    def quadratic_load(self) -> QuadraticLoad | None:
        """The numbers of a torque against a quadratic load, of a model that obeys these equations.

        ``None`` for other models. Effects are not counted. A class with equations of its own
        must define it as well: it is not inherited from a parent with other equations.

        Example:
            >>> dft.Thruster(beta=40.0).quadratic_load.drive_gain
            40.0
            >>> dft.SpeedLoopThruster().quadratic_load is None
            True
        """
        return None

    def initial(self, s: Signals) -> Mapping[str, Signal | float]:
        """Initial states where neither a measurement nor the user gives them; zero by default.

        Where a log does not measure a state, a value here is the first guess of where it begins;
        one that depends on a free parameter is where it begins, in every log, and the parameter
        is estimated from that.
        """
        return {}

    def settled(self, s: Signals) -> Mapping[str, Signal | float]:
        """Where states end while the inputs stay as they are; none by default.

        A craft's actuators begin so: they follow their commands far faster than the craft moves,
        and a start of each in every log would be as many numbers more to estimate.

        Example:
            >>> s = dft.models.Signals({"command": 0.5})
            >>> float(dft.SpeedLoopThruster(gain=300.0).settled(s)["speed"])
            150.0
        """
        return {}

    def start_from(self, first: Mapping[str, Any]) -> Mapping[str, Any]:
        """States at the start of a log that follow from what is measured of other outputs.

        Args:
            first: the first measurement of each output that begins with the log.

        Example:
            >>> rov = dft.Craft(dft.bodies.SixDegrees())
            >>> round(float(rov.start_from({"heading": 3.1415926535})["qz"]), 6)
            1.0
        """
        return {}

    def _telling(self, channels: Collection[str]) -> tuple[str, ...]:
        """The channels from whose series `start_from` tells states at any sample; none of most."""
        return ()

    def at(
        self,
        place: Sequence[float],
        pointing: Sequence[float] = (1.0, 0.0, 0.0),
        *,
        reaction: float | None = None,
    ) -> Mounted[Self]:
        """The model at a place of a craft, where its output ``thrust`` pushes; see `Craft`.

        Args:
            place: forward, to starboard and down from the origin of the craft [m].
            pointing: where a positive thrust pushes; ahead by default. Its length does not count.
            reaction: torque per thrust that the propeller leaves on the hull [m], positive where it
                turns the hull clockwise as seen along ``pointing``; none by default.

        Raises:
            InputError: a place or a direction that is none, or a model without a thrust.

        Example:
            >>> dft.Thruster().at((-0.35, 0.28, 0.0)).place
            (-0.35, 0.28, 0.0)
        """
        if "thrust" not in self.outputs:
            raise InputError(
                f"at: expected a model with an output 'thrust', found '{self.name}', which puts "
                f"out {listing(self.outputs)}.",
                "Place a thruster, or one of dft.actuators.",
            )
        return Mounted(self, (*place,), (*pointing,), reaction)  # pyright: ignore[reportArgumentType]

    # -- parameters by their full names ------------------------------------------------------------

    @property
    def parameters(self) -> dict[str, Parameter]:
        """All parameters by full name: ``alpha``, and ``effect.parameter`` for the effects.

        Example:
            >>> list((dft.Thruster() + "actuator_lag").parameters)
            ['alpha', 'beta', 'ct', 'actuator_lag.time_constant']
        """
        named = {name: self._present(name) for name in self._parameters}
        for effect in self.effects:
            named |= {f"{effect.name}.{k}": effect._present(k) for k in effect._parameters}
        return named

    def _mend_of_name(self, name: str) -> str:
        """What to do about a parameter that the model lacks: add its effect, if it has a place."""
        effect = name.rpartition(".")[0]
        if effect in Effect.library:
            with contextlib.suppress(InputError):
                if name in (self + effect).parameters:
                    return f'Add the effect "{effect}" first.'
        return "Correct the name."

    def replace(
        self,
        parameters: Mapping[str, float | Parameter | Mapping[str, Any]] | None = None,
        /,
        **more: float | Parameter | Mapping[str, Any],
    ) -> Self:
        """The model with some parameters changed: by a value, a `Parameter`, or some fields.

        Args:
            parameters: full name to new value, in the unit that ``model.parameters[name].unit``
                says, which is SI or an effort of 1 at the full command whatever the unit of the
                logs; needed for names such as ``"actuator_lag.time_constant"``.
            **more: the same for names without a dot.

        Raises:
            InputError: a name that the model does not have (the nearest is named), or a value
                outside its bounds.

        Example:
            >>> model = dft.Thruster().replace(alpha={"value": 0.03, "fixed": True}, ct=0.02)
            >>> model.parameters["alpha"].fixed
            True
        """
        named = self.parameters
        for name, new in {**(parameters or {}), **more}.items():
            if name not in named:  # the mend is sought only then: it tries to add the effect
                mend = self._mend_of_name(name)
                check_known(name, named, f"{self} has no parameter", mend=mend)
            named[name] = changed(named[name], new, name)
            named[name].check(name)
        effects = (
            effect._with_parameters({k: named[f"{effect.name}.{k}"] for k in effect._parameters})
            for effect in self.effects
        )
        base = self._with_parameters({k: named[k] for k in self._parameters})
        return base._copy(effects=tuple(effects))

    def fix(self, *names: str) -> Self:
        """The model with these parameters held at their values."""
        return self.replace({name: {"fixed": True} for name in names})

    def free(self, *names: str) -> Self:
        """The model with these parameters to be estimated."""
        return self.replace({name: {"fixed": False} for name in names})

    def bind(self, values: Mapping[str, ArrayLike]) -> Self:
        """The model reading (possibly traced) values by full name; unnamed ones stay."""
        effects = []
        for effect in self.effects:
            full = {k: f"{effect.name}.{k}" for k in effect._parameters}
            effects.append(effect._bound({k: values[n] for k, n in full.items() if n in values}))
        base = {k: values[k] for k in self._parameters if k in values}
        return self._copy(effects=tuple(effects), **base)

    # -- effects -----------------------------------------------------------------------------------

    def __add__(self, other: Effect | str | Sequence[Effect | str]) -> Self:
        if isinstance(other, str):
            other = effect_named(other)
        if isinstance(other, list | tuple):
            model = self
            for effect in other:
                model = model + effect
            return model
        if isinstance(other, type) and issubclass(other, Effect):
            raise InputError(
                f"{self}: expected an effect, found the class {other.__name__}.",
                f"Write model + {other.__name__}().",
            )
        if not isinstance(other, Effect):
            return NotImplemented
        if any(effect.name == other.name for effect in self.effects):
            raise InputError(
                f"{self} already has the effect '{other.name}'.",
                f'Take it out first: model - "{other.name}".'
                + " Or give one of them another name." * isinstance(other, MadeEffect),
            )
        channels = (*self.inputs, *self.optional_inputs, *self.outputs)
        other._check_places(self.name, tuple(self.ports), channels)
        return self._copy(effects=(*self.effects, self._fitted_in(other)))

    def placements(self, effect: Effect) -> Iterable[Effect]:
        """The effect everywhere that it may act: a craft has more places than one."""
        return (effect,)

    def constant_words(self, name: str, fixed: float, wanted: float) -> str:
        """What it comes to that logs want another value of a fixed parameter; "" by default.

        Example:
            >>> boat = dft.layouts.OTTER.craft()
            >>> boat.constant_words("port.strength", 1.0, 0.78)
            'port gives 22 % less thrust than starboard'
        """
        return ""

    def _fitted_in(self, effect: Effect) -> Effect:
        """An effect with the units of this model's channels, and the optional ones it needs."""
        for port in effect.ports if effect.reads else ():
            signals = self.signals_at(port)
            for name in effect.reads:
                if name not in signals:
                    raise effect.unread(name, port, signals)
        always = {*self.inputs, *self.states}
        needs = [n for n in effect.reads if n in self.optional_inputs and n not in always]
        effect = self._with_its_units(effect)
        return effect._copy(needs=tuple({*effect.needs, *needs})) if needs else effect

    def signals_at(self, port: str) -> tuple[str, ...]:
        """The signals that an effect may read at a port, or on a channel.

        Example:
            >>> dft.Thruster().signals_at("shaft")
            ('time', 'command', 'speed', 'inflow', 'supply_voltage')
        """
        names = ("time", *self.inputs, *self.optional_inputs)
        if port in self.ports:
            names = ("time", *self.inputs, *self.states, *self.optional_inputs)
            names += reported_at(self.equations, names, port)
        elif port in self.outputs:
            names = ("time", *self.inputs, *self.states, *self.outputs, *self.optional_inputs)
        return tuple(dict.fromkeys(names))

    def __sub__(self, name: str) -> Self:
        kept = tuple(effect for effect in self.effects if effect.name != name)
        if len(kept) == len(self.effects):
            raise InputError(
                f"{self} has no effect '{name}'; it has {listing([e.name for e in self.effects])}.",
                "Correct the name.",
            )
        return self._copy(effects=kept)

    def as_plain(self) -> dict[str, Any]:
        """What it takes to make the model again, as data, with its effects."""
        return {**super().as_plain(), "effects": [effect.as_plain() for effect in self.effects]}

    @property
    def structure(self) -> tuple[Hashable, ...]:
        """What fixes the compiled code: classes and options of the model and its effects."""
        return (*super().structure, *(effect.structure for effect in self.effects))

    @property
    def all_states(self) -> dict[str, str]:
        """The model's states and those of its effects (``effect.state``), with their units.

        Example:
            >>> (dft.Thruster() + "actuator_lag").all_states
            {'speed': 'rad/s', 'actuator_lag.response': ''}
        """
        effect_states = {
            f"{effect.name}.{name}": unit
            for effect in self.effects
            for name, unit in effect.states.items()
        }
        return {**self.states, **effect_states}

    @property
    def free_starts(self) -> tuple[str, ...]:
        """The states of its effects whose initial values are estimated for each log.

        Example:
            >>> (dft.Thruster() + dft.effects.PeriodicForce("shaft", 0.7)).free_starts
            ('periodic_force.sine', 'periodic_force.cosine')
        """
        return tuple(
            f"{effect.name}.{name}" for effect in self.effects for name in effect.free_starts
        )

    @property
    def per_log(self) -> tuple[str, ...]:
        """The parameters that differ from log to log; their values are means."""
        return tuple(name for name, p in self.parameters.items() if p.per_log)

    def __repr__(self) -> str:
        return " + ".join([super().__repr__(), *(repr(effect) for effect in self.effects)])

    def _repr_html_(self) -> str:
        from diffthrust._support.page import notebook_html

        return notebook_html(Report(Section("", str(self), parameter_rows(self.parameters))))

    def __str__(self) -> str:
        return " + ".join([self.name, *(effect.name for effect in self.effects)])


MODELS = Model.library
"""The library's models, by name."""

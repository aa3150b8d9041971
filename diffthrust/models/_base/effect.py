"""Effects: small physical terms at ports of models, the ports, and the catalogue of effects."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from importlib import import_module
from importlib.metadata import entry_points
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing, nearby, nearest
from diffthrust.models._base.component import Component
from diffthrust.models._base.signals import Rate, Signal, Signals, elementwise, expect


class Acting(NamedTuple):
    """An effect as it acts at a port: itself, or behind the names of a part of a model.

    What acts, the port by its own name, the signals read there, the full names of its states.
    """

    effect: Effect
    port: str
    signals: Signals
    states: Mapping[str, str]


class Effect(Component):
    """A physical term with parameters, a null value and a port.

    A subclass sets ``name`` (canonical, as in spec files), ``port`` (a port of the model, or the
    name of an input or output channel to act on the whole recorded series), ``needs`` (channels
    that the log must have as inputs), declares its parameters with their ``null`` values, and
    implements ``__call__``. An effect with states of its own names them in ``states`` (name to
    unit) and implements ``rates``; its states are then read from the signals by their names. Those
    in ``free_starts`` begin somewhere else in every log, as the phase of a wave does.
    An effect on a channel that reads other samples than the present one (a delay, a rate limit)
    sets ``memory``. An effect that acts at several places lists them in ``ports`` and implements
    `at` instead of ``__call__``.

    Example:
        >>> class ViscousFriction(dft.Effect):
        ...     '''Friction of the seals, proportional to speed.'''
        ...
        ...     name = "viscous_friction"
        ...     port = "shaft"
        ...     rate: float = dft.parameter(0.1, unit="1/s", bounds=(0, None), null=0.0)
        ...
        ...     def __call__(self, value, s):
        ...         return value - self.rate * s.speed
        >>> print(dft.Thruster() + ViscousFriction())
        thruster + viscous_friction
        >>> friction, s = ViscousFriction(rate=0.2), dft.models.Signals({"speed": 10.0})
        >>> friction.at("shaft", 5.0, s), friction.at_null().at("shaft", 5.0, s)
        (3.0, 5.0)
        >>> friction.of_user, friction.differs, friction.form, friction.initial(5.0, s)
        (True, False, {}, {})
        >>> friction.acting("shaft", s).states, friction.scaled(dict) is friction
        ({}, True)
        >>> print(friction.unread("rpm", "shaft", ("time", "speed")).mend)
        Correct the name; known there are 'time', 'speed'.
    """

    library: ClassVar[dict[str, type[Effect]]] = {}
    port: ClassVar[str] = ""
    in_words: ClassVar[str] = ""
    """What it does as a person would say it, with its parameters: "the motor's torque lags by
    {time_constant}"; ``{change:more}`` reads "20 % less", ``{fraction:%}`` "5 %". Its name else."""
    needs: ClassVar[tuple[str, ...]] = ()
    states: ClassVar[Mapping[str, str]] = {}
    free_starts: ClassVar[tuple[str, ...]] = ()
    """States of its own of which nothing tells where they begin: a fit estimates that by log."""
    memory: ClassVar[bool] = False
    ports: ClassVar[tuple[str, ...]] = ()
    reads: tuple[str, ...] = ()
    """Signals that it reads, where these are known; a model refuses one that it does not have."""
    by_log: ClassVar[tuple[str, ...]] = ()
    """Parameters that each log has its own of, as of a current: so a diagnosis of several tries."""
    required: ClassVar[tuple[str, ...]] = ("name", "port")
    """Fields that each class of effects must set."""

    def __init_subclass__(cls, abstract: bool = False, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if "ports" in vars(cls):
            cls.port = cls.ports[0]
        elif cls.port:
            cls.ports = (cls.port,)
        if cls.name and not cls.name.isidentifier():
            raise InputError(
                f"Effect {cls.__name__}: the name {cls.name!r} is not made of letters, digits and "
                "underscores.",
                "Write it like the names of Python: my_effect.",
            )
        missing = [field for field in cls.required if not getattr(cls, field)]
        if missing and not abstract:  # an abstract one leaves them to its subclasses
            raise InputError(
                f"Effect {cls.__name__}: expected {' and '.join(missing)} in the class body.",
                f'Write {missing[0]} = "..." in the class.',
            )

    def __call__(self, value: Signal, s: Signals) -> Signal:
        """The value that leaves the port when `value` arrives at it."""
        raise InputError(
            f"Effect '{self.name}' has no __call__.", "Define def __call__(self, value, s): ..."
        )

    def at(self, port: str, value: Signal, s: Signals) -> Signal:
        """The value that leaves one of ``ports``: that of ``__call__`` where there is one."""
        return self(value, s)

    def rates(self, value: Signal, s: Signals) -> Mapping[str, Rate]:
        """Time derivatives of the effect's own states (a number or `Relaxing` for each).

        Example:
            >>> s = dft.models.Signals({"actuator_lag": 0.0, "speed": 0.0, "time": 0.0})
            >>> dft.effects.ActuatorLag(time_constant=0.1).states
            {'response': ''}
        """
        raise InputError(
            f"Effect '{self.name}' has states but no rates.",
            "Define def rates(self, value, s): return {state: derivative}.",
        )

    def initial(self, value: Signal, s: Signals) -> Mapping[str, Signal | float]:
        """States at the start of a log, from the value that arrives there; zero by default."""
        return {}

    def acting(self, port: str, s: Signals) -> Acting:
        """The effect, the port, the signals and the full names of its states, as it acts there."""
        return Acting(self, port, s, {name: f"{self.name}.{name}" for name in self.states})

    def _check_places(self, model: str, ports: Sequence[str], channels: Sequence[str]) -> None:
        """Raise `InputError` where a model has none of its ports, or integrates nothing there."""
        for port in self.ports:
            if port not in (*ports, *channels):
                raise InputError(
                    f"Effect '{self.name}' acts at the port '{port}', which the model "
                    f"'{model}' does not have; it has {listing([*ports, *channels])}.",
                    "Use an effect made for one of these ports.",
                )
            # a channel is a recorded series, on which nothing is integrated
            if self.states and port not in ports:
                raise InputError(
                    f"Effect '{self.name}' has states of its own and acts on the channel "
                    f"'{port}'; states are integrated at ports inside the model only: "
                    f"{listing(ports)}.",
                    "Let it act at one of these ports.",
                )

    def unread(self, name: str, port: str, signals: Sequence[str]) -> InputError:
        """The error for a signal that it reads and that the model does not have there."""
        near = nearest(name, signals)
        return InputError(
            f"Effect '{self.name}' reads the signal {name!r}, which is not known at the port "
            f"'{port}'{'; ' + near if near else ''}.",
            f"Correct the name; known there are {listing(signals)}.",
        )

    def size_words(self, starts: Sequence[Mapping[str, float]]) -> str:
        """Its size in words, where its initial states in some logs tell of it; empty by default.

        Args:
            starts: log by log its states, by their own names.

        Example:
            >>> waves = dft.effects.PeriodicForce("shaft", 0.7, 25.0, unit="rad/s^2")
            >>> waves.size_words([{"sine": 0.6, "cosine": 0.8}])
            'amplitude 25 rad/s^2'
        """
        return ""

    @property
    def form(self) -> dict[str, float]:
        """Fixed parameters that are not as declared, and so choose another form of the effect."""
        return {
            name: getattr(self, name)
            for name, p in self._parameters.items()
            if p.fixed and p.probes and getattr(self, name) != self.declared[name].value
        }

    def consequence(self, model: Component, recorded: Collection[str] = ()) -> str:
        """What the numbers come to in a model, in words, where they do not say so; "" by default.

        Args:
            model: the model.
            recorded: the channels that the logs have.

        Example:
            >>> model = dft.Vessel(drive="twin", command="effort", exponent=2.35)
            >>> dft.effects.DifferentialGain(gain=0.049).consequence(model)
            "the right thruster gives 79 % of the left one's force"
        """
        return ""

    def over_logs(self, ranges: Mapping[str, tuple[float, float]]) -> str:
        """Its size in what the logs contain, where its numbers refer to something else.

        Empty by default.

        Args:
            ranges: the smallest and the largest value of each input in the logs.

        Example:
            >>> sag = dft.effects.SupplyVoltageSag(share=1.0, nominal=24.0)
            >>> sag.over_logs({"supply_voltage": (10.0, 20.0)})
            'the drive at 10 V is 50 % of that at 20 V'
        """
        return ""

    def of_sampling(self, step: float) -> str:
        """What a log's held samples do to the numbers, beyond their errors; "" by default.

        Args:
            step: from one sample of what it acts on to the next [s].

        Example:
            >>> dft.effects.CommandDelay(delay=0.1).of_sampling(0.02).partition(" ")[0]
            'command_delay.delay'
            >>> dft.effects.CommandOffset(offset=0.1).of_sampling(0.02)
            ''
        """
        return ""

    def scaled(self, levels: Callable[[], Mapping[str, float]]) -> Effect:
        """The effect with sizes and trial values that follow from the logs; as it is, by default.

        Args:
            levels: gives how large the signals of the model are, the ports' among them: the 90th
                percentile of the absolute value.
        """
        return self

    def at_null(self) -> Effect:
        """The same effect with every parameter that has a null value set to it."""
        nulls = {k: p.null for k, p in self._parameters.items() if p.null is not None}
        described = {k: self._parameters[k].with_value(v) for k, v in nulls.items()}
        return self._copy(_parameters={**self._parameters, **described}, **nulls)

    @property
    def of_user(self) -> bool:
        """Whether the library has no effect of its name and class: one of the user's own."""
        return type(self) is not EFFECTS.get(self.name)

    @property
    def differs(self) -> bool:
        """Whether parameters of it differ from log to log."""
        return any(p.per_log for p in self._parameters.values())

    def differing(self, apart: bool = True) -> Effect:
        """The same effect, its parameters ``by_log`` marked as differing from log to log, or not.

        Example:
            >>> dft.effects.WaterCurrent().differing().differs
            True
        """
        marked = {k: replace(self._parameters[k], per_log=apart) for k in self.by_log}
        return self._copy(_parameters={**self._parameters, **marked}) if marked else self


EFFECTS = Effect.library
"""The library's effects, by name."""


class Ports:
    """Passes a value through the effects that act at a port, in the order they were added.

    One instance serves one evaluation of a model's equations; it collects the rates of the
    effects' own states on the way. With ``starting=True`` those states are set to their initial
    values instead, as the value arrives.

    Example:
        >>> s = dft.models.Signals({"command": 1.0, "speed": 10.0})
        >>> port = dft.models.Ports((), s)
        >>> port("drive", 42.0)
        42.0
        >>> port.tell(swept=100.0)
    """

    def __init__(self, effects: Sequence[Effect], signals: Signals, starting: bool = False) -> None:
        self._effects = effects
        self._signals = signals
        self._starting = starting
        self.rates: dict[str, Rate] = {}
        self.initial: dict[str, Signal | float] = {}

    def tell(self, **signals: Signal | float) -> None:
        """Let the effects at the ports that follow read what the model has worked out."""
        self._signals = self._signals.also(signals)

    def hears(self, part: str) -> bool:
        """Whether anything may read what is told of a part; where not, it need not be worked out.

        Example:
            >>> dft.models.Ports((), dft.models.Signals({})).hears("port")
            False
        """
        return any(port.startswith(f"{part}.") for e in self._effects for port in e.ports)

    def __call__(self, port: str, value: Signal) -> Signal:
        for effect in self._effects:
            if port in effect.ports:
                value = self._through(effect, port, value)
        return value

    def _through(self, effect: Effect, port: str, value: Signal) -> Signal:
        acting, place, signals, full = effect.acting(port, self._signals)
        where = type(acting).__name__
        if not full:
            with elementwise(where):
                return acting.at(place, value, signals)
        if self._starting:
            start = acting.initial(value, signals)
            self.initial.update({full[name]: start.get(name, 0.0) for name in full})
            signals = signals.also({name: self.initial[full[name]] for name in full})
        else:
            signals = signals.also({name: self._signals[full[name]] for name in full})
        with elementwise(where):
            rates = acting.rates(value, signals)
            leaving = acting.at(place, value, signals)
        expect(f"{where}.rates", "rate of the state", full, rates)
        self.rates.update({full[name]: rates[name] for name in full})
        return leaving


def reported_at(equations: Callable[..., Any], names: Iterable[str], port: str) -> tuple[str, ...]:
    """The signals that equations report to the effects at a port, besides their own inputs."""
    signals = tuple(dict.fromkeys(("time", *names)))
    readable: dict[str, tuple[str, ...]] = {}

    def run(values: dict[str, Signal]) -> Signal:
        s = Signals(values)
        reading = Reading((), s)
        equations(s, reading)
        readable.update(reading.readable)
        return values["time"]

    # an abstract evaluation: the equations are walked through once, nothing is computed
    jax.eval_shape(run, {name: jnp.asarray(0.5) for name in signals})
    return tuple(name for name in readable.get(port, ()) if name not in signals)


class Reading(Ports):
    """Ports that note what may be read there, what passes, and what the model tells.

    They may add a ``push`` to what passes.
    """

    def __init__(
        self, effects: Sequence[Effect], signals: Signals, push: Mapping[str, Any] | None = None
    ) -> None:
        super().__init__(effects, signals)
        self.push = push or {}
        self.readable: dict[str, tuple[str, ...]] = {}
        self.seen: dict[str, Any] = {}
        self.told: dict[str, Any] = {}

    def hears(self, part: str) -> bool:
        return True

    def tell(self, **signals: Any) -> None:
        super().tell(**signals)
        self.told |= signals

    def __call__(self, port: str, value: Any) -> Any:
        self.readable[port] = tuple(self._signals)
        self.seen[port] = value = super().__call__(port, value)
        return value + self.push[port] if port in self.push else value


_GROUP = "diffthrust.effects"
"""Packages offer effects of their own by entry points of this group, each naming a class.

It is also the name of the folder whose import registers the library's own: as text, for what is
registered must not be known here, and a model must find it by name even where nobody has touched
that folder yet."""


@lru_cache(maxsize=1)
def catalogue() -> Mapping[str, type[Effect]]:
    """All known effects by name: the library's in the order of its files, then packages'."""
    import_module(_GROUP)
    # sorted, since the order of registration follows what happens to be imported first
    classes = dict(sorted(EFFECTS.items(), key=lambda e: (e[1].__module__, e[1].__qualname__)))
    for point in entry_points(group=_GROUP):
        cls = point.load()
        if not (isinstance(cls, type) and issubclass(cls, Effect)):
            raise InputError(
                f"The entry point '{point.name}' of {_GROUP} gives {cls!r}, which is no effect.",
                "Let it name a class derived from diffthrust.Effect.",
            )
        if cls.name in classes:
            raise InputError(
                f"The entry point '{point.name}' of {_GROUP} gives an effect '{cls.name}', a name "
                "that is taken.",
                "Rename the effect, or remove the package.",
            )
        classes[cls.name] = cls
    return classes


def effect_named(name: str) -> Effect:
    """The effect of a canonical name, as its class declares it."""
    classes = catalogue()
    if name not in classes:
        raise InputError(
            f"the effect {name!r} is not known; {nearby(name, classes)}.",
            "Correct the name ('diffthrust effects' lists all); an effect of your own is added as "
            "an object: model + MyEffect().",
        )
    return classes[name]()

"""Parts of a craft seen by themselves, under their short names, and effects on its actuators.

On a craft the command of the thruster ``port`` is the signal ``port.command``, its thrust passes
the port ``port.propeller``, its gain is the parameter ``port.gain``. The thruster's equations, and
the effects on it, read ``s.command`` and call ``port("propeller", ...)`` as they always do.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Hashable, Mapping, Sequence
from dataclasses import replace
from typing import Any, ClassVar

from diffthrust._support.words import joined
from diffthrust.models._base.component import Component
from diffthrust.models._base.effect import Acting, Effect, Ports
from diffthrust.models._base.parameter import Parameter, Relative
from diffthrust.models._base.signals import Signal, Signals

COMMON = ("time", "supply_voltage")
"""Signals of the whole craft that its parts read by the same names: one clock, one battery."""
_PLACE = ("x", "y", "z")


def signals_under(s: Signals, scope: str) -> Signals:
    """The signals of a part by their short names, beside those of the whole."""
    prefix = f"{scope}."
    common = {name: s[name] for name in s if "." not in name}
    short = {name.removeprefix(prefix): s[name] for name in s if name.startswith(prefix)}
    return Signals({**common, **short})


class PortsUnder(Ports):
    """The ports of a part by their short names, inside those of the whole."""

    def __init__(self, whole: Ports, scope: str) -> None:
        self._whole = whole
        self._scope = scope

    def tell(self, **signals: Signal | float) -> None:
        self._whole.tell(**{f"{self._scope}.{name}": value for name, value in signals.items()})

    def __call__(self, port: str, value: Signal) -> Signal:
        return self._whole(f"{self._scope}.{port}", value)


def lifted(described: Parameter, scope: str, signals: Collection[str]) -> Parameter:
    """A parameter of a part as one of the whole: units and trial values follow the part's signals.

    Trial values may follow others, as the length of the logs: these are named as they were.
    """
    pattern, probes = described.pattern or described.unit, described.probes
    if "{" in pattern:
        described = replace(described, pattern=re.sub(r"\{(\w+)\}", rf"{{{scope}.\1}}", pattern))
    if isinstance(probes, Relative) and probes.signal in signals:
        described = replace(described, probes=replace(probes, signal=f"{scope}.{probes.signal}"))
    return described


def prefixed(scope: str, named: Any) -> dict[str, Any]:
    """What belongs to a part, by the names of the whole."""
    return {name if name in COMMON else f"{scope}.{name}": named[name] for name in named}


def place_parameters(scope: str, place: Sequence[float]) -> dict[str, Parameter]:
    """The place of a part, held."""
    return {
        f"{scope}.{axis}": Parameter(value, "m", fixed=True, size=0.3, doc="place")
        for axis, value in zip(_PLACE, place, strict=True)
    }


def place_of(scope: str, values: Mapping[str, Any]) -> tuple[Any, Any, Any]:
    """Where a part is, by the (possibly traced) values of the whole."""
    x, y, z = (values[f"{scope}.{axis}"] for axis in _PLACE)
    return x, y, z


class Placed(Effect):
    """An effect behind the names of the actuators on which it acts; see `Craft.placed`.

    It is the effect itself: its equations read the signals of each actuator by their short names.
    """

    required: ClassVar[tuple[str, ...]] = ()

    def __init__(
        self,
        effect: Effect,
        members: Sequence[str],
        name: str,
        signals: Collection[str] = (),
        told: Collection[str] = (),
    ) -> None:
        """Of an effect made for the model of the members, which are all of that model.

        Args:
            effect: the effect.
            members: the actuators, by name.
            name: on the craft: "port.actuator_lag", or "actuator_lag" on all that share.
            signals: what the actuator's equations read and report.
            told: signals that the craft works out for them, which no log need have.
        """
        first = members[0]
        needs = (n for n in effect.needs if n not in told)
        named = {k: lifted(p, first, signals) for k, p in effect._parameters.items()}
        words = f"{joined(members)}: {effect.in_words}" if effect.in_words else ""
        self._set(
            effect=effect,
            members=tuple(members),
            name=name,
            ports=tuple(f"{m}.{p}" for m in members for p in effect.ports),
            port=f"{first}.{effect.port}",
            needs=tuple(n if n in COMMON else f"{m}.{n}" for n in needs for m in members),
            states={k: u for m in members for k, u in self._states_of(effect, members, m).items()},
            memory=effect.memory,
            in_words=words,
            declared={k: lifted(p, first, signals) for k, p in effect.declared.items()},
            _lifting=(tuple(signals), tuple(told)),
        )
        starts = [name for name in effect.states if name in effect.free_starts]
        if len(members) > 1:
            starts = [f"{m}.{name}" for m in members for name in starts]
        self._set(
            free_starts=tuple(starts),
            _parameters=named,
            **{k: getattr(effect, k) for k in named},
        )

    effect: Effect
    members: tuple[str, ...]
    _lifting: tuple[tuple[str, ...], tuple[str, ...]]

    @staticmethod
    def _states_of(effect: Effect, members: Sequence[str], member: str) -> dict[str, str]:
        """The states at one actuator, by their names behind that of the placed effect."""
        scope = f"{member}." if len(members) > 1 else ""
        return {f"{scope}{name}": unit for name, unit in effect.states.items()}

    @property
    def inner(self) -> Effect:
        """The effect with the present values."""
        return self.effect._bound({k: getattr(self, k) for k in self._parameters})

    def acting(self, port: str, s: Signals) -> Acting:
        """The effect itself, at the actuator whose port this is."""
        member, _, short = port.partition(".")
        states = self._states_of(self.effect, self.members, member)
        pairs = zip(self.effect.states, states, strict=True)
        full = {name: f"{self.name}.{state}" for name, state in pairs}
        return Acting(self.inner, short, signals_under(s, member), full)

    def __call__(self, value: Signal, s: Signals) -> Signal:
        """The value that leaves the port of the first actuator."""
        return self.at(self.port, value, s)

    def at(self, port: str, value: Signal, s: Signals) -> Signal:
        acting = self.acting(port, s)
        return acting.effect.at(acting.port, value, acting.signals)

    def scaled(self, levels: Callable[[], Mapping[str, float]]) -> Effect:
        first = self.members[0]

        def short() -> Mapping[str, float]:
            return {n: float(v) for n, v in signals_under(Signals(levels()), first).items()}

        inner = self.inner
        adapted = inner.scaled(short)
        return self if adapted is inner else self._with(adapted)

    def consequence(self, model: Component, recorded: Collection[str] = ()) -> str:
        return self.inner.consequence(model, recorded)

    def over_logs(self, ranges: Mapping[str, tuple[float, float]]) -> str:
        scope = f"{self.members[0]}."
        return self.inner.over_logs({n.removeprefix(scope): r for n, r in ranges.items()})

    def of_sampling(self, step: float) -> str:
        return self.inner.of_sampling(step)

    def size_words(self, starts: Sequence[Mapping[str, float]]) -> str:
        scope = f"{self.members[0]}."
        short = [{n.removeprefix(scope): v for n, v in start.items()} for start in starts]
        return self.inner.size_words(short)

    def _with(self, effect: Effect) -> Placed:
        return Placed(effect, self.members, self.name, *self._lifting)

    @property
    def own(self) -> bool:
        """It is what a craft makes of an effect, which may be the user's own."""
        return False

    @property
    def of_user(self) -> bool:
        return self.effect.of_user

    @property
    def arguments(self) -> dict[str, Any]:
        signals, told = self._lifting
        return {"members": self.members, "name": self.name, "signals": signals, "told": told}

    @property
    def parts(self) -> dict[str, Component]:
        return {"effect": self.effect}

    def as_code(self, written: Callable[[Component], str]) -> str:
        """What is added to the craft: an actuator and the effect, or the effect for all."""
        effect = written(self.effect)
        return f'("{self.members[0]}", {effect})' if len(self.members) == 1 else effect

    @property
    def structure(self) -> tuple[Hashable, ...]:
        return (type(self), self.name, self.members, self.effect.structure)

    def as_plain(self) -> dict[str, Any]:
        """The effect as data, with the actuators on which it acts."""
        plain = self.effect.as_plain()
        named = {name: self._present(name) for name in self._parameters}
        return {**plain, "parameters": named, "members": self.members}

    def __repr__(self) -> str:
        return f"{joined(self.members)}: {self.inner!r}"

"""An effect on one actuator of a craft, or on several that share their numbers."""

from __future__ import annotations

from collections.abc import Callable, Collection, Hashable, Mapping, Sequence
from typing import Any, ClassVar

from diffthrust._support.words import joined
from diffthrust.models._base.component import Component
from diffthrust.models._base.effect import Acting, Effect
from diffthrust.models._base.signals import Signal, Signals
from diffthrust.models._craft.scope import COMMON, lifted, signals_under


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
        """The value that leaves the effect at one of the actuators."""
        acting = self.acting(port, s)
        return acting.effect.at(acting.port, value, acting.signals)

    def scaled(self, levels: Callable[[], Mapping[str, float]]) -> Effect:
        """With sizes from the logs: those of the first actuator's signals."""
        first = self.members[0]

        def short() -> Mapping[str, float]:
            return {n: float(v) for n, v in signals_under(Signals(levels()), first).items()}

        inner = self.inner
        adapted = inner.scaled(short)
        return self if adapted is inner else self._with(adapted)

    def consequence(self, model: Component, recorded: Collection[str] = ()) -> str:
        """What the numbers come to, in words, as the effect says it."""
        return self.inner.consequence(model, recorded)

    def over_logs(self, ranges: Mapping[str, tuple[float, float]]) -> str:
        """What the numbers come to over what the logs hold, at the first actuator."""
        scope = f"{self.members[0]}."
        return self.inner.over_logs({n.removeprefix(scope): r for n, r in ranges.items()})

    def of_sampling(self, step: float) -> str:
        """What a log's held samples do to the numbers, as the effect says it."""
        return self.inner.of_sampling(step)

    def size_words(self, starts: Sequence[Mapping[str, float]]) -> str:
        """Its size in words, as the effect says it of the first actuator."""
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
        """Whether the effect is the user's own."""
        return self.effect.of_user

    @property
    def arguments(self) -> dict[str, Any]:
        """Where it is placed."""
        signals, told = self._lifting
        return {"members": self.members, "name": self.name, "signals": signals, "told": told}

    @property
    def parts(self) -> dict[str, Component]:
        """The effect."""
        return {"effect": self.effect}

    def as_code(self, written: Callable[[Component], str]) -> str:
        """What is added to the craft: an actuator and the effect, or the effect for all."""
        effect = written(self.effect)
        return f'("{self.members[0]}", {effect})' if len(self.members) == 1 else effect

    @property
    def structure(self) -> tuple[Hashable, ...]:
        """What fixes the compiled code."""
        return (type(self), self.name, self.members, self.effect.structure)

    def as_plain(self) -> dict[str, Any]:
        """The effect as data, with the actuators on which it acts."""
        plain = self.effect.as_plain()
        named = {name: self._present(name) for name in self._parameters}
        return {**plain, "parameters": named, "members": self.members}

    def __repr__(self) -> str:
        return f"{joined(self.members)}: {self.inner!r}"

"""The effects that a diagnosis tries, and the ports at which an unknown signal may be missing."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence, Set
from dataclasses import dataclass
from typing import Self

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from diffthrust._support._running.batching import padded
from diffthrust._support.errors import InputError
from diffthrust._support.names import listing, nearby, nearest
from diffthrust.models._base.effect import Effect, Reading, catalogue
from diffthrust.models._base.model import Model
from diffthrust.models._base.signals import Signals, UnknownSignal
from diffthrust.simulation._integrate import plain_rate
from diffthrust.simulation._linearise import enters, slopes_at
from diffthrust.simulation._record import Record, are_tables
from diffthrust.simulation._trajectory import equations_of

TAKES_TIME = "takes time, and these tables have none"
"""Why static tables cannot test an effect."""
_EVERY = "all"
"""The word for the whole catalogue."""

Candidates = str | Effect | type[Effect] | Sequence[str | Effect | type[Effect]]


def candidates_of(
    model: Model,
    records: Sequence[Record],
    wanted: Candidates | None = None,
) -> tuple[list[Effect], dict[str, str]]:
    """The effects to try, and those that cannot be tried on these logs, with the reason.

    Args:
        model: the model; effects that it has, and those made for other ports, are left out.
        records: all of them, training and unseen.
        wanted: name, effect or class of effect, or several; "all" is the whole catalogue, which is
            tried where ``None``. A name of `constants_of` is no effect, and is passed over.

    Raises:
        InputError: a wanted effect that does not exist, that the model has no port for, or that is
            called like one of its parameters.
    """
    named, chosen = _asked_for(wanted, model)
    scope = _Scope.of(model, records, named)
    has = {effect.name for effect in model.effects}
    places = {*model.ports, *scope.inputs, *model.outputs}
    tried: list[Effect] = []
    untestable: dict[str, str] = {}
    for effect in chosen:
        elsewhere = [port for port in effect.ports if port not in places]
        if effect.name in has:
            continue
        if effect.reads and not elsewhere:
            effect = (model + effect).effects[-1]  # which knows what it needs there
        if effect.name in model.parameters:  # each of these is a candidate by its own name
            if effect.name in named:
                raise InputError(
                    f"candidates: the effect {effect.name!r} is called like a parameter of "
                    f"'{model}'.",
                    "Give the effect another name.",
                )
            untestable[effect.name] = "it is called like a parameter of the model"
        elif elsewhere:
            if effect.name in named:
                _ = model + effect  # says what is wrong
                untestable[effect.name] = f"needs the input {listing(elsewhere)}"
        elif why := scope.why_not(effect):
            untestable[effect.name] = why
        else:
            tried.append(effect)
    return tried, untestable


@dataclass(frozen=True)
class _Scope:
    """What the logs and the model offer to effects, by which some of these cannot be tried."""

    model: Model
    named: Set[str]  # effects that were asked for one by one
    inputs: Set[str]  # of all logs
    measured: Set[str]  # in any log
    passed: Set[str]  # inputs that the model takes
    unseen: Set[str]  # ports on which nothing that is measured depends
    prescribed: Sequence[str]  # states that the logs give
    timeless: bool  # the logs are static tables

    @classmethod
    def of(cls, model: Model, records: Sequence[Record], named: Set[str]) -> Self:
        """Of all records, training and unseen."""
        first, measured = records[0], {name for record in records for name in record.measured}
        return cls(
            model,
            named,
            set.intersection(*(set(record.inputs) for record in records)),
            measured,
            {*first.inputs_for(model)},
            unseen_at(model, first, measured),
            [name for name in model.states if name in first.inputs],
            are_tables(records),
        )

    def why_not(self, effect: Effect) -> str:
        """Why an effect that acts where these logs have something cannot be tried; "" if it can."""
        model, is_named = self.model, effect.name in self.named
        if lacking := [name for name in effect.needs if name not in self.inputs]:
            return f"needs the channel {listing(lacking)}, which no log has"
        # the trials of an effect read what reaches the model without it
        if unread := [name for name in effect.needs if name not in self.passed]:
            return (
                f"reads the channel {listing(unread)}, which the model {model.name} does not take"
            )
        if all(p in model.outputs and p not in self.measured for p in effect.ports):
            return f"the channel {listing(effect.ports)} is not measured"
        if not is_named and (absent := _absent_signal(model, effect, self.inputs)):
            return f"reads the signal {absent}, which the model does not have"
        if self.timeless and _takes_time(model, effect, self.inputs):
            return TAKES_TIME
        if remembered := [p for p in effect.ports if effect.memory and p in model.states]:
            return f"reads the past of {listing(remembered)}, by which the trials correct the model"
        if all(p.null is None for p in effect._parameters.values()):
            if is_named:
                raise InputError(
                    f"candidates: the effect {effect.name!r} has no parameter with a null value: "
                    "at which value does it leave the model unchanged?",
                    "Give one in its declaration, such as parameter(0.3, null=0.0).",
                )
            return "no parameter of it has a null value"
        if all(port in self.unseen for port in effect.ports):
            why = f" while the logs prescribe {listing(self.prescribed)}" if self.prescribed else ""
            return f"nothing that is measured depends on it{why}"
        return ""


def _takes_time(model: Model, effect: Effect, inputs: Collection[str]) -> bool:
    """Whether an effect has states, remembers, or reads the clock."""
    return bool(effect.states) or effect.memory or enters("time", model + effect, inputs)


def _absent_signal(model: Model, effect: Effect, inputs: Set[str]) -> str:
    """A signal that an effect reads where it acts and that is not there; "" if all are.

    A thruster on a craft that is a curve of its command has the port of the propeller, whose other
    effects read the speed of a shaft.
    """
    if inputs >= {*effect.ports}:  # such an effect takes the recorded series alone
        return ""
    try:
        enters("time", model + effect, inputs)
    except UnknownSignal as error:
        return error.signal
    return ""


def constants_of(model: Model, wanted: Candidates | None = None) -> tuple[str, ...]:
    """The fixed parameters of a model to try: all with the catalogue, else those that are named.

    Example:
        >>> constants_of(dft.Vessel()), constants_of(dft.Vessel(), "wind")
        (('lever_arm',), ())
    """
    names = {candidate for candidate in _several(wanted) if isinstance(candidate, str)}
    return tuple(name for name in constants_in(model) if _EVERY in names or name in names)


def asks_for_all(wanted: Candidates | None) -> bool:
    """Whether the whole catalogue is among the candidates that were asked for.

    Example:
        >>> asks_for_all(None), asks_for_all(["all", "wind"]), asks_for_all("wind")
        (True, True, False)
    """
    return any(isinstance(word, str) and word == _EVERY for word in _several(wanted))


def _several(wanted: Candidates | None) -> Sequence[str | Effect | type[Effect]]:
    if wanted is None or isinstance(wanted, str | Effect | type):
        return (_EVERY if wanted is None else wanted,)
    return wanted if isinstance(wanted, Collection) else (wanted,)


def _asked_for(wanted: Candidates | None, model: Model) -> tuple[set[str], list[Effect]]:
    """The names of effects that were asked for one by one, and all effects in question."""
    effects, constants = catalogue(), constants_in(model)
    chosen: list[Effect] = []
    named: set[str] = set()
    for candidate in _several(wanted):
        if isinstance(candidate, str) and candidate in constants:
            continue
        if isinstance(candidate, str) and candidate == _EVERY:
            names = {effect.name for effect in chosen}
            every = (effect() for name, effect in effects.items() if name not in names)
            chosen += [placed for effect in every for placed in model.placements(effect)]
            continue
        for effect in _called(candidate, model):
            if effect.name not in named:  # it replaces its like in the catalogue
                named.add(effect.name)
                chosen = [other for other in chosen if other.name != effect.name] + [effect]
    return named, chosen


def _called(candidate: object, model: Model) -> Sequence[Effect]:
    """The effects that a name, a class or an object stands for: a name, at all of its places."""
    effects, constants = catalogue(), constants_in(model)
    if isinstance(candidate, str):
        member, _, word = candidate.rpartition(".")
        if word not in effects:
            near = nearest(candidate, constants)
            besides = f"; constants of the model are {listing(constants)}" if constants else ""
            raise InputError(
                f"candidates: the effect {candidate!r} is not known; "
                f"{nearby(word, effects)}{besides}{f' ({near})' if near else ''}.",
                "Correct the name ('diffthrust effects' lists all). An effect of your own is "
                "given as an object, on the command line as my_effect.py:MyEffect; 'all' "
                "stands for the catalogue.",
            )
        placed = [e for e in model.placements(effects[word]()) if not member or e.name == candidate]
        return placed or (effects[word](),)
    if isinstance(candidate, type) and issubclass(candidate, Effect):
        candidate = candidate()
    if not isinstance(candidate, Effect):
        raise InputError(
            f"candidates: expected names, effects or classes of effects, found {candidate!r}.",
            "Give for example 'command_deadband', or an effect of your own.",
        )
    return (candidate,)


# -- fixed parameters, each a candidate whose null is its value ------------------------------------


def constants_in(model: Model) -> tuple[str, ...]:
    """The fixed parameters of a model and of its effects, each a candidate by its name.

    The forms of an effect are fixed, too, but are tried with the effect.

    Example:
        >>> constants_in(dft.Vessel())
        ('lever_arm',)
    """
    return tuple(n for n, p in model.parameters.items() if p.fixed and not p.probes)


def of_effect(parameter: str, effect: str) -> bool:
    """Whether a parameter belongs to a candidate: an effect, or a fixed parameter of that name."""
    return effect in (parameter, parameter.rpartition(".")[0])


def with_candidates(
    model: Model,
    effects: Iterable[str],
    candidates: Mapping[str, Effect],
    like: Model | None = None,
) -> Model:
    """A model with some candidates: effects are added, fixed parameters are freed.

    An effect that may differ by log does so as it does in the model ``like``, if it is there.
    """
    freed = [n for n in effects if n not in candidates]
    added = {n: candidates[n] for n in effects if n in candidates}
    for effect in () if like is None else like.effects:
        if effect.name in added:
            added[effect.name] = added[effect.name].differing(effect.differs)
    return model.free(*freed) + list(added.values())


# -- ports, and what each drives -------------------------------------------------------------------


@dataclass(frozen=True)
class DrivingPort:
    """One port at which an unknown signal is tried.

    Args:
        port: the port.
        state: the state whose rate it drives, or ``None``.
        output: the measured output that it drives without a state between, or ``None``.
    """

    port: str
    state: str | None
    output: str | None

    @property
    def target(self) -> str:
        """What it drives: a state or an output."""
        return self.state or self.output or ""


def words_and_unit(model: Model, port: str) -> tuple[str, str]:
    """The signal at a port in words, and its unit, with which the description of the port ends."""
    parts = re.fullmatch(r"(.*?) *\[([^]]*)\]", model.ports[port], re.DOTALL)
    return (parts[1], parts[2]) if parts else (model.ports[port], "")


def unseen_at(model: Model, record: Record, channels: Collection[str]) -> set[str]:
    """Ports and inputs through which nothing reaches a measured channel.

    Where a state is prescribed by the log, what would drive it drives nothing.
    """
    rates, outputs = slopes_at(model, record)
    observed = [rates[n] for n in model.states if n not in record.inputs]
    observed += [outputs[n] for n in outputs if n in channels and n not in record.inputs]
    names = [(1, port) for port in model.ports]
    names += [(2, name) for name in record.inputs_for(model) if name not in model.states]
    return {name for index, name in names if all(slopes[index][name] == 0 for slopes in observed)}


def places_of(model: Model, record: Record, channels: Sequence[str]) -> tuple[DrivingPort, ...]:
    """One port for every state that a port drives, and one for every measured output that one does.

    Nothing drives a state that the log prescribes. Of several ports that drive the same, the last
    one is taken: the sum of all that acts there.
    """
    rates, outputs = slopes_at(model, record)
    places: list[DrivingPort] = []
    for state in model.states:
        if state in record.inputs:
            continue
        pushing = [p for p in model.ports if state in rates and rates[state][1][p] != 0]
        if pushing:
            # a port that drives no other state as well, if there is one: it is nearest to the state
            single = [p for p in pushing if sum(bool(r[1][p] != 0) for r in rates.values()) == 1]
            places.append(DrivingPort((single or pushing)[-1], state, None))
    taken = {place.port for place in places}
    for output in outputs:
        pushing = [p for p in model.ports if outputs[output][1][p] != 0 and p not in taken]
        if pushing and output in channels:
            places.append(DrivingPort(pushing[-1], None, output))
    return tuple(places)


def slopes_along(
    model: Model, series: Mapping[str, np.ndarray], place: DrivingPort
) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of what a place drives by its state and by its port, at every sample, ``(T,)``.

    What it drives is the rate of its state; or an output, whose derivative by a state is zero.
    """
    signals = {name: jnp.asarray(padded(value), float) for name, value in series.items()}
    state, still = signals.get(place.state or "", jnp.zeros(())), jnp.zeros_like(signals["time"])

    def driven(x: Array, push: Array) -> Array:
        s = Signals({**signals, place.state: x} if place.state else signals)
        rates, outputs = equations_of(model, s, Reading(model.effects, s, {place.port: push}))
        value = plain_rate((rates if place.state else outputs)[place.target])
        return jnp.broadcast_to(value, still.shape)

    unit, zeros = jnp.ones_like(state), jnp.zeros_like(state)
    _, by_state = jax.jvp(driven, (state, still), (unit, jnp.zeros_like(still)))
    _, by_port = jax.jvp(driven, (state, still), (zeros, jnp.ones_like(still)))
    count = series["time"].size
    return np.asarray(by_state if place.state else still)[:count], np.asarray(by_port)[:count]


def place_words(model: Model, port: str) -> str:
    """A port in words: its name, and what the signal there is."""
    if port in model.ports:
        return f"the port '{port}' ({words_and_unit(model, port)[0]})"
    if port in model.outputs:
        return f"the measured {port} (its sensor)"
    return f"the recorded {port}"

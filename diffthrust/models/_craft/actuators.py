"""The actuators of a craft: the numbers that they share, the effects on them, how they push."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import jax.numpy as jnp

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust._support.validation import check_known
from diffthrust._support.words import joined, percent
from diffthrust.models._base.component import Mounted
from diffthrust.models._base.effect import Effect
from diffthrust.models._base.model import Model
from diffthrust.models._base.parameter import Parameter
from diffthrust.models._base.signals import Signal, Signals
from diffthrust.models._craft.placed import Placed, lifted, place_parameters
from diffthrust.models._craft.six import Triple, cross, dot, lessened, scaled, times

TOLD = ("inflow", "crossflow")
"""What the craft works out for each actuator: the speed of the water past it, along its axis in the
direction in which it pushes the craft, and across [m/s]."""
PUSH = "push"
"""The port of an actuator's force on the craft, which is not the net ``force`` of a body: an effect
on that, such as buoyancy, acts on no thruster."""
PUSH_WORDS = "force of the actuator along its axis [N]"


class Actuators(dict[str, Mounted[Model]]):
    """Actuators without effects at their places, by name; a group has the numbers of its first."""

    def __init__(
        self, mounted: Mapping[str, Mounted[Model]], share: Sequence[Sequence[str]]
    ) -> None:
        super().__init__(mounted)
        self.share = _groups_of(mounted, share)

    def group_of(self, name: str) -> tuple[str, ...]:
        """Those with the numbers of one."""
        return next((group for group in self.share if name in group), (name,))

    def owner(self, name: str) -> str:
        """The one after which the numbers of one are called."""
        return self.group_of(name)[0]

    def groups(self) -> tuple[tuple[str, ...], ...]:
        """All by their numbers: those that share them together, others alone."""
        return tuple(dict.fromkeys(self.group_of(name) for name in self))

    def parameters(self) -> dict[str, Parameter]:
        """Those of the models, once for each group, and of each its strength, place, reaction."""
        named: dict[str, Parameter] = {}
        for name, mounted in self.items():
            group = self.group_of(name)
            if name == group[0]:
                named |= _lifted(name, mounted.model)
            if len(group) > 1:
                named[f"{name}.strength"] = Parameter(
                    1.0, bounds=(None, None), fixed=True, size=1.0, doc="force beside its like"
                )
            named |= place_parameters(name, mounted.place)
            if mounted.reaction is not None:
                named[f"{name}.reaction"] = Parameter(
                    mounted.reaction, "m", fixed=True, size=0.02, doc="torque per thrust"
                )
        return named

    def alone(self, name: str, parameter: Callable[[str], Parameter]) -> Model:
        """The model of one by itself, with its numbers among the present ones of the craft."""
        check_known(name, self, "The craft has no actuator")
        model, owner = self[name].model, self.owner(name)
        named = {}
        for k, p in model._parameters.items():
            present = parameter(f"{owner}.{k}")
            named[k] = replace(present, unit=p.unit, pattern=p.pattern, probes=p.probes)
        return model._with_parameters(named)

    def commanded_in(
        self, unit: str, parameter: Callable[[str], Parameter]
    ) -> tuple[Actuators, dict[str, Parameter]]:
        """Those whose commands have a choice in another unit, and the craft's parameters then."""
        mounted = dict(self)
        changed: dict[str, Parameter] = {}
        for name, present in self.items():
            if not present.model.commands:
                continue
            mounted[name] = replace(present, model=present.model.commanded_in(unit))
            if name == self.owner(name):
                changed |= _lifted(name, self.alone(name, parameter).commanded_in(unit))
        return Actuators(mounted, self.share), changed

    def strength_words(self, name: str, fixed: float, wanted: float) -> str:
        """What it means that logs want another strength of one than that at which it is held."""
        if wanted < 0:
            return f"{name} pushes the other way: turn its direction, or the sign of its command"
        share = wanted / fixed - 1.0
        change = f"{percent(abs(share))} {'more' if share > 0 else 'less'}"
        group = [member for member in self.group_of(name) if member != name]
        return f"{name} gives {change} thrust than {group[0] if len(group) == 1 else 'the others'}"

    # -- effects on them ---------------------------------------------------------------------------

    def placed(self, effect: Effect, members: Sequence[str], craft: str) -> Effect:
        """An effect on some of one group; without members, on all of the group that has its ports.

        Where none has them it is returned as it is; ``craft`` is how messages call the craft.
        """
        for name in members:
            check_known(name, self, "The craft has no actuator")
        if members:
            if len({self.group_of(name) for name in members}) > 1:
                raise InputError(
                    f"{craft}: {listing(members)} do not share their numbers.",
                    f"Add the effect '{effect.name}' to each.",
                )
            return self._on(effect, members)
        places = self._taking(effect)
        places = [group for group in places if len(group) > 1] or places
        if len(places) > 1:
            raise InputError(
                f"{craft}: the effect '{effect.name}' can act on "
                f"{joined(' and '.join(group) for group in places)}, which do not share their "
                "numbers.",
                f'Say where: craft + ("{places[0][0]}", "{effect.name}").',
            )
        return self._on(effect, places[0]) if places else effect

    def placements(self, effect: Effect) -> Iterator[Effect]:
        """An effect on all of each group that has its ports, then on each one of a group."""
        groups = self._taking(effect)
        for group in groups:
            yield self._on(effect, group)
        for group in groups:
            if len(group) > 1:
                yield from (self._on(effect, (name,)) for name in group)

    def _taking(self, effect: Effect) -> list[tuple[str, ...]]:
        """The groups that have the ports of an effect."""
        return [group for group in self.groups() if self._takes(effect, group[0])]

    def _takes(self, effect: Effect, name: str) -> bool:
        model = self[name].model
        return all(port in {*model.ports, *model.channel_units, PUSH} for port in effect.ports)

    def _on(self, effect: Effect, members: Sequence[str]) -> Placed:
        """An effect on some of one group."""
        members = tuple(members)
        model = self[members[0]].model
        # what it has on a craft: the port of its force, and the water past it
        optional = {**dict.fromkeys(TOLD, "m/s"), **model.optional_inputs}
        on_craft = model._copy(ports={**model.ports, PUSH: PUSH_WORDS}, optional_inputs=optional)
        fitted = (on_craft + effect).effects[-1]
        sharing = [group for group in self.share if self._takes(effect, group[0])]
        if len(members) == 1:
            name = f"{members[0]}.{effect.name}"
        elif members == sharing[0] and len(sharing) == 1:
            name = effect.name
        else:
            between = "and" if len(members) == 2 else "to"
            name = f"{members[0]}_{between}_{members[-1]}.{effect.name}"
        return Placed(fitted, members, name, _signals(model), TOLD)


def past(s: Signals, velocity: Triple, pointing: Triple) -> Signals:
    """The signals of an actuator, with the water that moves past it where no log gives it."""
    axial = dot(velocity, pointing)
    across = lessened(velocity, scaled(axial, pointing))
    # the root has no derivative at rest: a micrometre per second stands in for it
    flow = {"inflow": axial, "crossflow": jnp.sqrt(dot(across, across) + 1e-12)}
    # 0.0 * time: what a body does not have is a plain number, and effects of a log read series
    return s.also({k: v + 0.0 * s["time"] for k, v in flow.items() if k not in s})


def wrench(
    pointing: Triple, thrust: Signal, side_thrust: Signal | None, reaction: Any
) -> tuple[Triple, Triple]:
    """Force and moment of an actuator, by its direction; ``None`` for what it does not have."""
    force = scaled(thrust, pointing)
    if side_thrust is not None:
        side = scaled(side_thrust, cross((0.0, 0.0, 1.0), pointing))
        force = (force[0] + side[0], force[1] + side[1], force[2])
    if reaction is None:
        return force, (0.0, 0.0, 0.0)
    return force, scaled(times(reaction, thrust), pointing)


def _signals(model: Model) -> frozenset[str]:
    """Names that belong to an actuator: its channels, states and ports."""
    return frozenset({*model.channel_units, *model.states, *model.ports, PUSH, *TOLD})


def _lifted(name: str, model: Model) -> dict[str, Parameter]:
    """The parameters of an actuator, as the craft has them."""
    signals = _signals(model)
    return {f"{name}.{k}": lifted(p, name, signals) for k, p in model._parameters.items()}


def _groups_of(
    mounted: Mapping[str, Mounted[Model]], share: Sequence[Sequence[str]]
) -> tuple[tuple[str, ...], ...]:
    """The groups of those that share their numbers, each of more than one of equal models."""
    groups = tuple(tuple(group) for group in share)
    seen: set[str] = set()
    for group in groups:
        for name in group:
            if name not in mounted or name in seen:
                problem = "is in two groups" if name in seen else "is no actuator"
                raise InputError(
                    f"share: {name!r} {problem}; there are {listing(mounted)}.",
                    'Name each once: share=[("port", "starboard")].',
                )
            seen.add(name)
        for name in group:
            first, model = (mounted[member].model for member in (group[0], name))
            if model.structure != first.structure:
                raise InputError(
                    f"share: expected one model for {listing(group)}, found {first} and {model}.",
                    "Share numbers among actuators of one model only.",
                )
    return tuple(group for group in groups if len(group) > 1)
